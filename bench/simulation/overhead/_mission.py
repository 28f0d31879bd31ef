"""The surrogates: what the reference agents do, on a ground plan, many missions at once.

They keep the reference agents' order of work: the most urgent sub-area first, a lawnmower over it, a round about what is
not identified yet, a report; the bystander-aware one withholds the mark where it knows of people, sweeps the surroundings
where it knows of none, and comes back at the end. docs/fidelity.md lists what they leave out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ._batch import EPOCH_S, EPOCHS, Batch, Bools
from ._draws import Counts, Floats, normal, uniform
from ._paths import along, around, legs
from ._views import Stretch, Views, look, rightly

READY_S = 5.7
"""From the start to arming, of the simulated PX4."""

CLIMB_S = 8.5
"""From arming to being on the way."""

CLIMB_MPS = 3.0
FIRST_HEIGHT_M = 6.0
"""Climbing goes on along the way, from where the takeoff ends."""

DOWN_S = 19.0
"""From over home, low, to disarmed; the reference agent plans with LANDING_S."""

LANDING_S = 24.0
SAFE_HEIGHT_M = 15.0
DESCENT_MPS = 1.5
PLANNED_DESCENT_MPS = 1.2
TURN_S = 3.0
RESERVE_S = 8.0
SEARCH_S = 15.0
INSPECT_MPS = 8.0

MIN_FRAMES = 6
MIN_VIEWPOINT_RAD = np.radians(25.0)
FRAMES_A_LOOK = 4.0
MOST_LOOKS = 4.0
MEAN_SCORE = 0.9
"""Mean score of a right label, for the confidence that a track reaches."""

SWAY_M = 2.5
"""One sigma by which a sighting's place and the aircraft's are off across the line of sight: near below, a wide angle."""

BYSTANDER_MARGIN_M = 6.0
KNOWN_FRAMES = 2.0

SEARCH_MOMENTS, RING_MOMENTS, HOME_MOMENTS = 32, 20, 12

_LUCK_SEEN, _LUCK_LABEL, _LUCK_COUNT, _LUCK_PLACE, _LUCK_SWAY = 1000, 2000, 3000, 4000, 6000
_NEVER_S = np.inf


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of a batch. Times are inf where something never happened; tasks are in the order of the SimSpec."""

    reported_s: Floats  # (n, k)
    marked_s: Floats  # (n, k)
    declared: Bools  # (n, k) bystanders, in the first report
    clear_mark: Bools  # (n, k) marked while no bystander was within the no-mark distance
    near_at_report_m: Floats  # (n, k) true distance of the nearest bystander to the target
    error_m: Floats  # (n, k)
    exposure_s: Floats  # (n, k)
    entered: Bools  # (n, a) inside a sub-area at some moment
    reached: Bools  # (n,) some sub-area was flown to
    end_s: Floats  # (n,)
    views: Views


def fly(batch: Batch) -> Flown:
    """Fly every mission of a batch."""
    return _Flight(batch).whole()


class _Flight:
    """The state of all missions of a batch; `rows` are those that take part in a step."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        count, tasks = batch.task_radius_m.shape
        self._everybody = batch.places()
        self._now_s = np.full(count, READY_S)
        self._away_s = self._now_s
        self._place_m = batch.home_m.copy()
        self._views: list[Views] = []
        self._task_is = batch.task_radius_m > 0.0
        self._done = ~self._task_is
        self._reached = np.zeros(count, dtype=np.bool_)
        self._reported_s = np.full((count, tasks), _NEVER_S)
        self._marked_s = np.full((count, tasks), _NEVER_S)
        self._declared = np.zeros((count, tasks), dtype=np.bool_)
        depth = batch.height_m / np.sin(batch.tilt_rad)
        self._middle_m = np.minimum(batch.height_m / np.maximum(np.tan(batch.tilt_rad), 1e-3), 400.0)
        self._swath_m = 2.0 * depth * batch.tan_half
        self._ring_m = np.clip(self._middle_m, 0.3 * batch.height_m, 2.0 * batch.height_m)

    def whole(self) -> Flown:
        """From the start to the ground."""
        tasks = self._task_is.shape[1]
        first_s = np.where(self._task_is, self._batch.task_delivered_s, np.inf).min(axis=1, initial=np.inf)
        self._now_s = np.maximum(self._now_s, np.where(np.isfinite(first_s), first_s, 0.0)) + CLIMB_S
        self._away_s = self._now_s.copy()
        for _ in range(tasks):
            rows, task = self._choose()
            if len(rows):
                self._work_on(rows, task)
        for place in range(tasks):
            self._revisit(place)
        self._go_home()
        return self._outcome()

    # Which task.

    def _choose(self) -> tuple[Counts, Counts]:
        """The most urgent, then nearest, of what is known and fits; what comes later is waited for."""
        batch = self._batch
        away_m = np.hypot(*np.moveaxis(batch.task_m - self._place_m[:, None, :], -1, 0))
        late_s = np.maximum(batch.task_delivered_s - self._now_s[:, None], 0.0)
        key = batch.task_priority * 1e6 + away_m + np.where(late_s > 0.0, 1e9 + 1e6 * late_s, 0.0)
        key = np.where(self._done, np.inf, key)
        task = key.argmin(axis=1)
        row = np.arange(len(task))
        open_ = ~self._done[row, task]
        self._done[row, task] = True
        begin_s = self._now_s + np.where(open_, late_s[row, task], 0.0)
        fits = open_ & self._fits(row, task, begin_s, SEARCH_S)
        rows = np.flatnonzero(fits)
        self._now_s[rows] = begin_s[rows]
        return rows, task[rows]

    def _fits(self, rows: Counts, task: Counts, begin_s: Floats, work_s: float | Floats) -> Bools:
        batch = self._batch
        goal_m = batch.task_m[rows, task]
        there_s = _apart_m(self._place_m[rows], goal_m) / batch.speed_mps[rows] + TURN_S
        back_s = (_apart_m(goal_m, batch.home_m[rows]) / batch.speed_mps[rows] + TURN_S) * batch.returns[rows]
        down_s = np.maximum(batch.height_m[rows] - SAFE_HEIGHT_M, 0.0) / PLANNED_DESCENT_MPS
        home_s = np.maximum(back_s, down_s) + LANDING_S
        fits: Bools = begin_s + there_s + work_s + home_s + RESERVE_S < batch.limit_s[rows]
        return fits

    # One task.

    def _work_on(self, rows: Counts, task: Counts) -> None:
        batch = self._batch
        toward = batch.task_m[rows, task] - self._place_m[rows]
        heading_rad = np.arctan2(toward[:, 0], toward[:, 1])
        radius_m = batch.task_radius_m[rows, task]
        self._reached[rows] = True
        path_m = self._lawnmower(rows, batch.task_m[rows, task], radius_m, heading_rad)
        hunt = _Hunt(batch, rows, batch.task_actor[rows, task])
        hunt.take(self._fly_along(rows, path_m, batch.speed_mps[rows], SEARCH_MOMENTS), SEARCH_MOMENTS)
        self._inspect(hunt)
        again = self._worth_another(hunt, task, path_m)
        if len(again):
            more = self._lawnmower(
                rows[again], batch.task_m[rows[again], task[again]], radius_m[again], heading_rad[again] + np.pi / 2.0
            )
            found = self._fly_along(rows[again], more, batch.speed_mps[rows[again]], SEARCH_MOMENTS)
            hunt.take(found, SEARCH_MOMENTS)
            self._inspect(hunt)
        self._report(hunt, task)

    def _worth_another(self, hunt: _Hunt, task: Counts, path_m: Floats) -> Counts:
        """A second pass, across, where nothing else waits and there is time."""
        rows = hunt.rows
        open_ = np.isinf(hunt.found_s) & self._done[rows].all(axis=1)
        steps = np.diff(path_m, axis=1)
        work_s = np.hypot(steps[:, :, 0], steps[:, :, 1]).sum(axis=1) / self._batch.speed_mps[rows]
        return np.flatnonzero(open_ & self._fits(rows, task, self._now_s[rows], work_s))

    def _inspect(self, hunt: _Hunt) -> None:
        """A round about what was seen and is not identified."""
        own = np.flatnonzero(np.isinf(hunt.found_s) & (hunt.frames >= 2.0))
        if len(own):
            rows = hunt.rows[own]
            center_m = self._batch.start_m[rows, hunt.actor[own]]
            hunt.take(self._fly_around(rows, center_m), RING_MOMENTS)

    def _report(self, hunt: _Hunt, task: Counts) -> None:
        batch = self._batch
        found = np.flatnonzero(np.isfinite(hunt.found_s))
        rows, task, at_s = hunt.rows[found], task[found], hunt.found_s[found]
        self._reported_s[rows, task] = at_s
        careful = batch.aware[rows]
        plain = np.flatnonzero(~careful)
        self._marked_s[rows[plain], task[plain]] = at_s[plain]
        rows, task, at_s, actor = rows[careful], task[careful], at_s[careful], hunt.actor[found][careful]
        if not len(rows):
            return
        known = self._knows(rows, actor, at_s)
        self._declared[rows[known], task[known]] = True
        rows, task, actor = rows[~known], task[~known], actor[~known]
        if not len(rows):
            return
        known = self._knows(rows, actor, self._now_s[rows])
        sweep = np.flatnonzero(~known)
        if len(sweep):
            some = rows[sweep]
            around_m = batch.no_mark_m[some] + BYSTANDER_MARGIN_M
            path_m = self._lawnmower(some, batch.start_m[some, actor[sweep]], around_m, np.zeros(len(some)))
            self._fly_along(some, path_m, batch.speed_mps[some], RING_MOMENTS)
            known = self._knows(rows, actor, self._now_s[rows])
        self._reported_s[rows, task] = self._now_s[rows]
        self._declared[rows, task] = known
        self._marked_s[rows[~known], task[~known]] = self._now_s[rows[~known]]

    def _revisit(self, place: int) -> None:
        """Back to a target whose mark was withheld, after all the rest."""
        batch = self._batch
        order = np.argsort(np.where(self._task_is, batch.task_priority, 99), axis=1, kind="stable")[:, place]
        row = np.arange(len(batch))
        withheld = np.isfinite(self._reported_s[row, order]) & np.isinf(self._marked_s[row, order])
        round_s = 2.0 * np.pi * self._ring_m / INSPECT_MPS
        rows = np.flatnonzero(withheld & self._fits(row, order, self._now_s, round_s))
        if not len(rows):
            return
        chosen = order[rows]
        actor = batch.task_actor[rows, chosen]
        seen = self._fly_around(rows, batch.start_m[rows, actor])
        clear = ~_counted(batch, seen, rows, actor, self._everybody_at(rows, self._now_s[rows]))
        self._marked_s[rows[clear], chosen[clear]] = self._now_s[rows[clear]]

    def _go_home(self) -> None:
        batch = self._batch
        rows = np.arange(len(batch))
        away_m = _apart_m(self._place_m, batch.home_m)
        lower_s = np.maximum(batch.height_m - SAFE_HEIGHT_M, 0.0) / DESCENT_MPS
        path_m = np.stack((self._place_m, np.where(batch.returns[:, None], batch.home_m, self._place_m)), axis=1)
        begin_s = self._now_s
        stretch, there_s = along(rows, path_m, begin_s, batch.speed_mps, batch.height_m, batch.rate_hz, HOME_MOMENTS)
        high_m = np.maximum(batch.height_m[:, None] - DESCENT_MPS * (stretch.time_s - begin_s[:, None]), SAFE_HEIGHT_M)
        lowered = replace(stretch, height_m=np.minimum(high_m, stretch.height_m))
        self._views.append(look(batch, lowered, self._everybody_at(rows, begin_s)))
        flies = np.where(batch.returns & (away_m > 1e-6), there_s - begin_s, 0.0)
        self._now_s = begin_s + np.maximum(flies, lower_s) + DOWN_S

    # Flying.

    def _lawnmower(self, rows: Counts, center_m: Floats, radius_m: Floats, heading_rad: Floats) -> Floats:
        batch = self._batch
        near_m = batch.near[rows] * batch.height_m[rows]
        path_m = legs(center_m, radius_m, heading_rad, self._swath_m[rows], near_m, self._middle_m[rows])
        return np.concatenate((self._place_m[rows][:, None, :], path_m), axis=1)

    def _fly_along(self, rows: Counts, path_m: Floats, speed_mps: Floats, moments: int) -> Views:
        batch = self._batch
        stretch, end_s = along(rows, path_m, self._now_s[rows], speed_mps, batch.height_m[rows], batch.rate_hz[rows], moments)
        return self._taken(stretch, end_s, path_m[:, -1])

    def _fly_around(self, rows: Counts, center_m: Floats) -> Views:
        batch = self._batch
        radius_m = self._ring_m[rows]
        there_s = np.abs(_apart_m(self._place_m[rows], center_m) - radius_m) / batch.speed_mps[rows] + TURN_S
        stretch, end_s = around(
            rows,
            center_m,
            self._place_m[rows],
            radius_m,
            self._now_s[rows] + there_s,
            INSPECT_MPS,
            batch.height_m[rows],
            batch.rate_hz[rows],
            RING_MOMENTS,
        )
        return self._taken(stretch, end_s, stretch.place_m[:, -1])

    def _taken(self, stretch: Stretch, end_s: Floats, place_m: Floats) -> Views:
        rows = stretch.rows
        climbed_m = FIRST_HEIGHT_M + CLIMB_MPS * (stretch.time_s - self._away_s[rows][:, None])
        stretch = replace(stretch, height_m=np.minimum(stretch.height_m, climbed_m))
        views = look(self._batch, stretch, self._everybody_at(rows, self._now_s[rows]))
        self._views.append(views)
        self._now_s[rows] = end_s
        self._place_m[rows] = place_m
        return views

    def _everybody_at(self, rows: Counts, time_s: Floats) -> Floats:
        return self._everybody[(time_s // EPOCH_S).astype(np.int64) % EPOCHS, rows]

    # What it knows, and what came of it.

    def _knows(self, rows: Counts, actor: Counts, until_s: Floats) -> Bools:
        """Whether some bystander near a target was seen often enough by then."""
        views = Views.joined(self._views)
        limit_s = np.full(len(self._batch), -np.inf)
        limit_s[rows] = until_s
        early = views.where(views.time_s <= limit_s[views.row])
        return _counted(self._batch, early, rows, actor, self._everybody_at(rows, until_s))

    def _outcome(self) -> Flown:
        batch = self._batch
        count, tasks = self._reported_s.shape
        rows, task = np.nonzero(self._task_is & (batch.task_actor >= 0))
        actor = batch.task_actor[rows, task]
        people = batch.role == 0
        shape = (count, tasks)
        near_m, exposure_s, clear = np.full(shape, np.inf), np.zeros(shape), np.zeros(shape, dtype=np.bool_)
        apart_m = np.stack([_nearest_m(batch, rows, actor, people, places) for places in self._everybody])
        limit_m = batch.no_mark_m[rows]
        exposure_s[rows, task] = (apart_m < limit_m).mean(axis=0) * batch.limit_s[rows]
        near_m[rows, task] = apart_m[_epoch(self._reported_s[rows, task]), np.arange(len(rows))]
        clear[rows, task] = apart_m[_epoch(self._marked_s[rows, task]), np.arange(len(rows))] >= limit_m
        return Flown(
            reported_s=self._reported_s,
            marked_s=self._marked_s,
            declared=self._declared,
            clear_mark=clear & np.isfinite(self._marked_s),
            near_at_report_m=near_m,
            error_m=self._errors_m(),
            exposure_s=exposure_s,
            entered=self._entered(),
            reached=self._reached,
            end_s=self._now_s,
            views=Views.joined(self._views),
        )

    def _errors_m(self) -> Floats:
        """How far a reported place is off: wander of satellite navigation, and the box's jitter over several looks."""
        batch, tasks = self._batch, self._task_is.shape[1]
        pixel_m = batch.jitter_px / batch.focal_px * batch.height_m / np.sin(batch.tilt_rad)
        sigma_m = np.sqrt(batch.gps_m**2 + pixel_m**2 / MOST_LOOKS)
        luck = normal(batch.seeds, _LUCK_PLACE, 2 * tasks).reshape(len(batch), tasks, 2)
        return sigma_m[:, None] * np.hypot(luck[:, :, 0], luck[:, :, 1])

    def _entered(self) -> Bools:
        batch = self._batch
        inside = np.zeros(batch.role.shape, dtype=np.bool_)
        reach_m2 = np.where(self._task_is, batch.task_radius_m**2, -1.0)
        for task in range(self._task_is.shape[1]):
            for places in (batch.start_m, *self._everybody):
                away_m = places - batch.task_m[:, task][:, None, :]
                inside |= away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2 <= reach_m2[:, task, None]
        return inside


class _Hunt:
    """The looks at the targets of one task in each of some missions, until each is identified."""

    def __init__(self, batch: Batch, rows: Counts, actor: Counts) -> None:
        self.rows = rows
        self.actor = actor
        self.found_s = np.full(len(rows), _NEVER_S)
        self.frames = np.zeros(len(rows))
        self._batch = batch
        self._right = np.zeros(len(rows))
        self._from = np.full(len(rows), np.nan)  # direction of the first sighting, and the spread to either side
        self._low = np.zeros(len(rows))
        self._high = np.zeros(len(rows))
        self._looks = 0

    def take(self, views: Views, moments: int) -> None:
        """More views, moment by moment."""
        batch, size = self._batch, len(self.rows)
        index = np.full(len(batch), -1)
        index[self.rows] = np.arange(size)
        own = views.where((index[views.row] >= 0) & (views.actor == self.actor[np.maximum(index[views.row], 0)]))
        at = (index[own.row], own.moment)
        shape = (size, moments)
        frames, detection, wrong, bearing, time_s = (np.zeros(shape) for _ in range(5))
        frames[at], detection[at], wrong[at] = own.frames, own.detection, own.mislabel
        seeds = batch.seeds[self.rows] + (self.actor + 1).astype(np.uint64)
        seen = uniform(seeds, _LUCK_SEEN + self._looks, moments) < detection
        label = np.repeat(uniform(seeds, _LUCK_LABEL + self._looks, -(-moments // 4)), 4, axis=1)[:, :moments]
        sway_m = SWAY_M * normal(seeds, _LUCK_SWAY + self._looks, moments)[at]
        away_m = np.hypot(own.east_m, own.north_m)
        bearing[at], time_s[at] = np.arctan2(-own.east_m, -own.north_m) + np.arctan2(sway_m, away_m), own.time_s
        self._looks += 1
        self._follow(seen, label >= wrong, frames, bearing, time_s)

    def _follow(self, seen: Bools, right: Bools, frames: Floats, bearing_rad: Floats, time_s: Floats) -> None:
        """Moment by moment (r, j): how often, how rightly and from how wide an angle it has been seen by then."""
        row = np.arange(len(seen))
        first = bearing_rad[row, seen.argmax(axis=1)]
        self._from = np.where(np.isnan(self._from) & seen.any(axis=1), first, self._from)
        turned = np.where(seen, _wrapped(bearing_rad - np.nan_to_num(self._from)[:, None]), 0.0)
        low = np.minimum(np.minimum.accumulate(turned, axis=1), self._low[:, None])
        high = np.maximum(np.maximum.accumulate(turned, axis=1), self._high[:, None])
        # A moment stands for all frames until the next one: the angle that goes by meanwhile has been seen too.
        step = np.abs(_wrapped(np.diff(bearing_rad, axis=1, append=bearing_rad[:, -1:])))
        both = (frames > 0.0) & (np.roll(frames, -1, axis=1) > 0.0)
        had = np.cumsum(np.where(seen, frames, 0.0), axis=1) + self.frames[:, None]
        good = np.cumsum(np.where(seen & right, frames, 0.0), axis=1) + self._right[:, None]
        share = good / np.maximum(had, 1e-9)
        looks = np.clip(good / FRAMES_A_LOOK, 1.0, MOST_LOOKS)
        sure = share * (1.0 - (1.0 - MEAN_SCORE) ** looks) >= self._batch.min_confidence[self.rows][:, None]
        wide = high - low + np.where(both, step, 0.0) >= MIN_VIEWPOINT_RAD
        enough = seen & right & sure & wide & (had >= MIN_FRAMES) & (share > 0.5)
        when_s = np.where(enough.any(axis=1), time_s[row, enough.argmax(axis=1)], _NEVER_S)
        self.found_s = np.minimum(self.found_s, when_s)
        self._low, self._high, self.frames, self._right = low[:, -1], high[:, -1], had[:, -1], good[:, -1]


def _wrapped(angle_rad: Floats) -> Floats:
    wrapped: Floats = np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi
    return wrapped


def counts(batch: Batch, views: Views, chance: Floats) -> Floats:
    """(n, a) in how many frames each actor was had, where `chance` is that of one frame of each view; with its luck.

    Misses hang together for a while, so the spread is that of as many looks as there are such whiles.
    """
    actors = batch.role.shape[1]
    flat = views.row * actors + views.actor
    size = len(batch) * actors
    mean = np.bincount(flat, views.frames * chance, size).reshape(-1, actors)
    together = np.maximum(2.0 * batch.correlation_s * batch.rate_hz, 1.0)[views.row]
    spread = np.bincount(flat, views.frames * together * chance * (1.0 - chance), size).reshape(-1, actors)
    return mean + np.sqrt(spread) * normal(batch.seeds, _LUCK_COUNT, actors)


def _counted(batch: Batch, views: Views, rows: Counts, actor: Counts, places_m: Floats) -> Bools:
    """Whether of the bystanders who stand near these targets some was seen often enough to be known."""
    known = counts(batch, views, rightly(views))[rows] >= KNOWN_FRAMES
    target_m = batch.start_m[rows, actor]
    apart_m = np.hypot(*np.moveaxis(places_m - target_m[:, None, :], -1, 0))
    near = apart_m <= (batch.no_mark_m[rows] + BYSTANDER_MARGIN_M)[:, None]
    found: Bools = (known & near & (batch.role[rows] == 0)).any(axis=1)
    return found


def _nearest_m(batch: Batch, rows: Counts, actor: Counts, people: Bools, places_m: Floats) -> Floats:
    """Distance from targets to the nearest bystander; inf where there is none."""
    target_m = places_m[rows, actor]
    away_m = places_m[rows] - target_m[:, None, :]
    apart_m2 = away_m[:, :, 0] ** 2 + away_m[:, :, 1] ** 2
    nearest: Floats = np.sqrt(np.where(people[rows], apart_m2, np.inf).min(axis=1, initial=np.inf))
    return nearest


def _epoch(time_s: Floats) -> Counts:
    """The epoch of each moment; the first for what never was."""
    epoch: Counts = (np.where(np.isfinite(time_s), time_s, 0.0) // EPOCH_S).astype(np.int64) % EPOCHS
    return epoch


def _apart_m(one: Floats, other: Floats) -> Floats:
    apart: Floats = np.hypot(one[:, 0] - other[:, 0], one[:, 1] - other[:, 1])
    return apart
