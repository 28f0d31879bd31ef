"""From a base SimSpec to the SimSpecs that are flown: a design of experiments, then a place for every actor.

from bench.realization import place, realize
plans = realize(base, design, agents)          # which situations, each with its own seeds
flown = place(plans[0].simspec)                # the same, with every actor in its place
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._number_levels import with_number_levels as with_number_levels
    from ._realize import Bases as Bases
    from ._realize import Rating as Rating
    from ._realize import RealizationPlan as RealizationPlan
    from ._realize import design_pairs as design_pairs
    from ._realize import realize as realize
    from ._realize import situations as situations
    from .design import BASE as BASE
    from .design import INACTIVE as INACTIVE
    from .design import Design as Design
    from .design import DesignFactor as DesignFactor
    from .design import DesignPoint as DesignPoint
    from .design import DesignQuality as DesignQuality
    from .design import FactorLevel as FactorLevel
    from .design import FactorRange as FactorRange
    from .design import FullFactorial as FullFactorial
    from .design import Method as Method
    from .design import Sobol as Sobol
    from .design import design_quality as design_quality
    from .placement import PlacementInfeasible as PlacementInfeasible
    from .placement import PlacementUnsound as PlacementUnsound
    from .placement import check_placement as check_placement
    from .placement import place as place

__getattr__ = lazy_names(__name__)
