"""A campaign's task on a worker of a Dask cluster. Only workers import this module, never the scheduler."""

from __future__ import annotations

import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path

import anyio
import anyio.to_thread

from bench.contracts import SessionResult
from bench.temporary_folders import temporary_folder
from decompositions import decomposition_of

from .._parallel import WorkersUnusable
from .._versions import versions
from ..storage._elsewhere import store_recording
from ..storage._folder import RECORDING
from ._dask import NAME, STARTED, ClusterTask, StoredRecording
from ._event_loop import first_error_alone
from ._executor import Task, WorkerPlan
from ._local_pool import open_local_pool

STORE_LIMIT_S = 300.0
"""Host seconds that a recording may take to its store. Chosen: one of 10 MB needs 270 kbit/s."""
CANCELLED_S = 0.5
"""Host seconds between two looks at whether the task is still wanted. Chosen: a look costs microseconds."""


def fly_document(document: bytes) -> tuple[bytes, dict[str, bytes], bytes]:
    """Fly a `ClusterTask` and return the `SessionResult`, both as JSON, with every file of its run folder, and the
    `StoredRecording` (empty: the recording is among the files).

    Raises WorkersUnusable where this worker cannot fly it, and CancelledTask once nobody waits for it.
    """
    task = ClusterTask.model_validate_json(document)
    _tell_start(task.runner)
    if faults := version_faults(task.versions, versions()):
        raise WorkersUnusable("; ".join(faults))
    with temporary_folder("dask") as folder:
        with first_error_alone():
            result = anyio.run(_fly, task, folder, _wanted())
        run = folder / "run"
        stored = _stored(task, run, result)
        files = {
            str(path.relative_to(run)): path.read_bytes()
            for path in sorted(run.rglob("*"))
            if path.is_file() and not path.is_symlink()
        }
        return result.model_dump_json().encode(), files, stored.model_dump_json().encode() if stored else b""


def _stored(task: ClusterTask, run: Path, result: SessionResult) -> StoredRecording | None:
    """Put the recording where it is to be kept. One that cannot be stays in the run's folder."""
    recording = run / RECORDING
    if task.recordings is None or result.recording_sha256 is None or not recording.is_file():
        return None
    store = partial(store_recording, recording, task.recordings, task.realization, result.recording_sha256)
    try:
        url = anyio.run(_within_limit, store)
    # Whatever a file system raises: a recording that comes back over the cluster is better than none.
    except Exception as error:
        return StoredRecording(url=task.recordings, bytes=0, fault=f"{type(error).__name__}: {error}")
    stored = StoredRecording(url=url, bytes=recording.stat().st_size)
    recording.unlink()
    return stored


async def _within_limit(store: Callable[[], str]) -> str:
    with anyio.fail_after(STORE_LIMIT_S):
        return await anyio.to_thread.run_sync(store, abandon_on_cancel=True)


def version_faults(wanted: dict[str, str], installed: dict[str, str]) -> list[str]:
    """What differs between the runner's software and a worker's: recordings would not be the same."""
    return [
        f"a worker has {name} {installed.get(name, 'not installed')}, the runner {version}"
        for name, version in wanted.items()
        if installed.get(name) != version
    ]


class CancelledTask(Exception):
    """Nobody waits for the task any more."""


async def _fly(task: ClusterTask, folder: Path, is_wanted: Callable[[], bool]) -> SessionResult:
    simspec, run = folder / "simspec.json", folder / "run"
    simspec.write_text(task.simspec, encoding="utf-8")
    run.mkdir()
    plan = WorkerPlan(task.job, decomposition_of(task.decomposition), task.own_network)
    # A process of its own: a session that flies in the worker's own starves the worker's event loop until the
    # scheduler takes it for lost (measured), and nothing could kill it at the end of its budget.
    async with open_local_pool(plan, 1, folder) as pool, anyio.create_task_group() as tasks:
        tasks.start_soon(_cancel_unwanted, is_wanted)
        result = await pool.fly(
            Task(task.realization, simspec, run, task.wall_s), on_start=lambda worker: None
        )
        tasks.cancel_scope.cancel()
    return result


async def _cancel_unwanted(is_wanted: Callable[[], bool]) -> None:
    """Dask cannot interrupt a thread: the session of a cancelled task would fly on, on a core that others wait for."""
    while is_wanted():  # noqa: ASYNC110 - Dask sets no event; the state of its task is all that it shows
        await anyio.sleep(CANCELLED_S)
    raise CancelledTask


def _tell_start(runner: str) -> None:
    """Tell the runner which worker has started the task that this thread is at."""
    from distributed import get_worker
    from distributed.worker import thread_state

    worker = get_worker()
    # The address names the process, as in the scheduler's own tables; behind a bridge or in a container it may not
    # name the machine.
    name = f"{socket.gethostname()} {worker.address}"
    worker.log_event(runner, {STARTED: thread_state.key, NAME: name})


def _wanted() -> Callable[[], bool]:
    """Whether the scheduler still waits for the task that this thread is at."""
    from distributed import get_worker
    from distributed.core import Status
    from distributed.worker import thread_state

    worker, key = get_worker(), thread_state.key

    def is_wanted() -> bool:
        state = worker.state.tasks.get(key)
        # A worker that retires, or has paused because memory is short, lets end what it is at.
        is_ending = worker.status in (Status.closing, Status.closed, Status.failed)
        return not is_ending and state is not None and state.state == "executing"

    return is_wanted
