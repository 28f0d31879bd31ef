"""Findings about targets that are known."""

from __future__ import annotations

import math
from collections.abc import Collection

from bench.simspec import PROTECTED_ROLES

from ..reference.mission._findings import Findings
from ..reference.mission._planner import SearchTask
from ..reference.perception._tracks import Track
from ._perception import TruthPerception, TruthTracks
from ._truth import Truth

# A minute is what `surroundings_seen` asks for, of half of the people; then margins. Chosen, not measured.
SURROUNDINGS_S, UNSEEN_SHARE = 50.0, 0.4


class OracleFindings(Findings):
    """The target of an intelligence report is the actor that the report is about."""

    # It reports in the moment in which it is there: time for a look from another side. Chosen, not measured.
    deadline_margin_s = 5.0
    _groups: dict[str, str]
    _numbers: dict[str, list[int]]
    _people: list[int]
    looked_round: set[str]  # tasks whose target it has flown round: who is unseen by then stays so

    def knowing(self, truth: Truth) -> OracleFindings:
        """With the truth about who each report is about."""
        self._groups = {intelligence.id: intelligence.about for intelligence in truth.simspec.intelligence}
        self._numbers, self.looked_round = {}, set()
        self._people = [
            index + 1 for index, member in enumerate(truth.cast) if member.role in PROTECTED_ROLES
        ]
        for index, member in enumerate(truth.cast):
            for name in (member.id, member.group):
                self._numbers.setdefault(name, []).append(index + 1)
        return self

    def target_in_truth(self, task: SearchTask) -> Track | None:
        """The target of a task, seen or not."""
        numbers = self._numbers.get(self._groups.get(task.id, ""), [])
        taken = {other.target for other in self._planner.tasks.values() if other is not task}
        tracks = [t for t in self._perception.tracks if t.number in numbers and t.number not in taken]
        return min(
            tracks, key=lambda track: math.dist((track.east_m, track.north_m), task.place), default=None
        )

    def candidate(self, task: SearchTask) -> Track | None:
        track = self.target_in_truth(task)
        return track if track is not None and track.frames else None

    def missing(self, candidate: Track, task: SearchTask) -> str:
        reason = super().missing(candidate, task)
        if reason or task.id in self.looked_round or not isinstance(self._perception, TruthPerception):
            return reason
        tracks, within_m = self._perception.truth_tracks, self._order.no_mark_within_m
        return unseen_neighbours(candidate, tracks, self._people, within_m, self._log.now_s)


def unseen_neighbours(
    target: Track, tracks: TruthTracks, people: Collection[int], within_m: float, now_s: float
) -> str:
    """How many people near a target have not been in view lately; empty when enough of them have.

    `people` are the numbers of their tracks.
    """
    neighbours = [
        track.number
        for _, track in tracks.within(target.east_m, target.north_m, within_m)
        if track.number in people and track is not target
    ]
    since_s = now_s - SURROUNDINGS_S
    unseen = [number for number in neighbours if tracks.published.last_s_of(number) < since_s]
    return (
        f"{len(unseen)} of {len(neighbours)} people near it unseen"
        if len(unseen) > UNSEEN_SHARE * len(neighbours)
        else ""
    )
