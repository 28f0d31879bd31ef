"""What a campaign asks of an executor: of local processes, a Dask cluster, or anything else that flies tasks."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Protocol

from bench.contracts import OnProgress, SessionResult, ignore_progress

from ._task import Task, WorkerPlan

OnStart = Callable[[str], None]
"""Called once with the name of the worker that a task went to, before anything of it runs."""


class Executor(Protocol):
    """Flies tasks somewhere, each in a task of the runner's event loop."""

    @property
    def capacity(self) -> int:
        """How many tasks it can fly at once now. May change, also to zero, while workers come and go."""

    async def fly(
        self, task: Task, on_start: OnStart, on_progress: OnProgress = ignore_progress
    ) -> SessionResult:
        """Fly a task; only while fewer than `capacity` fly. Whatever becomes of the session or of its worker is a result.

        `on_progress` is called with what the executor learns of the session while it flies, which may be nothing.
        Cancelled, it kills the session and its agent. Raises WorkersUnusable when no task can be flown any more.
        """


class OpenExecutor(Protocol):
    """Opens an executor for one campaign run, for up to `workers` sessions at once.

    Leaving the block ends every worker that it started.
    """

    def __call__(
        self, plan: WorkerPlan, workers: int, folder: Path
    ) -> AbstractAsyncContextManager[Executor]: ...
