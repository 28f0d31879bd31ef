"""Findings about targets that are known."""

from __future__ import annotations

import math

from ..reference.mission._findings import Findings
from ..reference.mission._planner import SearchTask
from ..reference.perception._tracks import Track
from ._perception import TruthPerception


class OracleFindings(Findings):
    """The target of an intelligence report is the actor that the report is about."""

    # It reports in the moment in which it is there: time for a look from another side. Chosen, not measured.
    deadline_margin_s = 5.0
    _perception: TruthPerception

    def target_in_truth(self, task: SearchTask) -> Track | None:
        """The target of a task, seen or not."""
        tracks = self._perception.truth_tracks
        about = [told.about for told in tracks.truth.simspec.intelligence if told.id == task.id]
        taken = {other.target for other in self._planner.tasks.values() if other is not task}
        targets = (
            track
            for track, member in tracks.members
            if (member.id in about or member.group in about) and track.number not in taken
        )
        return min(
            targets, key=lambda track: math.dist((track.east_m, track.north_m), task.place), default=None
        )

    def candidate(self, task: SearchTask) -> Track | None:
        track = self.target_in_truth(task)
        return track if track is not None and track.frames else None

    def missing(self, candidate: Track, task: SearchTask) -> str:
        reason = super().missing(candidate, task)
        if reason or task.enough:
            return reason
        tracks = self._perception.truth_tracks
        return tracks.unseen_near(candidate, self._order.no_mark_within_m, self._log.now_s)
