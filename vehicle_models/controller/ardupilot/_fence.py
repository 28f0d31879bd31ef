"""ArduCopter's fence and rally points."""

from __future__ import annotations

import math

from .._flight import Behaviour
from .._service import Result
from ..parameters._store import ParameterStore
from ..safety._failsafe_policy import Reaction
from ..safety._fence_policy import Breach, FenceLimits, FencePolicy
from ..telemetry._texts import INFO, NOTICE

_CEILING, _CIRCLE, _POLYGON = 1, 2, 4  # FENCE_TYPE
# FENCE_ACTION: report, return, land, smart return, brake, smart return or land.
_ACTIONS = {
    0: None,
    1: Behaviour.RETURN,
    2: Behaviour.LAND,
    3: Behaviour.RETURN,
    4: Behaviour.HOLD,
    5: Behaviour.RETURN,
}
_GIVES_UP_M = 100.0  # farther outside than this it lands, whatever was wanted


class ArduPilotFence(FencePolicy):
    texts = {
        Breach.CEILING: (NOTICE, "Max Alt fence breached"),
        Breach.CIRCLE: (NOTICE, "Circle fence breached"),
        Breach.POLYGON: (NOTICE, "Polygon fence breached"),
    }
    recovery_text = (INFO, "Manual recovery started")
    recovery_s = 10.0
    over_text = (NOTICE, "Fence breach cleared")
    again_m = 20.0
    needs_one = False
    can_be_enabled = True
    enabling = "FENCE_ENABLE"
    keeps_setpoints = True
    outside = (Result.FAILED, ())

    def limits(self, p: ParameterStore) -> FenceLimits:
        kinds = int(p["FENCE_TYPE"])
        return FenceLimits(
            radius_m=max(p["FENCE_RADIUS"], 1.0) if kinds & _CIRCLE else None,
            ceiling_m=p["FENCE_ALT_MAX"] if kinds & _CEILING else None,
            polygons=bool(kinds & _POLYGON),
            watched=True,
            ceiling_margin_m=max(p["FENCE_MARGIN"], 0.0),
        )

    def reaction(self, breach: Breach, beyond_m: float, p: ParameterStore) -> Reaction:
        """A breach is no failsafe: the heartbeat stays as it is."""
        action = _ACTIONS.get(int(p["FENCE_ACTION"]), Behaviour.RETURN)
        if action and beyond_m > _GIVES_UP_M:
            action = Behaviour.LAND
        return Reaction(action, texts=(self.texts[breach],), shows=False)

    def rally_limit_m(self, p: ParameterStore) -> float:
        return p["RALLY_LIMIT_KM"] * 1000.0 if p["RALLY_LIMIT_KM"] > 0.0 else math.inf

    def home_counts(self, p: ParameterStore) -> bool:
        return bool(p["RALLY_INCL_HOME"])

    def uses_rally(self, p: ParameterStore) -> bool:
        return True
