"""The worker processes that fly one session after another and are replaced when one is lost."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import anyio

from bench.contracts import OnProgress, Outcome, SessionFailure, SessionResult, ignore_progress
from bench.documents import dump_json
from bench.errors import SetupError
from bench.removal import remove_tree
from bench.simspec import SimSpec
from bench.temporary_folders import temporary_folder
from decompositions import Decomposition

from .._parallel import WorkersUnusable
from ._event_loop import blocking
from ._executor import (
    FLIGHTS,
    JobNotImportable,
    OnStart,
    Task,
    TaskEnded,
    TaskProgress,
    WorkerPlan,
    WorkerReady,
)
from ._worker import await_exit, kill_tree, processes_marked

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


@asynccontextmanager
async def open_local_pool(
    plan: WorkerPlan,
    workers: int,
    folder: Path,
    grace_s: float = GRACE_S,
    clock: Callable[[], float] = time.monotonic,
) -> AsyncIterator[LocalPool]:
    """Yield a pool of up to `workers` processes on this machine, which write their logs to `folder`/logs.

    `clock` gives the host seconds by which the budgets of sessions are judged. Raises this process's soft limit of open
    files where it is too low for them, and SetupError where the hard limit is.
    """
    _allow_open_files(workers)
    # Workers of a runner that was killed may still be writing for a moment, and a run folder has one writer
    # only.
    for pid in processes_marked(FOLDER_VARIABLE, str(folder.resolve())):
        kill_tree(pid)
    with _open_scratch(folder) as scratch:
        pool = LocalPool(plan, folder, scratch, grace_s, clock)
        try:
            yield pool
        finally:
            pool.close()


@blocking
async def fly_realization(
    simspec: SimSpec, decomposition: Decomposition, folder: Path, realization: str, own_network: bool = True
) -> SessionResult:
    """Fly one realization into `folder`, created if it does not exist, and return its result without writing it.

    In a process of its own, as a campaign does: with `own_network` in a network of its own where the host gives one, which
    this process, having threads, can no longer enter. Leaves `recording.mcap`, `simspec.json` (realized) and `agent.log` in
    the folder. A session that fails is a result, never an exception. Positions that come with the SimSpec are checked before
    the flight: SETUP_INVALID if they break what the SimSpec asks for. Raises WorkersUnusable when no worker process can be
    started.
    """
    # Imported here: a runner flies nothing itself.
    from bench.agents import cache_faults

    # Before the session's budget begins.
    if faults := cache_faults(simspec.agent):
        return SessionFailure.of(SetupError(faults)).result(realization)
    plan = WorkerPlan(FLIGHTS.flight, decomposition, own_network)
    with temporary_folder("worker") as temporary:
        document = temporary / "simspec.json"
        document.write_text(dump_json(simspec), encoding="utf-8")
        task = Task(realization, document, folder.resolve(), simspec.budgets.wall_s)
        async with open_local_pool(plan, 1, temporary) as pool:
            return await pool.fly(task, on_start=lambda worker: None)


# Measured: a session with the shipped agents has up to 50 open files, a runner 18 and then 2 for each worker. Cameras,
# links and services add some.
FILES_OF_A_SESSION = 128
_FILES_OF_A_RUNNER, _FILES_OF_A_WORKER = 64, 4


def _allow_open_files(workers: int) -> None:
    """Raises SetupError where this process may not open as many files as sessions and runner need: each session would end
    as a fault of the bench, after all its retries.
    """
    needed = max(FILES_OF_A_SESSION, _FILES_OF_A_RUNNER + _FILES_OF_A_WORKER * workers)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < needed:
        what = f"{hard} open files are allowed (ulimit -Hn), and {needed} are needed for sessions at once: {workers}"
        remedy = f"raise the limit (`ulimit -n {needed}` as root, or `nofile` in /etc/security/limits.conf)"
        if hard >= FILES_OF_A_SESSION:
            remedy += ", or take fewer workers (--workers)"
        raise SetupError("workers", what, remedy)
    if soft != resource.RLIM_INFINITY and soft < needed:
        # The workers inherit it.
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


@contextmanager
def _open_scratch(folder: Path) -> Generator[Path]:
    """Where the sessions of a campaign keep temporary files, without those that an earlier runner left."""
    scratch = folder.resolve() / SCRATCH
    remove_tree(scratch)
    scratch.mkdir(parents=True)
    try:
        yield scratch
    finally:
        remove_tree(scratch)


@dataclass(slots=True)
class _Worker:
    """A worker process as the runner sees it. `started` is a reading of the pool's clock."""

    name: str
    process: subprocess.Popen[bytes]
    link: Connection[Any, Any]
    lifeline_fd: int
    log: Path
    log_start: int
    started: float
    ready: bool = False

    def send(self, message: object) -> None:
        """Send a message. That the worker has ended is noticed when its answer is read."""
        with suppress(BrokenPipeError, ConnectionResetError):
            self.link.send(message)

    def log_tail(self) -> str:
        """The end of what it wrote to stdout and stderr."""
        with suppress(OSError), self.log.open("rb") as file:
            file.seek(max(self.log_start, self.log.stat().st_size - 2000))
            return file.read().decode(errors="replace").strip()
        return ""

    def kill(self) -> None:
        """Kill the process and everything that it started. Doing it again does nothing."""
        if self.link.closed:
            return
        # Reaped only after the kill: until then the kernel gives its id to no other process.
        kill_tree(self.process.pid)
        self.process.wait()
        self.link.close()
        os.close(self.lifeline_fd)


class LocalPool:
    """Worker processes, each idle or at a task."""

    def __init__(
        self,
        plan: WorkerPlan,
        folder: Path,
        scratch: Path,
        grace_s: float,
        clock: Callable[[], float],
    ) -> None:
        self._plan, self._grace_s, self._clock = plan, grace_s, clock
        self._folder, self._scratch = folder, scratch
        self._idle: list[_Worker] = []
        self._started_count = 0
        self._false_starts = 0

    async def fly(
        self, task: Task, on_start: OnStart, on_progress: OnProgress = ignore_progress
    ) -> SessionResult:
        worker = self._idle_worker() or self._start_worker()
        answer: TaskEnded | SessionResult | None = None
        try:
            on_start(worker.name)
            answer = await self._answer(worker, task, on_progress)
        finally:
            # Also when the runner stops: a session is killed with its agent, never left behind.
            if isinstance(answer, TaskEnded):
                self._idle.append(worker)
            else:
                worker.kill()
        return answer.result if isinstance(answer, TaskEnded) else answer

    def close(self) -> None:
        """Kill the idle workers. Those at a task ended with it."""
        while self._idle:
            self._idle.pop().kill()

    async def _answer(
        self, worker: _Worker, task: Task, on_progress: OnProgress
    ) -> TaskEnded | SessionResult:
        """What a worker made of a task, or the result in the place of what it could not send."""
        if not worker.ready and (lost := await self._make_ready(worker)) is not None:
            return _substitute(task, Outcome.WORKER_LOST, lost)
        # The session's budget does not pay for the worker's imports.
        began = self._clock()
        worker.send(task)
        deadline = began + task.wall_s + self._grace_s
        try:
            while isinstance(message := await self._receive(worker, deadline), TaskProgress):
                on_progress(message.update)
        except TimeoutError:
            reason = f"the session was killed {self._grace_s:g} s after its budget of {task.wall_s:g} s"
            return _substitute(task, Outcome.WALL_BUDGET, reason, self._clock() - began)
        if isinstance(message, TaskEnded):
            return message
        return _substitute(task, Outcome.WORKER_LOST, await _end_text(worker), self._clock() - began)

    async def _make_ready(self, worker: _Worker) -> str | None:
        """Wait until a new worker has imported its job. How it ended instead, if it did. Raises WorkersUnusable."""
        try:
            message = await self._receive(worker, worker.started + START_LIMIT_S)
        except TimeoutError:
            raise WorkersUnusable(
                f"the worker {worker.name} did not import {self._plan.job} within {START_LIMIT_S:g} s"
            ) from None
        match message:
            case WorkerReady():
                worker.ready = True
                self._false_starts = 0
                return None
            case JobNotImportable():
                raise WorkersUnusable(f"a worker cannot import the job {self._plan.job}:\n{message.reason}")
        reason = await _end_text(worker)
        self._false_starts += 1
        if self._false_starts >= MAX_FALSE_STARTS:
            raise WorkersUnusable(
                f"{MAX_FALSE_STARTS} workers in a row ended before they were ready; {reason}"
            )
        return reason

    async def _receive(self, worker: _Worker, deadline: float) -> object | None:
        """The next message of a worker; None if it is gone. Raises TimeoutError when the clock reads `deadline`."""
        while (left_s := deadline - self._clock()) > 0.0:
            # Judged by the clock again afterwards: the loop's own time is not the clock that was handed in.
            with anyio.move_on_after(left_s):
                await anyio.wait_readable(worker.link)
                return _message(worker.link)
        raise TimeoutError

    def _idle_worker(self) -> _Worker | None:
        while self._idle:
            worker = self._idle.pop()
            # The link of an idle worker is readable only once it has ended.
            if not worker.link.poll():
                return worker
            worker.kill()
        return None

    def _start_worker(self) -> _Worker:
        self._started_count += 1
        name = f"w{self._started_count}"
        link, worker_link = Pipe()
        # The kernel closes the runner's end however the runner ends, and the worker sees that even during a
        # session.
        worker_lifeline_fd, lifeline_fd = os.pipe()
        log = self._folder / "logs" / f"{name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        scratch = self._scratch / name
        scratch.mkdir()
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
        worker.send(self._plan)
        return worker


def _message(link: Connection[Any, Any]) -> object | None:
    try:
        message: object = link.recv()
    except (EOFError, ConnectionResetError):
        return None
    return message


async def _end_text(worker: _Worker) -> str:
    """How a worker ended that closed its link."""
    # The link closes before the process is gone: without the wait its exit code would be that of the kill.
    await await_exit(worker.process.pid, EXIT_LIMIT_S)
    worker.kill()
    output = worker.log_tail()
    reason = f"the worker {worker.name} {_exit_text(worker.process.returncode)}"
    return f"{reason}; its last output: {output}" if output else reason


def _substitute(task: Task, outcome: Outcome, reason: str, wall_s: float = 0.0) -> SessionResult:
    """The result in place of the one that the worker could not send."""
    return SessionResult(
        realization=task.realization, outcome=outcome, reason=reason, wall_s=round(wall_s, 3)
    )


def _exit_text(code: int) -> str:
    if code < 0:
        # Numbers of real-time signals have no name in the enumeration.
        with suppress(ValueError):
            return f"was killed by {signal.Signals(-code).name}"
    return f"ended with code {code}"
