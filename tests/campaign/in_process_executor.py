"""An executor without processes: jobs run in the test's own process, and a seed draws the order in which they end."""

from __future__ import annotations

import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from anyio.lowlevel import checkpoint

from bench.campaign import OnStart, OpenExecutor, Task, WorkerPlan, digest_of
from bench.campaign.execution._executor import load_job, with_progress
from bench.contracts import OnProgress, SessionFailure, SessionResult, ignore_progress
from bench.documents import load_document
from bench.simspec import SimSpec

# Turns of the event loop after which everything has happened that was to happen at once, with a margin: a signal
# takes five until it has cancelled something.
_SETTLED = 20


class HostClock:
    """Host seconds that pass only where a test says so, and while a run sleeps and nothing flies."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.flying = 0
        self.starts: list[tuple[float, str]] = []
        self.ends: list[tuple[float, str]] = []

    def __call__(self) -> float:
        return self.now_s

    async def sleep(self, span_s: float) -> None:
        for _ in range(_SETTLED):
            await checkpoint()
        while self.flying:
            await checkpoint()
        for _ in range(_SETTLED):
            await checkpoint()
        self.now_s += span_s


class InProcessExecutor:
    """Obeys the contract of `Executor`."""

    def __init__(
        self, plan: WorkerPlan, workers: int, order: random.Random, clock: HostClock | None = None
    ) -> None:
        self._job, self._decomposition = load_job(plan.job), plan.decomposition
        self._workers, self._order = workers, order
        self._clock = clock or HostClock()

    async def fly(
        self, task: Task, on_start: OnStart, on_progress: OnProgress = ignore_progress
    ) -> SessionResult:
        self._clock.flying += 1
        self._clock.starts.append((self._clock.now_s, task.realization))
        try:
            assert self._clock.flying <= self._workers
            on_start(f"w{self._clock.flying}")
            for _ in range(self._order.randint(1, 2 * self._workers)):
                await checkpoint()
            return self._result(task, on_progress)
        finally:
            self._clock.flying -= 1
            self._clock.ends.append((self._clock.now_s, task.realization))

    def _result(self, task: Task, on_progress: OnProgress) -> SessionResult:
        simspec = load_document(task.simspec, SimSpec)
        job = with_progress(load_job(task.job) if task.job else self._job, on_progress)
        try:
            result = job(simspec, self._decomposition, task.folder, task.realization)
        except Exception as error:  # as a worker does
            result = SessionFailure.of(error).result(task.realization, 0.0)
        recording = task.folder / "recording.mcap"
        if result.recording_sha256 is None and recording.is_file():
            # As a worker does.
            result = result.model_copy(update={"recording_sha256": digest_of(recording)})
        return result


def open_in_process(seed: int = 0, clock: HostClock | None = None) -> OpenExecutor:
    """Opens such executors; the same seed ends tasks in the same order."""

    @asynccontextmanager
    async def open_executor(plan: WorkerPlan, workers: int, folder: Path) -> AsyncIterator[InProcessExecutor]:
        del folder
        yield InProcessExecutor(plan, workers, random.Random(seed), clock)

    return open_executor
