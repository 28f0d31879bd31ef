"""How PX4 brings a multicopter down with its default parameters: what the agent and its surrogate reckon with.

Pure.
"""

from __future__ import annotations

import math

# MPC_Z_VEL_MAX_DN under setpoints, MPC_Z_V_AUTO_DN in a landing.
DESCENT_MPS = 1.5
# MPC_LAND_ALT1, MPC_LAND_ALT2 and MPC_LAND_SPEED: from the first height the sink rate falls in proportion to height,
# until below the second it is the third.
LAND_SLOWER_BELOW_M, LAND_SLOWEST_BELOW_M, LAND_MPS = 10.0, 5.0, 0.7
# From the touch to disarmed: 1.1 s until PX4 detects the landing (docs/vehicle.md), then COM_DISARM_LAND.
DISARM_S = 1.1 + 2.0


def landing_s(height_m: float) -> float:
    """Seconds from a height, where a landing begins at full descent, to disarmed on the ground."""
    fast_m = max(0.0, height_m - LAND_SLOWER_BELOW_M)
    slowest_m = min(height_m, LAND_SLOWEST_BELOW_M)
    # The sink rate is a line over height between the two: the time is the integral of its inverse.
    slope_per_s = (DESCENT_MPS - LAND_MPS) / (LAND_SLOWER_BELOW_M - LAND_SLOWEST_BELOW_M)
    slower_m = min(height_m, LAND_SLOWER_BELOW_M) - slowest_m
    slower_s = math.log(1.0 + slope_per_s * slower_m / LAND_MPS) / slope_per_s
    return fast_m / DESCENT_MPS + slower_s + slowest_m / LAND_MPS + DISARM_S
