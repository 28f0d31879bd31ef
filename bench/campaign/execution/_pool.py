"""The local executor: worker processes that fly one session after another and are replaced when one is
lost.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol

from bench.contracts import Outcome, SessionResult

from ._processes import await_exit, kill_tree, processes_marked
from ._task import JobNotImportable, Task, TaskEnded, WorkerPlan, WorkerReady, WorkersUnusable

# The spans below are chosen, not measured: long enough for a busy machine, since a span that is too short
# costs a session.
START_LIMIT_S = 120.0
"""Host seconds that a worker has to import its job."""

GRACE_S = 15.0
"""Host seconds past its budget that a session has to end by itself before it is killed."""

EXIT_LIMIT_S = 2.0
"""Host seconds that a worker which closed its link has to end by itself."""

MAX_FALSE_STARTS = 3
"""Workers in a row that may end before they are ready."""

SCRATCH = ".scratch"
"""Folder of the sessions' temporary files, so that those of killed sessions can be deleted as well."""

FOLDER_VARIABLE = "REBAR_CAMPAIGN_FOLDER"
"""Environment variable by which workers of an earlier runner on the same folder are found."""

# `sys.path` travels along: the job may be in a module that only the runner's own path finds, as those of
# tests are.
_BOOT = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
if {own_network}:
    # Before any import that starts a thread; the session says what it means that there is none.
    from bench.network_namespace import enter_network_namespace
    enter_network_namespace()
from bench.campaign.execution._worker import main
main({link}, {lifeline}, {name!r})
"""


class Executor(Protocol):
    """Flies tasks somewhere. Used by one thread. Every submitted task comes back once, as a `TaskEnded`."""

    @property
    def free(self) -> int:
        """How many more tasks can be submitted now."""

    @property
    def busy(self) -> int:
        """How many tasks are running."""

    def submit(self, task: Task) -> str:
        """Start a task and return the name of its worker. Only while `free` is above zero."""

    def wait(self, timeout_s: float | None, wake_fd: int) -> list[TaskEnded]:
        """Wait for tasks to end and return them.

        Empty after `timeout_s` host seconds (None: no limit) or once `wake_fd` is readable. Raises
        WorkersUnusable.
        """


class OpenExecutor(Protocol):
    """Opens an executor for one campaign run.

    Leaving the block kills every task that is running, with its agent.
    """

    def __call__(self, plan: WorkerPlan, workers: int, folder: Path) -> AbstractContextManager[Executor]: ...


@contextmanager
def open_local_pool(
    plan: WorkerPlan,
    workers: int,
    folder: Path,
    grace_s: float = GRACE_S,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[LocalPool]:
    """Yield a pool of up to `workers` processes on this machine, which write their logs to `folder`/logs.

    `clock` gives the host seconds by which the budgets of sessions are judged.
    """
    # Workers of a runner that was killed may still be writing for a moment, and a run folder has one writer
    # only.
    for pid in processes_marked(FOLDER_VARIABLE, str(folder.resolve())):
        kill_tree(pid)
    scratch = folder / SCRATCH
    shutil.rmtree(scratch, ignore_errors=True)
    pool = LocalPool(plan, workers, folder, grace_s, clock)
    try:
        yield pool
    finally:
        pool.close()
        shutil.rmtree(scratch, ignore_errors=True)


@dataclass(slots=True)
class _Worker:
    """A worker process as the runner sees it. Times are readings of the pool's clock."""

    name: str
    process: subprocess.Popen[bytes]
    link: Connection[Any, Any]
    lifeline_fd: int
    log: Path
    log_start: int
    started: float
    ready: bool = False
    task: Task | None = None
    task_started: float = 0.0

    def log_tail(self) -> str:
        """The end of what it wrote to stdout and stderr."""
        with suppress(OSError), self.log.open("rb") as file:
            file.seek(max(self.log_start, self.log.stat().st_size - 2000))
            return file.read().decode(errors="replace").strip()
        return ""

    def kill(self) -> None:
        """Kill the process and everything that it started."""
        # Reaped only after the kill: until then the kernel gives its id to no other process.
        kill_tree(self.process.pid)
        self.process.wait()
        self.link.close()
        os.close(self.lifeline_fd)


class LocalPool:
    """Worker processes, each idle or at a task."""

    def __init__(
        self, plan: WorkerPlan, workers: int, folder: Path, grace_s: float, clock: Callable[[], float]
    ) -> None:
        self._plan, self._limit, self._folder, self._grace_s, self._clock = (
            plan,
            workers,
            folder,
            grace_s,
            clock,
        )
        self._workers: list[_Worker] = []
        self._started_count = 0
        self._false_starts = 0

    @property
    def free(self) -> int:
        return self._limit - self.busy

    @property
    def busy(self) -> int:
        return sum(worker.task is not None for worker in self._workers)

    def submit(self, task: Task) -> str:
        worker = (
            next((worker for worker in self._workers if worker.task is None), None) or self._start_worker()
        )
        worker.task = task
        worker.task_started = self._clock()
        # A worker that died meanwhile is noticed by `wait`, which returns the task as lost.
        with suppress(BrokenPipeError, ConnectionResetError):
            worker.link.send(task)
        return worker.name

    def wait(self, timeout_s: float | None, wake_fd: int) -> list[TaskEnded]:
        timeouts = [
            timeout_s,
            *(self._deadline(worker) - self._clock() for worker in self._workers if worker.task),
        ]
        span_s = min((max(timeout, 0.0) for timeout in timeouts if timeout is not None), default=None)
        links = {worker.link: worker for worker in self._workers}
        readable = [links[link] for link in wait([*links, wake_fd], span_s) if isinstance(link, Connection)]
        ended = [task for worker in readable for task in self._receive(worker)]
        late = [worker for worker in self._workers if worker.task and self._clock() >= self._deadline(worker)]
        return ended + [task for worker in late for task in self._kill_late(worker)]

    def close(self) -> None:
        """Kill all workers and their sessions."""
        while self._workers:
            self._workers.pop().kill()

    def _start_worker(self) -> _Worker:
        self._started_count += 1
        name = f"w{self._started_count}"
        link, worker_link = Pipe()
        # The kernel closes the runner's end however the runner ends, and the worker sees that even during a
        # session.
        worker_lifeline_fd, lifeline_fd = os.pipe()
        log = self._folder / "logs" / f"{name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        scratch = self._folder.resolve() / SCRATCH / name
        scratch.mkdir(parents=True)
        with log.open("ab") as output:
            log_start = output.tell()
            process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-c",
                    _BOOT.format(
                        own_network=self._plan.own_network,
                        link=worker_link.fileno(),
                        lifeline=worker_lifeline_fd,
                        name=name,
                    ),
                    json.dumps(sys.path),
                ],
                pass_fds=(worker_link.fileno(), worker_lifeline_fd),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, FOLDER_VARIABLE: str(self._folder.resolve()), "TMPDIR": str(scratch)},
                # A process group of its own, to be killed as a whole, and out of reach of the terminal's
                # Ctrl-C.
                start_new_session=True,
            )
        worker_link.close()
        os.close(worker_lifeline_fd)
        worker = _Worker(name, process, link, lifeline_fd, log, log_start, self._clock())
        self._workers.append(worker)
        with suppress(BrokenPipeError, ConnectionResetError):
            link.send(self._plan)
        return worker

    def _deadline(self, worker: _Worker) -> float:
        """The reading of the clock at which a worker at a task is killed."""
        if not worker.ready:
            return worker.started + START_LIMIT_S
        assert worker.task is not None
        return worker.task_started + worker.task.wall_s + self._grace_s

    def _receive(self, worker: _Worker) -> Sequence[TaskEnded]:
        try:
            message = worker.link.recv()
        except (EOFError, ConnectionResetError):
            return self._replace_lost(worker)
        match message:
            case WorkerReady():
                worker.ready = True
                # The session's budget does not pay for the worker's imports.
                worker.task_started = self._clock()
                self._false_starts = 0
            case TaskEnded():
                worker.task = None
                return [message]
            case JobNotImportable():
                raise WorkersUnusable(f"a worker cannot import the job {self._plan.job}:\n{message.reason}")
        return []

    def _replace_lost(self, worker: _Worker) -> list[TaskEnded]:
        """Remove a worker that is gone, and return the task that it was at as lost."""
        # The link closes before the process is gone: without the wait its exit code would be that of the
        # kill.
        await_exit(worker.process.pid, EXIT_LIMIT_S)
        self._remove(worker)
        output = worker.log_tail()
        reason = f"the worker {worker.name} {_exit_text(worker.process.returncode)}" + (
            f"; its last output: {output}" if output else ""
        )
        if not worker.ready:
            self._false_starts += 1
            if self._false_starts >= MAX_FALSE_STARTS:
                raise WorkersUnusable(
                    f"{MAX_FALSE_STARTS} workers in a row ended before they were ready; {reason}"
                )
        return self._substitute_result(worker, Outcome.WORKER_LOST, reason)

    def _kill_late(self, worker: _Worker) -> list[TaskEnded]:
        self._remove(worker)
        if not worker.ready:
            raise WorkersUnusable(
                f"the worker {worker.name} did not import {self._plan.job} within {START_LIMIT_S:g} s"
            )
        assert worker.task is not None
        reason = f"the session was killed {self._grace_s:g} s after its budget of {worker.task.wall_s:g} s"
        return self._substitute_result(worker, Outcome.WALL_BUDGET, reason)

    def _remove(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.kill()

    def _substitute_result(self, worker: _Worker, outcome: Outcome, reason: str) -> list[TaskEnded]:
        """The result in place of the one that the worker could not send. Empty if it had no task."""
        if worker.task is None:
            return []
        realization, wall_s = worker.task.realization, round(self._clock() - worker.task_started, 3)
        result = SessionResult(realization=realization, outcome=outcome, reason=reason, wall_s=wall_s)
        return [TaskEnded(realization, worker.name, result)]


def _exit_text(code: int) -> str:
    if code < 0:
        # Numbers of real-time signals have no name in the enumeration.
        with suppress(ValueError):
            return f"was killed by {signal.Signals(-code).name}"
    return f"ended with code {code}"
