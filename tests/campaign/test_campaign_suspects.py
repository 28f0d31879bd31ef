"""An agent cannot be rid of a session by breaking the bench, nor draw another by making a real autopilot fail; and no
fault of the host is laid on it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from campaign_fakes import CONFINED, FORFEIT, Script, attempts, fly, small_campaign, texts_of

from bench.agents.confinement import rungs
from bench.campaign import (
    Campaign,
    CampaignAgent,
    CampaignFolder,
    CampaignSummary,
    load_measurable_decomposition,
    open_journal,
    open_local_pool,
    read_result,
    request_retry,
    rescore,
    verify_folder,
)
from bench.campaign.execution._attempts import FirmwareWatch, failed_in_flight
from bench.campaign.execution._flight import fly_confined, fly_here, forfeit_realization
from bench.campaign.execution._suspects import SuspectWatch, is_suspect
from bench.campaign.storage._firmware_ends import (
    add_firmware_ends,
    drawn_out_realizations,
    firmware_ends,
)
from bench.contracts import (
    FIRMWARE_FAILED,
    Confinement,
    Fact,
    FirmwareEnds,
    Outcome,
    SessionResult,
    SuspectEnds,
    facts_of,
)
from bench.realization import place
from bench.reporting import load_report_data, render_report
from bench.simspec import AgentSpec, load_simspec

FIRST, SECOND, THIRD = "p001-r1-fake", "p002-r2-fake", "p003-r1-fake"


def flown(
    folder: Path, acts: dict[str, str], memory_kills: Callable[[], int] = lambda: 0
) -> tuple[CampaignSummary, dict[str, SessionResult]]:
    """A campaign of six fakes in this process; its results by realization."""
    return fly(folder, script=Script(acts), forfeit=FORFEIT, memory_kills=memory_kills), results(folder)


def results(folder: Path) -> dict[str, SessionResult]:
    ends = {path.name: read_result(path, path.name) for path in (folder / "runs").iterdir()}
    return {name: result for name, result in ends.items() if result is not None}


def of_agents(*names: str) -> Campaign:
    """A campaign of one design point, flown twice by each of these agents."""
    agents = tuple(CampaignAgent(manifest=name) for name in names)
    return small_campaign(points=1, replicates=2).model_copy(update={"agents": agents})


def test_two_agents_that_break_the_bench_again_are_charged(tmp_path: Path) -> None:
    """Both runs count, with a recording of their own and both attempts in the result; the campaign is complete."""
    summary, results = flown(tmp_path, {FIRST: "rob", SECOND: "rob"})
    assert summary.complete
    assert summary.outcomes == {Outcome.COMPLETED: 4, Outcome.AGENT_BROKE_BENCH: 2}
    for name in (FIRST, SECOND):
        ends = texts_of(results[name], SuspectEnds)
        assert ends == ("bench_error: FileNotFoundError: somebody removed the recording",) * 2
        assert (
            CampaignFolder(tmp_path).run(name) / "recording.mcap"
        ).read_bytes() == f"none of {name}".encode()
        assert attempts(tmp_path)[name] == 3
    assert results[THIRD].fact(SuspectEnds) is None
    assert verify_folder(tmp_path) == []
    assert flown(tmp_path, {})[0].flown == 0, "an agent's own end is not flown again"


def test_the_rerun_of_a_suspect_is_confined_where_the_host_can(tmp_path: Path) -> None:
    """Two that would break the bench each time end by themselves once confined, are marked, and are charged nothing."""
    script = Script({FIRST: "rob", SECOND: "rob"})
    summary = fly(tmp_path, script=script, forfeit=FORFEIT, confined=CONFINED)
    assert summary.outcomes == {Outcome.COMPLETED: 6}
    for name, suspect in ((FIRST, True), (SECOND, True), (THIRD, False)):
        result = results(tmp_path)[name]
        assert (len(texts_of(result, SuspectEnds)) == 1) == suspect
        confinement = result.fact(Confinement)
        assert (confinement and confinement.isolation) == ("landlock" if suspect else None)


def test_a_confined_rerun_is_the_session_of_the_campaign(tmp_path: Path) -> None:
    """For real: the agent asks for no rung and gets one; SimSpec and recording are those of the unconfined session."""
    if rungs()["landlock"].trial() is not None:
        pytest.skip("no rung starts here")
    spec = load_simspec(Path(__file__).parents[2] / "examples" / "search.yaml")
    mission = spec.mission.model_copy(update={"time_limit_s": 5.0})
    agent = spec.agent.model_copy(update={"isolation": "none"})
    spec = place(spec.model_copy(update={"mission": mission, "agent": agent}))
    nodes = load_measurable_decomposition("search-and-report")
    free = fly_here(spec, nodes, tmp_path / "free", "run")
    confined = fly_confined(spec, nodes, tmp_path / "confined", "run")
    boxes = [result.fact(Confinement) for result in (free, confined)]
    assert [box is not None and box.isolation != "none" for box in boxes] == [False, True]
    # What each leaves open differs, and stands in the result alone: the recording is the same on every host.
    free_walls, confined_walls = (box and box.open_walls for box in boxes)
    assert free_walls is not None
    assert confined_walls is not None
    assert {"files", "tcp", "disk"} <= set(free_walls)
    assert set(confined_walls) < set(free_walls) - {"files", "kernel"}
    assert confined.recording_sha256 == free.recording_sha256
    assert confined.outcome is free.outcome


def test_once_is_marked_and_charged_to_nobody(tmp_path: Path) -> None:
    """The second attempts go well: their outcomes are their own, and both stay visible."""
    summary, results = flown(tmp_path, {FIRST: "rob-once", SECOND: "raise-once"})
    assert summary.outcomes == {Outcome.COMPLETED: 6}
    assert [len(texts_of(results[name], SuspectEnds)) for name in (FIRST, SECOND, THIRD)] == [1, 1, 0]


@pytest.mark.parametrize("act", ["raise", "rob"])
def test_a_fault_that_two_agents_meet_in_a_scene_is_laid_on_neither(tmp_path: Path, act: str) -> None:
    """Whatever fails; what one of two agents alone meets, in another scene, is laid on that one."""
    acts = {"p001-r1-first": act, "p001-r1-second": act, "p001-r2-second": act}
    summary = fly(tmp_path, of_agents("first", "second"), Script(acts), forfeit=FORFEIT)
    ends = [results(tmp_path)[name] for name in acts]
    assert summary.outcomes[Outcome.AGENT_BROKE_BENCH] == 1
    assert [len(texts_of(end, SuspectEnds)) for end in ends] == [2, 2, 2]
    assert [end.outcome is Outcome.AGENT_BROKE_BENCH for end in ends] == [False, False, True]


def test_a_host_without_memory_is_not_laid_on_the_agent(tmp_path: Path) -> None:
    """The kernel kills something during every attempt: nothing is suspect."""
    kills = iter(range(1000))
    summary, results = flown(tmp_path, {FIRST: "rob", SECOND: "rob"}, lambda: next(kills))
    assert summary.completeness.missing == {Outcome.BENCH_ERROR: 2}
    assert all(result.fact(SuspectEnds) is None for result in results.values())


def test_a_worker_that_is_killed_each_time(tmp_path: Path) -> None:
    """Real processes and SIGKILL: one realization each time, one once."""
    script = Script({FIRST: "kill", SECOND: "kill-once"})
    summary = fly(tmp_path, script=script, workers=2, forfeit=FORFEIT, open_executor=open_local_pool)
    assert summary.outcomes == {Outcome.COMPLETED: 5, Outcome.AGENT_BROKE_BENCH: 1}
    (end,) = texts_of(results(tmp_path)[SECOND], SuspectEnds)
    assert end.startswith("worker_lost: the worker ")
    assert "was killed by SIGKILL" in end


def ended(realization: str, outcome: Outcome, reason: str = "", *facts: Fact) -> SessionResult:
    return SessionResult(realization=realization, outcome=outcome, reason=reason, facts=facts_of(*facts))


LOST = ended("a", Outcome.WORKER_LOST, "the worker w1 was killed by SIGKILL")


STARTED = Confinement(isolation="landlock", network="own", open_walls=())
NOT_STARTED = Confinement(isolation="landlock", network="own")


@pytest.mark.parametrize(
    ("result", "suspect"),
    [
        (LOST, True),
        (ended("a", Outcome.BENCH_ERROR, "ConnectionResetError: [Errno 104]"), True),
        (ended("a", Outcome.BENCH_ERROR, "KeyError: 'x'", STARTED), True),
        (ended("a", Outcome.BENCH_ERROR, "OSError: disk", NOT_STARTED), False),
        (ended("a", Outcome.WALL_BUDGET, "killed", STARTED), False),
        (ended("a", Outcome.AGENT_CRASHED, "OSError: of the agent", STARTED), False),
    ],
)
def test_what_is_suspect(result: SessionResult, suspect: bool) -> None:
    """On every rung, but not before the agent has started."""
    assert is_suspect(result) == suspect


def test_every_attempt_counts_and_something_must_work() -> None:
    """Two realizations side by side: one lost twice, the other once."""
    watch = SuspectWatch(lambda: 7)
    other = LOST.model_copy(update={"realization": "b"})
    for result in (LOST, other):
        watch.start(result.realization)
        watch.record(result)
        assert not watch.forfeits(result, bench_works=True), "once is no evidence"
    watch.record(LOST)
    assert not watch.forfeits(LOST, bench_works=False)
    assert not watch.forfeits(other, bench_works=True)
    assert watch.forfeits(LOST, bench_works=True)
    assert (watch.is_forfeited("a"), watch.is_forfeited("b")) == (True, False)
    # The session without the agent is lost too: then it is the host, and there is no third time.
    watch.record(LOST)
    assert not watch.forfeits(LOST, bench_works=True)


def test_a_confined_agent_is_suspected_as_well() -> None:
    """Two workers are lost twice each, under an agent on a rung and under one without, which is confined for the rerun."""
    watch = SuspectWatch(lambda: 0, lambda: CONFINED, {"a": False, "b": True}.__getitem__)
    jobs = []
    for name in ("a", "b", "a", "b"):
        jobs.append(watch.confined_job(name))
        watch.record(LOST.model_copy(update={"realization": name}))
    assert jobs == [None, None, None, CONFINED]
    ends = [LOST.model_copy(update={"realization": name}) for name in ("a", "b")]
    assert [watch.forfeits(end, bench_works=True) for end in ends] == [True, True]
    assert [len(texts_of(watch.marked(end), SuspectEnds)) for end in ends] == [2, 2]


def test_a_forfeited_realization_is_recorded_and_measured(tmp_path: Path) -> None:
    """For real: both paces end before anything flies, with what the situation considers, and score again the same."""
    example = Path(__file__).parents[2] / "examples" / "search.yaml"
    decomposition = load_measurable_decomposition("search-and-report")
    spec = place(load_simspec(example)).model_copy(update={"agent": AgentSpec(manifest="reference-naive")})
    result = forfeit_realization(spec, decomposition, tmp_path / "run", "run")
    assert result.outcome is Outcome.AGENT_BROKE_BENCH, result.reason
    assert result.outcome.counts
    assert result.simulated_s == 0.0
    values = {
        observation.observable: observation.x for observation in result.observations if observation.considered
    }
    assert len(values) >= 3
    assert sum(x or 0.0 for x in values.values()) <= 0.2 * len(values), values
    (tmp_path / "run" / "result.json").write_text(result.model_dump_json())
    again = rescore(tmp_path / "run", decomposition)
    assert again.outcome is Outcome.AGENT_BROKE_BENCH
    assert again.observations == result.observations


def test_the_report_lists_suspects_first_and_shows_probes(tmp_path: Path) -> None:
    """Of six runs the last two by name are suspect, and one of them probed; a run without probes has a dash."""
    last, before = "p003-r2-fake", "p003-r1-fake"
    flown(tmp_path, {last: "rob", before: "rob-once"})
    path = CampaignFolder(tmp_path).run(before) / "result.json"
    document = json.loads(path.read_text())
    document["counters"] = {"tick_strangers": 2, "simulation_refused": 3, "air_lost": 9}
    path.write_text(json.dumps(document))
    page = render_report(load_report_data(tmp_path))
    table = page[page.index('id="all-runs"') :].split("</table>")[0]
    rows = table.split("<tr>")[2:]
    assert ["<td>suspect: " in row for row in rows] == [True, True, False, False, False, False]
    assert before in rows[1]
    assert "2 strangers on the tick socket, 3 attempts to change the simulation" in rows[1]
    assert "air_lost" not in table
    # Of two marked runs, the one that did not complete.
    assert last in rows[0]
    assert "agent broke bench" in rows[0]
    assert ">Probes</th>" in table
    assert f"may have caused, in {before}, {last}." in page


END = "after 12.5 s: the autopilot's firmware failed: PX4 ended with SIGSEGV"


def test_a_firmware_that_fails_in_flight_is_flown_once_more_and_marked(tmp_path: Path) -> None:
    """One fails each time and is missing after two flights, however long retries may last; one fails once and counts."""
    summary, results = flown(tmp_path, {FIRST: "firmware", SECOND: "firmware-once", THIRD: "raise-once"})
    assert summary.outcomes == {Outcome.COMPLETED: 5, Outcome.BENCH_ERROR: 1}
    assert not summary.complete
    assert [attempts(tmp_path)[name] for name in (FIRST, SECOND, THIRD)] == [2, 2, 2]
    assert texts_of(results[FIRST], FirmwareEnds) == (END, END)
    assert texts_of(results[SECOND], FirmwareEnds) == (END,)
    assert texts_of(results[THIRD], FirmwareEnds) == ()
    (note,) = [note for note in load_report_data(tmp_path).notes if "real autopilot failed" in note]
    assert f"in {FIRST}, {SECOND}." in note


def test_no_run_of_the_campaign_gives_an_agent_further_draws(tmp_path: Path) -> None:
    """One agent's firmware fails in both replicates, once in one of the other's: three resumed runs fly nothing, unless a
    person asks for it, and each such draw is in the result.
    """
    campaign = of_agents("crasher", "steady")
    acts = {"p001-r1-crasher": "firmware", "p001-r2-crasher": "firmware", "p001-r2-steady": "firmware-once"}
    assert fly(tmp_path, campaign, Script(acts)).outcomes == {Outcome.COMPLETED: 2, Outcome.BENCH_ERROR: 2}
    flights = {"p001-r1-crasher": 2, "p001-r2-crasher": 2, "p001-r1-steady": 1, "p001-r2-steady": 2}
    for _ in range(2):
        summary = fly(tmp_path, campaign, Script(acts))
        assert (summary.flown, summary.completeness.drawn_out, attempts(tmp_path)) == (0, 2, flights)
    request_retry(tmp_path)
    assert fly(tmp_path, campaign, Script(acts)).flown == 0
    # One person's word is one flight each, whose end is as final as before.
    summary = fly(tmp_path, campaign, Script({"p001-r1-crasher": "firmware"}), rerun={Outcome.BENCH_ERROR})
    assert (summary.flown, summary.completeness.drawn_out) == (2, 1)
    assert attempts(tmp_path) == flights | {"p001-r1-crasher": 3, "p001-r2-crasher": 3}
    ends = {name: texts_of(result, FirmwareEnds) for name, result in results(tmp_path).items()}
    assert ends["p001-r1-crasher"] == (END,) * 3
    assert ends["p001-r2-crasher"] == (END,) * 2, "it went well in the end, and says how often it did not"
    assert (ends["p001-r2-steady"], ends["p001-r1-steady"]) == ((END,), ())
    assert fly(tmp_path, campaign).flown == 0


def failed(realization: str, simulated_s: float, reason: str = f"{FIRMWARE_FAILED}: x") -> SessionResult:
    return ended(realization, Outcome.BENCH_ERROR, reason).model_copy(update={"simulated_s": simulated_s})


def test_what_the_host_spoils_between_two_failures_gives_no_draw(tmp_path: Path) -> None:
    """Counted are failures in flight, whatever came between them; a realization that last failed otherwise is flown."""
    with open_journal(tmp_path / "journal.sqlite") as journal:
        add_firmware_ends(journal, {"p001-r1-crasher": ["in a shard"], "p001-r1-steady": ["x", "y"]})
        add_firmware_ends(journal, {})
        assert firmware_ends(journal) == {"p001-r1-crasher": ["in a shard"], "p001-r1-steady": ["x", "y"]}
        watch = FirmwareWatch(journal)
        for end, exhausted in (
            (failed("p001-r1-crasher", 0.0), False),
            (failed("p001-r1-crasher", 3.0), True),
        ):
            watch.record(end)
            assert watch.is_exhausted(end) is exhausted
        assert drawn_out_realizations(journal) == frozenset(), "neither has a result"


@pytest.mark.parametrize(
    ("result", "in_flight"),
    [
        (failed("a", 0.5), True),
        (failed("a", 0.0), False),
        (failed("a", 0.5, "KeyError: 'x'"), False),
        (failed("a", 0.5).model_copy(update={"outcome": Outcome.COMPLETED}), False),
    ],
)
def test_only_failures_that_an_agent_can_reach_are_limited(
    result: SessionResult, in_flight: bool, tmp_path: Path
) -> None:
    assert failed_in_flight(result) is in_flight
    with open_journal(tmp_path / "journal.sqlite") as journal:
        watch = FirmwareWatch(journal)
        verdicts = []
        for _ in range(3):
            watch.record(result)
            verdicts.append(watch.is_exhausted(result))
        assert verdicts == ([False, True, True] if in_flight else [False] * 3)
        assert not watch.is_exhausted(failed("b", 0.5))
