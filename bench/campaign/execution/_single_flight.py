"""One realization flown by a worker of its own, as a campaign flies it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from bench.contracts import SessionResult
from bench.documents import dump_json
from bench.simspec import SimSpec
from decompositions import Decomposition

from ._blocking import blocking
from ._pool import open_local_pool
from ._task import FLIGHT_JOB, Task, WorkerPlan


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
    plan = WorkerPlan(FLIGHT_JOB, decomposition, own_network)
    with tempfile.TemporaryDirectory(prefix="rebar-worker-") as temporary:
        document = Path(temporary, "simspec.json")
        document.write_text(dump_json(simspec), encoding="utf-8")
        task = Task(realization, document, folder.resolve(), simspec.budgets.wall_s)
        async with open_local_pool(plan, 1, Path(temporary)) as pool:
            return await pool.fly(task, on_start=lambda worker: None)
