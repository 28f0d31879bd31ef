"""The way home, how long it takes, and when it must be taken: by the time or the charge left."""

from __future__ import annotations

import numpy as np

from bench.arrays import Counts, Floats

from ..._settings import DEFAULTS
from ...flight._limits import DESCENT_MPS, landing_s
from ...flight._reserve import BATTERY_MARGIN, CHARGE_SPARE_S
from ...mission._planner import TURN_S
from ..batch._airspace import SurrogateAirspace, in_arrays, padded
from ..batch._batch import Batch
from ._views import Stretch


class WayHome:
    """Ways and times of a batch, round what is forbidden at the moment."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._closed = any(airspace is not None for airspace in batch.airspaces)
        left = batch.charge_fraction - batch.use_per_s * batch.limit_s
        self._has_spare = (left > batch.reserve + 0.25) & np.isinf(batch.charge_s)

    def way_m(self, rows: Counts, begin_m: Floats, end_m: Floats, now_s: Floats) -> Floats:
        """(r,) lengths of the ways that may be flown between places."""
        length_m: Floats = np.hypot(end_m[:, 0] - begin_m[:, 0], end_m[:, 1] - begin_m[:, 1])
        for members, space in self._spaces(rows, now_s):
            length_m[members] = space.length_m(begin_m[members], end_m[members])
        return length_m

    def paths(self, rows: Counts, corners_m: Floats, now_s: Floats) -> Floats:
        """Paths (r, w, 2) round what is forbidden, with more corners where that takes some."""
        if not self._closed:
            return corners_m
        routed = [(members, space.paths(corners_m[members])) for members, space in self._spaces(rows, now_s)]
        longest = max([corners_m.shape[1], *(path.shape[1] for _, path in routed)])
        lengthened = padded(corners_m, longest)
        for members, path in routed:
            lengthened[members] = padded(path, longest)
        return lengthened

    def latest_s(self, rows: Counts, place_m: Floats, now_s: Floats) -> Floats:
        """(r,) when it has to leave a place, to be home in time."""
        return np.asarray(self._batch.limit_s[rows] - DEFAULTS.reserve_s - self._home_s(rows, place_m, now_s))

    def turns_back_s(self, stretch: Stretch, begin_s: Floats, end_s: Floats, away_s: Floats) -> Floats:
        """(r,) when a stretch has to be left for home; inf where it can be flown to its end."""
        batch, rows = self._batch, stretch.rows
        turns_s = np.full(len(rows), np.inf)
        farthest_m = np.hypot(*np.moveaxis(stretch.place_m - batch.home_m[rows][:, None], -1, 0)).max(axis=1)
        # Where there is time enough even from the farthest place by a way twice as long, nothing has to be
        # looked at closely.
        latest_s = end_s + self._spent_s(rows, 2.0 * farthest_m) + DEFAULTS.reserve_s
        tight = np.flatnonzero((latest_s >= batch.limit_s[rows]) | ~self._has_spare[rows])
        if len(tight):
            times_s = begin_s[tight], end_s[tight], away_s[tight]
            turns_s[tight] = self._must_turn_s(stretch.select(tight), *times_s)
        return turns_s

    def _must_turn_s(self, stretch: Stretch, begin_s: Floats, end_s: Floats, away_s: Floats) -> Floats:
        batch, rows = self._batch, stretch.rows
        time_s = np.column_stack((stretch.time_s, end_s))  # it may wait at the very end
        before_s = np.column_stack((begin_s, time_s[:, :-1]))
        place_m = np.concatenate((stretch.place_m, stretch.place_m[:, -1:]), axis=1)
        now_s = np.where(np.isfinite(time_s), time_s, 0.0).ravel()
        every_row = np.repeat(rows, time_s.shape[1])
        home_s = self._home_s(every_row, place_m.reshape(-1, 2), now_s).reshape(time_s.shape)
        latest_s = batch.limit_s[rows][:, None] - DEFAULTS.reserve_s - home_s
        by_time_s = np.where(time_s >= latest_s, np.maximum(latest_s, before_s), np.inf)
        charge_at_s = np.where(np.isfinite(time_s), time_s, batch.limit_s[rows][:, None])
        charge = self.charge_at(rows, charge_at_s, away_s)
        needed = batch.use_per_s[rows][:, None] * (home_s + CHARGE_SPARE_S) + BATTERY_MARGIN
        short = charge <= np.maximum(batch.reserve[rows][:, None] + needed, DEFAULTS.min_battery)
        fell_s = batch.charge_s[rows][:, None]
        falls = (before_s < fell_s) & (fell_s <= time_s)
        when_s = np.where(falls, fell_s, np.where(np.isfinite(time_s), time_s, before_s))
        return np.asarray(np.minimum(by_time_s, np.where(short, when_s, np.inf)).min(axis=1))

    def charge_at(self, rows: Counts, time_s: Floats, away_s: Floats) -> Floats:
        """Charge at moments (r, j) of missions that took off at `away_s`."""
        batch = self._batch
        since_s = np.maximum(time_s - away_s[:, None], 0.0)
        full = batch.charge_fraction[rows][:, None] - batch.use_per_s[rows][:, None] * since_s
        fell_s = batch.charge_s[rows][:, None]
        after_s = np.where(
            np.isfinite(fell_s), np.maximum(time_s - np.where(np.isfinite(fell_s), fell_s, 0.0), 0.0), 0.0
        )
        after_drop = batch.charge_left[rows][:, None] - batch.use_per_s[rows][:, None] * after_s
        return np.asarray(np.where(time_s >= fell_s, np.minimum(full, after_drop), full))

    def _home_s(self, rows: Counts, place_m: Floats, now_s: Floats) -> Floats:
        """Time from a place at mission height to disarmed on the ground, as the agent reckons it."""
        return self._spent_s(rows, self.way_m(rows, place_m, self._batch.home_m[rows], now_s))

    def _spent_s(self, rows: Counts, away_m: Floats) -> Floats:
        batch = self._batch
        back_s = (away_m / batch.pace_mps[rows] + TURN_S) * batch.returns[rows]
        down_s = np.maximum(batch.height_m[rows] - DEFAULTS.safe_height_m, 0.0) / DESCENT_MPS
        to_safe_s = np.where(batch.keeps_up[rows], back_s + down_s, np.maximum(back_s, down_s))
        return np.asarray(to_safe_s + landing_s(DEFAULTS.safe_height_m))

    def _spaces(self, rows: Counts, now_s: Floats) -> list[tuple[Counts, SurrogateAirspace]]:
        """The rows (by their place among these) that have an airspace, with what is in force there."""
        if not self._closed:
            return []
        members: dict[SurrogateAirspace, list[int]] = {}
        for index, airspaces in enumerate(self._batch.airspaces[rows]):
            if airspaces is not None:
                members.setdefault(in_arrays(airspaces.at(float(now_s[index]))), []).append(index)
        return [(np.array(indices), airspace) for airspace, indices in members.items()]
