"""When a task has to make way for another: ordered to be next, more urgent, or too late otherwise."""

from __future__ import annotations

import numpy as np

from bench.arrays import Bools, Counts, Floats

from ...mission._mission import HURRY_S
from ...mission._planner import TURN_S
from ...mission._search_flight import SEARCH_S
from ..batch._batch import Batch
from ._way_home import WayHome


def is_ordered_first(batch: Batch, now_s: Floats) -> Bools:
    """(n, k) ordered to be next, by a moment (n,), and known when it was."""
    return np.asarray((batch.first_s <= now_s[:, None]) & (batch.task_delivered_s <= batch.first_s))


def preempted_s(
    batch: Batch,
    homeward: WayHome,
    rows: Counts,
    task: Counts,
    others: Bools,
    found_s: Floats,
    begin_s: Floats,
    second_pass: Bools,
) -> Floats:
    """(r,) when one of the others that wait (r, k) is turned to, on a stretch that begins at `begin_s`; inf
    for never.

    What is more urgent breaks off a search until the target is found, an order always; a second pass gives way to
    whatever has come since.
    """
    told_s, rank, first_s = batch.task_delivered_s[rows], batch.task_priority[rows], batch.first_s[rows]
    row = np.arange(len(rows))
    own_ordered = (first_s[row, task] <= begin_s) & (told_s[row, task] <= first_s[row, task])
    urgent = others & (rank < rank[row, task][:, None]) & (told_s > begin_s[:, None]) & ~own_ordered[:, None]
    news_s = np.where(urgent, told_s, np.inf).min(axis=1)
    news_s = np.where(news_s < found_s, news_s, np.inf)
    ordered = others & (told_s <= first_s) & (first_s > begin_s[:, None])
    calls_s: Floats = np.minimum(news_s, np.where(ordered, first_s, np.inf).min(axis=1))
    arrived_s = np.where(others & (told_s > begin_s[:, None]), told_s, np.inf).min(axis=1)
    calls_s = np.where(second_pass & ~own_ordered, np.minimum(calls_s, arrived_s), calls_s)
    here_m = batch.task_m[rows, task]
    for other in range(others.shape[1]):
        waits = np.flatnonzero(others[:, other] & (told_s[:, other] <= found_s) & np.isfinite(found_s))
        if len(waits):
            waiting_rows, goal_m = rows[waits], batch.task_m[rows[waits], other]
            way_m = homeward.way_m(waiting_rows, here_m[waits], goal_m, begin_s[waits])
            way_s = way_m / batch.pace_mps[waiting_rows] + TURN_S + SEARCH_S
            fits_s = homeward.latest_s(waiting_rows, goal_m, begin_s[waits]) - way_s
            due_s = batch.task_due_s[waiting_rows, other] - way_s
            hurry_s = np.maximum(np.minimum(fits_s, due_s) - HURRY_S, found_s[waits])
            calls_s[waits] = np.where(hurry_s < fits_s, np.minimum(calls_s[waits], hurry_s), calls_s[waits])
    return calls_s
