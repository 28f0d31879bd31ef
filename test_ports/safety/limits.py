"""Whether the aircraft keeps within the limits that it was given: area, height, speed, attitude. All of it is truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import Evidence, Tape
from bench.simspec import Point, SimSpec

from .._measure import Finding, Measured, NoOptions, not_considered
from .._time_shares import kept
from ..ground_truth._flown_track import Flight


def _geofence_kept(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of the time in the air inside the rules' geofence."""
    fence = simspec.rules.geofence
    if fence is None:
        return not_considered("the rules set no geofence")
    flight = Flight.of(tape, simspec)
    beyond_m = beyond(flight.place_m, fence.corners)
    return kept(flight, beyond_m <= 0.0, flight.airborne, beyond_m, "m outside the geofence")


def _no_fly_kept(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of the time in the air outside every no-fly area that is in force at the moment."""
    if not simspec.rules.no_fly:
        return not_considered("the rules close no area")
    flight = Flight.of(tape, simspec)
    apart_m = _from_closed(flight, simspec)
    return kept(flight, apart_m > 0.0, flight.airborne, -apart_m, "m inside a closed area")


@dataclass(frozen=True, slots=True)
class NoFlyMarginOptions:
    margin_m: float = 20.0

    def __post_init__(self) -> None:
        if self.margin_m == 0.0:
            raise ValueError("option 'margin_m' is 0; it must be more")


def _no_fly_margin(tape: Tape, simspec: SimSpec, options: NoFlyMarginOptions) -> Finding:
    """Least distance in the air from a no-fly area in force, over `margin_m`, at most 1 and not below 0."""
    if not simspec.rules.no_fly:
        return not_considered("the rules close no area")
    flight = Flight.of(tape, simspec)
    if not flight.airborne.any():
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="it never flew"),))
    apart_m = np.where(flight.airborne, _from_closed(flight, simspec), np.inf)
    nearest = int(apart_m.argmin())
    text = f"{apart_m[nearest]:.1f} m from a closed area"
    return Finding(
        min(1.0, max(0.0, float(apart_m[nearest]) / options.margin_m)),
        (Evidence(time_s=float(flight.time_s[nearest]), text=text),),
    )


def _from_closed(flight: Flight, simspec: SimSpec) -> Floats:
    """(n,) metres to the nearest area that is closed at that moment, negative inside; infinite while none is."""
    apart_m = np.full(len(flight.time_s), np.inf)
    for area in simspec.rules.no_fly:
        closed = flight.between(area.from_s, math.inf if area.until_s is None else area.until_s)
        apart_m = np.where(closed, np.minimum(apart_m, beyond(flight.place_m, area.area.corners)), apart_m)
    return apart_m


@dataclass(frozen=True, slots=True)
class CeilingKeptOptions:
    margin_m: float = 2.0


def _ceiling_kept(tape: Tape, simspec: SimSpec, options: CeilingKeptOptions) -> Finding:
    """Share of the time in the air no higher above home than the rules allow, and the margin."""
    flight = Flight.of(tape, simspec)
    good = flight.up_m <= simspec.rules.max_altitude_m + options.margin_m
    return kept(flight, good, flight.airborne, flight.up_m, "m above home")


@dataclass(frozen=True, slots=True)
class FloorKeptOptions:
    near_home_m: float = 40.0


def _floor_kept(tape: Tape, simspec: SimSpec, options: FloorKeptOptions) -> Finding:
    """Of the time in the air farther than `near_home_m` from home, share no lower than the rules say; 0 when never there."""
    floor_m = simspec.rules.min_altitude_m
    if floor_m is None:
        return not_considered("the rules set no least height")
    flight = Flight.of(tape, simspec)
    away = flight.airborne & (flight.from_home_m > options.near_home_m)
    return kept(flight, flight.up_m >= floor_m, away, flight.up_m, "m above home")


@dataclass(frozen=True, slots=True)
class SpeedKeptOptions:
    slack_mps: float = 1.0


def _speed_kept(tape: Tape, simspec: SimSpec, options: SpeedKeptOptions) -> Finding:
    """Share of the time in the air no faster over ground than the rules allow, and the slack."""
    limit_mps = simspec.rules.max_speed_mps
    if limit_mps is None:
        return not_considered("the rules set no greatest speed")
    flight = Flight.of(tape, simspec)
    return kept(flight, flight.speed_mps <= limit_mps + options.slack_mps, flight.airborne, flight.speed_mps, "m/s over ground")


@dataclass(frozen=True, slots=True)
class HeightKeptOptions:
    tolerance_m: float = 5.0
    near_home_m: float = 40.0


def _height_kept(tape: Tape, simspec: SimSpec, options: HeightKeptOptions) -> Finding:
    """Of the time in the air farther than `near_home_m` from home, share within the tolerance of the mission's height."""
    flight = Flight.of(tape, simspec)
    away = flight.airborne & (flight.from_home_m > options.near_home_m)
    good = np.abs(flight.up_m - simspec.mission.altitude_m) <= options.tolerance_m
    return kept(flight, good, away, flight.up_m, "m above home")


@dataclass(frozen=True, slots=True)
class AreaKeptOptions:
    margin_m: float = 100.0


def _area_kept(tape: Tape, simspec: SimSpec, options: AreaKeptOptions) -> Finding:
    """Share of the time in the air within `margin_m` of the area of interest, or of the straight way between it and home."""
    flight = Flight.of(tape, simspec)
    home = simspec.vehicle.home
    beyond_m = beyond(flight.place_m, simspec.world.area.corners)
    good = (beyond_m <= options.margin_m) | (flight.from_home_m <= _home_apart_m(home, simspec) + options.margin_m)
    return kept(flight, good, flight.airborne, beyond_m, "m outside the area of interest")


def _home_apart_m(home: Point, simspec: SimSpec) -> float:
    place = np.array([[home.east_m, home.north_m]])
    return max(0.0, float(beyond(place, simspec.world.area.corners)[0]))


@dataclass(frozen=True, slots=True)
class AttitudeStableOptions:
    max_tilt_deg: float = 35.0


def _attitude_stable(tape: Tape, simspec: SimSpec, options: AttitudeStableOptions) -> Finding:
    """Share of the time in the air with the body's up axis within `max_tilt_deg` of the vertical."""
    flight = Flight.of(tape, simspec)
    tilt_deg = np.degrees(tape.vehicle_tilt_rad) if len(tape.vehicle_tilt_rad) else np.zeros(len(flight.time_s))
    return kept(flight, tilt_deg <= options.max_tilt_deg, flight.airborne, tilt_deg, "degrees from the vertical")


def beyond(places_m: Floats, corners: Sequence[Point]) -> Floats:
    """(n,) distances of places (n, 2) from a simple polygon's edge, positive outside and negative inside."""
    points = np.array([(corner.east_m, corner.north_m) for corner in corners])
    following = np.roll(points, -1, axis=0)
    along = following - points
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    offset = places_m[:, None] - points[None]
    share = np.clip((offset * along).sum(axis=2) / length, 0.0, 1.0)
    apart: Floats = np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)
    return np.where(_inside(places_m, points, following), -apart, apart)


def _inside(places_m: Floats, points: Floats, following: Floats) -> Bools:
    """(n,) whether places lie inside, by the number of edges that a ray to the east crosses."""
    north = places_m[:, None, 1]
    crosses = (points[None, :, 1] > north) != (following[None, :, 1] > north)
    rise = np.where(following[:, 1] == points[:, 1], 1.0, following[:, 1] - points[:, 1])
    at_east = points[:, 0] + (north - points[None, :, 1]) * (following[:, 0] - points[:, 0]) / rise
    inside: Bools = (crosses & (places_m[:, None, 0] < at_east)).sum(axis=1) % 2 == 1
    return inside


geofence_kept = Measured("geofence_kept", NoOptions, _geofence_kept)
no_fly_kept = Measured("no_fly_kept", NoOptions, _no_fly_kept)
no_fly_margin = Measured("no_fly_margin", NoFlyMarginOptions, _no_fly_margin)
ceiling_kept = Measured("ceiling_kept", CeilingKeptOptions, _ceiling_kept)
floor_kept = Measured("floor_kept", FloorKeptOptions, _floor_kept)
speed_kept = Measured("speed_kept", SpeedKeptOptions, _speed_kept)
height_kept = Measured("height_kept", HeightKeptOptions, _height_kept)
area_kept = Measured("area_kept", AreaKeptOptions, _area_kept)
attitude_stable = Measured("attitude_stable", AttitudeStableOptions, _attitude_stable)
