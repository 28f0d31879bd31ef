"""Where the vehicle believes to have been, moment by moment."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from typing import TypeVar

from bench.contracts import Origin
from bench.geodesy import wrapped as wrapped_deg
from bench.values import value_class

# Samples: over six seconds at 10 Hz, because detections come late.
MAX_SAMPLES = 64
# How far beyond the latest sample motion is carried on. Chosen, not measured.
AHEAD_S = 0.5


@value_class(frozen=True, slots=True)
class VehiclePose:
    """East/north in the map frame, height above home, attitude against NED (yaw clockwise from north)."""

    time_s: float
    east_m: float
    north_m: float
    height_m: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float


@value_class(frozen=True, slots=True)
class _Place:
    time_s: float
    east_m: float
    north_m: float
    height_m: float
    velocity_enu_mps: tuple[float, float, float]


@value_class(frozen=True, slots=True)
class _Turn:
    time_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float


S = TypeVar("S", _Place, _Turn)


class PoseHistory:
    """Positions and attitudes as they came, to be asked for any moment between them."""

    def __init__(self) -> None:
        self._places: deque[_Place] = deque(maxlen=MAX_SAMPLES)
        self._turns: deque[_Turn] = deque(maxlen=MAX_SAMPLES)

    def place(
        self,
        time_s: float,
        east_m: float,
        north_m: float,
        height_m: float,
        velocity_enu_mps: tuple[float, float, float],
    ) -> None:
        """Take in one position; one that is not newer than the last is dropped."""
        if not self._places or time_s > self._places[-1].time_s:
            self._places.append(_Place(time_s, east_m, north_m, height_m, velocity_enu_mps))

    def turn(self, time_s: float, roll_rad: float, pitch_rad: float, yaw_rad: float) -> None:
        """Take in one attitude, likewise."""
        if not self._turns or time_s > self._turns[-1].time_s:
            self._turns.append(_Turn(time_s, roll_rad, pitch_rad, yaw_rad))

    def latest(self) -> VehiclePose | None:
        """The newest position with the attitude of that moment."""
        return self.at(self._places[-1].time_s) if self._places else None

    @property
    def velocity_en_mps(self) -> tuple[float, float]:
        """Of the newest position, east and north."""
        return self._places[-1].velocity_enu_mps[:2] if self._places else (0.0, 0.0)

    def at(self, time_s: float) -> VehiclePose | None:
        """The pose at a moment, linear between samples; None where the history does not reach."""
        place, turn = self._place_at(time_s), self._turn_at(time_s)
        if place is None or turn is None:
            return None
        return VehiclePose(
            time_s, place.east_m, place.north_m, place.height_m, turn.roll_rad, turn.pitch_rad, turn.yaw_rad
        )

    def _place_at(self, time_s: float) -> _Place | None:
        if (around := _around(self._places, time_s)) is None:
            return None
        a, b, share = around
        # Beyond the last sample motion is carried on.
        beyond_s = max(time_s - b.time_s, 0.0)
        east_mps, north_mps, up_mps = b.velocity_enu_mps
        return _Place(
            time_s,
            a.east_m + share * (b.east_m - a.east_m) + east_mps * beyond_s,
            a.north_m + share * (b.north_m - a.north_m) + north_mps * beyond_s,
            a.height_m + share * (b.height_m - a.height_m) + up_mps * beyond_s,
            b.velocity_enu_mps,
        )

    def _turn_at(self, time_s: float) -> _Turn | None:
        if (around := _around(self._turns, time_s)) is None:
            return None
        a, b, share = around
        return _Turn(
            time_s,
            a.roll_rad + share * (b.roll_rad - a.roll_rad),
            a.pitch_rad + share * (b.pitch_rad - a.pitch_rad),
            a.yaw_rad + share * wrapped(b.yaw_rad - a.yaw_rad),
        )


def _around(samples: Sequence[S], time_s: float) -> tuple[S, S, float] | None:
    """The samples before and after a moment, and how far between them it is; one of them twice where it is at or beyond an
    end, None where the history does not reach.
    """
    if not samples or time_s < samples[0].time_s - 1e-6 or time_s > samples[-1].time_s + AHEAD_S:
        return None
    after = _first_since(samples, time_s - 1e-6)
    if after in (0, len(samples)):
        end = samples[0 if after == 0 else -1]
        return end, end, 0.0
    a, b = samples[after - 1], samples[after]
    return a, b, (time_s - a.time_s) / (b.time_s - a.time_s)


def _first_since(samples: Sequence[S], time_s: float) -> int:
    """Index of the first sample that is not before a moment; their number where there is none."""
    # Nearly every question is about the newest sample, several in each tick.
    if len(samples) > 1 and samples[-2].time_s < time_s <= samples[-1].time_s:
        return len(samples) - 1
    return bisect_left(samples, time_s, key=lambda sample: sample.time_s)


def wrapped(angle_rad: float) -> float:
    """The same direction in (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


def east_north_of(latitude_deg: float, longitude_deg: float, origin: Origin) -> tuple[float, float]:
    """East and north metres from the origin on the WGS84 ellipsoid, first order: a place 300 m north and 300 m east is
    2 cm off at 47 degrees of latitude and 18 cm at 85.

    Radii of curvature in the meridian and the prime vertical as in Torge, Geodesy, section 4.1.
    """
    flattening = 1.0 / 298.257223563
    eccentricity_2 = flattening * (2.0 - flattening)
    latitude_rad = math.radians(origin.latitude_deg)
    root = math.sqrt(1.0 - eccentricity_2 * math.sin(latitude_rad) ** 2)
    prime_m = 6378137.0 / root
    meridian_m = prime_m * (1.0 - eccentricity_2) / root**2
    east_m = (
        math.radians(wrapped_deg(longitude_deg - origin.longitude_deg))
        * (prime_m + origin.altitude_m)
        * math.cos(latitude_rad)
    )
    north_m = math.radians(latitude_deg - origin.latitude_deg) * (meridian_m + origin.altitude_m)
    return east_m, north_m
