"""The runner with real worker processes and fake sessions: every realization once, whatever happens."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import campaign_fakes
import pytest
from campaign_fakes import JOB, Script, entries, fly, known, small_campaign

from bench.campaign import (
    CampaignFolder,
    Collaborators,
    Jobs,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    RunOptions,
    WorkersUnusable,
    digest_of,
    open_local_pool,
    read_result,
    run_campaign_sync,
    verify_folder,
)
from bench.contracts import Outcome
from bench.errors import SetupError

ALL = {f"p{point:03d}-r{replicate}-fake" for point in (1, 2, 3) for replicate in (1, 2)}


def outcomes(folder: Path) -> dict[str, Outcome | None]:
    return {name: entry.outcome for name, entry in entries(folder).items()}


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@contextmanager
def runner(folder: Path, *acts: str) -> Iterator[subprocess.Popen[str]]:
    """A runner in a process of its own."""
    code = (
        "import sys; sys.path[:0] = [sys.argv[1]]; import campaign_fakes; campaign_fakes.main(*sys.argv[2:])"
    )
    beside = str(Path(campaign_fakes.__file__).parent)
    command = [sys.executable, "-c", code, beside, str(folder), *acts]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_flies_everything_once(tmp_path: Path) -> None:
    """A campaign gets one complete result for each realization, the same bytes in any folder, and its manifest holds."""
    events: list[object] = []
    paths = CampaignFolder(tmp_path / "out")

    summary = fly(paths.path, workers=2, observers=[events.append], open_executor=open_local_pool)

    assert summary.complete
    assert summary.flown == 6
    assert summary.outcomes == {Outcome.COMPLETED: 6}
    assert outcomes(paths.path) == dict.fromkeys(ALL, Outcome.COMPLETED)
    assert all(read_result(paths.run(name), name) for name in ALL)
    assert sum(isinstance(event, RealizationStarted) for event in events) == 6
    assert [event.done for event in events if isinstance(event, RealizationFinished)] == [1, 2, 3, 4, 5, 6]
    assert verify_folder(paths.path) == []
    fly(tmp_path / "again")
    files, again = (
        json.loads((folder / "manifest.json").read_text())["files"]
        for folder in (paths.path, tmp_path / "again")
    )
    assert {name: digest for name, digest in files.items() if not name.startswith("logs/")} == again


def test_runs_again_without_flying_again(tmp_path: Path) -> None:
    """A finished folder is left as it is; a lost result is flown again, alone; a lost SimSpec comes back from its seeds;
    more replicates join those that are there.
    """
    fly(tmp_path)
    paths = CampaignFolder(tmp_path)
    before = {name: digest_of(paths.simspec(name)) for name in ALL}

    assert fly(tmp_path).flown == 0
    paths.run("p002-r1-fake").joinpath("result.json").unlink()
    paths.simspec("p001-r1-fake").unlink()
    assert fly(tmp_path).flown == 1
    grown = fly(tmp_path, small_campaign(replicates=3))

    assert (grown.flown, grown.total) == (3, 9)
    assert {name: digest_of(paths.simspec(name)) for name in ALL} == before


def test_what_could_never_be_scored_is_not_flown(tmp_path: Path) -> None:
    """Situations that the decomposition cannot rate are refused before the first is placed, with what they lack."""
    with pytest.raises(
        SetupError, match="key factor 'intelligence_uncertainty_m' has no value in this situation"
    ):
        run_campaign_sync(small_campaign(), tmp_path, collaborators=Collaborators(jobs=Jobs(JOB)))

    assert not list(tmp_path.glob("simspecs/*"))


def test_bad_sessions_cost_themselves_only(tmp_path: Path) -> None:
    """Jobs that raise, exit, crash or leave end with a reason after one retry, and the other sessions complete."""
    acts = {"p001-r1-fake": "raise", "p001-r2-fake": "exit", "p002-r1-fake": "segv", "p002-r2-fake": "leave"}
    events: list[object] = []

    summary = fly(
        tmp_path, script=Script(acts), workers=2, observers=[events.append], open_executor=open_local_pool
    )

    assert summary.completeness.missing == {Outcome.BENCH_ERROR: 2, Outcome.WORKER_LOST: 2}
    by_id = entries(tmp_path)
    for name, outcome, words in (
        ("p001-r1-fake", Outcome.BENCH_ERROR, "a made-up bench error"),
        ("p001-r2-fake", Outcome.WORKER_LOST, "ended with code 3"),
        ("p002-r1-fake", Outcome.WORKER_LOST, "SIGSEGV"),
        ("p002-r2-fake", Outcome.BENCH_ERROR, ""),
    ):
        assert by_id[name].outcome is outcome
        assert words in by_id[name].reason
    assert {name: entry.attempts for name, entry in by_id.items()} == {
        name: 2 if name in acts else 1 for name in ALL
    }
    retried = [event.realization for event in events if isinstance(event, RealizationRetried)]
    assert sorted(retried) == sorted(acts)


def test_the_last_words_of_a_worker_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the result and the journal, and what Python wrote in the log too, also where its encoding lacks a sign."""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    fly(tmp_path, script=Script({"p001-r1-fake": "babble"}), workers=2, open_executor=open_local_pool)

    printed, written = "printed \\x1b[2J\\u202e -", "written \\x1b[2J\ufffd"
    result = known(read_result(tmp_path / "runs" / "p001-r1-fake", "p001-r1-fake"))
    for reason in (result.reason, entries(tmp_path)["p001-r1-fake"].reason):
        assert reason.endswith(f"ended with code 3; its last output: {printed}\n{written}")
    logs = [path.read_bytes() for path in (tmp_path / "logs").iterdir()]
    assert [log for log in logs if printed.encode() in log]


def test_a_retry_may_succeed(tmp_path: Path) -> None:
    """A lost worker that does not come back leaves a completed run and a second attempt in the journal. In
    between, real workers wait for a pause of the real clock with nothing else to do.
    """
    events: list[object] = []
    campaign = small_campaign(1, 1, retry_s=0.1)
    script = Script({"p001-r1-fake": "exit-once"})
    summary = fly(tmp_path, campaign, script, observers=[events.append], open_executor=open_local_pool)

    assert summary.outcomes == {Outcome.COMPLETED: 1}
    (pause_s,) = (event.pause_s for event in events if isinstance(event, RealizationRetried))
    assert 0.1 <= pause_s <= 0.125
    assert entries(tmp_path)["p001-r1-fake"].attempts == 2


def test_hung_session_is_killed(tmp_path: Path) -> None:
    """A session past its wall budget is killed with its agent and retried, since the host may have been busy;
    then it ends as WALL_BUDGET.
    """
    campaign = small_campaign(points=1, wall_s=0.3)
    agent = tmp_path / "agent.pid"
    agents: set[str] = set()

    reading_s = 0.0

    def clock() -> float:
        """Stands still but for the life of the agent, however slow the host is; there, every reading leaps
        over the budget.
        """
        nonlocal reading_s
        # Every reading and not only the first: the runner may hear that the worker is ready, and begin to
        # count, after the agent has started.
        if agent.is_file() and (pid := agent.read_text()) and is_alive(int(pid)):
            agents.add(pid)
            reading_s += 100.0
        return reading_s

    open_executor = partial(open_local_pool, grace_s=0.2, clock=clock)
    summary = fly(tmp_path, campaign, Script({"p001-r1-fake": "hang"}), open_executor=open_executor)

    assert summary.outcomes == {Outcome.WALL_BUDGET: 1, Outcome.COMPLETED: 1}
    assert entries(tmp_path)["p001-r1-fake"].attempts == len(agents) == 2
    assert not any(is_alive(int(pid)) for pid in agents)
    assert not (tmp_path / ".scratch").exists()


def test_job_that_cannot_be_imported(tmp_path: Path) -> None:
    """When no worker can work the campaign says so and decides nothing about any realization."""
    with pytest.raises(WorkersUnusable, match="no_such_module"):
        run_campaign_sync(
            small_campaign(),
            tmp_path,
            RunOptions(Script()),  # type: ignore[arg-type]
            Collaborators(jobs=Jobs("no_such_module:fly")),
        )

    assert set(outcomes(tmp_path).values()) == {None}
    assert fly(tmp_path).complete


def test_observer_may_fail(tmp_path: Path) -> None:
    """An observer that raises is counted, and changes nothing."""

    def clumsy(event: object) -> None:
        raise RuntimeError(f"cannot show {event}")

    summary = fly(tmp_path, small_campaign(points=1), observers=[clumsy])

    assert summary.complete
    assert summary.observer_faults == 1 + 2 * 2


@pytest.mark.parametrize("sealed", [True, None, False])
def test_finish_that_writes_the_manifest(tmp_path: Path, sealed: bool | None) -> None:
    """Where `finish` returns True, its manifest stays; any other is written over, with the files that `finish` wrote."""

    def finish(folder: CampaignFolder) -> bool | None:
        (folder.path / "scores.parquet").write_bytes(b"scores")
        folder.manifest.write_text("{}")
        return sealed

    fly(tmp_path, finish=finish)

    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert (manifest == {}) is (sealed is True)
    assert sealed or "scores.parquet" in manifest["files"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_asked_to_stop(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C and SIGTERM kill what runs, agents included, and leave a folder that can be resumed."""
    with runner(tmp_path, "p003-r1-fake", "hang") as process:
        assert process.stdout is not None
        for _ in range(11):
            assert process.stdout.readline().endswith("-fake\n")
        process.send_signal(number)
        assert process.stdout.readline() == f"stopped: received {number.name}\n"
        assert process.wait() == 0

    assert not is_alive(int((tmp_path / "agent.pid").read_text()))
    assert fly(tmp_path, small_campaign(points=6)).flown == 1


def test_two_runners_on_one_folder(tmp_path: Path) -> None:
    """The second runner is refused with the process id of the first. The lock ends with its holder, even after kill -9;
    so do its workers, with the agents that they had started.
    """
    with runner(tmp_path, "p003-r1-fake", "hang") as process:
        assert process.stdout is not None
        for _ in range(11):  # all but the one that hangs
            assert process.stdout.readline()
        with pytest.raises(SetupError, match=f"in use by another run \\(process {process.pid}\\)"):
            fly(tmp_path, small_campaign(points=6))
        watch = os.pidfd_open(int((tmp_path / "agent.pid").read_text()))
        process.kill()

    try:
        assert select.select([watch], [], [], 20.0)[0], "the agent is still there"
    finally:
        os.close(watch)
    assert fly(tmp_path, small_campaign(points=6)).flown == 1


def test_importing_is_light() -> None:
    """Documents, journal and runner come without the simulator, the streams or the scorer."""
    code = "import sys, bench.campaign; print([m for m in ('jsbsim', 'zenoh', 'pymavlink', 'polars') if m in sys.modules])"

    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        == "[]\n"
    )
