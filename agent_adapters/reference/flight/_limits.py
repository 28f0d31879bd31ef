"""How high and how fast one mission is flown, by its order and the rules, and how it comes down. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

from bench.contracts import MissionOrder
from bench.values import value_class

from ._caution import SLOW_SHARE, Caution

if TYPE_CHECKING:
    from bench.simspec import Mission, Rules

# Kept from the heights that the rules state: gusts and the autopilot's control error. Chosen, not measured.
HEIGHT_RULE_MARGIN_M = 1.5

# Kept from the speed that the rules state, for the same reason. Chosen, not measured.
SPEED_RULE_MARGIN_MPS = 0.7

# How PX4 brings a multicopter down with its default parameters: what the agent and its surrogate reckon with.
# MPC_Z_VEL_MAX_DN under setpoints, MPC_Z_V_AUTO_DN in a landing.
DESCENT_MPS = 1.5
# MPC_LAND_ALT1, MPC_LAND_ALT2 and MPC_LAND_SPEED: from the first height the sink rate falls in proportion to height,
# until below the second it is the third.
LAND_SLOWER_BELOW_M, LAND_SLOWEST_BELOW_M, LAND_MPS = 10.0, 5.0, 0.7
# From the touch to disarmed: 1.1 s until PX4 detects the landing (docs/vehicle.md), then COM_DISARM_LAND.
DISARM_S = 1.1 + 2.0


@value_class(frozen=True, slots=True)
class MissionLimits:
    """Height above home, cruise speed, and the speed with which the time to fly somewhere is reckoned."""

    height_m: float
    speed_mps: float
    pace_mps: float

    @classmethod
    def of(
        cls,
        asked: MissionOrder | Mission,
        rules: MissionOrder | Rules,
        caution: Caution,
        speed_share: float = 1.0,
    ) -> Self:
        """The limits of what is asked under these rules, with that much care for people and share of the speed."""
        ceiling_m = rules.max_altitude_m - HEIGHT_RULE_MARGIN_M
        floor_m = 0.0 if rules.min_altitude_m is None else rules.min_altitude_m + HEIGHT_RULE_MARGIN_M
        height_m = max(min(asked.altitude_m, rules.max_altitude_m), floor_m)
        speed_mps = speed_share * asked.speed_mps
        if rules.max_speed_mps is not None:
            # Under a rule slower than twice the margin half of the allowed speed is flown: a margin alone
            # would stop it.
            slower_mps = max(rules.max_speed_mps - SPEED_RULE_MARGIN_MPS, 0.5 * rules.max_speed_mps)
            speed_mps = min(speed_mps, slower_mps)
        # People may be anywhere on the way: time is reckoned with the speed that is flown near them.
        slow_mps = caution.slow_mps
        return cls(
            height_m=caution.height_m(height_m, max(ceiling_m, height_m)),
            speed_mps=speed_mps,
            pace_mps=speed_mps if slow_mps is None else min(speed_mps, SLOW_SHARE * slow_mps),
        )


def landing_s(height_m: float) -> float:
    """Seconds from a height, where a landing begins at full descent, to disarmed on the ground."""
    fast_m = max(0.0, height_m - LAND_SLOWER_BELOW_M)
    slowest_m = min(height_m, LAND_SLOWEST_BELOW_M)
    # The sink rate is a line over height between the two: the time is the integral of its inverse.
    slope_per_s = (DESCENT_MPS - LAND_MPS) / (LAND_SLOWER_BELOW_M - LAND_SLOWEST_BELOW_M)
    slower_m = min(height_m, LAND_SLOWER_BELOW_M) - slowest_m
    slower_s = math.log(1.0 + slope_per_s * slower_m / LAND_MPS) / slope_per_s
    return fast_m / DESCENT_MPS + slower_s + slowest_m / LAND_MPS + DISARM_S
