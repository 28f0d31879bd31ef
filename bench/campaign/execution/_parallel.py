"""A pure function over many items, on several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, TypeVar

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
    pool = ProcessPoolExecutor(
        min(workers, len(items)),
        mp_context=_FreshContext(),
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


class _FreshProcess(SpawnProcess):
    """A process that does not run the user's script again, which therefore needs no `if __name__ == "__main__"`."""

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802, the hook of multiprocessing
        with _without_main():
            return SpawnProcess._Popen(process_obj)


class _FreshContext(SpawnContext):
    # Spawned, not forked: imported libraries run threads, whose locks a forked child would inherit held.
    Process = _FreshProcess


@contextmanager
def _without_main() -> Iterator[None]:
    """multiprocessing tells a new process to import what stands in `sys.modules` as `__main__`."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


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
