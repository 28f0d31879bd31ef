"""A worker: a process that flies one realization after another for as long as its runner lives. And how processes are
killed together with everything that they started.
"""

from __future__ import annotations

import faulthandler
import os
import select
import signal
import threading
import time
import traceback
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import anyio

from bench.contracts import OnProgress, Outcome, ProgressUpdate, SessionFailure, SessionResult
from bench.documents import load_json_document
from bench.simspec import SimSpec
from bench.visible_text import visible_output

from ..storage._files import digest_of
from ..storage._folder import RECORDING
from ._executor import (
    Job,
    JobNotImportable,
    Task,
    TaskEnded,
    TaskProgress,
    WorkerPlan,
    WorkerReady,
    load_job,
    with_progress,
)


def main(link_fd: int, lifeline_fd: int, name: str) -> None:
    """Serve tasks from the link until it is closed.

    The lifeline closes only when the runner's process ends.
    """
    # An agent that inherited them would keep both open, and the runner would not notice the end of the
    # worker.
    for fd in (link_fd, lifeline_fd):
        os.set_inheritable(fd, False)
    faulthandler.enable()
    threading.Thread(target=_die_with_runner, args=(lifeline_fd,), daemon=True).start()
    # What it prints is read in its log, and told as its last words.
    with visible_output():
        _serve(Connection(link_fd), name)


def _serve(link: Connection[Any, Any], name: str) -> None:
    plan: WorkerPlan = link.recv()
    try:
        job = load_job(plan.job)
    except Exception:
        link.send(JobNotImportable(traceback.format_exc()))
        return
    link.send(WorkerReady())
    while True:
        try:
            task: Task = link.recv()
        except EOFError:
            return
        result = _result(job, task, plan.decomposition, _progress_sender(link))
        link.send(TaskEnded(task.realization, name, result))


def _die_with_runner(lifeline_fd: int) -> None:
    """Wait until the runner is gone, then kill this worker, its session and its agent: nobody would read the result."""
    while os.read(lifeline_fd, 1):
        pass
    kill_tree(os.getpid())


def _progress_sender(link: Connection[Any, Any]) -> OnProgress:
    """What sends updates to the runner."""
    poll = select.poll()
    poll.register(link, select.POLLOUT)

    def send(update: ProgressUpdate) -> None:
        # A runner that is stopped, or busy for minutes, does not read: the session must not wait for it. The socket is
        # writable while a quarter of its buffer is in use at most, so a message of 300 bytes never blocks.
        with suppress(OSError):
            if poll.poll(0):
                link.send(TaskProgress(update))

    return send


def _result(job: Job, task: Task, decomposition: Any, on_progress: OnProgress) -> SessionResult:
    began = time.monotonic()
    try:
        job = with_progress(load_job(task.job) if task.job else job, on_progress)
        result = job(
            simspec=load_json_document(task.simspec, SimSpec),
            decomposition=decomposition,
            folder=task.folder,
            realization=task.realization,
        )
        if not isinstance(result, SessionResult) or result.realization != task.realization:
            raise TypeError(f"the job returned {result!r:.200}, not the result of {task.realization}")
    except (Exception, SystemExit) as error:  # whatever a session does, it costs itself and not the worker
        failure = SessionFailure.of(error)
        # What was refused before it flew took no session time; a bench error may have come at its very end.
        wall_s = round(time.monotonic() - began, 3) if failure.outcome is Outcome.BENCH_ERROR else 0.0
        return failure.result(task.realization, wall_s)
    recording = task.folder / RECORDING
    if result.recording_sha256 is None and recording.is_file():
        return result.model_copy(update={"recording_sha256": digest_of(recording)})
    return result


def kill_tree(pid: int) -> None:
    """Kill a process, the group that it leads, and every descendant, whatever session each is in by now."""
    for descendant in descendants(pid):
        with suppress(ProcessLookupError, PermissionError):
            os.kill(descendant, signal.SIGKILL)
    # The group comes before the process: a process that kills itself this way does not get further than its
    # group.
    for kill in (os.killpg, os.kill):
        with suppress(ProcessLookupError, PermissionError):
            kill(pid, signal.SIGKILL)


async def await_exit(pid: int, span_s: float) -> bool:
    """Wait for a child process to end, without reaping it. Returns whether it ended within `span_s`."""
    # Not waitpid: reaping would free the id, and the kill that follows could reach a stranger.
    exit_fd = os.pidfd_open(pid)
    try:
        with anyio.move_on_after(span_s):
            await anyio.wait_readable(exit_fd)
            return True
        return False
    finally:
        os.close(exit_fd)


def descendants(pid: int) -> list[int]:
    """Children, grandchildren and so on, as the kernel knows them now. Empty on a system without /proc."""
    known: list[int] = []
    waiting = [pid]
    while waiting:
        children = _children(waiting.pop())
        known += children
        waiting += children
    return known


def _children(pid: int) -> list[int]:
    children: list[int] = []
    # Processes end while they are listed, so any of these files may be gone.
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                children += map(int, (task / "children").read_text(encoding="ascii").split())
    return children


def processes_marked(variable: str, value: str) -> list[int]:
    """Other processes of this user that were started with this environment variable at this value."""
    mark = f"{variable}={value}".encode()
    marked = []
    for folder in Path("/proc").glob("[0-9]*"):
        # Other users' processes cannot be read, and are never the bench's.
        with suppress(OSError):
            if int(folder.name) != os.getpid() and mark in (folder / "environ").read_bytes().split(b"\0"):
                marked.append(int(folder.name))
    return marked
