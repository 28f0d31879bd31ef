"""The runner with real worker processes and fake sessions: every realization once, whatever happens."""

from __future__ import annotations

import json
import os
import random
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import anyio
import campaign_fakes
import pytest
from campaign_fakes import JOB, Script, entries, fly, small_campaign

from bench.campaign import (
    CampaignFolder,
    Collaborators,
    Jobs,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    RunOptions,
    Task,
    WorkerPlan,
    WorkersUnusable,
    digest_of,
    open_journal,
    open_local_pool,
    read_result,
    realizations,
    run_campaign_sync,
    verify_folder,
    write_whole,
)
from bench.contracts import Outcome, SessionResult
from bench.documents import dump_json
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
def runner(folder: Path, span_s: float, *acts: str) -> Iterator[subprocess.Popen[str]]:
    """A runner in a process of its own."""
    code = (
        "import sys; sys.path[:0] = [sys.argv[1]]; import campaign_fakes; campaign_fakes.main(*sys.argv[2:])"
    )
    beside = str(Path(campaign_fakes.__file__).parent)
    command = [sys.executable, "-c", code, beside, str(folder), str(span_s), *acts]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_flies_everything_once(tmp_path: Path) -> None:
    """A campaign gets one complete result for each realization, and its manifest holds."""
    events: list[object] = []

    summary = fly(tmp_path, workers=2, observers=[events.append], open_executor=open_local_pool)

    assert summary.complete
    assert summary.flown == 6
    assert summary.outcomes == {Outcome.COMPLETED: 6}
    assert outcomes(tmp_path) == dict.fromkeys(ALL, Outcome.COMPLETED)
    paths = CampaignFolder(tmp_path)
    assert all(read_result(paths.run(name), name) for name in ALL)
    assert sum(isinstance(event, RealizationStarted) for event in events) == 6
    assert [event.done for event in events if isinstance(event, RealizationFinished)] == [1, 2, 3, 4, 5, 6]
    assert verify_folder(tmp_path) == []
    paths.run("p001-r1-fake").joinpath("recording.mcap").write_bytes(b"tampered with")
    assert [fault.where for fault in verify_folder(tmp_path)] == ["runs/p001-r1-fake/recording.mcap"]


def test_runs_again_without_flying_again(tmp_path: Path) -> None:
    """A finished folder is left as it is; a lost result is flown again, alone; more replicates join those
    that are there.
    """
    fly(tmp_path)
    before = {name: digest_of(CampaignFolder(tmp_path).simspec(name)) for name in ALL}

    assert fly(tmp_path).flown == 0
    CampaignFolder(tmp_path).run("p002-r1-fake").joinpath("result.json").unlink()
    assert fly(tmp_path).flown == 1
    grown = fly(tmp_path, small_campaign(replicates=3))

    assert (grown.flown, grown.total) == (3, 9)
    assert {name: digest_of(CampaignFolder(tmp_path).simspec(name)) for name in ALL} == before


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
    assert by_id["p001-r1-fake"].outcome is Outcome.BENCH_ERROR
    assert "a made-up bench error" in by_id["p001-r1-fake"].reason
    assert by_id["p001-r2-fake"].outcome is Outcome.WORKER_LOST
    assert "ended with code 3" in by_id["p001-r2-fake"].reason
    assert by_id["p002-r1-fake"].outcome is Outcome.WORKER_LOST
    assert "SIGSEGV" in by_id["p002-r1-fake"].reason
    assert by_id["p002-r2-fake"].outcome is Outcome.BENCH_ERROR
    assert [by_id[name].attempts for name in acts] == [2, 2, 2, 2]
    assert [by_id[name].attempts for name in sorted(ALL - acts.keys())] == [1, 1]
    assert sorted(event.realization for event in events if isinstance(event, RealizationRetried)) == sorted(
        acts
    )


def test_the_last_words_of_a_worker_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the result and the journal, and what Python wrote in the log too, also where its encoding lacks a sign."""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    fly(tmp_path, script=Script({"p001-r1-fake": "babble"}), workers=2, open_executor=open_local_pool)

    printed, written = "printed \\x1b[2J\\u202e -", "written \\x1b[2J\ufffd"
    result = read_result(tmp_path / "runs" / "p001-r1-fake", "p001-r1-fake")
    assert result is not None
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
    assert [0.1 <= event.pause_s <= 0.125 for event in events if isinstance(event, RealizationRetried)] == [
        True
    ]
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


def test_two_workers_lost_at_once(tmp_path: Path) -> None:
    """Both tasks end as lost, each with its own worker; the next task gets a new worker."""
    plans = realizations(small_campaign(points=2, replicates=2))
    acts = {plan.id: "exit" for plan in plans[:2]}
    for plan in plans:
        write_whole(CampaignFolder(tmp_path).simspec(plan.id), dump_json(plan.simspec))
    tasks = [
        Task(
            plan.id,
            CampaignFolder(tmp_path).simspec(plan.id),
            CampaignFolder(tmp_path).fresh_run(plan.id),
            600.0,
        )
        for plan in plans
    ]
    workers: list[str] = []
    results: list[SessionResult] = []

    async def fly_all() -> None:
        async def fly(task: Task) -> None:
            results.append(await pool.fly(task, workers.append))

        async with open_local_pool(WorkerPlan(JOB, Script(acts)), 2, tmp_path) as pool:
            async with anyio.create_task_group() as flights:
                for task in tasks[:2]:
                    flights.start_soon(fly, task)
            await fly(tasks[2])

    anyio.run(fly_all)
    assert workers == ["w1", "w2", "w3"]
    assert {result.realization for result in results[:2]} == set(acts)
    assert {result.outcome for result in results[:2]} == {Outcome.WORKER_LOST}
    assert all("ended with code 3" in result.reason for result in results[:2])
    assert results[2].outcome is Outcome.COMPLETED


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


def test_no_room_is_a_result(tmp_path: Path) -> None:
    """A scene that cannot be placed is a result with its reason, without any worker."""
    campaign = small_campaign(points=1, replicates=1)
    assert campaign.base is not None
    crowd = campaign.base.actors[0].model_copy(update={"count": 5000})
    campaign = campaign.model_copy(update={"base": campaign.base.model_copy(update={"actors": (crowd,)})})

    summary = fly(tmp_path, campaign, open_executor=open_local_pool)

    assert summary.outcomes == {Outcome.PLACEMENT_INFEASIBLE: 1}
    assert "5000 of 'people' need at least" in entries(tmp_path)["p001-r1-fake"].reason
    assert not (tmp_path / "logs").exists()


def test_finish_comes_before_the_manifest(tmp_path: Path) -> None:
    """What is made of a complete campaign is in its manifest."""
    fly(tmp_path, finish=lambda folder: (folder.path / "scores.parquet").write_bytes(b"scores") and None)

    assert "scores.parquet" in json.loads((tmp_path / "manifest.json").read_text())["files"]


@pytest.mark.parametrize("sealed", [True, None, False])
def test_finish_that_writes_the_manifest(tmp_path: Path, sealed: bool | None) -> None:
    """Where `finish` returns True, its manifest stays; any other is written over."""

    def finish(folder: CampaignFolder) -> bool | None:
        folder.manifest.write_text("{}")
        return sealed

    fly(tmp_path, finish=finish)

    assert ((tmp_path / "manifest.json").read_text() == "{}") is (sealed is True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_asked_to_stop(tmp_path: Path, number: signal.Signals) -> None:
    """Ctrl-C and SIGTERM kill what runs, agents included, and leave a folder that can be resumed."""
    with runner(tmp_path, 0.0, "p003-r1-fake", "hang") as process:
        assert process.stdout is not None
        for _ in range(11):  # all but the one that hangs
            assert process.stdout.readline().endswith("-fake\n")
        process.send_signal(number)
        assert process.stdout.readline() == f"stopped: received {number.name}\n"
        assert process.wait() == 0

    assert not is_alive(int((tmp_path / "agent.pid").read_text()))
    assert fly(tmp_path, small_campaign(points=6)).flown == 1


def test_two_runners_on_one_folder(tmp_path: Path) -> None:
    """The second runner is refused with the process id of the first.

    The lock ends with its holder, even after kill -9.
    """
    with runner(tmp_path, 0.0, "p003-r1-fake", "hang") as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        with pytest.raises(SetupError, match=f"in use by another run \\(process {process.pid}\\)"):
            fly(tmp_path, small_campaign(points=6))
        process.kill()

    assert fly(tmp_path, small_campaign(points=6)).complete


def test_killed_runner_resumes(tmp_path: Path) -> None:
    """Killed with -9 again and again at random moments, the campaign still comes to one result for each realization."""
    chance = random.Random(5)
    for _ in range(4):
        with runner(tmp_path, 0.02) as process:
            assert process.stdout is not None
            for _ in range(chance.randint(0, 3)):
                process.stdout.readline()
            try:
                process.wait(chance.uniform(0.0, 0.1))
            except subprocess.TimeoutExpired:
                process.kill()

    summary = fly(tmp_path, small_campaign(points=6))

    assert summary.outcomes == {Outcome.COMPLETED: 12}
    paths = CampaignFolder(tmp_path)
    for name, entry in entries(tmp_path).items():
        result = read_result(paths.run(name), name)
        assert result is not None
        assert entry.result_sha256 == digest_of(paths.run(name) / "result.json")
    with open_journal(paths.journal) as journal:
        completed = journal._database.execute(
            "SELECT realization FROM attempts WHERE outcome = 'completed'"
        ).fetchall()
    assert (
        len(completed) == len(set(completed)) <= 12
    )  # fewer if a result was taken up that the journal had missed
    assert verify_folder(tmp_path) == []


def test_killed_runner_takes_its_workers_along(tmp_path: Path) -> None:
    """Workers notice that their runner is gone, and end with the agents that they had started."""
    with runner(tmp_path, 0.0, "p003-r1-fake", "hang") as process:
        assert process.stdout is not None
        for _ in range(11):
            process.stdout.readline()
        agent = int((tmp_path / "agent.pid").read_text())
        watch = os.pidfd_open(agent)
        process.kill()

    try:
        assert select.select([watch], [], [], 20.0)[0], "the agent is still there"
    finally:
        os.close(watch)


def test_result_that_the_journal_missed_is_taken_up(tmp_path: Path) -> None:
    """A runner killed between writing a result and noting it loses nothing.

    A damaged recording is flown again.
    """
    fly(tmp_path)
    with open_journal(tmp_path / "journal.sqlite") as journal:
        for name in ("p001-r1-fake", "p002-r1-fake"):
            journal.forget(name)
    CampaignFolder(tmp_path).run("p002-r1-fake").joinpath("recording.mcap").write_bytes(b"cut off")

    summary = fly(tmp_path)

    assert summary.flown == 1
    assert entries(tmp_path)["p001-r1-fake"].attempts == 1
    assert entries(tmp_path)["p002-r1-fake"].attempts == 2


def test_same_campaign_same_bytes(tmp_path: Path) -> None:
    """The same campaign leaves the same SimSpecs and recordings, byte for byte, in any folder."""
    for name in ("first", "second"):
        fly(tmp_path / name, small_campaign(points=2), workers=2, open_executor=open_local_pool)

    first, second = (
        json.loads((tmp_path / name / "manifest.json").read_text())["files"] for name in ("first", "second")
    )
    assert first == second


def test_lost_simspec_is_written_again(tmp_path: Path) -> None:
    """A SimSpec that was deleted or damaged comes back from its seeds with the same bytes."""
    fly(tmp_path)
    paths = CampaignFolder(tmp_path)
    before = digest_of(paths.simspec("p001-r1-fake"))
    paths.simspec("p001-r1-fake").unlink()

    fly(tmp_path)

    assert digest_of(paths.simspec("p001-r1-fake")) == before


def test_importing_is_light() -> None:
    """Documents, journal and runner come without the simulator, the streams or the scorer."""
    code = "import sys, bench.campaign; print([m for m in ('jsbsim', 'zenoh', 'pymavlink', 'polars') if m in sys.modules])"

    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        == "[]\n"
    )


def test_an_edited_result_is_refused_and_flown_again_once_it_is_removed(tmp_path: Path) -> None:
    """The chain has the digest of the result: a different one in its place stops every run, however well
    formed, and stays as it is.
    """
    fly(tmp_path)
    file = CampaignFolder(tmp_path).run("p002-r1-fake") / "result.json"
    before = file.read_bytes()
    file.write_bytes(before.replace(b'"simulated_s": 1.0', b'"simulated_s": 9.0'))
    edited = file.read_bytes()
    assert edited != before
    with pytest.raises(SetupError, match=r"result.json: has changed since its session"):
        fly(tmp_path)
    assert file.read_bytes() == edited
    file.unlink()
    assert fly(tmp_path).flown == 1
    assert file.read_bytes() != before.replace(b'"simulated_s": 1.0', b'"simulated_s": 9.0')
    assert verify_folder(tmp_path) == []


def test_a_full_disk_is_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bench errors on a full disk stop the campaign with a sentence.

    With space again, everything is flown.
    """
    with monkeypatch.context() as full:
        full.setattr("bench.campaign.execution._dispatcher.MIN_FREE_BYTES", 2**60)
        with pytest.raises(SetupError, match="the disk is full"):
            fly(tmp_path, script=Script({"p001-r1-fake": "raise"}))
    assert outcomes(tmp_path)["p001-r1-fake"] is None
    ended = fly(tmp_path)
    assert (ended.complete, ended.outcomes) == (True, {Outcome.COMPLETED: 6})
