"""From a base SimSpec to the SimSpecs that are flown: a design of experiments, then a place for every actor.

from bench.realization import place, realize
plans = realize(base, design, agents)          # which situations, each with its own seeds
flown = place(plans[0].simspec)                # the same, with every actor in its place
"""

from __future__ import annotations

from ._check import check_placement as check_placement
from ._clash import PlacementInfeasible as PlacementInfeasible
from ._covering import CoveringArray as CoveringArray
from ._design import Design as Design
from ._design import DesignPoint as DesignPoint
from ._design import Method as Method
from ._factorial import FullFactorial as FullFactorial
from ._factorial import OneByOne as OneByOne
from ._factors import INACTIVE as INACTIVE
from ._factors import Factor as Factor
from ._factors import Level as Level
from ._factors import Range as Range
from ._nested import Nested as Nested
from ._orthogonal import NearlyOrthogonalLatinHypercube as NearlyOrthogonalLatinHypercube
from ._orthogonal import OrthogonalLatinHypercube as OrthogonalLatinHypercube
from ._placement import PlacementUnsound as PlacementUnsound
from ._placement import place as place
from ._quality import DesignQuality as DesignQuality
from ._quality import design_quality as design_quality
from ._realize import Rating as Rating
from ._realize import RealizationPlan as RealizationPlan
from ._realize import design_pairs as design_pairs
from ._realize import realize as realize
from ._realize import scene_seed as scene_seed
from ._realize import situations as situations
from ._sampled import Halton as Halton
from ._sampled import LatinHypercube as LatinHypercube
from ._sampled import Sobol as Sobol
from ._screening import DefinitiveScreening as DefinitiveScreening
from ._screening import FractionalFactorial as FractionalFactorial
from ._screening import PlackettBurman as PlackettBurman
from ._stratified import Stratified as Stratified
