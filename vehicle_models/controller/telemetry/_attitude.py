"""The attitude of the body as quaternion and rotation, worked out once for all messages of a step."""

from __future__ import annotations

import math

from bench.contracts import Vector

from ..state._flight_state import FlightState


def quaternion(flight: FlightState) -> tuple[float, float, float, float]:
    """w, x, y, z of the body (FRD) against north-east-down."""
    return attitude_quaternion(flight.roll_rad, flight.pitch_rad, flight.yaw_rad)


def attitude_quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """w, x, y, z of an attitude against north-east-down, radians."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


class BodyAttitude:
    """The attitude of the body against north-east-down at one moment, `time_ns`; `quaternion` is w, x, y,
    z.
    """

    __slots__ = ("_rows", "quaternion", "time_ns")

    def __init__(self, flight: FlightState) -> None:
        self.time_ns = flight.time_ns
        self.quaternion = w, x, y, z = quaternion(flight)
        self._rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
            (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
            (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
        )

    def rotated(self, north: float, east: float, down: float) -> Vector:
        """A north-east-down vector in the body's frame."""
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        return (
            a * north + b * east + c * down,
            d * north + e * east + f * down,
            g * north + h * east + i * down,
        )

    def to_ned(self, forward: float, right: float, down: float) -> Vector:
        """A vector in the body's frame as north, east, down."""
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        return (
            a * forward + d * right + g * down,
            b * forward + e * right + h * down,
            c * forward + f * right + i * down,
        )


class AttitudeCache:
    """The present attitude; several messages of a step need it."""

    def __init__(self, flight: FlightState) -> None:
        self._flight = flight
        self._body = BodyAttitude(flight)

    def now(self) -> BodyAttitude:
        if self._body.time_ns != self._flight.time_ns:
            self._body = BodyAttitude(self._flight)
        return self._body
