"""Findings about targets that are known."""

from __future__ import annotations

import math

from ..reference.mission._findings import Findings
from ..reference.mission._planner import SearchTask
from ..reference.perception._tracks import Track
from ._truth import Truth


class OracleFindings(Findings):
    """The target of an intelligence report is the actor that the report is about."""

    # It reports in the moment in which it is there: time for a look from another side. Chosen, not measured.
    deadline_margin_s = 5.0
    _groups: dict[str, str]
    _numbers: dict[str, list[int]]

    def knowing(self, truth: Truth) -> OracleFindings:
        """With the truth about who each report is about."""
        self._groups = {intelligence.id: intelligence.about for intelligence in truth.simspec.intelligence}
        self._numbers = {}
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
