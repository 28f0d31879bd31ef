"""A pure function over many items, on several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from ._task import WorkersUnusable

Item = TypeVar("Item")
Result = TypeVar("Result")

OnDone = Callable[[int, int], None]
"""Called with the number of items that are done, and the number of all."""


def map_in_processes(
    job: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    on_done: OnDone = lambda done, total: None,
) -> list[Result]:
    """`job(item)` for every item, in the order of `items`, the same for any number of `workers`.

    With one worker, in this process. Otherwise `job` and items are pickled. Raises what `job` raises for the first
    item for which it raises anything, and WorkersUnusable if a process is killed.
    """
    results: list[Result] = []

    def take(result: Result) -> None:
        results.append(result)
        on_done(len(results), len(items))

    if min(workers, len(items)) <= 1:
        for item in items:
            take(job(item))
        return results
    # Spawned, not forked: imported libraries run threads, whose locks a forked child would inherit held.
    pool = ProcessPoolExecutor(
        min(workers, len(items)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_leave_interruption_to_parent,
    )
    try:
        for future in [pool.submit(job, item) for item in items]:
            take(future.result())
    except BrokenProcessPool as error:
        raise WorkersUnusable(
            "a worker process was killed, perhaps because memory ran out; try again with fewer --workers"
        ) from error
    finally:
        # What is waiting is dropped: an interrupted command shall end with the items that are under way.
        pool.shutdown(cancel_futures=True)
    return results


def _leave_interruption_to_parent() -> None:
    # Ctrl-C reaches every process of the terminal; the parent alone says so and ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    # The pool's queue never closes for a worker, which holds both ends of it: a killed parent would leave it behind.
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
