"""What the X500 does not survive."""

from __future__ import annotations

import math

from .._jsbsim import VehicleMotion

_CRASH_MPS = 3.0
_CRASH_TILT_RAD = math.radians(70.0)
_NEAR_GROUND_M = 0.5
_TOUCH_M = 0.02


def has_crashed(motion: VehicleMotion, speed_before_mps: float) -> bool:
    """Whether it hits the ground at more than 3 m/s, or lies on its side near it; `speed_before_mps` is that of one step
    before.
    """
    if motion.up_m > _NEAR_GROUND_M:
        return False
    # The angle between the body's down axis and the vertical, from roll and pitch.
    tilt = math.acos(min(max(math.cos(motion.roll_rad) * math.cos(motion.pitch_rad), -1.0), 1.0))
    return tilt > _CRASH_TILT_RAD or (motion.up_m < _TOUCH_M and speed_before_mps > _CRASH_MPS)
