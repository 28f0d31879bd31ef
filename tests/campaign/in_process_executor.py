"""An executor without processes: jobs run in the test's own process, and a seed draws the order in which they
end.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.campaign import OpenExecutor, Task, TaskEnded, WorkerPlan, digest_of
from bench.campaign.execution._task import load_job
from bench.contracts import SessionFailure
from bench.documents import load_document
from bench.simspec import SimSpec


class HostClock:
    """Host seconds that pass only where a test says so, and while an executor waits with nothing to do."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class InProcessExecutor:
    """Obeys the contract of `Executor`.

    With `reports` above one it breaks it: every task comes back several times.
    """

    def __init__(
        self,
        plan: WorkerPlan,
        workers: int,
        order: random.Random,
        reports: int = 1,
        clock: HostClock | None = None,
    ) -> None:
        self._job, self._decomposition = load_job(plan.job), plan.decomposition
        self._workers, self._order, self._reports = workers, order, reports
        self._running: list[Task] = []
        self._clock = clock

    @property
    def free(self) -> int:
        return self._workers - len(self._running)

    @property
    def busy(self) -> int:
        return len(self._running)

    def submit(self, task: Task) -> str:
        assert self.free > 0
        self._running.append(task)
        return f"w{len(self._running)}"

    def wait(self, timeout_s: float | None, wake_fd: int) -> list[TaskEnded]:
        del wake_fd
        if not self._running:
            assert self._clock is not None
            assert timeout_s is not None, "nothing runs, and nothing ends the wait"
            self._clock.now_s += timeout_s
            return []
        self._order.shuffle(self._running)
        count = self._order.randint(1, len(self._running))
        ended, self._running = self._running[:count], self._running[count:]
        return [report for task in ended for report in self._fly(task)]

    def _fly(self, task: Task) -> list[TaskEnded]:
        simspec = load_document(task.simspec, SimSpec)
        job = load_job(task.job) if task.job else self._job
        try:
            result = job(simspec, self._decomposition, task.folder, task.realization)
        except Exception as error:  # as a worker does
            result = SessionFailure.of(error).result(task.realization, 0.0)
        recording = task.folder / "recording.mcap"
        if result.recording_sha256 is None and recording.is_file():
            # As a worker does.
            result = result.model_copy(update={"recording_sha256": digest_of(recording)})
        # The repeated reports differ from the first, as those of two flights would.
        results = [result.model_copy(update={"wall_s": float(number)}) for number in range(self._reports)]
        return [
            TaskEnded(task.realization, f"w{number}", repeated) for number, repeated in enumerate(results)
        ]


def open_in_process(seed: int = 0, reports: int = 1, clock: HostClock | None = None) -> OpenExecutor:
    """Opens such executors; the same seed ends tasks in the same order."""

    @contextmanager
    def open_executor(plan: WorkerPlan, workers: int, folder: Path) -> Iterator[InProcessExecutor]:
        del folder
        yield InProcessExecutor(plan, workers, random.Random(seed), reports, clock)

    return open_executor
