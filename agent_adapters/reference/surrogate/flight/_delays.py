"""What makes a flight come later: standing, straying, waiting for the detector or for leave, people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.arrays import Bools, Floats

from ..._watch import BLIND_S
from ...flight._caution import BRAKING_MPS2, MARGIN_M
from ...flight._pilot import BLIND_WAIT_S
from ...mission._planner import ACCELERATION_MPS2, TURN_S
from ..batch._batch import FAR_M, Batch
from ._views import Stretch


def first_open_s(spans_s: Floats, at_s: Floats) -> Floats:
    """(r,) the first moment from `at_s` on in none of its spans; inf where that never comes."""
    for span in range(spans_s.shape[1]):
        since_s, until_s = spans_s[:, span].T
        at_s = np.where((since_s <= at_s) & (at_s < until_s), until_s, at_s)
    return at_s


def delayed(
    batch: Batch, stretch: Stretch, end_s: Floats, home_by_s: Floats | None = None
) -> tuple[Stretch, Floats, Floats]:
    """A stretch with all that it waits for on the way, when it ends, and when it is blown off for good (inf:
    never).

    The flight is there to see something, and waits for the detector. With `home_by_s` it flies home: then it
    does not, nor does it stray from its way, and stands no longer than to that moment.
    """
    rows = stretch.rows
    began_s = stretch.time_s[:, 0] - 0.5 * stretch.span_s[:, 0]
    time_s, gone_s = stretch.time_s, np.full(len(rows), np.inf)
    for since_s, until_s in _spans(batch.stands_s[rows]):
        until_s = until_s if home_by_s is None else np.minimum(until_s, home_by_s)
        time_s, end_s = _shifted(time_s, end_s, np.maximum(since_s, began_s), until_s)
    if home_by_s is None:
        for span in range(batch.strays_s.shape[1]):
            since_s, until_s, stays_s, return_mps = batch.strays_s[rows, span].T
            home_mps = np.minimum(batch.pace_mps[rows], return_mps)
            since_s = np.maximum(since_s, began_s)
            span_s = until_s - np.where(np.isinf(since_s), 0.0, since_s)
            away_m = _away_m(batch, stretch, time_s, since_s)
            home_s = away_m / home_mps + TURN_S + home_mps / (2.0 * ACCELERATION_MPS2)
            gone_for_good = (since_s < until_s) & (since_s < end_s) & (home_s + stays_s <= span_s)
            gone_s = np.where(gone_for_good, np.minimum(gone_s, since_s), gone_s)
            strayed_m = np.minimum(
                away_m, home_mps * np.maximum(np.where(np.isinf(span_s), 0.0, span_s), 0.0)
            )
            back_s = np.where(np.isinf(until_s), since_s, until_s + strayed_m / batch.pace_mps[rows])
            time_s, end_s = _shifted(time_s, end_s, np.where(since_s < until_s, since_s, np.inf), back_s)
        for since_s, until_s in _spans(batch.blind_s[rows]):
            since_s = np.maximum(since_s + BLIND_S, began_s)
            time_s, end_s = _shifted(time_s, end_s, since_s, np.minimum(until_s, since_s + BLIND_WAIT_S))
    return replace(stretch, time_s=time_s), end_s, gone_s


def slowed_near_people(
    batch: Batch, stretch: Stretch, end_s: Floats, places_m: Floats
) -> tuple[Stretch, Floats]:
    """A stretch flown by one who is slow by the time that it is near anybody, and when it then ends."""
    rows = stretch.rows
    if np.isinf(batch.slow_mps[rows]).all():
        return stretch, end_s
    people_m = np.where((batch.role[rows] == 0)[..., None], places_m, FAR_M)
    away_m = people_m[:, None] - stretch.place_m[:, :, None]
    nearest_m = np.sqrt((away_m[..., 0] ** 2 + away_m[..., 1] ** 2).min(axis=2))
    room_m = np.maximum(nearest_m - batch.slow_within_m[rows][:, None] - MARGIN_M, 0.0)
    limit_mps = np.sqrt(np.minimum(batch.slow_mps[rows], 1e6)[:, None] ** 2 + 2.0 * BRAKING_MPS2 * room_m)
    span_s = np.maximum(stretch.span_s, stretch.flown_m() / limit_mps)
    later_s = np.cumsum(span_s - stretch.span_s, axis=1)
    return replace(stretch, time_s=stretch.time_s + later_s, span_s=span_s), end_s + later_s[:, -1]


def _spans(spans_s: Floats) -> list[tuple[Floats, Floats]]:
    return [(spans_s[:, span, 0], spans_s[:, span, 1]) for span in range(spans_s.shape[1])]


def _shifted(time_s: Floats, end_s: Floats, since_s: Floats, until_s: Floats) -> tuple[Floats, Floats]:
    """All from a moment on comes later by the span from then to another."""
    wait_s = np.where(since_s < until_s, until_s - np.where(np.isinf(since_s), 0.0, since_s), 0.0)
    waits: Bools = time_s >= since_s[:, None]
    return np.where(waits, time_s + wait_s[:, None], time_s), np.where(end_s > since_s, end_s + wait_s, end_s)


def _away_m(batch: Batch, stretch: Stretch, time_s: Floats, since_s: Floats) -> Floats:
    """(r,) distance from home of where it is at a moment."""
    at = np.minimum((time_s < since_s[:, None]).sum(axis=1), time_s.shape[1] - 1)
    away_m = stretch.place_m[np.arange(len(at)), at] - batch.home_m[stretch.rows]
    return np.asarray(np.hypot(away_m[:, 0], away_m[:, 1]))
