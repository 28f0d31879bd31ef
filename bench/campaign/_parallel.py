"""A pure function over many items, on several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, TypeVar

from bench.errors import RebarError

Item = TypeVar("Item")
Result = TypeVar("Result")

_ITEMS_AHEAD = 2
"""Items that each helper has: one under way, and one so that it need not wait for this process."""

OnDone = Callable[[int, int], None]
"""Called with the number of items that are done, and the number of all."""


class WorkersUnusable(RebarError):
    """No worker can be started. No realization has a result because of it."""


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
    with _open_pool(min(workers, len(items))) as pool:
        for future in [pool.submit(job, item) for item in items]:
            take(future.result())
    return results


class Helpers:
    """Processes that share work with this one, or none, which then does all of it."""

    def __init__(self, pool: Executor | None = None, count: int = 0) -> None:
        self._pool, self._count = pool, count

    def share(self, job: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """`job(item)` for every item, in the order of `items`, the same for any number of helpers.

        What a helper gets is pickled. Raises as `map_in_processes` does.
        """
        outcomes: list[Future[Result]] = []
        waiting: list[Future[Result]] = []
        for item in items:
            # Handed out one by one: what has been given to a pool cannot be taken back reliably.
            if self._pool is not None and len(waiting) < _ITEMS_AHEAD * self._count:
                outcome = self._pool.submit(job, item)
            else:
                outcome = _outcome(job, item)
            outcomes.append(outcome)
            waiting.append(outcome)
            # The first of all failures is among what has begun.
            if any(outcome.done() and outcome.exception() for outcome in waiting):
                break
            waiting = [outcome for outcome in waiting if not outcome.done()]
        return [outcome.result() for outcome in outcomes]

    def dismiss(self) -> None:
        """Let the helpers end, without waiting for that. They share nothing any more."""
        if self._pool is not None:
            self._pool.shutdown(wait=False)


@contextmanager
def open_helpers(count: int, first_job: Callable[[], object]) -> Iterator[Helpers]:
    """Yield `count` further processes. They run `first_job` at once, so that they have imported what later jobs need while
    this process does something else. Leaving the block ends them.
    """
    if count < 1:
        yield Helpers()
        return
    with _open_pool(count) as pool:
        for _ in range(count):
            pool.submit(first_job)
        yield Helpers(pool, count)


def _outcome(job: Callable[[Item], Result], item: Item) -> Future[Result]:
    outcome: Future[Result] = Future()
    try:
        outcome.set_result(job(item))
    except Exception as error:
        # Raised when its turn comes: an item before it may fail as well.
        outcome.set_exception(error)
    return outcome


@contextmanager
def _open_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    pool = ProcessPoolExecutor(workers, mp_context=_FreshContext(), initializer=_leave_interruption_to_parent)
    try:
        yield pool
    except BrokenProcessPool as error:
        raise WorkersUnusable(
            "a worker process was killed, perhaps because memory ran out; try again with fewer --workers"
        ) from error
    finally:
        # What is waiting is dropped: an interrupted command shall end with the items that are under way.
        pool.shutdown(cancel_futures=True)


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
