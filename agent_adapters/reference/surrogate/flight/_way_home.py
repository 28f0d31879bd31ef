"""The way home, how long it takes, and when it must be taken: by the time or the charge left."""

from __future__ import annotations

import numpy as np

from bench.arrays import Bools, Counts, Floats

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
        self._spare = bool(
            ((batch.charge_fraction - batch.use_per_s * batch.limit_s) > batch.reserve + 0.25).all()
        )
        self._spare &= not np.isfinite(batch.charge_s).any()

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
        longest_s = self._spent_s(rows, 2.0 * farthest_m)
        tight = np.flatnonzero(
            (end_s + longest_s + DEFAULTS.reserve_s >= batch.limit_s[rows]) | (not self._spare)
        )
        if not len(tight):
            return turns_s
        tight_rows = rows[tight]
        time_s = np.concatenate(
            (stretch.time_s[tight], end_s[tight][:, None]), axis=1
        )  # it may wait at the very end
        count, moments = time_s.shape
        place_m = np.concatenate((stretch.place_m[tight], stretch.place_m[tight][:, -1:]), axis=1).reshape(
            -1, 2
        )
        now_s = np.where(np.isfinite(time_s), time_s, 0.0).ravel()
        home_s = self._home_s(np.repeat(tight_rows, moments), place_m, now_s).reshape(count, moments)
        before_s = np.concatenate((begin_s[tight][:, None], time_s[:, :-1]), axis=1)
        latest_s = batch.limit_s[tight_rows][:, None] - DEFAULTS.reserve_s - home_s
        by_time_s = np.where(time_s >= latest_s, np.maximum(latest_s, before_s), np.inf)
        short, short_s = self._short(tight_rows, time_s, before_s, home_s, away_s[tight])
        by_charge_s = np.where(short, short_s, np.inf)
        turns_s[tight] = np.minimum(by_time_s, by_charge_s).min(axis=1)
        return turns_s

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

    def _short(
        self, rows: Counts, time_s: Floats, before_s: Floats, home_s: Floats, away_s: Floats
    ) -> tuple[Bools, Floats]:
        batch = self._batch
        charge = self.charge_at(
            rows, np.where(np.isfinite(time_s), time_s, batch.limit_s[rows][:, None]), away_s
        )
        use_per_s = batch.use_per_s[rows][:, None]
        needed = batch.reserve[rows][:, None] + use_per_s * (home_s + CHARGE_SPARE_S) + BATTERY_MARGIN
        fell_s = batch.charge_s[rows][:, None]
        when_s = np.where(
            (before_s < fell_s) & (fell_s <= time_s), fell_s, np.where(np.isfinite(time_s), time_s, before_s)
        )
        return charge <= np.maximum(needed, DEFAULTS.min_battery), when_s

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
