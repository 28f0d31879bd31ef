"""The attitude of the body as quaternion (w, x, y, z of body FRD against north-east-down), and turned vectors."""

from __future__ import annotations

import math

from bench.contracts import Vector

from ..state._flight_state import FlightState

Quaternion = tuple[float, float, float, float]


def quaternion(flight: FlightState) -> Quaternion:
    return attitude_quaternion(flight.roll_rad, flight.pitch_rad, flight.yaw_rad)


def attitude_quaternion(roll: float, pitch: float, yaw: float) -> Quaternion:
    """From angles in radians."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def turned_to_body(attitude: Quaternion, ned: Vector) -> Vector:
    """A vector of north, east, down in the axes of the body."""
    w, x, y, z = attitude
    n, e, d = ned
    return (
        (1 - 2 * (y * y + z * z)) * n + 2 * (x * y + w * z) * e + 2 * (x * z - w * y) * d,
        2 * (x * y - w * z) * n + (1 - 2 * (x * x + z * z)) * e + 2 * (y * z + w * x) * d,
        2 * (x * z + w * y) * n + 2 * (y * z - w * x) * e + (1 - 2 * (x * x + y * y)) * d,
    )


def turned_to_ned(attitude: Quaternion, body: Vector) -> Vector:
    """A vector of forward, right, down in north, east, down."""
    w, x, y, z = attitude
    return turned_to_body((w, -x, -y, -z), body)


class AttitudeCache:
    """The present attitude; several messages of a step need it."""

    def __init__(self, flight: FlightState) -> None:
        self._flight = flight
        self._time_ns = -1
        self._attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def now(self) -> Quaternion:
        if self._time_ns != self._flight.time_ns:
            self._time_ns, self._attitude = self._flight.time_ns, quaternion(self._flight)
        return self._attitude
