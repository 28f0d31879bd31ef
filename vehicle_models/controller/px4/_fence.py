"""PX4's fence and rally points. What a breach looks like on the link was not observed; it is as its source has it."""

from __future__ import annotations

import math

from .._service import Result
from ..parameters._store import ParameterStore
from ..safety._failsafe_policy import Reaction
from ..safety._fence_policy import Breach, FenceLimits, FencePolicy
from ..telemetry._texts import CRITICAL
from ._failsafes import fence_reaction


class Px4Fence(FencePolicy):
    texts = {
        Breach.CEILING: (CRITICAL, "Geofence: exceeding maximum altitude above Home"),
        Breach.CIRCLE: (CRITICAL, "Geofence: exceeding maximum distance to Home"),
        Breach.POLYGON: (CRITICAL, "Geofence: approaching or outside geofence"),
    }
    recovery_text = over_text = None
    recovery_s = 0.0
    again_m = math.inf
    needs_one = True
    can_be_enabled = False
    enabling = None
    keeps_setpoints = False
    outside = (Result.ACCEPTED, ((CRITICAL, "Reposition is outside geofence"),))

    def limits(self, p: ParameterStore) -> FenceLimits:
        return FenceLimits(
            radius_m=p["GF_MAX_HOR_DIST"] if p["GF_MAX_HOR_DIST"] > 0.0 else None,
            ceiling_m=p["GF_MAX_VER_DIST"] if p["GF_MAX_VER_DIST"] > 0.0 else None,
            polygons=True,
            watched=int(p["GF_ACTION"]) != 0,
        )

    def reaction(self, breach: Breach, beyond_m: float, p: ParameterStore) -> Reaction:
        return fence_reaction(self.texts[breach], p)

    def rally_limit_m(self, p: ParameterStore) -> float:
        return math.inf

    def home_counts(self, p: ParameterStore) -> bool:
        return True

    def uses_rally(self, p: ParameterStore) -> bool:
        """RTL_TYPE 0: home or the nearest rally point."""
        return int(p["RTL_TYPE"]) == 0
