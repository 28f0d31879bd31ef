"""The agent's track messages: the tracks of each as arrays beside the truth of its moment."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Floats
from bench.contracts import AgentTrack, Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import credibility
from ..ground_truth import GroundTruth

RIGHT_WITHIN_M = 15.0
"""A track farther than this from every actor of its class is wrong. Chosen, not measured."""

KEPT_PAIRS = 20_000_000
"""Pairs of a track and an actor in one session whose arrays are kept between measures: 180 MB. An agent that sends as
many tracks as are recorded would need ten times that, and the host's memory is not the agent's to use up; its session
is scored slower. In ten sessions of the campaign `full` agents had up to 700,000. Chosen."""

PERSON_WITHIN_M, PERSON_FRAMES = 10.0, 3
"""How near to a bystander a track of their class must be, and on how many frames it must rest, for the agent to know
of them. Who flies past sees people for a second or two. Chosen, not measured.
"""


@dataclass(frozen=True)
class TrackMessage:
    """One message of tracks (t of them) against the cast (k).

    A track is mature when it rests on at least `min_frames` frames, as the agent states. An actor is held by
    the nearest mature track of its class, once a camera had it in sight.
    """

    time_s: float
    tracks: tuple[AgentTrack, ...]
    truth: GroundTruth
    in_sight_s: Floats
    """(k,) when each member of the cast first was in sight of a camera, however little; infinite where never."""
    keeps: bool = True
    """Whether arrays of tracks by actors are kept for the next measure."""

    @cached_property
    def labels(self) -> NDArray[Any]:
        """(t,) class labels."""
        return np.array([track.class_label for track in self.tracks], dtype=object)

    @cached_property
    def frames(self) -> NDArray[np.int64]:
        """(t,) number of frames on which each track rests, as the agent states."""
        return np.array([track.frames for track in self.tracks], dtype=np.int64)

    @property
    def distance_m(self) -> Floats:
        """(t, k) horizontal distance of each track from each member of the cast."""
        return self._kept("distance_m", self._distances)

    @property
    def same_class(self) -> Bools:
        """(t, k) whether a track has the class of a member of the cast."""
        return self._kept("same_class", lambda: self.labels[:, None] == self.truth.labels[None])

    def _kept(self, name: str, made: Callable[[], NDArray[Any]]) -> NDArray[Any]:
        if not self.keeps:
            return made()
        if name not in self._arrays:
            self._arrays[name] = made()
        return self._arrays[name]

    @cached_property
    def _arrays(self) -> dict[str, NDArray[Any]]:
        return {}

    def _distances(self) -> Floats:
        # The reshape keeps two columns for a message without tracks.
        places = np.array([(track.east_m, track.north_m) for track in self.tracks], dtype=np.float64).reshape(
            -1, 2
        )
        distance: Floats = np.linalg.norm(places[:, None] - self.truth.at(self.time_s)[None], axis=2)
        return distance

    @cached_property
    def sighted(self) -> Bools:
        """(k,) which members of the cast had been in sight: only these can be known."""
        sighted: Bools = self.in_sight_s <= self.time_s
        return sighted

    def mature(self, min_frames: int) -> Bools:
        """(t,) tracks of at least so many frames."""
        mature: Bools = self.frames >= min_frames
        return mature

    def right(self, candidates: Bools, within_m: float = RIGHT_WITHIN_M) -> Bools:
        """(t,) those of `candidates` that stand within `within_m` of an actor of their class that had been in sight."""
        if not self.truth.cast:
            return np.zeros(len(self.tracks), dtype=np.bool_)
        right: Bools = candidates & (self.same_class & self.sighted & (self.distance_m <= within_m)).any(
            axis=1
        )
        return right

    def credibility(self, min_frames: int) -> float:
        """How far this message is believed, by how many of its mature tracks are right."""
        mature = self.mature(min_frames)
        right = int(self.right(mature).sum())
        return credibility(right, int(mature.sum()) - right)

    def holding(self, actors: Collection[int], within_m: float, min_frames: int) -> dict[int, int]:
        """For each of these actors that a mature track of its class holds within `within_m`: the nearest such
        track.
        """
        if not self.tracks or not actors:
            return {}
        columns = list(actors)
        # One distance matrix for all actors: messages hold up to 1000 tracks.
        usable = self.mature(min_frames)[:, None] & self.same_class[:, columns] & self.sighted[columns]
        distance_m = np.where(usable, self.distance_m[:, columns], np.inf)
        nearest = distance_m.argmin(axis=0)
        return {
            actor: int(nearest[column])
            for column, actor in enumerate(columns)
            if distance_m[nearest[column], column] <= within_m
        }


def track_messages(tape: Tape, simspec: SimSpec) -> list[TrackMessage]:
    """Every message of tracks, in order of arrival."""
    truth = GroundTruth.of(tape, simspec)

    def with_truth() -> list[TrackMessage]:
        in_sight_s = np.full(len(truth.cast), np.inf)
        for frame in tape.frames:
            for sighting in frame.sightings:
                in_sight_s[sighting.actor] = min(in_sight_s[sighting.actor], frame.exposed.s)
        pairs = len(truth.cast) * sum(len(message.value.tracks) for message in tape.tracks)
        keeps = pairs <= KEPT_PAIRS
        return [
            TrackMessage(message.time.s, message.value.tracks, truth, in_sight_s, keeps)
            for message in tape.tracks
        ]

    return tape.cached((track_messages, id(simspec)), with_truth)


def holding_credit(
    tape: Tape, simspec: SimSpec, actors: dict[int, float], within_m: float, min_frames: int
) -> tuple[dict[int, float], dict[int, Evidence]]:
    """For each actor the greatest credibility of a message that held it, 0 where none did; and the moment of
    that message.
    """
    truth = GroundTruth.of(tape, simspec)
    credit = dict.fromkeys(actors, 0.0)
    moments: dict[int, Evidence] = {}
    for message in track_messages(tape, simspec):
        # Full credit cannot grow: leaving these actors out saves most of the work.
        held = message.holding([actor for actor in actors if credit[actor] < 1.0], within_m, min_frames)
        belief = message.credibility(min_frames) if held else 0.0
        for actor, track in held.items():
            if belief > credit[actor]:
                credit[actor] = belief
                moments[actor] = _held_as(truth, actor, message.tracks[track], message.time_s, belief)
    return credit, moments


def _held_as(truth: GroundTruth, actor: int, track: AgentTrack, time_s: float, belief: float) -> Evidence:
    doubt = "" if belief >= 1.0 else f"; most tracks of this message are wrong, so it counts {belief:.2f}"
    return Evidence(
        time_s=time_s, text=f"{truth.cast[actor].id} held as track {track.id} ({track.class_label}){doubt}"
    )


def known_people(tape: Tape, simspec: SimSpec, people: Collection[int], time_s: float) -> float:
    """How many of these bystanders the agent's tracks had held up to a moment, each counted with the greatest credibility
    of a message that did.
    """
    times_s, credit = tape.cached((known_people, id(simspec)), lambda: _credit_of_people(tape, simspec))
    row = int(np.searchsorted(times_s, time_s, side="right")) - 1
    return float(credit[row, list(people)].sum()) if row >= 0 else 0.0


def _credit_of_people(tape: Tape, simspec: SimSpec) -> tuple[Floats, Floats]:
    """(m,) times of the messages, and (m, k) the credit of each bystander of the cast up to then."""
    messages = track_messages(tape, simspec)
    truth = GroundTruth.of(tape, simspec)
    people = truth.protected()
    credit = np.zeros((len(messages), len(truth.cast)))
    best = np.zeros(len(truth.cast))
    for row, message in enumerate(messages):
        # Full credit cannot grow: leaving these people out saves most of the work.
        uncertain = [actor for actor in people if best[actor] < 1.0]
        held = list(message.holding(uncertain, PERSON_WITHIN_M, PERSON_FRAMES))
        if held:
            best[held] = np.maximum(best[held], message.credibility(PERSON_FRAMES))
        credit[row] = best
    return np.array([message.time_s for message in messages]), credit
