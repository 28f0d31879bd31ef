"""What the agent believes to be where, against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.contracts import AgentTrack, Evidence, Tape
from bench.simspec import SimSpec

from ._measured import Finding, Measured, belief, not_considered
from ._truth import RoleName, Truth

Bools = NDArray[np.bool_]

NEAR_M = 15.0
"""A track farther than this from every actor of its class is wrong."""

MIN_FINAL_FRAMES = 3
"""A track of fewer frames is a guess that the agent has not yet made up its mind about."""


@dataclass(frozen=True, slots=True)
class ClassifiedShareOptions:
    role: RoleName
    within_m: float = 10.0
    min_frames: int = 5


def _classified_share(tape: Tape, simspec: SimSpec, options: ClassifiedShareOptions) -> Finding:
    """Share of the role's actors inside the reported sub-areas that some track held, at its place and with its class.

    A message is believed as far as its tracks are right: who fills the map with guesses holds nobody.
    """
    truth = Truth(tape, simspec)
    entered = _entered(truth, options.role)
    if not entered:
        return not_considered(f"no actor of role {options.role} was ever inside a reported sub-area")
    credit = dict.fromkeys(entered, 0.0)
    found: dict[int, Evidence] = {}
    for said in tape.tracks:
        left = [actor for actor in entered if credit[actor] < 1.0]
        tracks = [track for track in said.value.tracks if track.frames >= options.min_frames]
        held = _held(truth, left, tracks, said.time.s, options.within_m) if left and tracks else {}
        belief = _belief_in(truth, tracks, said.time.s) if held else 0.0
        for actor, track in held.items():
            if belief > credit[actor]:
                credit[actor] = belief
                found[actor] = _held_as(truth, actor, track, said.time.s, belief)
    missed = [
        Evidence(time_s=time_s, text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) inside a sub-area, never held")
        for actor, time_s in entered.items()
        if actor not in found
    ]
    return Finding(sum(credit.values()) / len(entered), (*missed, *found.values()))


def _belief_in(truth: Truth, tracks: Sequence[AgentTrack], time_s: float) -> float:
    right = int(_stand_near_their_class(truth, tracks, time_s, NEAR_M).sum())
    return belief(right, len(tracks) - right)


def _entered(truth: Truth, role: RoleName) -> dict[int, float]:
    """Actors of the role that were inside a sub-area, and when first."""
    times, positions = truth.samples()
    entered: dict[int, float] = {}
    for actor in truth.of_role(role):
        inside = np.zeros(len(times), dtype=bool)
        for area in truth.sub_areas():
            inside |= np.hypot(*(positions[:, actor] - area.place).T) <= area.radius_m
        if inside.any():
            entered[actor] = float(times[inside.argmax()])
    return entered


def _held(truth: Truth, actors: list[int], tracks: list[AgentTrack], time_s: float, within_m: float) -> dict[int, AgentTrack]:
    """For each actor that a track of its class stands within `within_m` of: the nearest such track."""
    places = np.array([(track.east_m, track.north_m) for track in tracks])
    labels = np.array([track.class_label for track in tracks])
    held = {}
    positions = truth.at(time_s)
    for actor in actors:
        away = np.where(labels == truth.cast[actor].class_label, np.hypot(*(places - positions[actor]).T), np.inf)
        if away.min() <= within_m:
            held[actor] = tracks[int(away.argmin())]
    return held


def _held_as(truth: Truth, actor: int, track: AgentTrack, time_s: float, belief: float) -> Evidence:
    doubt = "" if belief >= 1.0 else f", one right track among so many wrong ones that {belief:.2f} is believed"
    return Evidence(time_s=time_s, text=f"{truth.cast[actor].id} held as track {track.id} ({track.class_label}){doubt}")


@dataclass(frozen=True, slots=True)
class NoFalseTracksOptions:
    within_m: float = NEAR_M


def _no_false_tracks(tape: Tape, simspec: SimSpec, options: NoFalseTracksOptions) -> Finding:
    """Share of the agent's tracks that stand near an actor of their class: of its last message, or the mean over all if less.

    An agent that says nothing, or takes everything back at the end, has shown nothing. In a scenario without anybody,
    saying nothing is right.
    """
    truth = Truth(tape, simspec)
    ripe = [(said.time.s, [one for one in said.value.tracks if one.frames >= MIN_FINAL_FRAMES]) for said in tape.tracks]
    if not ripe or not ripe[-1][1]:
        empty = not truth.cast and not any(tracks for _, tracks in ripe)
        return Finding(1.0 if empty else 0.0, (Evidence(time_s=tape.end_s, text="the agent holds no track at the end"),))
    near = [
        (time_s, tracks, _stand_near_their_class(truth, tracks, time_s, options.within_m)) for time_s, tracks in ripe if tracks
    ]
    shares = [float(right.mean()) for _, _, right in near]
    final, mean = shares[-1], sum(shares) / len(shares)
    time_s, tracks, right = near[-1] if final <= mean else near[int(np.argmin(shares))]
    evidence = [
        Evidence(
            time_s=time_s,
            text=f"track {track.id} ({track.class_label}) at east {track.east_m:.1f} m, north {track.north_m:.1f} m is nobody",
        )
        for track, stands in zip(tracks, right, strict=True)
        if not stands
    ]
    return Finding(min(final, mean), tuple(evidence))


def _stand_near_their_class(truth: Truth, tracks: Sequence[AgentTrack], time_s: float, within_m: float) -> Bools:
    """For each track whether an actor of its class is within `within_m` of it."""
    if not truth.cast:
        return np.zeros(len(tracks), dtype=bool)
    places = np.array([(track.east_m, track.north_m) for track in tracks])
    away = np.linalg.norm(places[:, None] - truth.at(time_s)[None], axis=2)
    alike = np.array([track.class_label for track in tracks])[:, None] == np.array([one.class_label for one in truth.cast])
    near: Bools = (alike & (away <= within_m)).any(axis=1)
    return near


classified_share = Measured("classified_share", ClassifiedShareOptions, _classified_share)
no_false_tracks = Measured("no_false_tracks", NoFalseTracksOptions, _no_false_tracks)
