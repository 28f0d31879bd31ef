"""The surrogates: what the reference agents do, on a ground plan, many missions at once.

They keep the reference agents' order of work: the most urgent sub-area first, a lawnmower over it, a round
about what is not identified yet, a report; the bystander-aware one withholds the mark where it knows of
people, looks round where it has not seen enough, and comes back at the end. docs/fidelity.md lists what they
leave out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.arrays import Bools, Counts, Floats

from ..._settings import DEFAULTS
from ...flight._limits import DESCENT_MPS, landing_s
from ...flight._paths import BRAKING_MPS2, CORNER_MPS
from ...flight._pilot import FIRST_HEIGHT_M
from ...mission._mission import HURRY_S
from ...mission._planner import TURN_S
from ...mission._search_flight import SEARCH_S
from ..batch._batch import Batch
from ._delays import delayed, first_open_s, slowed_near_people
from ._identification import NEVER_S
from ._paths import RING_MOMENTS, cut_off, lawnmower, path_stretch, ring_stretch
from ._reporting import CLIMB_S, Missions
from ._views import Stretch, Views

# MPC_Z_VEL_MAX_UP of PX4.
CLIMB_MPS = 3.0
DOWN_S = landing_s(DEFAULTS.safe_height_m)
"""From over home, low, to disarmed."""

# Enough that a moment is shorter than a leg; more cost time in proportion. Chosen, not measured.
SEARCH_MOMENTS, HOME_MOMENTS = 32, 12


class FlownMissions(Missions):
    """All missions of a batch, flown when it is made."""

    def __init__(self, batch: Batch) -> None:
        super().__init__(batch)
        self._fly()
        self.views = Views.joined(self._views)
        self.end_s = self._now_s
        self.took_off_s = self._away_s - CLIMB_S
        # An answer that comes when the aircraft is down is of no use; what needs none may still wait for leave
        # to report.
        self.marked_s[(batch.consent_s > 0.0) & (self.marked_s > self.end_s[:, None])] = NEVER_S

    @property
    def away_m(self) -> Floats:
        """(n,) from home, at the end."""
        return np.asarray(np.hypot(*(self.place_m - self.batch.home_m).T))

    def _fly(self) -> None:
        """From the start to the ground."""
        batch, tasks = self.batch, self._task_is.shape[1]
        first_s = np.where(self._task_is, batch.task_delivered_s, np.inf).min(axis=1, initial=np.inf)
        begin_s = np.maximum(self._now_s, np.where(np.isfinite(first_s), first_s, 0.0))
        begin_s = np.minimum(first_open_s(batch.stands_s, begin_s), batch.limit_s)
        self._ended = (batch.ends_s <= begin_s) | (begin_s >= batch.limit_s)
        self._now_s = begin_s + CLIMB_S + np.maximum(batch.floor_m - FIRST_HEIGHT_M, 0.0) / CLIMB_MPS
        self._away_s = self._now_s - np.maximum(batch.floor_m - FIRST_HEIGHT_M, 0.0) / CLIMB_MPS
        for _ in range(4 * tasks):  # a task that was broken off may be taken up again
            if (self._dealt_with | self._ended[:, None]).all() and not np.isfinite(batch.first_s).any():
                break
            rows, task = self._choose()
            if len(rows):
                self._work_on(rows, task)
        for place in range(tasks):
            self._revisit(place)
        self._mark_as_ordered()
        self._go_home()

    # Which task.

    def _choose(self) -> tuple[Counts, Counts]:
        """What is ordered to be next, then the most urgent, then the nearest; later ones are waited for."""
        batch = self.batch
        self._take_up_again()
        away_m = np.hypot(*np.moveaxis(batch.task_m - self.place_m[:, None, :], -1, 0))
        late_s = np.maximum(batch.task_delivered_s - self._now_s[:, None], 0.0)
        key = batch.task_priority * 1e6 + away_m + np.where(late_s > 0.0, 1e9 + 1e6 * late_s, 0.0)
        first = self._is_ordered_first()
        key = np.where(first, -1e10 * (1.0 + np.where(first, batch.first_s, 0.0)), key)
        key = np.where(self._dealt_with | self._ended[:, None], np.inf, key)
        task = key.argmin(axis=1)
        row = np.arange(len(task))
        open_ = ~self._dealt_with[row, task] & ~self._ended
        self._dealt_with[row, task] |= open_
        begin_s = self._now_s + np.where(open_, late_s[row, task], 0.0)
        stood_s = np.minimum(first_open_s(batch.stands_s, begin_s), batch.limit_s)
        begin_s = np.where(begin_s > self._now_s, stood_s, begin_s)
        ended = open_ & (begin_s >= batch.ends_s)
        self._ended |= ended
        self._now_s = np.where(ended, np.maximum(self._now_s, batch.ends_s), self._now_s)
        open_ &= ~ended
        fits = open_ & self._fits(row, task, begin_s, SEARCH_S)
        rows = np.flatnonzero(fits)
        self._now_s[rows] = begin_s[rows]
        return rows, task[rows]

    def _take_up_again(self) -> None:
        """What was given up, and is ordered to be next, waits again."""
        heeds = self._is_ordered_first() & ~self._obeyed_first
        self._obeyed_first |= heeds
        again = heeds & self._dealt_with & self._task_is & np.isinf(self.found_s)
        self._dealt_with &= ~again
        self._passes[again] = 0

    def _fits(self, rows: Counts, task: Counts, begin_s: Floats, work_s: float | Floats) -> Bools:
        """Whether there is time to go to a task, work there for a while, and come home."""
        goal_m = self.batch.task_m[rows, task]
        way_m = self._way_home.way_m(rows, self.place_m[rows], goal_m, begin_s)
        there_s = way_m / self.batch.pace_mps[rows] + TURN_S
        return np.asarray(begin_s + there_s + work_s < self._way_home.latest_s(rows, goal_m, begin_s))

    # One task.

    def _work_on(self, rows: Counts, task: Counts) -> None:
        batch = self.batch
        self.reached[rows] = True
        toward = batch.task_m[rows, task] - self.place_m[rows]
        heading_rad = np.arctan2(toward[:, 0], toward[:, 1]) + self._passes[rows, task] % 2 * np.pi / 2.0
        rows, task, heading_rad = self._search(rows, task, heading_rad)
        if not len(rows):
            return
        path_m = self._lawnmower(
            rows, batch.task_m[rows, task], batch.task_radius_m[rows, task], heading_rad + np.pi / 2.0
        )
        again = self._worth_another(rows, task, path_m)
        if again.any():
            self._search(rows[again], task[again], heading_rad[again] + np.pi / 2.0)

    def _search(self, rows: Counts, task: Counts, heading_rad: Floats) -> tuple[Counts, Counts, Floats]:
        """One pass over a sub-area and what follows; those that have not found and were not called away."""
        batch = self.batch
        self._passes[rows, task] += 1
        path_m = self._lawnmower(rows, batch.task_m[rows, task], batch.task_radius_m[rows, task], heading_rad)
        stays = self._fly_along(rows, path_m, SEARCH_MOMENTS, task=task)
        rows, task, heading_rad = rows[stays], task[stays], heading_rad[stays]
        open_ = self._still_open(rows, task)
        inspected = np.flatnonzero(open_ & (self._identification.frames[rows, task] >= 2.0))
        stays = np.ones(len(rows), dtype=np.bool_)
        if len(inspected):
            members = rows[inspected], task[inspected]
            stays[inspected] = self._fly_around(*members, self._targets_m(*members))
            self._look_round(*(column[stays[inspected]] for column in members))
        unfinished = stays & np.isinf(self.found_s[rows, task]) & ~self._ended[rows]
        return rows[unfinished], task[unfinished], heading_rad[unfinished]

    def _look_round(self, rows: Counts, task: Counts) -> None:
        """After a round: what is identified is reported, by the careful one after a sweep of the unseen."""
        batch = self.batch
        unsettled = np.flatnonzero(self._still_open(rows, task) & np.isfinite(self.found_s[rows, task]))
        if not len(unsettled):
            return
        rows, task = rows[unsettled], task[unsettled]
        toward = batch.task_m[rows, task] - self.place_m[rows]
        around_m = batch.no_mark_m[rows] + DEFAULTS.bystander_margin_m
        path_m = self._lawnmower(
            rows, self._targets_m(rows, task), around_m, np.arctan2(toward[:, 0], toward[:, 1])
        )
        self._fly_along(rows, path_m, RING_MOMENTS)
        at_s = self._now_s[rows]
        self._judge(rows, task, at_s)
        unsettled = np.flatnonzero(~self._settled[rows, task])  # what one sweep does not show stays unseen
        self._report(rows[unsettled], task[unsettled], at_s[unsettled], marks=False)

    def _worth_another(self, rows: Counts, task: Counts, path_m: Floats) -> Counts:
        """A second pass, across, where nothing else waits and there is time."""
        waits = ~self._dealt_with[rows] & (self.batch.task_delivered_s[rows] <= self._now_s[rows][:, None])
        open_ = ~waits.any(axis=1) & (self._passes[rows, task] < 2)
        steps = np.diff(path_m, axis=1)
        work_s = np.hypot(steps[:, :, 0], steps[:, :, 1]).sum(axis=1) / self.batch.speed_mps[rows]
        return np.flatnonzero(open_ & self._fits(rows, task, self._now_s[rows], work_s))

    def _revisit(self, place: int) -> None:
        """Back to a target whose mark was withheld, after all the rest."""
        batch = self.batch
        order = np.argsort(np.where(self._task_is, batch.task_priority, 99), axis=1, kind="stable")[:, place]
        row = np.arange(len(batch))
        withheld = (
            (self.reported_s[row, order] + batch.consent_s[row, order] <= self._now_s)
            & np.isinf(self.marked_s[row, order])
            & ~self._ended
        )
        withheld &= first_open_s(batch.closed_s, self._now_s) <= self._now_s
        round_s = 2.0 * np.pi * self._ring_m / DEFAULTS.inspect_speed_mps
        rows = np.flatnonzero(withheld & self._fits(row, order, self._now_s, round_s))
        if not len(rows):
            return
        chosen = order[rows]
        stays = self._fly_around(rows, chosen, self._targets_m(rows, chosen))
        rows, chosen = rows[stays], chosen[stays]
        at_s = self._now_s[rows]
        # On this round alone: who was there before may have gone.
        known = self._knows(rows, chosen, at_s, first_stretch=-1)
        clear = known.within == 0
        clear[clear] = self._seen_enough(rows[clear], chosen[clear], at_s[clear])
        said_s = first_open_s(batch.closed_s[rows], at_s)
        self.marked_s[rows[clear], chosen[clear]] = said_s[clear]

    def _go_home(self) -> None:
        batch = self.batch
        rows = np.arange(len(batch))
        away_m = np.hypot(*(self.place_m - batch.home_m).T)
        lower_s = np.maximum(batch.height_m - DEFAULTS.safe_height_m, 0.0) / DESCENT_MPS
        goal_m = np.where(batch.returns[:, None], batch.home_m, self.place_m)
        begin_s = self._now_s.copy()
        path_m = self._way_home.paths(rows, np.stack((self.place_m, goal_m), axis=1), begin_s)
        stretch, there_s = path_stretch(rows, path_m, begin_s, batch.speed_mps, batch.height_m, HOME_MOMENTS)
        since_s = np.where(batch.keeps_up, there_s, begin_s)
        high_m = np.maximum(
            batch.height_m[:, None] - DESCENT_MPS * np.maximum(stretch.time_s - since_s[:, None], 0.0),
            DEFAULTS.safe_height_m,
        )
        stretch = replace(stretch, height_m=np.minimum(high_m, stretch.height_m))
        flies = np.where(batch.returns & (away_m > 1e-6), there_s - begin_s, 0.0)
        end_s = begin_s + np.where(batch.keeps_up, flies + lower_s, np.maximum(flies, lower_s))
        stretch, end_s = self._slowed(stretch, end_s)
        home_by_s = self._way_home.latest_s(rows, self.place_m, begin_s)
        stretch, end_s, _ = delayed(batch, stretch, end_s, home_by_s)
        down, down_s = batch.landed_from_s < end_s, np.maximum(batch.landed_from_s, begin_s)
        stretch, place_m = cut_off(stretch, goal_m, np.where(down, down_s, np.inf), self.place_m)
        end_s = np.where(down, down_s + lower_s, end_s)
        self._views.append(self._views_of(stretch, begin_s))
        self.course.append(stretch)
        self.place_m = place_m
        self._notice_in_passing(stretch, self._views[-1], begin_s, end_s, None)
        self._now_s = end_s + DOWN_S
        self._meet_deadlines(rows, begin_s)

    # Flying.

    def _lawnmower(self, rows: Counts, center_m: Floats, radius_m: Floats, heading_rad: Floats) -> Floats:
        batch = self.batch
        near_m = batch.near_edge[rows] * batch.height_m[rows]
        path_m = lawnmower(center_m, radius_m, heading_rad, self._swath_m[rows], near_m, self._middle_m[rows])
        return np.concatenate((self.place_m[rows][:, None, :], path_m), axis=1)

    def _fly_along(self, rows: Counts, path_m: Floats, moments: int, task: Counts | None = None) -> Bools:
        if not len(rows):
            return np.zeros(0, dtype=np.bool_)
        batch, begin_s = self.batch, self._now_s[rows]
        path_m = self._way_home.paths(rows, path_m, begin_s)
        speed_mps, height_m = batch.speed_mps[rows], batch.height_m[rows]
        stretch, end_s = path_stretch(rows, path_m, begin_s, speed_mps, height_m, moments)
        return self._fly_stretch(stretch, end_s, path_m[:, -1], task)

    def _fly_around(self, rows: Counts, task: Counts, center_m: Floats) -> Bools:
        """Once round a target, until that is settled."""
        batch = self.batch
        radius_m = self._ring_m[rows]
        apart_m = self._way_home.way_m(rows, self.place_m[rows], center_m, self._now_s[rows])
        speed_mps = batch.speed_mps[rows]
        braking_s = np.maximum(speed_mps - CORNER_MPS, 0.0) ** 2 / (2.0 * BRAKING_MPS2 * speed_mps)
        there_s = self._now_s[rows] + np.abs(apart_m - radius_m) / speed_mps + braking_s
        place_m, height_m = self.place_m[rows], batch.height_m[rows]
        stretch, end_s = ring_stretch(rows, center_m, place_m, radius_m, there_s, height_m)
        return self._fly_stretch(stretch, end_s, stretch.place_m[:, -1], task, round_it=True)

    def _fly_stretch(
        self,
        stretch: Stretch,
        end_s: Floats,
        place_m: Floats,
        task: Counts | None = None,
        *,
        round_it: bool = False,
    ) -> Bools:
        """Fly a stretch as far as nothing calls away from it; (r,) whether it stays with its task."""
        rows, begin_s = stretch.rows, self._now_s[stretch.rows]
        climbed_m = FIRST_HEIGHT_M + CLIMB_MPS * (stretch.time_s - self._away_s[rows][:, None])
        stretch = replace(stretch, height_m=np.minimum(stretch.height_m, climbed_m))
        stretch, end_s = self._slowed(stretch, end_s)
        stretch, end_s, astray_s = delayed(self.batch, stretch, end_s)
        over_s = self._way_home.turns_back_s(stretch, begin_s, end_s, self._away_s[rows])
        over_s = np.minimum(over_s, np.maximum(np.minimum(astray_s, self.batch.ends_s[rows]), begin_s))
        views = self._views_of(stretch, begin_s)
        leaves_s = np.full(len(rows), np.inf)
        self._views.append(views)
        if task is not None:
            everybody_m = self._everybody_at(rows, begin_s)
            observed = self._identification.observe(rows, task, stretch, views, everybody_m)
            found_s = self._identification.identified_s(observed)
            leaves_s = self._leaves_s(rows, task, found_s, begin_s, end_s, round_it=round_it)
            self._identification.commit(observed, found_s, np.minimum(over_s, leaves_s))
        left_s = np.minimum(over_s, leaves_s)
        self._notice_in_passing(stretch, views, begin_s, np.minimum(left_s, end_s), task)
        cut_s = np.where(left_s < end_s, np.maximum(left_s, begin_s), np.inf)
        if np.isfinite(cut_s).any():
            limit_s = np.full(len(self.batch), np.inf)
            limit_s[rows] = cut_s
            flown = views.time_s <= limit_s[views.row]
            self._views[-1] = views.where(flown)
            stretch, place_m = cut_off(stretch, place_m, cut_s, self.place_m[rows])
        self.course.append(stretch)
        self._now_s[rows] = np.minimum(end_s, cut_s)
        self._meet_deadlines(rows, begin_s)
        self.place_m[rows] = place_m
        self._ended[rows] |= over_s < np.minimum(end_s, np.maximum(leaves_s, begin_s))
        if task is None:
            return ~self._ended[rows]
        diverted = (leaves_s < end_s) & ~self._ended[rows] & np.isinf(self.found_s[rows, task])
        self._dealt_with[rows[diverted], task[diverted]] = False
        leaves: Bools = diverted | self._ended[rows]
        ready = np.flatnonzero(leaves & np.isfinite(self.found_s[rows, task]))
        if len(ready):
            members = rows[ready], task[ready]
            self._judge(*members, self.found_s[members])
        return np.asarray(~leaves)

    def _leaves_s(
        self, rows: Counts, task: Counts, found_s: Floats, begin_s: Floats, end_s: Floats, *, round_it: bool
    ) -> Floats:
        """(r,) when something else is turned to: the target is settled, or another is more urgent; or inf."""
        settles = np.isfinite(found_s) & (found_s <= end_s) & (round_it | (self._passes[rows, task] > 1))
        settles &= ~self._settled[rows, task]
        careful = np.flatnonzero(settles & self.batch.bystander_aware[rows])
        settles[careful] = self._knows(rows[careful], task[careful], found_s[careful]).within > 0
        leaves_s = np.where(settles, np.maximum(found_s, begin_s), np.inf)
        return np.asarray(np.minimum(leaves_s, self._preempted_s(rows, task, found_s, begin_s)))

    def _is_ordered_first(self) -> Bools:
        """(n, k) ordered to be next by now, and known when it was."""
        ordered_s = self.batch.first_s
        return np.asarray((ordered_s <= self._now_s[:, None]) & (self.batch.task_delivered_s <= ordered_s))

    def _preempted_s(self, rows: Counts, task: Counts, found_s: Floats, begin_s: Floats) -> Floats:
        """(r,) when another task that waits is turned to, on a stretch that begins at `begin_s`; inf for never.

        What is more urgent breaks off a search until the target is found, an order always; a second pass gives way to
        whatever has come since.
        """
        batch, row, others = self.batch, np.arange(len(rows)), ~self._dealt_with[rows]
        told_s, rank, first_s = batch.task_delivered_s[rows], batch.task_priority[rows], batch.first_s[rows]
        own_ordered = (first_s[row, task] <= begin_s) & (told_s[row, task] <= first_s[row, task])
        news = others & (told_s > begin_s[:, None])
        urgent = news & (rank < rank[row, task][:, None]) & ~own_ordered[:, None]
        urgent &= told_s < found_s[:, None]
        ordered = others & (told_s <= first_s) & (first_s > begin_s[:, None])
        gives_way = news & ((self._passes[rows, task] > 1) & ~own_ordered)[:, None]
        news_s = np.where(urgent | gives_way, told_s, np.inf).min(axis=1)
        calls_s: Floats = np.minimum(news_s, np.where(ordered, first_s, np.inf).min(axis=1))
        here_m = batch.task_m[rows, task]
        for other in range(others.shape[1]):
            waits = np.flatnonzero(others[:, other] & (told_s[:, other] <= found_s) & np.isfinite(found_s))
            if len(waits):
                waiting_rows, goal_m = rows[waits], batch.task_m[rows[waits], other]
                way_m = self._way_home.way_m(waiting_rows, here_m[waits], goal_m, begin_s[waits])
                way_s = way_m / batch.pace_mps[waiting_rows] + TURN_S + SEARCH_S
                fits_s = self._way_home.latest_s(waiting_rows, goal_m, begin_s[waits]) - way_s
                due_s = batch.task_due_s[waiting_rows, other] - way_s
                hurry_s = np.maximum(np.minimum(fits_s, due_s) - HURRY_S, found_s[waits])
                hurries_s = np.where(hurry_s < fits_s, hurry_s, np.inf)
                calls_s[waits] = np.minimum(calls_s[waits], hurries_s)
        return calls_s

    def _notice_in_passing(
        self, stretch: Stretch, views: Views, begin_s: Floats, until_s: Floats, task: Counts | None
    ) -> None:
        """What is seen of the targets of other tasks counts too; a target that a broken-off search has found is
        reported by the careful one where it is not to be marked.
        """
        batch, rows = self.batch, stretch.rows
        for other in range(batch.task_radius_m.shape[1]):
            waits = self._task_is[rows, other] & ~self._settled[rows, other]
            waits &= np.isfinite(batch.deadline_s[rows]) & (batch.task_delivered_s[rows, other] < until_s)
            at = np.flatnonzero(waits if task is None else waits & (task != other))
            if not len(at):
                continue
            members = rows[at], np.full(len(at), other)
            places_m = self._everybody_at(rows[at], begin_s[at])
            look = self._identification.observe(*members, stretch.select(at), views, places_m)
            found_s = self._identification.identified_s(look)
            self._identification.commit(look, self.found_s[members], until_s[at])
            broken_off = batch.bystander_aware[rows[at]] & (self._passes[members] > 0)
            broken_off &= (found_s <= until_s[at]) & np.isinf(self.found_s[members])
            broken_off &= np.isinf(batch.first_s[members])
            found = at[broken_off]
            if len(found):
                found_rows, others, at_s = rows[found], np.full(len(found), other), found_s[broken_off]
                near = self._knows(found_rows, others, at_s).within > 0
                members = found_rows[near], others[near]
                self._settle(*members, at_s[near])
                self._report(*members, at_s[near], marks=False)

    def _slowed(self, stretch: Stretch, end_s: Floats) -> tuple[Stretch, Floats]:
        everybody_m = self._everybody_at(stretch.rows, self._now_s[stretch.rows])
        return slowed_near_people(self.batch, stretch, end_s, everybody_m)
