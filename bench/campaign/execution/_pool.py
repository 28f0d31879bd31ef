"""The local executor: worker processes that outlive sessions, and are replaced when one does not."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol

from bench.contracts import Outcome, SessionResult

from ._processes import await_exit, end_tree, marked
from ._task import Broken, Ended, Ready, Task, WorkerPlan, WorkersUnusable

START_S = 120.0
"""Host seconds that a worker has to import its job, on a machine that may be busy."""

GRACE_S = 15.0
"""Host seconds past its budget that a session has to end by itself before it is ended by force."""

EXIT_S = 2.0
"""Host seconds that a worker which closed its link has to end by itself."""

FALSE_STARTS = 3
SCRATCH = ".scratch"
"""Where sessions keep temporary files, so that those of sessions ended by force go too."""

MARK = "REBAR_CAMPAIGN_FOLDER"
_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from bench.campaign.execution._worker import main; main({}, {}, {!r})"


class Executor(Protocol):
    """Whatever flies tasks somewhere. Used by one thread; every task handed in comes back once, as an `Ended`."""

    @property
    def free(self) -> int:
        """How many tasks could begin at once now."""

    @property
    def busy(self) -> int:
        """How many tasks are out."""

    def submit(self, task: Task) -> str:
        """Begin a task; the name of who does it. Only while something is free."""

    def wait(self, timeout_s: float | None, wake_fd: int) -> list[Ended]:
        """Tasks that ended; empty after the timeout or when something can be read from `wake_fd`. Raises WorkersUnusable."""


class OpenExecutor(Protocol):
    """Makes an executor for one campaign run; leaving the block ends every task that is out, with its agent."""

    def __call__(self, plan: WorkerPlan, workers: int, folder: Path) -> AbstractContextManager[Executor]: ...


@contextmanager
def open_local_pool(plan: WorkerPlan, workers: int, folder: Path, grace_s: float = GRACE_S) -> Iterator[LocalPool]:
    """Yield a pool of up to `workers` processes on this machine, which write their logs to `folder`/logs.

    Workers of an earlier runner on this folder that are still there are ended first: one realization, one writer.
    """
    for pid in marked(MARK, str(folder.resolve())):
        end_tree(pid)
    scratch = folder / SCRATCH
    shutil.rmtree(scratch, ignore_errors=True)
    pool = LocalPool(plan, workers, folder, grace_s)
    try:
        yield pool
    finally:
        pool.end()
        shutil.rmtree(scratch, ignore_errors=True)


@dataclass(slots=True)
class _Worker:
    """A worker process seen from the runner."""

    name: str
    process: subprocess.Popen[bytes]
    link: Connection[Any, Any]
    lifeline_fd: int
    log: Path
    log_start: int
    began: float
    ready: bool = False
    task: Task | None = None
    began_task: float = 0.0

    def last_words(self) -> str:
        """The end of what it wrote to stdout and stderr."""
        with suppress(OSError), self.log.open("rb") as file:
            file.seek(max(self.log_start, self.log.stat().st_size - 2000))
            return file.read().decode(errors="replace").strip()
        return ""

    def end(self) -> None:
        """End the process and everything that it started. Not reaped before: until then its id is nobody else's."""
        end_tree(self.process.pid)
        self.process.wait()
        self.link.close()
        os.close(self.lifeline_fd)


class LocalPool:
    """Workers, idle or at a task."""

    def __init__(self, plan: WorkerPlan, workers: int, folder: Path, grace_s: float) -> None:
        self._plan, self._limit, self._folder, self._grace_s = plan, workers, folder, grace_s
        self._workers: list[_Worker] = []
        self._named = 0
        self._false_starts = 0

    @property
    def free(self) -> int:
        return self._limit - self.busy

    @property
    def busy(self) -> int:
        return sum(worker.task is not None for worker in self._workers)

    def submit(self, task: Task) -> str:
        idle = next((worker for worker in self._workers if worker.task is None), None) or self._begin()
        idle.task = task
        idle.began_task = time.monotonic()
        with suppress(
            BrokenPipeError, ConnectionResetError
        ):  # a worker that died meanwhile is noticed by `wait`, with the task that it had
            idle.link.send(task)
        return idle.name

    def wait(self, timeout_s: float | None, wake_fd: int) -> list[Ended]:
        spans = [timeout_s, *(self._deadline(worker) - time.monotonic() for worker in self._workers if worker.task)]
        span_s = min((max(span, 0.0) for span in spans if span is not None), default=None)
        links = {worker.link: worker for worker in self._workers}
        spoke = [links[one] for one in wait([*links, wake_fd], span_s) if isinstance(one, Connection)]
        ended = [one for worker in spoke for one in self._hear(worker)]
        late = [worker for worker in self._workers if worker.task and time.monotonic() >= self._deadline(worker)]
        return ended + [one for worker in late for one in self._too_late(worker)]

    def end(self) -> None:
        """End all workers and whatever they were at."""
        while self._workers:
            self._workers.pop().end()

    def _begin(self) -> _Worker:
        self._named += 1
        name = f"w{self._named}"
        ours, theirs = Pipe()
        lifeline, held = os.pipe()
        log = self._folder / "logs" / f"{name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        scratch = self._folder.resolve() / SCRATCH / name
        scratch.mkdir(parents=True)
        with log.open("ab") as output:
            start = output.tell()
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", _BOOT.format(theirs.fileno(), lifeline, name), json.dumps(sys.path)],
                pass_fds=(theirs.fileno(), lifeline),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, MARK: str(self._folder.resolve()), "TMPDIR": str(scratch)},
                start_new_session=True,  # a group of its own to end it by, out of reach of the terminal's Ctrl-C
            )
        theirs.close()
        os.close(lifeline)
        worker = _Worker(name, process, ours, held, log, start, time.monotonic())
        self._workers.append(worker)
        with suppress(BrokenPipeError, ConnectionResetError):
            ours.send(self._plan)
        return worker

    def _deadline(self, worker: _Worker) -> float:
        """The moment of the host's monotonic clock at which patience with a worker ends."""
        if not worker.ready:
            return worker.began + START_S
        assert worker.task is not None
        return worker.began_task + worker.task.wall_s + self._grace_s

    def _hear(self, worker: _Worker) -> Sequence[Ended]:
        try:
            said = worker.link.recv()
        except (EOFError, ConnectionResetError):
            return self._lost(worker)
        match said:
            case Ready():
                worker.ready = True
                worker.began_task = time.monotonic()  # its budget does not pay for imports
                self._false_starts = 0
            case Ended():
                worker.task = None
                return [said]
            case Broken():
                raise WorkersUnusable(f"the job {self._plan.job} cannot be imported by a worker:\n{said.reason}")
        return []

    def _lost(self, worker: _Worker) -> list[Ended]:
        """A worker that is gone, and with it the session that it was at."""
        await_exit(worker.process.pid, EXIT_S)  # it may be about to say why
        self._dismiss(worker)
        how = _how_it_ended(worker.process.returncode)
        words = worker.last_words()
        reason = f"the worker {worker.name} {how}" + (f"; its last words: {words}" if words else "")
        if not worker.ready:
            self._false_starts += 1
            if self._false_starts >= FALSE_STARTS:
                raise WorkersUnusable(f"{FALSE_STARTS} workers in a row ended before they had begun; {reason}")
        return self._instead(worker, Outcome.WORKER_LOST, reason)

    def _too_late(self, worker: _Worker) -> list[Ended]:
        self._dismiss(worker)
        if not worker.ready:
            raise WorkersUnusable(f"the worker {worker.name} did not import {self._plan.job} within {START_S:g} s")
        assert worker.task is not None
        reason = f"the session was ended by force {self._grace_s:g} s after its budget of {worker.task.wall_s:g} s"
        return self._instead(worker, Outcome.WALL_BUDGET, reason)

    def _dismiss(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.end()

    def _instead(self, worker: _Worker, outcome: Outcome, reason: str) -> list[Ended]:
        """The result that the worker could not give."""
        if worker.task is None:
            return []
        realization, took_s = worker.task.realization, round(time.monotonic() - worker.began_task, 3)
        result = SessionResult(realization=realization, outcome=outcome, reason=reason, wall_s=took_s)
        return [Ended(realization, worker.name, result)]


def _how_it_ended(code: int) -> str:
    if code < 0:
        with suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"ended with code {code}"
