"""The looks at the target of each task, until it is identified as the agent identifies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bench.arrays import Bools, Counts, Floats

from ..._settings import DEFAULTS
from ...mission._findings import DEADLINE_FRAMES, DEADLINE_S
from ...perception._tracks import FRAMES_A_LOOK, MOST_LOOKS
from ..batch._batch import Batch
from ..batch._draws import uniform
from ._views import Stretch, Views

MIN_VIEWPOINT_RAD = np.radians(DEFAULTS.min_viewpoint_deg)
# For the confidence that a track reaches. Chosen, not measured.
MEAN_LABEL_SCORE = 0.9
"""Mean score of a right label, for the confidence that a track reaches."""

_STREAM_SEEN, _STREAM_LABEL = 1000, 2000
_NEXT_LOOK = np.uint64(1_000_003)
NEVER_S = np.inf


class Identification:
    """What has been seen of the target of each task (n, k) so far; a task taken up again goes on."""

    def __init__(self, batch: Batch) -> None:
        shape = batch.task_radius_m.shape
        self.found_s = np.full(shape, NEVER_S)
        self.frames = np.zeros(shape)
        self._batch = batch
        self._right = np.zeros(shape)
        self._from = np.full(shape, np.nan)  # direction of the first sighting, and the spread to either side
        self._low = np.zeros(shape)
        self._high = np.zeros(shape)
        self._looks = np.zeros(shape, dtype=np.uint64)

    def observe(
        self, rows: Counts, task: Counts, stretch: Stretch, views: Views, places_m: Floats
    ) -> TargetLook:
        """What a stretch showed of the targets of these tasks. Nothing counts before `take`."""
        batch, size, moments = self._batch, len(rows), stretch.time_s.shape[1]
        actor = batch.task_actor[rows, task]
        index = np.full(len(batch), -1)
        index[rows] = np.arange(size)
        seen = views.where((index[views.row] >= 0) & (views.actor == actor[np.maximum(index[views.row], 0)]))
        at = (index[seen.row], seen.moment)
        frames, detection, wrong = (np.zeros((size, moments)) for _ in range(3))
        frames[at], detection[at], wrong[at] = seen.frames, seen.detection, seen.mislabel
        seeds = batch.seeds[rows] + (actor + 1).astype(np.uint64) + _NEXT_LOOK * self._looks[rows, task]
        sighted = (uniform(seeds, _STREAM_SEEN, moments) < detection) & (frames > 0.0)
        label = np.repeat(uniform(seeds, _STREAM_LABEL, -(-moments // 4)), 4, axis=1)[:, :moments]
        away_m = stretch.place_m - places_m[np.arange(size), np.maximum(actor, 0)][:, None]
        bearing_rad = np.arctan2(away_m[:, :, 0], away_m[:, :, 1])
        return TargetLook(rows, task, stretch.time_s, sighted, label >= wrong, frames, bearing_rad)

    def identified_s(self, look: TargetLook) -> Floats:
        """(r,) when each of these targets is identified: before the stretch, during it, or never."""
        state = self._after(look, look.sighted)
        rows, task = look.rows, look.task
        least = self._batch.min_confidence[rows][:, None]
        confident = _confident(state.right_frames, state.seen_frames, least)
        enough_angle = state.high - state.low >= MIN_VIEWPOINT_RAD
        identified = (
            look.sighted & look.right & confident & enough_angle & (state.seen_frames >= DEFAULTS.min_frames)
        )
        due_s = (self._batch.task_delivered_s[rows, task] + self._batch.deadline_s[rows])[:, None]
        late = (look.time_s >= due_s - DEADLINE_S) & (look.time_s < due_s)
        identified |= late & confident & (state.seen_frames >= DEADLINE_FRAMES)
        at = identified.argmax(axis=1)
        when_s = np.where(identified.any(axis=1), look.time_s[np.arange(len(rows)), at], NEVER_S)
        return np.asarray(np.minimum(self.found_s[rows, task], when_s))

    def commit(self, look: TargetLook, found_s: Floats, until_s: Floats) -> None:
        """What was sighted up to a moment (r,) counts; what would have been found after it was not."""
        rows, task = look.rows, look.task
        state = self._after(look, look.sighted & (look.time_s <= until_s[:, None]))
        self.found_s[rows, task] = np.where(found_s <= until_s, found_s, self.found_s[rows, task])
        self.frames[rows, task], self._right[rows, task] = state.seen_frames[:, -1], state.right_frames[:, -1]
        self._low[rows, task], self._high[rows, task] = state.low[:, -1], state.high[:, -1]
        self._from[rows, task] = state.first_rad
        self._looks[rows, task] += np.uint64(1)

    def good_enough(self, rows: Counts, task: Counts) -> Bools:
        """(r,) whether what has been sighted so far is enough for a report that falls due."""
        seen = self.frames[rows, task]
        confident = _confident(self._right[rows, task], seen, self._batch.min_confidence[rows])
        return np.asarray(confident & (seen >= DEADLINE_FRAMES))

    def _after(self, look: TargetLook, sighted: Bools) -> _SeenSoFar:
        """Moment by moment (r, j): how often, how rightly and from how wide an angle it has been sighted."""
        row, here = np.arange(len(sighted)), (look.rows, look.task)
        first_rad, begins = self._from[here], sighted.any(axis=1)
        begins &= np.isnan(first_rad)
        first_rad = np.where(begins, look.bearing_rad[row, sighted.argmax(axis=1)], first_rad)
        turned = _wrapped(look.bearing_rad - np.nan_to_num(first_rad)[:, None])
        # A moment stands for its span: the angle that goes by from its beginning to its end has been sighted.
        step = 0.5 * _wrapped(np.diff(look.bearing_rad, axis=1))
        begin = turned - np.concatenate((step[:, :1], step), axis=1)
        end = turned + np.concatenate((step, step[:, -1:]), axis=1)
        low = np.minimum.accumulate(np.where(sighted, np.minimum(begin, end), 0.0), axis=1)
        high = np.maximum.accumulate(np.where(sighted, np.maximum(begin, end), 0.0), axis=1)
        low, high = np.minimum(low, self._low[here][:, None]), np.maximum(high, self._high[here][:, None])
        frames = np.where(sighted, look.frames, 0.0)
        had = np.cumsum(frames, axis=1) + self.frames[here][:, None]
        right = np.cumsum(np.where(look.right, frames, 0.0), axis=1) + self._right[here][:, None]
        return _SeenSoFar(had, right, low, high, first_rad)


class TargetLook(NamedTuple):
    """One stretch's looks at targets, (r, j) each: whether sighted, rightly labelled, in how many frames."""

    rows: Counts
    task: Counts
    time_s: Floats
    sighted: Bools
    right: Bools
    frames: Floats
    bearing_rad: Floats


class _SeenSoFar(NamedTuple):
    seen_frames: Floats
    right_frames: Floats
    low: Floats
    high: Floats
    first_rad: Floats


def _confident(right_frames: Floats, seen_frames: Floats, least: Floats) -> Bools:
    looks = np.clip(right_frames / FRAMES_A_LOOK, 1.0, MOST_LOOKS)
    share = right_frames / np.maximum(seen_frames, 1e-9)
    return np.asarray((share * (1.0 - (1.0 - MEAN_LABEL_SCORE) ** looks) >= least) & (share > 0.5))


def _wrapped(angle_rad: Floats) -> Floats:
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)
