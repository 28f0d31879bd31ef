"""Angles and directions of a pose in the map frame."""

from __future__ import annotations

import math

from bench.streams import Quaternion, Vector3


def heading_deg(turn: Quaternion) -> float:
    """Clockwise from north, 0 to 360, of a pose in the map frame."""
    ahead_east = 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z)
    ahead_north = 2.0 * (turn.x * turn.y + turn.w * turn.z)
    return math.degrees(math.atan2(ahead_east, ahead_north)) % 360.0


def tilt_deg(turn: Quaternion) -> float:
    """Angle between the vehicle's up axis and the vertical."""
    # By half the angle: the arc cosine would lose small angles to rounding.
    return math.degrees(2.0 * math.atan2(math.hypot(turn.x, turn.y), math.hypot(turn.z, turn.w)))


def rotated(turn: Quaternion, vector: Vector3) -> Vector3:
    """A vector of the body's axes in those of the map: v + 2w(u x v) + 2u x (u x v)."""
    cross_x = turn.y * vector.z - turn.z * vector.y
    cross_y = turn.z * vector.x - turn.x * vector.z
    cross_z = turn.x * vector.y - turn.y * vector.x
    return Vector3(
        vector.x + 2.0 * (turn.w * cross_x + turn.y * cross_z - turn.z * cross_y),
        vector.y + 2.0 * (turn.w * cross_y + turn.z * cross_x - turn.x * cross_z),
        vector.z + 2.0 * (turn.w * cross_z + turn.x * cross_y - turn.y * cross_x),
    )
