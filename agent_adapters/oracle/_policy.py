"""When to mark, whom to expect, and which actor a report is about, where everybody is known."""

from __future__ import annotations

import math

import numpy as np

from bench.contracts import MissionOrder
from bench.simspec import endangered_roles

from ..reference._settings import Settings
from ..reference.mission._findings import Findings
from ..reference.mission._planner import SearchTask
from ..reference.mission._policy import BystanderAwarePolicy, Judgement, UnseenShare
from ..reference.perception._tracks import Track, Tracks, may_be_bystander
from ._perception import Truth, TruthPerception

# For so long a report foresees people, looked ahead in steps in which nobody walks farther than a metre.
FORESEEN_S, STEP_S = 30.0, 0.5
# A mark holds until people have walked on for a tick or two. Chosen, not measured.
MARK_MARGIN_M = 3.0
# Of a place that is given to the millimetre, an agent still may not state an error of nothing.
SIGMA_M = 0.5


class OraclePolicy(BystanderAwarePolicy):
    """Marks exactly what the rules allow, and counts exactly, now and ahead."""

    def __init__(self, order: MissionOrder, settings: Settings, truth: Truth) -> None:
        super().__init__(order, settings)
        self._truth = truth

    def _people_expected(self, target: Track, tracks: Tracks, now_s: float) -> float:
        cast, marked = self._truth.cast, target.number - 1
        roles = endangered_roles(cast[marked].role)
        people = [index for index, member in enumerate(cast) if member.role in roles]
        within = np.zeros(len(people), dtype=np.bool_)
        for at_s in np.arange(now_s, now_s + FORESEEN_S + STEP_S / 2, STEP_S):
            places = self._truth.places_m(float(at_s))
            offset = places[people] - places[marked]
            within |= np.hypot(offset[:, 0], offset[:, 1]) < self._within_m
        return float(within.sum())

    def _judge(self, target: Track, tracks: Tracks, now_s: float, unseen_share: UnseenShare) -> Judgement:
        people = sorted(
            track.distance_m(*target.place)
            for track in tracks
            if track is not target and may_be_bystander(track, self._classes)
        )
        count = sum(distance_m <= self._within_m for distance_m in people)
        nearest_m = round(people[0], 2) if people else None
        if people and people[0] <= self._within_m + MARK_MARGIN_M:
            reason = f"{count} bystanders within {self._within_m:g} m, the nearest at {people[0]:.0f} m"
            return Judgement(False, reason, bystanders_seen=count, nearest_bystander_m=nearest_m)
        reason = f"no bystander within {self._within_m:g} m"
        return Judgement(True, reason, bystanders_seen=0, nearest_bystander_m=nearest_m)

    def sigma_m(self, target: Track) -> float | None:
        return SIGMA_M


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
        return min(targets, key=lambda track: math.dist(track.place, task.place), default=None)

    def candidate(self, task: SearchTask) -> Track | None:
        track = self.target_in_truth(task)
        return track if track is not None and track.frames else None

    def missing(self, candidate: Track, task: SearchTask) -> str:
        reason = super().missing(candidate, task)
        if reason or task.enough:
            return reason
        tracks = self._perception.truth_tracks
        return tracks.unseen_near(candidate, self._order.no_mark_within_m, self._log.now_s)
