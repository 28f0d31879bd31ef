"""A campaign on a Dask cluster: a real scheduler, real workers, and what happens when one is killed."""

from __future__ import annotations

import os
import socket
import sqlite3
import subprocess
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from campaign_fakes import MIXED_ENDS, entries
from dask_cluster import DEADLY, open_cluster
from in_process_executor import open_in_process
from test_campaign_retention import some_scenes

from bench.campaign import (
    CampaignEvent,
    CampaignSummary,
    Collaborators,
    Jobs,
    Observer,
    OpenExecutor,
    RealizationRetried,
    RealizationStarted,
    open_dask,
    run_campaign_sync,
    verify_folder,
)
from bench.campaign.execution._dask_worker import version_faults
from bench.contracts import Outcome
from bench.errors import SetupError

pytest.importorskip("distributed", reason="the extra `dask` is not installed")
pytestmark = pytest.mark.process


def fly(
    folder: Path, open_executor: OpenExecutor, job: str = MIXED_ENDS, observers: tuple[Observer, ...] = ()
) -> CampaignSummary:
    campaign = some_scenes(None, count=2)
    campaign = campaign.model_copy(update={"budgets": campaign.budgets.model_copy(update={"retry_s": 0.0})})
    collaborators = Collaborators(observers, open_executor=open_executor, jobs=Jobs(job))
    return run_campaign_sync(campaign, folder, collaborators=collaborators)


def attempt_workers(folder: Path) -> dict[str, list[str]]:
    """The workers of each realization's attempts, as the journal has them."""
    workers: dict[str, list[str]] = {}
    with sqlite3.connect(folder / "journal.sqlite") as database:
        for realization, worker in database.execute(
            "SELECT realization, worker FROM attempts ORDER BY number"
        ):
            workers.setdefault(realization, []).append(worker)
    database.close()
    return workers


def evidence(folder: Path) -> dict[str, tuple[Outcome | None, bytes]]:
    """Outcome and recording of every realization."""
    return {
        name: (entry.outcome, (folder / "runs" / name / "recording.mcap").read_bytes())
        for name, entry in entries(folder).items()
    }


def test_a_cluster_gives_what_local_processes_give(tmp_path: Path) -> None:
    """With a scheduler that cannot import the bench, and then on a cluster of this machine: the same outcomes and the
    same recordings, byte for byte. A worker that is killed with its session costs one more attempt, and nothing else.
    """
    fly(tmp_path / "local", open_in_process())
    (tmp_path / "victim").write_text("worker")
    events: list[CampaignEvent] = []
    with open_cluster(tmp_path) as cluster:
        summary = fly(
            tmp_path / "cluster",
            partial(open_dask, address=cluster.address),
            DEADLY,
            observers=(events.append,),
        )
        assert [process.poll() for process in cluster.workers].count(None) == 1
    assert summary.complete

    assert evidence(tmp_path / "cluster") == evidence(tmp_path / "local")
    retried = [event for event in events if isinstance(event, RealizationRetried)]
    assert [event.outcome for event in retried] == [Outcome.WORKER_LOST]
    attempts = {name: entry.attempts for name, entry in entries(tmp_path / "cluster").items()}
    assert attempts == {name: 2 if name == retried[0].realization else 1 for name in attempts}
    assert verify_folder(tmp_path / "cluster") == []
    # The journal names the worker of every attempt by machine and process; the killed one is not that of the retry.
    workers = attempt_workers(tmp_path / "cluster")
    assert {name.split()[0] for names in workers.values() for name in names} == {socket.gethostname()}
    assert len({name for names in workers.values() for name in names}) == 2
    killed, survivor = workers.pop(retried[0].realization)
    assert killed != survivor
    assert all(name.split()[1].startswith("tcp://127.0.0.1:") for name in (killed, survivor))
    started = [event for event in events if isinstance(event, RealizationStarted)]
    assert {event.worker for event in started} == {killed, survivor}


# A runner as the command is: it says when it has a scheduler, then the error with which it ends, and whatever else is
# written meanwhile.
RUNNER = """
import sys; from contextlib import asynccontextmanager; from pathlib import Path
from test_campaign_dask import DEADLY, fly, open_dask; from bench.campaign import WorkersUnusable

@asynccontextmanager
async def open_executor(*arguments, **options):
    async with open_dask(*arguments, **options, address=sys.argv[2]) as executor:
        print("open", flush=True)
        yield executor

try:
    fly(Path(sys.argv[1]), open_executor, DEADLY)
except WorkersUnusable as error:
    sys.exit(str(error))
"""


GONE = "the Dask scheduler at {} is gone. Run the same command again: only the sessions that were under way are flown again\n"


def runner(folder: Path, address: str) -> subprocess.Popen[str]:
    path = os.pathsep.join(str(place) for place in (Path(__file__).parent, Path(__file__).parents[1]))
    return subprocess.Popen(
        [sys.executable, "-c", RUNNER, str(folder), address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )


def test_a_lost_scheduler_costs_what_was_under_way(tmp_path: Path) -> None:
    """The run ends with one sentence, the remedy: Distributed's tracebacks stay off the terminal, and none of ours joins
    them. On another cluster, the same command flies what has no result, and nothing twice.
    """
    with open_cluster(tmp_path) as cluster:
        (tmp_path / "victim").write_text(str(cluster.scheduler.pid))
        process = runner(tmp_path / "out", cluster.address)
        assert process.communicate() == ("open\n", GONE.format(cluster.address))
    first = entries(tmp_path / "out")
    done = {name for name, entry in first.items() if entry.outcome is not None}
    under_way = {name for name, entry in first.items() if entry.attempts and entry.outcome is None}
    assert 1 <= len(under_way) <= 2

    summary = fly(tmp_path / "out", partial(open_dask, at_most=1))

    assert (summary.complete, summary.flown) == (True, len(first) - len(done))
    attempts = {name: entry.attempts for name, entry in entries(tmp_path / "out").items()}
    assert attempts == {name: 1 + (name in under_way) for name in first}
    fly(tmp_path / "local", open_in_process())
    assert evidence(tmp_path / "out") == evidence(tmp_path / "local")


def test_a_scheduler_that_is_lost_before_a_worker_came_is_told_in_one_sentence(tmp_path: Path) -> None:
    """The campaign still waits for its first worker."""
    with open_cluster(tmp_path, workers=0) as cluster:
        process = runner(tmp_path / "out", cluster.address)
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        cluster.scheduler.kill()
        assert process.communicate() == ("", GONE.format(cluster.address))
    assert {entry.outcome for entry in entries(tmp_path / "out").values()} <= {None}


def test_a_cluster_of_this_machine_starts_beside_another_one(tmp_path: Path) -> None:
    """The port that Dask's schedulers have by default is taken: no warning reaches the terminal, and everything flies."""
    with socket.socket() as other:
        # Where it is taken already, that is as good.
        with suppress(OSError):
            other.bind(("", 8787))
            other.listen()
        fly(tmp_path / "out", open_dask)
    outcomes = {entry.outcome for entry in entries(tmp_path / "out").values()}
    assert outcomes == {Outcome.COMPLETED, Outcome.AGENT_CRASHED}  # as MIXED_ENDS has it


def test_schedulers_that_cannot_serve_are_refused(tmp_path: Path) -> None:
    """One that is not there, and one that repeats lost tasks unseen. Nothing was flown by either."""
    with pytest.raises(SetupError, match=r"no Dask scheduler answers at tcp://127.0.0.1:9"):
        fly(tmp_path / "out", partial(open_dask, address="tcp://127.0.0.1:9", connect_s=0.2))
    with (
        open_cluster(tmp_path, workers=0, repeats=3) as cluster,
        pytest.raises(SetupError, match=r"repeats the tasks of a lost worker 3 times.*ALLOWED_FAILURES=0"),
    ):
        fly(tmp_path / "out", partial(open_dask, address=cluster.address))

    assert {entry.attempts for entry in entries(tmp_path / "out").values()} == {0}


def test_workers_with_other_software_are_refused() -> None:
    """Each package that differs is named; packages that only the worker has do not matter."""
    runner = {"python": "3.13.1", "numpy": "2.1.0", "jsbsim": "1.3.3"}
    assert version_faults(runner, {**runner, "other": "1.0"}) == []
    assert version_faults(runner, {"python": "3.13.1", "numpy": "2.2.0"}) == [
        "a worker has numpy 2.2.0, the runner 2.1.0",
        "a worker has jsbsim not installed, the runner 1.3.3",
    ]
