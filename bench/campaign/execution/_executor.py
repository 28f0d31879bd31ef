"""What a run asks of what flies its sessions, and what it sends to workers."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from bench.contracts import OnProgress, ProgressUpdate, SessionResult, ignore_progress
from bench.errors import RebarError
from bench.simspec import SimSpec


class Job(Protocol):
    """What a worker does with a realization: fly it into `folder`, which exists and is empty, and return the result.

    The job does not write the result. One with a parameter `on_progress` is given what to tell how far its session is.
    """

    def __call__(
        self, simspec: SimSpec, decomposition: Any, folder: Path, realization: str
    ) -> SessionResult: ...


@dataclass(frozen=True, slots=True)
class Jobs:
    """What workers do with a realization, each a `Job` as `module:function`.

    `forfeit` takes the place of `flight` where the agent broke the bench, `confined` after an attempt that an unconfined
    agent may have broken; None: nothing does.
    """

    flight: str
    forfeit: str | None = None
    confined: str | None = None


_FLIGHT = "bench.campaign.execution._flight"
FLIGHTS = Jobs(f"{_FLIGHT}:fly_here", f"{_FLIGHT}:forfeit_realization", f"{_FLIGHT}:fly_confined")
"""The jobs of a campaign at full fidelity."""


@dataclass(frozen=True, slots=True)
class Task:
    """One realization to fly. It ends after at most `wall_s` host seconds, by itself or killed.

    `job` replaces the worker's own for this task, as `module:function`.
    """

    realization: str
    simspec: Path
    folder: Path
    wall_s: float
    job: str | None = None


@dataclass(frozen=True, slots=True)
class WorkerPlan:
    """What every worker gets at its start: its job, as `module:function`, and what all tasks share.

    With `own_network` a worker and its sessions live in a network namespace of their own, where the host gives one.
    """

    job: str
    decomposition: Any
    own_network: bool = True


@dataclass(frozen=True, slots=True)
class WorkerReady:
    """The worker has imported its job."""


@dataclass(frozen=True, slots=True)
class JobNotImportable:
    """The worker cannot import its job, so every task would fail."""

    reason: str


@dataclass(frozen=True, slots=True)
class TaskProgress:
    """How far the session of the worker's task is."""

    update: ProgressUpdate


@dataclass(frozen=True, slots=True)
class TaskEnded:
    """A task is over."""

    realization: str
    worker: str
    result: SessionResult


class BenchBroken(RebarError):
    """The first sessions all ended with bench errors, so the others would too."""


OnStart = Callable[[str], None]
"""Called once with the name of the worker that a task went to, before anything of it runs."""


class Executor(Protocol):
    """The pool of worker processes, or what tests put in its place."""

    async def fly(
        self, task: Task, on_start: OnStart, on_progress: OnProgress = ignore_progress
    ) -> SessionResult:
        """Fly a task. Whatever becomes of the session or of its worker is a result.

        Cancelled, it kills the session and its agent. Raises WorkersUnusable when no task can be flown any more.
        """


OpenExecutor = Callable[[WorkerPlan, int, Path], AbstractAsyncContextManager[Executor]]
"""Opens an executor in a campaign's folder for one run, for up to so many sessions at once. Leaving the block ends all of them."""


def load_job(path: str) -> Job:
    """The function at `module:function`."""
    module, _, name = path.partition(":")
    job: Job = getattr(importlib.import_module(module), name)
    return job


def with_progress(job: Job, on_progress: OnProgress) -> Job:
    """The job with somebody to tell how far its session is; the same one if it tells nobody."""
    if "on_progress" not in inspect.signature(job).parameters:
        return job
    telling_job: Callable[..., SessionResult] = job
    return partial(telling_job, on_progress=on_progress)
