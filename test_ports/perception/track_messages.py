"""The agent's track messages against the truth of their moments: all of a run as columns."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from bench.arrays import Bools, Counts, Floats, Objects
from bench.contracts import AgentTrack, Evidence, Tape
from bench.simspec import SimSpec

from ..ground_truth import GroundTruth
from .sightings import Sightings

RIGHT_WITHIN_M = 15.0
"""A track farther than this from every actor of its class is wrong. Chosen, not measured."""

BATCH_PAIRS = 40_000
"""Pairs of a track and an actor whose distances are worked out at once. An agent that sends as many tracks as are
recorded has ten thousand times as many in a session, and the host's memory is not the agent's to use up. Larger batches
are no faster (measured up to ten times as large).
"""

PERSON_WITHIN_M, PERSON_FRAMES = 10.0, 3
"""How near to a bystander a track of their class must be, and on how many frames it must rest, for the agent to know
of them. Who flies past sees people for a second or two. Chosen, not measured.
"""


@dataclass(frozen=True, slots=True)
class Holdings:
    """Which members of the cast (k) each message (m) holds, by tracks that rest on at least so many frames.

    `distance_m` (m, k) is that of the nearest such track of the member's class, infinite where there is none and until a
    camera showed the member, however little: measures of poor views ask for tracks of what is 6 pixels high. `track` (m, k) is its row, the first of equally near ones.
    `credibility` (m,) is how far each message is believed, by how many of these tracks are right.
    """

    distance_m: Floats
    track: Counts
    credibility: Floats

    def held(self, actors: Collection[int], within_m: float) -> Bools:
        """(m, len(actors)) whether a message holds an actor within so far."""
        return np.asarray(self.distance_m[:, list(actors)] <= within_m)

    def credit(self, actors: Collection[int], within_m: float) -> Floats:
        """(m, len(actors)) the credibility of a message that holds an actor within so far, 0 of any other."""
        return np.asarray(np.where(self.held(actors, within_m), self.credibility[:, None], 0.0))


class TrackMessages:
    """The messages of tracks (m of them) in order of arrival, and their tracks (t) one after another.

    `message` (t,) is the row of a track's message, `time_s` (m,) when it arrived, `frames` (t,) the number of frames on
    which a track rests, as the agent states. The tracks are set against a cast of k members.
    """

    def __init__(self, tape: Tape, simspec: SimSpec) -> None:
        self._truth = GroundTruth.of(tape, simspec)
        self.time_s: Floats = np.array([message.time.s for message in tape.tracks], dtype=np.float64)
        self.tracks: list[AgentTrack] = [track for message in tape.tracks for track in message.value.tracks]
        counts = [len(message.value.tracks) for message in tape.tracks]
        self.message: Counts = np.repeat(np.arange(len(counts)), counts)
        self.frames: Counts = np.array([track.frames for track in self.tracks], dtype=np.int64)
        self.labels: Objects = np.array([track.class_label for track in self.tracks], dtype=np.object_)
        places_m = [(track.east_m, track.north_m) for track in self.tracks]
        self._places_m = np.array(places_m, dtype=np.float64).reshape(-1, 2)  # also without tracks
        first_s = Sightings.of(tape).first_s()
        self._shown_s = np.array([first_s.get(actor, np.inf) for actor in range(len(self._truth.cast))])
        self._holdings: dict[int, Holdings] = {}

    @classmethod
    def of(cls, tape: Tape, simspec: SimSpec) -> Self:
        """The messages of a tape, gathered once."""
        return tape.cached((cls,), lambda: cls(tape, simspec), simspec)

    def mature(self, min_frames: int) -> Bools:
        """(t,) tracks of at least so many frames."""
        return np.asarray(self.frames >= min_frames)

    def right(self, within_m: float = RIGHT_WITHIN_M) -> Bools:
        """(t,) tracks that stand within `within_m` of an actor of their class that had been shown."""
        return np.asarray(self.nearest.sighted_m <= within_m)

    def per_message(self, tracks: Bools) -> Counts:
        """(m,) how many of these tracks (t,) each message has."""
        return np.bincount(self.message[tracks], minlength=len(self.time_s))

    def credibility(self, min_frames: int) -> Floats:
        """(m,) how far each message is believed, by how many of its mature tracks are right."""
        mature = self.mature(min_frames)
        right, wrong = self.per_message(mature & self.right()), self.per_message(mature & ~self.right())
        shares = np.divide(right, wrong, out=np.ones(len(right)), where=wrong > 0)
        return np.asarray(np.minimum(1.0, shares))

    def holdings(self, min_frames: int) -> Holdings:
        """Who is held in each message by tracks of at least so many frames."""
        if min_frames not in self._holdings:
            self._holdings[min_frames] = self._held_by(self.mature(min_frames), self.credibility(min_frames))
        return self._holdings[min_frames]

    def _held_by(self, candidates: Bools, credibility: Floats) -> Holdings:
        shape = (len(self.time_s), len(self._truth.cast))
        holdings = Holdings(np.full(shape, np.inf), np.zeros(shape, dtype=np.int64), credibility)
        for pairs in self._pairs_of_a_class(np.flatnonzero(candidates)):
            messages, begins, of_track = np.unique(
                self.message[pairs.tracks], return_index=True, return_inverse=True
            )
            cells = np.ix_(messages, pairs.actors)
            nearest_m = np.minimum.reduceat(pairs.sighted_m, begins, axis=0)
            is_nearest = pairs.sighted_m == nearest_m[of_track]
            rows = np.where(is_nearest, pairs.tracks[:, None], len(self.tracks))
            holdings.distance_m[cells] = nearest_m
            holdings.track[cells] = np.minimum.reduceat(rows, begins, axis=0)
        return holdings

    @cached_property
    def nearest(self) -> NearestActors:
        """The nearest actor of its class for every track."""
        count = len(self.tracks)
        nearest = NearestActors(
            np.zeros(count, dtype=np.int64), np.full(count, np.inf), np.full(count, np.inf)
        )
        for pairs in self._pairs_of_a_class(np.arange(count)):
            columns = pairs.distance_m.argmin(axis=1)
            nearest.actor[pairs.tracks] = pairs.actors[columns]
            nearest.distance_m[pairs.tracks] = pairs.distance_m[np.arange(len(columns)), columns]
            nearest.sighted_m[pairs.tracks] = pairs.sighted_m.min(axis=1)
        return nearest

    def _pairs_of_a_class(self, tracks: Counts) -> Iterator[_Pairs]:
        """Every pair of one of these tracks with an actor of its class, in blocks of one class."""
        for label in np.unique(self._truth.labels):
            actors = np.flatnonzero(self._truth.labels == label)
            for block, distance_m in self.distances(tracks[self.labels[tracks] == label], actors):
                sighted = self._shown_s[actors] <= self.time_s[self.message[block], None]
                yield _Pairs(block, actors, distance_m, np.where(sighted, distance_m, np.inf))

    def distances(self, tracks: Counts, actors: Counts) -> Iterator[tuple[Counts, Floats]]:
        """Horizontal distances of tracks, as ascending rows, from actors at the moments of their messages: rows (r,) and
        distances (r, len(actors)), in blocks of whole messages.
        """
        first = np.searchsorted(self.message[tracks], self.message[tracks])
        cuts = np.flatnonzero(np.diff(first * len(actors) // BATCH_PAIRS)) + 1
        for block in np.split(tracks, cuts) if len(tracks) else ():
            messages, of_track = np.unique(self.message[block], return_inverse=True)
            actors_m = self._truth.at_each(self.time_s[messages], actors)
            offset_m = self._places_m[block, None] - actors_m[of_track]
            yield block, np.sqrt(offset_m[..., 0] ** 2 + offset_m[..., 1] ** 2)


@dataclass(frozen=True, slots=True)
class NearestActors:
    """For each track (t,) the nearest actor of its class and its distance, infinite where the cast has none of that class;
    and the distance of the nearest of those that a camera had shown, infinite without one.
    """

    actor: Counts
    distance_m: Floats
    sighted_m: Floats


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Tracks (r,) and actors (a,) of a class, distances (r, a); `sighted_m` is infinite for the unshown."""

    tracks: Counts
    actors: Counts
    distance_m: Floats
    sighted_m: Floats


def holding_credit(
    tape: Tape, simspec: SimSpec, actors: Collection[int], within_m: float, min_frames: int
) -> tuple[dict[int, float], dict[int, Evidence]]:
    """For each actor the greatest credibility of a message that held it, 0 where none did; and the first moment of
    such a message, in order of the first that held it at all.
    """
    truth, messages = GroundTruth.of(tape, simspec), TrackMessages.of(tape, simspec)
    holdings = messages.holdings(min_frames)
    credit = holdings.credit(actors, within_m)
    greatest = dict(zip(actors, credit.max(axis=0, initial=0.0).tolist(), strict=True))
    moments: dict[int, Evidence] = {}
    for actor, column in in_order_of_appearance(actors, credit > 0.0):
        row = int(credit[:, column].argmax())
        track, time_s = messages.tracks[holdings.track[row, actor]], float(messages.time_s[row])
        moments[actor] = _held_as(truth, actor, track, time_s, greatest[actor])
    return greatest, moments


def in_order_of_appearance(actors: Collection[int], held: Bools) -> list[tuple[int, int]]:
    """The actors that some message holds, each with its column of `held` (m, k), in order of the first."""
    columns = np.flatnonzero(held.any(axis=0))
    # Stable: of one message in the order of the actors.
    first = np.array([held[:, column].argmax() for column in columns], dtype=np.int64)
    ordered = columns[first.argsort(kind="stable")]
    names = list(actors)
    return [(names[column], column) for column in ordered.tolist()]


def _held_as(truth: GroundTruth, actor: int, track: AgentTrack, time_s: float, belief: float) -> Evidence:
    doubt = "" if belief >= 1.0 else f"; most tracks of this message are wrong, so it counts {belief:.2f}"
    return Evidence(
        time_s=time_s, text=f"{truth.cast[actor].id} held as track {track.id} ({track.class_label}){doubt}"
    )


def known_people(tape: Tape, simspec: SimSpec, people: Collection[int], time_s: float) -> float:
    """How many of these people tracks had held up to a moment, each by its most credible message."""
    messages = TrackMessages.of(tape, simspec)

    def greatest_up_to_each() -> Floats:
        """(m, k) the greatest credit of each member of the cast so far."""
        credit = messages.holdings(PERSON_FRAMES).credit(range(len(truth.cast)), PERSON_WITHIN_M)
        return np.maximum.accumulate(credit, axis=0)

    truth = GroundTruth.of(tape, simspec)
    credit = tape.cached(known_people, greatest_up_to_each, simspec)
    row = int(np.searchsorted(messages.time_s, time_s, side="right")) - 1
    return float(credit[row, list(people)].sum()) if row >= 0 else 0.0
