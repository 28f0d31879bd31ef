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
async def fly_in_worker(
    simspec: SimSpec, decomposition: Decomposition, folder: Path, realization: str, own_network: bool = True
) -> SessionResult:
    """`fly_realization` in a process of its own, which can be confined and whose end costs nobody else anything.

    Raises WorkersUnusable when no worker process can be started.
    """
    plan = WorkerPlan(FLIGHT_JOB, decomposition, own_network)
    with tempfile.TemporaryDirectory(prefix="rebar-worker-") as temporary:
        document = Path(temporary, "simspec.json")
        document.write_text(dump_json(simspec), encoding="utf-8")
        task = Task(realization, document, folder.resolve(), simspec.budgets.wall_s)
        async with open_local_pool(plan, 1, Path(temporary)) as pool:
            return await pool.fly(task, on_start=lambda worker: None)
