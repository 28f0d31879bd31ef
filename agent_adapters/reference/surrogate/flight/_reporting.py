"""What the surrogates know of their targets and of people near them, and what they report and mark by that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bench.arrays import Bools, Counts, Floats

from ..._settings import DEFAULTS
from ...mission._findings import DEADLINE_S
from ...mission._mission import LAST_WORD_S
from ...perception._tracks import BYSTANDER_FRAMES
from ..batch._batch import Batch, standing_span_of
from ._delays import first_open_s
from ._identification import NEVER_S, Identification
from ._views import Stretch, Views, frame_counts, right_label_chance, unseen_share, views_of
from ._way_home import WayHome

READY_S = 5.7
"""From the start to arming, of the simulated PX4."""

CLIMB_S = 8.5
"""From arming to being on the way."""


class KnownBystanders(NamedTuple):
    """How many bystanders are known near each target, and the nearest one's distance; inf for none."""

    within: Counts
    nearest_m: Floats


class Missions:
    """The state of all missions of a batch; `rows` are those that take part in a step, `task` one of each.

    What is public is the outcome when all are over. Times are inf where something never happened; tasks are in the
    order of the SimSpec.
    """

    def __init__(self, batch: Batch) -> None:
        self.batch = batch
        count, tasks = batch.task_radius_m.shape
        self.everybody_m = batch.places()  # (EPOCHS, n, a, 2)
        self._identification = Identification(batch)
        self.found_s = self._identification.found_s  # (n, k)
        self._way_home = WayHome(batch)
        self._now_s = np.full(count, READY_S)
        self._away_s = self._now_s
        self.place_m = batch.home_m.copy()
        self.course: list[Stretch] = []
        self._views: list[Views] = []
        self._task_is = batch.is_task
        self._dealt_with = ~self._task_is
        self._passes = np.zeros((count, tasks), dtype=np.int64)
        self._obeyed_first = np.zeros((count, tasks), dtype=np.bool_)  # orders to be next
        self._settled = np.zeros((count, tasks), dtype=np.bool_)  # reported, or to be when that is allowed
        self._ended = np.zeros(count, dtype=np.bool_)  # nothing is left but to come down
        self.reached = np.zeros(count, dtype=np.bool_)  # some sub-area was flown to
        self.reported_s: Floats = np.full((count, tasks), NEVER_S)
        self.marked_s: Floats = np.full((count, tasks), NEVER_S)
        # As known when the target was reported.
        self.known = KnownBystanders(
            np.zeros((count, tasks), dtype=np.int64), np.full((count, tasks), np.inf)
        )
        depth = batch.height_m / np.sin(batch.tilt_rad)
        self._middle_m = np.minimum(batch.height_m / np.maximum(np.tan(batch.tilt_rad), 1e-3), 400.0)
        self._swath_m = 2.0 * depth * batch.tan_half
        self._ring_m = np.clip(self._middle_m, 0.3 * batch.height_m, 2.0 * batch.height_m)

    def _views_of(self, stretch: Stretch, begin_s: Floats) -> Views:
        """Who is in the picture, where the detector says anything."""
        views = views_of(self.batch, stretch, self._everybody_at(stretch.rows, begin_s))
        for span in range(self.batch.blind_s.shape[1]):
            since_s, until_s = self.batch.blind_s[views.row, span].T
            views = views.where((views.time_s < since_s) | (views.time_s >= until_s))
        return views

    def _everybody_at(self, rows: Counts, time_s: Floats) -> Floats:
        return self.everybody_m[standing_span_of(time_s), rows]

    def _targets_m(self, rows: Counts, task: Counts) -> Floats:
        """Where targets were last seen: about where they stand."""
        return self._everybody_at(rows, self._now_s[rows])[
            np.arange(len(rows)), np.maximum(self.batch.task_actor[rows, task], 0)
        ]

    def _knows(self, rows: Counts, task: Counts, until_s: Floats, first_stretch: int = 0) -> KnownBystanders:
        """Who near a target was seen often enough by then, on the stretches from `first_stretch` on."""
        batch = self.batch
        if not len(rows):
            return KnownBystanders(np.zeros(0, dtype=np.int64), np.zeros(0))
        limit_s = np.full(len(batch), -np.inf)
        limit_s[rows] = until_s
        stretches = self._views[first_stretch:]
        early = Views.joined([views.where(views.time_s <= limit_s[views.row]) for views in stretches])
        counts = frame_counts(batch, early, right_label_chance(early))[rows]
        places_m = self._everybody_at(rows, until_s)
        target_m = places_m[np.arange(len(rows)), np.maximum(batch.task_actor[rows, task], 0)]
        apart_m = np.linalg.norm(places_m - target_m[:, None], axis=2)
        apart_m[(counts < BYSTANDER_FRAMES) | (batch.role[rows] != 0)] = np.inf
        within = (apart_m <= (batch.no_mark_m[rows] + DEFAULTS.bystander_margin_m)[:, None]).sum(axis=1)
        return KnownBystanders(within, apart_m.min(axis=1, initial=np.inf))

    def _seen_enough(self, rows: Counts, task: Counts, until_s: Floats) -> Bools:
        """(r,) whether enough of a target's surroundings was in the picture lately."""
        unseen = unseen_share(self.batch, self.course, rows, self._targets_m(rows, task), until_s)
        return np.asarray(unseen <= DEFAULTS.unseen_share)

    def _still_open(self, rows: Counts, task: Counts) -> Bools:
        """Settle what was identified on the way; whether it is not reported yet."""
        found_s = self.found_s[rows, task]
        identified = np.flatnonzero(np.isfinite(found_s) & ~self._settled[rows, task])
        if len(identified):
            self._judge(rows[identified], task[identified], found_s[identified])
            undecided = identified[
                ~self._settled[rows[identified], task[identified]] & ~self._ended[rows[identified]]
            ]
            if len(undecided):  # seen more of it by now
                self._judge(rows[undecided], task[undecided], self._now_s[rows[undecided]])
        return np.asarray(~self._settled[rows, task] & ~self._ended[rows])

    def _judge(self, rows: Counts, task: Counts, at_s: Floats) -> None:
        """Report at a moment what the policy is content with; the careful one may want to see more first."""
        careful = self.batch.bystander_aware[rows]
        plain = ~careful
        self._report(rows[plain], task[plain], at_s[plain], marks=True)
        rows, task, at_s = rows[careful], task[careful], at_s[careful]
        if not len(rows):
            return
        known = self._knows(rows, task, at_s)
        self.known.within[rows, task], self.known.nearest_m[rows, task] = known
        withholds = known.within > 0
        self._report(rows[withholds], task[withholds], at_s[withholds], marks=False)
        rows, task, at_s = rows[~withholds], task[~withholds], at_s[~withholds]
        clear = self._seen_enough(rows, task, at_s)
        self._report(rows[clear], task[clear], at_s[clear], marks=True)

    def _report(self, rows: Counts, task: Counts, at_s: Floats, *, marks: bool) -> None:
        """Reported as soon as that is allowed."""
        batch = self.batch
        said_s = first_open_s(batch.closed_s[rows], at_s)
        said_s = np.where(said_s < batch.limit_s[rows] - LAST_WORD_S, said_s, NEVER_S)
        self.reported_s[rows, task] = said_s
        self._settled[rows, task] = True
        if marks:
            consent_s = batch.consent_s[rows, task]
            # The careful one marks later only while it remembers what it saw round the target.
            patience_s = np.where(batch.bystander_aware[rows], DEFAULTS.memory_s, np.inf)
            marked_s = np.where(consent_s <= patience_s, said_s + consent_s, NEVER_S)
            self.marked_s[rows, task] = np.minimum(self.marked_s[rows, task], marked_s)

    def _mark_as_ordered(self) -> None:
        """Targets identified by then; the careful one refuses where it knows of people, or has not looked."""
        batch = self.batch
        for index in range(batch.mark_s.shape[1]):
            at_s, task = batch.mark_s[:, index], np.maximum(batch.mark_task[:, index], 0)
            row = np.arange(len(batch))
            able = (
                (batch.mark_task[:, index] >= 0) & (self.found_s[row, task] <= at_s) & (at_s <= self._now_s)
            )
            able &= first_open_s(batch.closed_s, np.where(np.isfinite(at_s), at_s, 0.0)) <= at_s
            rows = np.flatnonzero(able)
            if not len(rows):
                continue
            chosen, when_s = task[rows], at_s[rows]
            careful = batch.bystander_aware[rows]
            refuses = careful & (self._knows(rows, chosen, when_s).within > 0)
            refuses[careful] |= ~self._seen_enough(rows[careful], chosen[careful], when_s[careful])
            rows, chosen, when_s = rows[~refuses], chosen[~refuses], when_s[~refuses]
            self.marked_s[rows, chosen] = np.minimum(self.marked_s[rows, chosen], when_s)
            self.reported_s[rows, chosen] = np.minimum(self.reported_s[rows, chosen], when_s)

    def _meet_deadlines(self, rows: Counts, begin_s: Floats) -> None:
        """Shortly before a report falls due what is known well enough is reported, looked round or not."""
        batch = self.batch
        due_s = batch.task_delivered_s[rows] + batch.deadline_s[rows][:, None]
        due = self._task_is[rows] & ~self._settled[rows] & (due_s > begin_s[:, None])
        due &= due_s - DEADLINE_S <= self._now_s[rows][:, None]
        at, task = np.nonzero(due)
        known = self._identification.good_enough(rows[at], task)
        at, task = at[known], task[known]
        members, at_s = (rows[at], task), np.maximum(due_s[at, task] - DEADLINE_S, begin_s[at])
        self._settle(*members, at_s)
        self._judge(*members, at_s)
        undecided = ~self._settled[members]
        self._report(members[0][undecided], task[undecided], at_s[undecided], marks=False)

    def _settle(self, rows: Counts, task: Counts, at_s: Floats) -> None:
        """Found by then, and done with."""
        self.found_s[rows, task] = np.minimum(self.found_s[rows, task], at_s)
        self._dealt_with[rows, task] = True
