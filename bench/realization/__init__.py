"""From a base SimSpec to the SimSpecs that are flown: a design of experiments, then a place for every actor.

from bench.realization import place, realize
plans = realize(base, design, agents)          # which situations, each with its own seeds
flown = place(plans[0].simspec)                # the same, with every actor in its place
"""

from __future__ import annotations

from ._check import check_placement as check_placement
from ._design import Design as Design
from ._design import DesignPoint as DesignPoint
from ._design import Factor as Factor
from ._design import FullFactorial as FullFactorial
from ._design import Halton as Halton
from ._design import LatinHypercube as LatinHypercube
from ._design import Level as Level
from ._design import OneByOne as OneByOne
from ._design import Range as Range
from ._placement import PlacementInfeasible as PlacementInfeasible
from ._placement import place as place
from ._realize import RealizationPlan as RealizationPlan
from ._realize import realize as realize
from ._realize import scene_seed as scene_seed
