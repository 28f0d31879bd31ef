"""Places for every actor: seeded sampling, a CP-SAT solver, proofs of impossibility, and a judge."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.errors import PlacementInfeasible as PlacementInfeasible
from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._check import check_placement as check_placement
    from ._placement import PlacementUnsound as PlacementUnsound
    from ._placement import place as place

__getattr__ = lazy_names(__name__)
