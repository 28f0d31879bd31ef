"""Numbers as MAVLink's integer fields hold them."""

from __future__ import annotations

import math


def heading_cdeg(yaw_rad: float) -> int:
    """0 to 35999 hundredths of a degree."""
    return round(math.degrees(yaw_rad) * 100.0) % 36000


def int16(value: float) -> int:
    """The nearest integer, within the bounds of 16 bits."""
    return round(value) if -32768.0 <= value <= 32767.0 else round(min(max(value, -32768.0), 32767.0))


def hundredths(value: float) -> int:
    return int16(value * 100.0)
