"""The executor over a Dask cluster: a scheduler somewhere, or one with worker processes on this machine.

Everything travels as bytes: the scheduler imports none of our packages, and no folder is shared. The journal stays
the only truth about what was flown, and the only one who repeats anything.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio
from pydantic import BaseModel, ConfigDict

from bench.contracts import OnProgress, Outcome, SessionResult, ignore_progress
from bench.errors import Fault, SetupError
from bench.visible_text import visible
from decompositions import DecompositionDocument

from .._parallel import WorkersUnusable
from .._versions import versions
from ..storage._dropped import DroppedRecording, note_pending
from ._executor import OnStart, Task, WorkerPlan
from ._local_pool import open_scratch

if TYPE_CHECKING:
    from distributed import Client

# Fields of the message that a worker has started a task. Not `worker`: the scheduler sets that to the address.
STARTED = "session_started"
"""The task's key."""
NAME = "name"
"""The worker's name: its machine and its address."""

CONNECT_S = 20.0
"""Host seconds in which a scheduler must answer. Chosen."""
CANCEL_S = 5.0
"""Host seconds for taking a task back when the runner stops. Chosen: a person waits for it."""
LOOK_S = 1.0
"""Host seconds between two looks at how many workers there are. Chosen."""
LOOKS_BEFORE_WARNING = 10
"""Looks in a row without a worker before somebody is warned. Chosen: workers take some seconds to start."""
WORKER = "dask"
"""The worker of an attempt that ended before its worker had said which one it is."""

# Evaluated on the worker. A function of ours would be pickled by its name, and the scheduler, which unpickles tasks,
# would have to import it.
_FLY = "__import__('bench.campaign.execution._dask_worker', fromlist=['fly_document']).fly_document(document)"


class ClusterTask(BaseModel):
    """A task with everything that it needs: a cluster's machines share no disk with the runner.

    `runner` is the topic on the scheduler where the runner learns which worker has started the task, `recordings` the URL
    below which the recording is kept; None sends it back.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    realization: str
    simspec: str
    decomposition: DecompositionDocument
    job: str
    wall_s: float
    own_network: bool
    versions: dict[str, str]
    runner: str
    recordings: str | None = None


class StoredRecording(BaseModel):
    """Where a worker has put a recording; or why it could not, so that the recording comes back instead."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    url: str
    bytes: int
    fault: str = ""


@dataclass(slots=True)
class _Start:
    """Where a task was started, once its worker has said so."""

    worker: str = WORKER
    reported: anyio.Event = field(default_factory=anyio.Event)
    announced: bool = False

    async def announce(self, on_start: OnStart) -> None:
        """Wait until the worker has said which one it is, and pass it on."""
        await self.reported.wait()
        self.announced = True
        on_start(self.worker)


class DaskExecutor:
    """Tasks on the worker threads of a cluster, one session to a thread."""

    def __init__(
        self,
        client: Client,
        plan: WorkerPlan,
        address: str,
        at_most: int | None,
        recordings: str | None,
        warn: Callable[[str], None],
    ) -> None:
        self._client, self._plan, self._address, self._at_most = client, plan, address, at_most
        self._warn, self._recordings = warn, recordings
        self._threads = 0
        self._submitted = 0
        self._starts: dict[str, _Start] = {}
        # The scheduler forgets the events of this topic, which has its own too, when the client leaves.
        client.subscribe_topic(client.id, self._note_start)

    @property
    def capacity(self) -> int:
        return self._threads if self._at_most is None else min(self._threads, self._at_most)

    async def fly(
        self, task: Task, on_start: OnStart, on_progress: OnProgress = ignore_progress
    ) -> SessionResult:
        from distributed.client import ClosedClientError

        self._submitted += 1
        key = f"{task.realization}-{self._client.id}-{self._submitted}"
        start = self._starts[key] = _Start()
        try:
            future = self._client.submit(
                eval,
                _FLY,
                {"document": self._document(task)},
                key=key,
                pure=False,
                retries=0,
            )
        except ClosedClientError as error:
            del self._starts[key]
            raise self._scheduler_lost() from error
        try:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(start.announce, on_start)
                result, files, stored = await self._answer(future, task)
                tasks.cancel_scope.cancel()
            if not start.announced:
                on_start(start.worker)
        finally:
            del self._starts[key]
            # Also of a task that has ended: the cluster forgets its recording.
            with anyio.CancelScope(shield=True), anyio.move_on_after(CANCEL_S):
                await future.cancel()
        for name, content in files.items():
            path = task.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        if stored is not None:
            self._note_stored(task, result, stored)
        return result

    async def watch(self) -> None:
        """Follow how many workers there are, and warn once each time that there have been none for a while."""
        looks_without = 0
        while True:
            try:
                with anyio.move_on_after(CONNECT_S):
                    self._threads = sum((await self._client.nthreads()).values())
            except OSError as error:
                raise self._scheduler_lost() from error
            looks_without = 0 if self._threads else looks_without + 1
            if looks_without == LOOKS_BEFORE_WARNING:
                self._warn(
                    f"the Dask scheduler at {self._address} has no workers; the campaign waits for one"
                )
            await anyio.sleep(LOOK_S)

    def _note_start(self, event: tuple[float, dict[str, Any]]) -> None:
        _, message = event
        start = self._starts.get(message.get(STARTED, ""))
        if start is not None:
            start.worker = visible(message[NAME])
            start.reported.set()

    def _note_stored(self, task: Task, result: SessionResult, stored: StoredRecording) -> None:
        if stored.fault or result.recording_sha256 is None:
            self._warn(f"{task.realization}: {stored.url} took no recording, so it came back: {stored.fault}")
            return
        note = DroppedRecording(
            recording_sha256=result.recording_sha256,
            bytes=stored.bytes,
            policy=f"kept at {self._recordings}",
            versions=versions(),
            kept_at=stored.url,
        )
        note_pending(task.folder, note)

    async def _answer(
        self, future: Any, task: Task
    ) -> tuple[SessionResult, dict[str, bytes], StoredRecording | None]:
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            result, files, stored = await future
        except KilledWorker as error:
            return _failure(task, Outcome.WORKER_LOST, f"the Dask worker is gone: {error}"), {}, None
        except (CancelledError, OSError) as error:
            raise self._scheduler_lost() from error
        except ImportError as error:
            raise WorkersUnusable(
                f"a Dask worker cannot import the bench: {error}. Install it there"
            ) from error
        except WorkersUnusable:
            raise
        except Exception as error:
            return _failure(task, Outcome.BENCH_ERROR, f"{type(error).__name__}: {error}"), {}, None
        where = StoredRecording.model_validate_json(stored) if stored else None
        return SessionResult.model_validate_json(result), files, where

    def _scheduler_lost(self) -> WorkersUnusable:
        return WorkersUnusable(
            f"the Dask scheduler at {self._address} is gone. "
            "Run the same command again: only the sessions that were under way are flown again"
        )

    def _document(self, task: Task) -> bytes:
        document = ClusterTask(
            realization=task.realization,
            simspec=task.simspec.read_text(encoding="utf-8"),
            decomposition=self._plan.decomposition.document,
            job=task.job or self._plan.job,
            wall_s=task.wall_s,
            own_network=self._plan.own_network,
            versions=versions(),
            runner=self._client.id,
            recordings=self._recordings,
        )
        return document.model_dump_json().encode()


def _failure(task: Task, outcome: Outcome, reason: str) -> SessionResult:
    return SessionResult(realization=task.realization, outcome=outcome, reason=reason)


@asynccontextmanager
async def open_dask(
    plan: WorkerPlan,
    workers: int,
    folder: Path,
    *,
    address: str | None = None,
    at_most: int | None = None,
    recordings: str | None = None,
    connect_s: float = CONNECT_S,
    warn: Callable[[str], None] = lambda warning: None,
) -> AsyncIterator[DaskExecutor]:
    """Yield an executor over the cluster at `address`, for `at_most` sessions at once (None: all of its threads).

    Without an address, over `workers` processes on this machine. `recordings` is the URL below which workers keep the
    recordings; None: they come back. `warn` is told when there are no workers. Raises SetupError if `distributed` is not installed,
    no scheduler answers, or the scheduler would repeat lost tasks by itself.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        fault = Fault("--executor", "dask needs the package distributed", "pip install 'rebar-bench[dask]'")
        raise SetupError(fault) from None
    async with AsyncExitStack() as stack:
        _keep_quiet()
        target: Any = address
        if address is None:
            scratch = str(stack.enter_context(open_scratch(folder)))
            target = await stack.enter_async_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    dashboard_address=None,
                    asynchronous=True,
                    local_directory=scratch,
                    env={"TMPDIR": scratch},
                    scheduler_kwargs={
                        "allowed_failures": 0,
                        "local_directory": scratch,
                        # Without a dashboard it still serves HTTP, by default at a port that another cluster may have.
                        "dashboard_address": "127.0.0.1:0",
                    },
                )
            )
        try:
            client = await stack.enter_async_context(
                Client(target, asynchronous=True, set_as_default=False, timeout=connect_s)
            )
            if address is not None:
                await _check_scheduler(client, address)
        except (OSError, ValueError, TypeError) as error:
            raise SetupError(
                "--executor",
                f"no Dask scheduler answers at {address}: {error}",
                "give its address, as in dask=tcp://HOST:8786",
            ) from error
        executor = DaskExecutor(client, plan, address or "this machine", at_most, recordings, warn)
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(executor.watch)
            yield executor
            tasks.cancel_scope.cancel()


def _keep_quiet() -> None:
    """Keep tracebacks of a lost connection off the terminal: the error that is raised says it in a sentence.

    For the life of this process: connections that nobody waits for speak after the executor is closed.
    """
    # Distributed gives several of its loggers a level of their own, which that of their parent does not change.
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


async def _check_scheduler(client: Client, address: str) -> None:
    """Raises SetupError for a scheduler that flies sessions again of which the journal would not know."""
    import dask

    repeats = await client.run_on_scheduler(dask.config.get, "distributed.scheduler.allowed-failures")
    if repeats != 0:
        raise SetupError(
            "--executor",
            f"the Dask scheduler at {address} repeats the tasks of a lost worker {repeats} times, unseen by the journal",
            "start it with DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=0 in its environment",
        )
