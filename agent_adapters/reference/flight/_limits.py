"""How high and how fast one mission is flown, by its order and the rules."""

from __future__ import annotations

from typing import Self

from bench.contracts import MissionOrder
from bench.values import value_class

from ._caution import SLOW_SHARE, Caution

# Kept from the heights that the rules state: gusts and the autopilot's control error. Chosen, not measured.
HEIGHT_RULE_MARGIN_M = 1.5

# Kept from the speed that the rules state, for the same reason. Chosen, not measured.
SPEED_RULE_MARGIN_MPS = 0.7


@value_class(frozen=True, slots=True)
class MissionLimits:
    """Height above home, cruise speed, and the speed with which the time to fly somewhere is reckoned."""

    height_m: float
    speed_mps: float
    pace_mps: float

    @classmethod
    def of(cls, order: MissionOrder, caution: Caution, *, speed_share: float = 1.0) -> Self:
        """The limits under an order, flown with that much care for people, and this share of the ordered speed."""
        ceiling_m = order.max_altitude_m - HEIGHT_RULE_MARGIN_M
        floor_m = 0.0 if order.min_altitude_m is None else order.min_altitude_m + HEIGHT_RULE_MARGIN_M
        height_m = max(min(order.altitude_m, order.max_altitude_m), floor_m)
        speed_mps = speed_share * order.speed_mps
        if order.max_speed_mps is not None:
            # Under a rule slower than twice the margin half of the allowed speed is flown: a margin alone
            # would stop it.
            speed_mps = min(
                speed_mps, max(order.max_speed_mps - SPEED_RULE_MARGIN_MPS, 0.5 * order.max_speed_mps)
            )
        # People may be anywhere on the way: time is reckoned with the speed that is flown near them.
        slow_mps = caution.slow_mps
        return cls(
            height_m=caution.height_m(height_m, max(ceiling_m, height_m)),
            speed_mps=speed_mps,
            pace_mps=speed_mps if slow_mps is None else min(speed_mps, SLOW_SHARE * slow_mps),
        )
