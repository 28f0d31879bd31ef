"""Tracks that an agent publishes, one at a time."""

from __future__ import annotations

import math

from bench.contracts import AgentTrack, AgentTracks, Tape

from .flown_samples import actors_at


def matured(message: AgentTracks, min_frames: int = 5) -> list[AgentTrack]:
    return [track for track in message.tracks if track.frames >= min_frames]


def track_distance_m(tape: Tape, track: AgentTrack, actor: int, time_s: float) -> float:
    return math.dist((track.east_m, track.north_m), actors_at(tape, time_s)[actor])


def sighted(tape: Tape, actor: int, time_s: float) -> bool:
    """Some frame by then showed anything of it."""
    return any(
        sighting.actor == actor
        for frame in tape.frames
        if frame.exposed.s <= time_s
        for sighting in frame.sightings
    )


def message_credibility(tape: Tape, message: AgentTracks, time_s: float, min_frames: int = 5) -> float:
    tracks = matured(message, min_frames)
    right = sum(
        any(
            track.class_label == member.class_label
            and track_distance_m(tape, track, actor, time_s) <= 15.0
            and sighted(tape, actor, time_s)
            for actor, member in enumerate(tape.cast)
        )
        for track in tracks
    )
    wrong = len(tracks) - right
    return min(1.0, right / wrong) if wrong else 1.0


def holder(
    tape: Tape, message: AgentTracks, actor: int, time_s: float, within_m: float, min_frames: int = 5
) -> AgentTrack | None:
    """The nearest mature track of the actor's class within reach."""
    distances = [
        (track_distance_m(tape, track, actor, time_s), index)
        for index, track in enumerate(message.tracks)
        if track.frames >= min_frames and track.class_label == tape.cast[actor].class_label
    ]
    nearest_m, index = min(distances, default=(math.inf, 0))
    return message.tracks[index] if nearest_m <= within_m and sighted(tape, actor, time_s) else None
