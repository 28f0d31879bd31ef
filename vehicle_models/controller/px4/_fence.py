"""PX4's fence and rally points. What a breach looks like on the link was not observed; the texts are the firmware's own."""

from __future__ import annotations

from .._board import Result
from .._fence_policy import Breach, FenceLimits, FencePolicy
from .._flight import Behaviour
from .._parameters import ParameterStore
from .._texts import CRITICAL, ERROR

# GF_ACTION: warning, hold, return, terminate (here: land), land. FOLLOW stands for "nothing but a warning".
_ACTIONS = {1: Behaviour.FOLLOW, 2: Behaviour.HOLD, 3: Behaviour.RETURN, 4: Behaviour.LAND, 5: Behaviour.LAND}
_VIOLATED = (CRITICAL, "Geofence violated")


class Px4Fence(FencePolicy):
    texts = dict.fromkeys(Breach, _VIOLATED)
    action_text = (ERROR, "Failsafe activated")
    marks_failsafe = True
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
            action=_ACTIONS.get(int(p["GF_ACTION"])),
        )

    def rally_limit_m(self, p: ParameterStore) -> float:
        return float("inf")

    def home_counts(self, p: ParameterStore) -> bool:
        return True

    def uses_rally(self, p: ParameterStore) -> bool:
        """RTL_TYPE 0: home or the nearest rally point."""
        return int(p["RTL_TYPE"]) == 0
