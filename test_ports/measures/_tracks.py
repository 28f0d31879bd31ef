"""What the agent believes to be where, against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.contracts import AgentTrack, Evidence, Tape
from bench.simspec import SimSpec

from ._measured import Finding, Measured, not_considered
from ._truth import RoleName, Truth

MIN_FINAL_FRAMES = 3
"""A track of fewer frames is a guess that the agent has not yet made up its mind about."""


@dataclass(frozen=True, slots=True)
class ClassifiedShareOptions:
    role: RoleName
    within_m: float = 10.0
    min_frames: int = 5


def _classified_share(tape: Tape, simspec: SimSpec, options: ClassifiedShareOptions) -> Finding:
    """Share of the role's actors inside the reported sub-areas that some track held, at its place and with its class."""
    truth = Truth(tape, simspec)
    entered = _entered(truth, options.role)
    if not entered:
        return not_considered(f"no actor of role {options.role} was ever inside a reported sub-area")
    found: dict[int, Evidence] = {}
    for said in tape.tracks:
        left = [actor for actor in entered if actor not in found]
        tracks = [track for track in said.value.tracks if track.frames >= options.min_frames]
        if left and tracks:
            held = _held(truth, left, tracks, said.time.s, options.within_m)
            found |= {actor: _held_as(truth, actor, track, said.time.s) for actor, track in held.items()}
    missed = [
        Evidence(time_s=time_s, text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) inside a sub-area, never held")
        for actor, time_s in entered.items()
        if actor not in found
    ]
    return Finding(len(found) / len(entered), (*missed, *found.values()))


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


def _held_as(truth: Truth, actor: int, track: AgentTrack, time_s: float) -> Evidence:
    return Evidence(time_s=time_s, text=f"{truth.cast[actor].id} held as track {track.id} ({track.class_label})")


@dataclass(frozen=True, slots=True)
class NoFalseTracksOptions:
    within_m: float = 15.0


def _no_false_tracks(tape: Tape, simspec: SimSpec, options: NoFalseTracksOptions) -> Finding:
    """Share of the agent's final tracks that stand near an actor of their class; 0 when it never published one.

    An agent that says nothing has shown nothing. In a scenario without anybody, saying nothing is right.
    """
    truth = Truth(tape, simspec)
    final = tape.tracks[-1] if tape.tracks else None
    tracks = [track for track in final.value.tracks if track.frames >= MIN_FINAL_FRAMES] if final else []
    if final is None or not tracks:
        return Finding(0.0 if truth.cast else 1.0, (Evidence(time_s=tape.end_s, text="the agent holds no track at the end"),))
    false = [track for track in tracks if not _stands_near_its_class(truth, track, final.time.s, options.within_m)]
    evidence = [
        Evidence(
            time_s=final.time.s,
            text=f"track {track.id} ({track.class_label}) at east {track.east_m:.1f} m, north {track.north_m:.1f} m is nobody",
        )
        for track in false
    ]
    return Finding(1.0 - len(false) / len(tracks), tuple(evidence))


def _stands_near_its_class(truth: Truth, track: AgentTrack, time_s: float, within_m: float) -> bool:
    away = truth.distances(time_s, track.east_m, track.north_m)
    return any(away[index] <= within_m for index, member in enumerate(truth.cast) if member.class_label == track.class_label)


classified_share = Measured("classified_share", ClassifiedShareOptions, _classified_share)
no_false_tracks = Measured("no_false_tracks", NoFalseTracksOptions, _no_false_tracks)
