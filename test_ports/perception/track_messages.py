"""The agent's picture, message by message: its tracks as arrays beside the truth of the moment."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Floats
from bench.contracts import AgentTrack, Tape
from bench.simspec import SimSpec

from .._measure import belief
from ..ground_truth._truth import Truth

NEAR_M = 15.0
"""A track farther than this from every actor of its class is wrong."""


@dataclass(frozen=True)
class Picture:
    """One message of tracks (t of them) against the cast (k)."""

    time_s: float
    tracks: tuple[AgentTrack, ...]
    truth: Truth

    @cached_property
    def labels(self) -> NDArray[Any]:
        """(t,) class labels."""
        return np.array([one.class_label for one in self.tracks], dtype=object)

    @cached_property
    def frames(self) -> NDArray[np.int64]:
        """(t,) how many frames each track says that it rests on."""
        return np.array([one.frames for one in self.tracks], dtype=np.int64)

    @cached_property
    def apart_m(self) -> Floats:
        """(t, k) horizontal distance of each track from each member of the cast."""
        places = np.array([(one.east_m, one.north_m) for one in self.tracks], dtype=np.float64).reshape(-1, 2)
        found: Floats = np.linalg.norm(places[:, None] - self.truth.at(self.time_s)[None], axis=2)
        return found

    @cached_property
    def alike(self) -> Bools:
        """(t, k) whether a track bears the class of a member of the cast."""
        found: Bools = self.labels[:, None] == self.truth.labels[None]
        return found

    def ripe(self, min_frames: int) -> Bools:
        """(t,) tracks of at least so many frames."""
        found: Bools = self.frames >= min_frames
        return found

    def right(self, among: Bools, within_m: float = NEAR_M) -> Bools:
        """(t,) those of `among` that stand within `within_m` of an actor of their class."""
        if not self.truth.cast:
            return np.zeros(len(self.tracks), dtype=np.bool_)
        found: Bools = among & (self.alike & (self.apart_m <= within_m)).any(axis=1)
        return found

    def belief(self, min_frames: int) -> float:
        """How far this message is believed, by how many of its ripe tracks are right."""
        ripe = self.ripe(min_frames)
        right = int(self.right(ripe).sum())
        return belief(right, int(ripe.sum()) - right)

    def holding(self, actors: Collection[int], within_m: float, min_frames: int) -> dict[int, int]:
        """For each of these actors that a ripe track of its class stands within `within_m` of: the nearest such track."""
        if not self.tracks or not actors:
            return {}
        among = list(actors)
        usable = self.ripe(min_frames)[:, None] & self.alike[:, among]
        away = np.where(usable, self.apart_m[:, among], np.inf)
        nearest = away.argmin(axis=0)
        return {actor: int(nearest[column]) for column, actor in enumerate(among) if away[nearest[column], column] <= within_m}


def pictures(tape: Tape, simspec: SimSpec) -> list[Picture]:
    """Every message of tracks, in order of arrival."""
    truth = Truth.of(tape, simspec)
    return tape.cached((pictures, id(simspec)), lambda: [Picture(said.time.s, said.value.tracks, truth) for said in tape.tracks])
