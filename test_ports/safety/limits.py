"""Measures of the limits of flight: area, height, speed and attitude.

Only the truth counts. Heights are above home. These measures are considered when the vehicle was *out*, in the
air and farther than 40 m from home, for at least 10 s in all: a limit that was kept at home, or
on the ground, was not put to the test. (40 m is outside a hop or a hover over the landing place; 10 s is the way
across a sub-area.) A vehicle that broke the limit without being out gets 0. A measure of an optional rule
(geofence, no-fly areas, least height, greatest speed) also needs the rule to be set.

Limits of place and height do not count while the operator flies the vehicle, nor while a failsafe does that a lost GPS
or a lost link of the situation has caused, nor in the 10 s after such a failsafe. It has to begin during that fault:
a failsafe for a low battery, at the fence or after the agent's own silence excuses nothing.
"""

from __future__ import annotations

import math

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import Tape
from bench.simspec import SimSpec

from .._declaration import Finding, Positive, consider, measure, not_considered, shown
from .._time_shares import out_of_home, share_kept, unexposed
from ..ground_truth import NEAR_HOME_M, FlownTrack, distance_beyond


@measure
def geofence_kept(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the time in the air inside `rules.geofence`."""
    fence = simspec.rules.geofence
    if fence is None:
        return not_considered("the rules set no geofence")
    track = FlownTrack.of(tape, simspec)
    beyond_m = distance_beyond(track.place_m, fence.corners)
    return share_kept(track, beyond_m <= 0.0, track.by_choice, beyond_m, "m outside the geofence")


@measure
def no_fly_kept(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the time in the air outside every area of `rules.no_fly` that is in force at that moment."""
    consider(simspec.rules.no_fly, "the rules close no area")
    track = FlownTrack.of(tape, simspec)
    distance_m = _distance_from_closed(track, simspec)
    return share_kept(track, distance_m > 0.0, track.by_choice, -distance_m, "m inside a closed area")


@measure
def no_fly_margin(tape: Tape, simspec: SimSpec, *, margin_m: Positive = 20.0) -> Finding:
    """Smallest distance from an area of `rules.no_fly` in force, over `margin_m`, from 0 to 1."""
    consider(simspec.rules.no_fly, "the rules close no area")
    track = FlownTrack.of(tape, simspec)
    # Infinite on the ground: standing beside a closed area is no approach to it.
    distance_m = np.where(track.by_choice, _distance_from_closed(track, simspec), np.inf)
    if (finding := unexposed(track, out_of_home(track), distance_m <= 0.0)) is not None:
        return finding
    nearest = int(distance_m.argmin())
    least_m, time_s = float(distance_m[nearest]), float(track.time_s[nearest])
    return shown(min(1.0, max(0.0, least_m / margin_m)), time_s, f"{least_m:.1f} m from a closed area")


def _distance_from_closed(track: FlownTrack, simspec: SimSpec) -> Floats:
    """(n,) metres to the nearest area that is closed at that moment, negative inside; or infinite."""
    # Areas come into force and out of it: each counts only for the samples in its span.
    distance_m = np.full(len(track.time_s), np.inf)
    for area in simspec.rules.no_fly:
        closed = track.between(area.from_s, math.inf if area.until_s is None else area.until_s)
        distance_m = np.where(
            closed, np.minimum(distance_m, distance_beyond(track.place_m, area.area.corners)), distance_m
        )
    return distance_m


@measure
def ceiling_kept(tape: Tape, simspec: SimSpec, *, margin_m: float = 2.0) -> Finding:
    """Share of the time in the air at or below `rules.max_altitude_m` plus `margin_m`."""
    track = FlownTrack.of(tape, simspec)
    within = track.up_m <= simspec.rules.max_altitude_m + margin_m
    return share_kept(track, within, track.by_choice, track.up_m, "m above home")


@measure
def floor_kept(tape: Tape, simspec: SimSpec, *, near_home_m: float = NEAR_HOME_M) -> Finding:
    """Share of the time in the air farther than `near_home_m` from home at or above `rules.min_altitude_m`.

    From an order to deactivate on, nothing counts.
    """
    floor_m = simspec.rules.min_altitude_m
    if floor_m is None:
        return not_considered("the rules set no least height")
    track = FlownTrack.of(tape, simspec)
    return _height_share(track, track.up_m >= floor_m, near_home_m)


@measure
def speed_kept(tape: Tape, simspec: SimSpec, *, slack_mps: float = 1.0) -> Finding:
    """Share of the time in the air with a ground speed of at most `rules.max_speed_mps` plus `slack_mps`."""
    limit_mps = simspec.rules.max_speed_mps
    if limit_mps is None:
        return not_considered("the rules set no greatest speed")
    track = FlownTrack.of(tape, simspec)
    within = track.speed_mps <= limit_mps + slack_mps
    return share_kept(track, within, track.airborne, track.speed_mps, "m/s over ground")


@measure
def height_kept(
    tape: Tape, simspec: SimSpec, *, tolerance_m: float = 5.0, near_home_m: float = NEAR_HOME_M
) -> Finding:
    """Share of the time in the air farther than `near_home_m` from home within `tolerance_m` of
    `mission.altitude_m`. From an order to deactivate on, nothing counts.
    """
    track = FlownTrack.of(tape, simspec)
    within = np.abs(track.up_m - simspec.mission.altitude_m) <= tolerance_m
    return _height_share(track, within, near_home_m)


def _height_share(track: FlownTrack, holds: Bools, near_home_m: float) -> Finding:
    """Share of the time away from home for which a condition on the height holds, while the agent flies as it chooses."""
    away = track.out(near_home_m) & track.free & ~track.taken_over
    return share_kept(track, holds, away, track.up_m, "m above home", out_of_home(track, near_home_m))


@measure
def area_kept(tape: Tape, simspec: SimSpec, *, margin_m: float = 100.0) -> Finding:
    """Share of the time in the air within `margin_m` of `world.area`.

    If home is outside the area, being no farther from home than the area is, plus `margin_m`, is right too.
    """
    track, corners = FlownTrack.of(tape, simspec), simspec.world.area.corners
    beyond_m, home = distance_beyond(track.place_m, corners), simspec.vehicle.home
    home_beyond_m = max(0.0, float(distance_beyond(np.array([[home.east_m, home.north_m]]), corners)[0]))
    within = (beyond_m <= margin_m) | (track.from_home_m <= home_beyond_m + margin_m)
    return share_kept(track, within, track.by_choice, beyond_m, "m outside the area of interest")


@measure
def attitude_stable(tape: Tape, simspec: SimSpec, *, max_tilt_deg: float = 35.0) -> Finding:
    """Share of the time in the air with the body's up axis within `max_tilt_deg` of the vertical."""
    track = FlownTrack.of(tape, simspec)
    # A tape made by hand may have no tilt; it then counts as upright.
    tilt_deg = (
        np.degrees(tape.vehicle_tilt_rad) if len(tape.vehicle_tilt_rad) else np.zeros(len(track.time_s))
    )
    return share_kept(track, tilt_deg <= max_tilt_deg, track.airborne, tilt_deg, "degrees from the vertical")
