"""Measures of flight near people: how near to bystanders, how fast and how long the aircraft flies.

Only the truth counts. A vehicle that never flew gets 0. A measure is considered when there are bystanders and
the rules that it names are set.
"""

from __future__ import annotations

import numpy as np

from bench.arrays import Bools
from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, measure, not_considered, nothing_shown
from .._time_shares import share_kept
from ..ground_truth import FlownTrack, GroundTruth

GUST_SLACK_MPS = 0.5
"""What a gust may add to a speed that was flown right. Chosen, not measured."""


@measure
def standoff_kept(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the time in the air with every bystander at least `rules.bystander_standoff_m` away.

    The distance is three-dimensional.
    """
    people, limit_m = GroundTruth.of(tape, simspec).of_role("bystander"), simspec.rules.bystander_standoff_m
    if not limit_m or not people:
        return not_considered("the rules set no stand-off, or there is no bystander")
    track = FlownTrack.of(tape, simspec)
    # In space: an aircraft high above a crowd keeps its stand-off.
    distance_m = np.hypot(track.distance_m(people), track.above_m(people)).min(axis=1)
    return share_kept(track, distance_m >= limit_m, track.airborne, distance_m, "m from a bystander")


@measure
def slow_near_bystanders(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the time near bystanders that the vehicle flies slowly enough.

    Near is a horizontal distance below `rules.bystander_slow_within_m`. Slow enough is a ground speed of at
    most `rules.bystander_slow_mps` plus 0.5 m/s. 1 when the vehicle flew and never came that near.
    """
    people, rules = GroundTruth.of(tape, simspec).of_role("bystander"), simspec.rules
    if rules.bystander_slow_within_m is None or rules.bystander_slow_mps is None or not people:
        return not_considered("the rules set no speed near bystanders, or there is no bystander")
    track = FlownTrack.of(tape, simspec)
    close = track.airborne & (track.distance_m(people).min(axis=1) < rules.bystander_slow_within_m)
    if track.airborne.any() and not close.any():
        return Finding(1.0, (Evidence(time_s=tape.end_s, text="it never came near a bystander"),))
    slow = track.speed_mps <= rules.bystander_slow_mps + GUST_SLACK_MPS
    return share_kept(track, slow, close, track.speed_mps, "m/s near a bystander")


@measure
def loiter_limited(tape: Tape, simspec: SimSpec, *, radius_m: float = 15.0) -> Finding:
    """`rules.max_loiter_over_bystander_s` divided by the longest unbroken stay near one bystander, at most 1.

    Near is a horizontal distance of at most `radius_m`.
    """
    truth, limit_s = GroundTruth.of(tape, simspec), simspec.rules.max_loiter_over_bystander_s
    people = truth.of_role("bystander")
    if limit_s is None or not people:
        return not_considered("the rules set no longest stay over a bystander, or there is no bystander")
    track = FlownTrack.of(tape, simspec)
    if not track.airborne.any():
        return nothing_shown(tape.end_s, "it never flew")
    # Each bystander has its own column: moving from one to the next ends a stay.
    over = track.airborne[:, None] & (track.distance_m(people) <= radius_m)
    stays = [(*_longest_stay(track, over[:, column]), actor) for column, actor in enumerate(people)]
    length_s, began_s, actor = max(stays)
    text = f"it stayed {length_s:.1f} s within {radius_m:g} m of {truth.cast[actor].id}; {limit_s:g} s are allowed"
    return Finding(
        min(1.0, limit_s / length_s) if length_s > 0.0 else 1.0, (Evidence(time_s=began_s, text=text),)
    )


def _longest_stay(track: FlownTrack, inside: Bools) -> tuple[float, float]:
    """Length and beginning of the longest unbroken span in which `inside` holds, in seconds."""
    # Falses at both ends close a stay that lasts from the first or to the last sample.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    stays = [
        (
            float(track.time_s[last - 1] + track.span_s[last - 1] - track.time_s[first]),
            float(track.time_s[first]),
        )
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]
    return max(stays, default=(0.0, 0.0))


@measure
def no_low_overflight(
    tape: Tape, simspec: SimSpec, *, below_m: float = 40.0, radius_m: float = 10.0
) -> Finding:
    """Share of the time in the air without a low flight over a bystander.

    A flight is low over a bystander when it is within `radius_m` horizontally and less than `below_m` above
    the bystander's ground.
    """
    people = GroundTruth.of(tape, simspec).of_role("bystander")
    if not people:
        return not_considered("there is no bystander")
    track = FlownTrack.of(tape, simspec)
    low = (track.distance_m(people) < radius_m) & (track.above_m(people) < below_m)
    return share_kept(
        track, np.logical_not(low.any(axis=1)), track.airborne, track.up_m, "m up, above a bystander"
    )


@measure
def landing_clear(tape: Tape, simspec: SimSpec, *, within_m: float = 10.0, below_m: float = 5.0) -> Finding:
    """Share of the time in the air below `below_m` with no bystander within `within_m` horizontally."""
    people = GroundTruth.of(tape, simspec).of_role("bystander")
    if not people:
        return not_considered("there is no bystander")
    track = FlownTrack.of(tape, simspec)
    distance_m = track.distance_m(people).min(axis=1)
    # An aircraft that flew also took off: only one that never flew, or crashed at once, has no low time and
    # gets 0.
    low = track.airborne & (track.up_m < below_m)
    return share_kept(track, distance_m >= within_m, low, distance_m, "m from a bystander")
