"""Runs that the host may have cost: flown again by themselves, by a clock that no test waits for, and never final without a
person's word.
"""

from __future__ import annotations

import json
import os
import signal
from itertools import pairwise
from pathlib import Path

import pytest
from campaign_fakes import Script, attempts, entries, fly, known, small_campaign
from in_process_executor import HostClock, open_in_process

from bench.campaign import (
    BenchBroken,
    CampaignFolder,
    CampaignSummary,
    Completeness,
    RealizationRetried,
    open_local_pool,
    verify_folder,
)
from bench.campaign.execution._attempts import JITTER, Retries, is_worth_a_retry
from bench.campaign.execution._dispatcher import _is_full
from bench.cli._app import run
from bench.contracts import AgentExit, Outcome, SessionResult, facts_of
from bench.errors import SetupError

ALL = [f"p{point:03d}-r{replicate}-fake" for point in (1, 2, 3) for replicate in (1, 2)]
LOST = ("p001-r2-fake", "p003-r1-fake")


@pytest.mark.parametrize(
    ("act", "outcome"), [("vanish", Outcome.SETUP_INVALID), ("raise", Outcome.BENCH_ERROR)]
)
def test_what_the_host_may_have_cost_is_flown_again_by_the_next_run(
    tmp_path: Path, act: str, outcome: Outcome
) -> None:
    """Files vanish for two of six sessions: they are missing until the same command is run again. Their
    earlier results are in aside/, and the other four are not touched.
    """
    broken = fly(tmp_path, script=Script(dict.fromkeys(LOST, act)))
    assert (broken.done, broken.complete) == (6, False)
    assert broken.completeness.missing == {outcome: 2}
    assert json.loads((tmp_path / "manifest.json").read_text())["missing"] == {outcome: 2}

    mended = fly(tmp_path)
    assert (mended.flown, mended.complete) == (2, True)
    assert mended.outcomes == {Outcome.COMPLETED: 6}
    assert attempts(tmp_path) == dict.fromkeys(attempts(tmp_path), 1) | dict.fromkeys(LOST, 3)
    assert {path.name for path in (tmp_path / "aside").iterdir()} == {f"{name}-2.json" for name in LOST}
    assert json.loads((tmp_path / "manifest.json").read_text())["missing"] == {}


def test_every_run_has_two_attempts_of_its_own(tmp_path: Path) -> None:
    """What failed on another day does not use up the retry of today."""
    for run_number in (1, 2):
        events: list[object] = []
        ended = fly(tmp_path, small_campaign(2), Script({LOST[0]: "vanish"}), observers=[events.append])
        assert ended.completeness.missing == {Outcome.SETUP_INVALID: 1}
        assert attempts(tmp_path)[LOST[0]] == 2 * run_number
        assert [event.realization for event in events if isinstance(event, RealizationRetried)] == [LOST[0]]


def test_a_person_may_accept_what_is_missing_and_take_it_back(tmp_path: Path) -> None:
    """Accepted is what has the outcome now, by realization; the manifest names it, and `rerun` withdraws it. What an
    agent did can be neither accepted nor flown again.
    """
    fly(tmp_path, script=Script({LOST[0]: "vanish", LOST[1]: "raise"}))
    half = fly(tmp_path, script=Script({LOST[1]: "raise"}), accept=[Outcome.SETUP_INVALID])
    assert half.completeness.missing == {Outcome.BENCH_ERROR: 1}
    assert half.completeness.accepted == (LOST[0],)
    assert half.flown == 1

    whole = fly(tmp_path, accept=[Outcome.BENCH_ERROR])
    assert (whole.complete, whole.flown, whole.completeness.accepted) == (True, 0, LOST)
    assert json.loads((tmp_path / "manifest.json").read_text())["accepted"] == list(LOST)

    back = fly(tmp_path, rerun=[Outcome.BENCH_ERROR])
    assert (back.complete, back.flown, back.completeness.accepted) == (True, 1, LOST[:1])
    assert "a made-up bench error" in (tmp_path / "aside" / f"{LOST[1]}-4.json").read_text()
    assert verify_folder(tmp_path) == []
    with pytest.raises(SetupError, match="agent_crashed cannot be accepted"):
        fly(tmp_path, accept=[Outcome.AGENT_CRASHED])
    with pytest.raises(SetupError, match="outcome agent_crashed cannot be rerun"):
        fly(tmp_path, rerun=[Outcome.AGENT_CRASHED])


def test_the_command_takes_only_outcomes_that_are_not_the_agents(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Anything else is refused before a file is written."""
    demo = Path(__file__).parents[2] / "campaigns" / "demo.yaml"
    assert run(["run", str(demo), "--out", str(tmp_path / "out"), "--again", "vehicle_crashed"]) == 2
    assert "bench_error, bench_too_slow, setup_invalid, wall_budget, worker_lost" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_scene_without_room_is_missing_until_it_is_accepted(tmp_path: Path) -> None:
    """No worker is asked, and it is not flown again, since the same seeds find no room; the campaign still lacks the run."""
    campaign = small_campaign(points=1, replicates=1)
    assert campaign.base is not None
    crowd = campaign.base.actors[0].model_copy(update={"count": 5000})
    campaign = campaign.model_copy(update={"base": campaign.base.model_copy(update={"actors": (crowd,)})})

    summary = fly(tmp_path, campaign, open_executor=open_local_pool)
    assert summary.completeness.missing == {Outcome.PLACEMENT_INFEASIBLE: 1}
    assert "5000 of 'people' need at least" in entries(tmp_path)["p001-r1-fake"].reason
    assert not (tmp_path / "logs").exists()
    assert fly(tmp_path, campaign).flown == 0
    assert fly(tmp_path, campaign, accept=[Outcome.PLACEMENT_INFEASIBLE]).complete


@pytest.mark.parametrize(
    ("act", "attempted", "crashed"), [("killed", 2, 1), ("crash", 1, 2)], ids=["killed", "exit code"]
)
def test_an_agent_that_may_have_been_killed_by_the_host_gets_a_second_attempt(
    tmp_path: Path, act: str, attempted: int, crashed: int
) -> None:
    """One that ends so once and one that ends so each time. The second end is its own, and an exit code is at once."""
    script = Script({LOST[0]: f"{act}-once", LOST[1]: act})
    summary = fly(tmp_path, script=script, workers=2)

    assert summary.complete
    assert summary.outcomes == {Outcome.COMPLETED: 6 - crashed, Outcome.AGENT_CRASHED: crashed}
    assert attempts(tmp_path) == dict.fromkeys(attempts(tmp_path), 1) | dict.fromkeys(LOST, attempted)


@pytest.mark.parametrize(
    ("exit_code", "worth"),
    [
        *((code, False) for code in (None, 0, 1, 127, 128, 134, 139, 255)),
        *((-number, False) for number in (signal.SIGSEGV, signal.SIGABRT, signal.SIGPIPE)),
        *((-number, True) for number in (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM)),
        *((code, True) for code in (129, 130, 137, 143)),
    ],
)
def test_only_an_end_that_others_may_have_caused_is_worth_a_retry(exit_code: int | None, worth: bool) -> None:
    facts = {} if exit_code is None else facts_of(AgentExit(code=exit_code))
    early = SessionResult(realization="r", outcome=Outcome.AGENT_CRASHED, facts=facts)
    assert is_worth_a_retry(early) is worth
    assert not is_worth_a_retry(early.model_copy(update={"simulated_s": 0.1})), (
        "it knows its situation by now"
    )
    assert not is_worth_a_retry(early.model_copy(update={"outcome": Outcome.COMPLETED}))
    assert is_worth_a_retry(early.model_copy(update={"outcome": Outcome.AGENT_NEVER_CONNECTED}))


@pytest.mark.parametrize("act", ["raise", "crash"])
def test_what_a_full_disk_may_have_cost_is_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, act: str
) -> None:
    """An agent that cannot write crashes: the disk is at fault, and with space again the session is flown."""
    with monkeypatch.context() as full:
        full.setattr("bench.campaign.execution._dispatcher.MIN_FREE_BYTES", 2**60)
        with pytest.raises(SetupError, match="the disk is full"):
            fly(tmp_path, script=Script({LOST[0]: act}))
    assert not CampaignFolder(tmp_path).run(LOST[0]).joinpath("result.json").exists()
    assert entries(tmp_path)[LOST[0]].outcome is None
    assert fly(tmp_path).outcomes == {Outcome.COMPLETED: 6}


def test_a_disk_without_free_inodes_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bytes may be free while no further file fits; a file system that counts no files is not full."""
    fields = list(os.statvfs(tmp_path))
    for files, free, full in ((1000, 0, True), (1000, 5, False), (0, 0, False)):
        fields[5], fields[7] = files, free
        disk = os.statvfs_result(fields)
        with monkeypatch.context() as patched:
            patched.setattr(os, "statvfs", lambda path, disk=disk: disk)
            assert _is_full(tmp_path) is full


def test_the_first_line_counts_names_and_explains() -> None:
    """Number, kinds and an example in the first line; the whole command in the second."""
    missing: dict[str, int] = {Outcome.SETUP_INVALID: 19, Outcome.BENCH_ERROR: 1}
    found = Completeness(24, missing, "p001-r1-a: there is no such file").lines(Path("out/my demo"))
    assert found == [
        "INCOMPLETE: 20 of 24 runs are missing: 1 bench_error, 19 setup_invalid (p001-r1-a: there is no such file)",
        "Run `rebar run 'out/my demo/campaign.yaml' --out 'out/my demo'` to fly them. "
        "To go without them for good, add --accept bench_error --accept setup_invalid to that command.",
    ]
    infeasible = Completeness(2, {Outcome.PLACEMENT_INFEASIBLE: 1}).lines(Path("out"))
    assert infeasible[1] == (
        "To go without them for good, run `rebar run out/campaign.yaml --out out --accept placement_infeasible`."
    )
    drawn_out = Completeness(9, {Outcome.BENCH_ERROR: 2}, drawn_out=2).lines(Path("out"))[1]
    assert drawn_out == (
        "The real autopilot of 2 of them failed in flight in each attempt: "
        "`rebar run out/campaign.yaml --out out --again bench_error` flies these once more. "
        "To go without them for good, run `rebar run out/campaign.yaml --out out --accept bench_error`."
    )
    some = Completeness(9, {Outcome.BENCH_ERROR: 3}, drawn_out=2).lines(Path("out"))[1]
    assert some.startswith(
        "Run `rebar run out/campaign.yaml --out out` to fly them. The real autopilot of 2 of them"
    )
    assert Completeness(24, {}).lines(Path("out")) == []
    # Beside a writer the remedy is to wait, and complete numbers may change too.
    found = Completeness(24, missing, writer="7").lines(Path("out"))
    assert found[0].endswith("19 setup_invalid; process 7 is at work in out, so these numbers will change.")
    assert found[1:] == ["Wait until it ends."]
    assert Completeness(24, {}, writer="7").lines(Path("out")) == [
        "RUNNING: process 7 is at work in out, so these numbers will change."
    ]


def test_a_broken_bench_stops_the_campaign(tmp_path: Path) -> None:
    """If the first five sessions all end with bench errors, no more are started. One that completes is enough to go on."""
    campaign = small_campaign()
    with pytest.raises(BenchBroken, match="the first 5 sessions all failed because of the bench or the host"):
        fly(tmp_path, campaign, Script(dict.fromkeys(ALL, "raise")), workers=2)

    assert sum(entry.attempts for entry in entries(tmp_path).values()) <= 6
    assert {entry.outcome for entry in entries(tmp_path).values()} == {None}
    summary = fly(tmp_path, campaign, Script(dict.fromkeys(ALL[1:], "raise")))
    assert summary.outcomes == {Outcome.BENCH_ERROR: 5, Outcome.COMPLETED: 1}


FAULTY = ("p001-r1-fake", "p002-r2-fake")
OTHERS = 4


class FaultUntil(dict[str, str]):
    """What realizations do: two of them fail until the clock reaches the moment at which the host is repaired."""

    def __init__(self, clock: HostClock, repaired_s: float) -> None:
        super().__init__(dict.fromkeys(FAULTY, "raise"))
        self._clock, self._repaired_s = clock, repaired_s

    def get(self, key: str, default: str | None = None) -> str | None:  # type: ignore[override]
        return super().get(key, default) if self._clock.now_s < self._repaired_s else default


def flown(
    folder: Path, repaired_s: float, total_wall_s: float | None = None
) -> tuple[CampaignSummary, HostClock, list[object]]:
    """A campaign on a host with two workers that fails two sessions at first, and its events."""
    clock = HostClock()
    events: list[object] = []
    summary = fly(
        folder,
        small_campaign(retry_s=60.0, total_wall_s=total_wall_s),
        Script(FaultUntil(clock, repaired_s)),
        workers=2,
        observers=[events.append],
        clock=clock,
        open_executor=open_in_process(clock=clock),
    )
    return summary, clock, events


def pauses_s(events: list[object], realization: str) -> list[float]:
    return [
        event.pause_s
        for event in events
        if isinstance(event, RealizationRetried) and event.realization == realization
    ]


def test_a_fault_of_a_minute_costs_no_run(tmp_path: Path) -> None:
    """Two of six sessions fail for a minute. The others end before the first pause does; the pauses double up to
    the cap, differ by their jitter, and are the same in a repetition.
    """
    summary, clock, events = flown(tmp_path / "first", repaired_s=60.0)

    assert summary.complete
    assert summary.outcomes == {Outcome.COMPLETED: 6}
    assert 60.0 <= clock.now_s <= 65.0 * (1.0 + JITTER)
    assert [time for time, name in clock.ends if name not in FAULTY] == [0.0] * OTHERS
    assert sum(attempts(tmp_path / "first").values()) == OTHERS + sum(
        len(pauses_s(events, name)) + 1 for name in FAULTY
    )
    for name in FAULTY:
        nominal_s = [5.0, 10.0, 20.0, 30.0][: len(pauses_s(events, name))]
        assert len(nominal_s) >= 3
        for pause_s, least_s in zip(pauses_s(events, name), nominal_s, strict=True):
            assert least_s <= pause_s <= least_s * (1.0 + JITTER)
        starts_s = [time for time, started in clock.starts if started == name]
        # Nothing else runs by then, so each attempt starts as soon as its pause is over.
        assert [b - a for a, b in pairwise(starts_s)] == pytest.approx(pauses_s(events, name))
    assert pauses_s(events, FAULTY[0]) != pauses_s(events, FAULTY[1])
    _, _, again = flown(tmp_path / "second", repaired_s=60.0)
    assert [pauses_s(again, name) for name in FAULTY] == [pauses_s(events, name) for name in FAULTY]


def test_a_fault_that_stays_ends_after_the_span_and_the_next_run_has_attempts_of_its_own(
    tmp_path: Path,
) -> None:
    """Final for this run once a minute has passed since the first failure, and not before."""
    for run_number in (1, 2):
        summary, clock, events = flown(tmp_path, repaired_s=1e9)
        assert summary.completeness.missing == {Outcome.BENCH_ERROR: 2}
        assert 60.0 <= clock.now_s <= 90.0 * (1.0 + JITTER)
        for name in FAULTY:
            assert sum(pauses_s(events, name)) >= 60.0 > sum(pauses_s(events, name)[:-1])
            assert attempts(tmp_path)[name] == run_number * (len(pauses_s(events, name)) + 1)


def test_the_total_budget_ends_a_pause(tmp_path: Path) -> None:
    """Nothing runs, two realizations pause, and the campaign stops on time. The next run flies them."""
    summary, clock, _ = flown(tmp_path, repaired_s=60.0, total_wall_s=3.0)

    assert (summary.stopped, clock.now_s) == ("the campaign's total wall budget is spent", 3.0)
    assert summary.done == OTHERS
    assert flown(tmp_path, repaired_s=0.0)[0].complete


def test_a_request_to_stop_is_not_kept_waiting_by_a_pause(tmp_path: Path) -> None:
    """SIGTERM arrives when the last session has failed: no time passes until the campaign has stopped."""
    clock = HostClock()

    class Stopped(dict[str, str]):
        def get(self, key: str, default: str | None = None) -> str | None:  # type: ignore[override]
            signal.raise_signal(signal.SIGTERM)
            return super().get(key, default)

    summary = fly(
        tmp_path,
        small_campaign(1, 1, retry_s=60.0),
        Script(Stopped({"p001-r1-fake": "raise"})),
        clock=clock,
        open_executor=open_in_process(clock=clock),
    )
    assert (summary.stopped, summary.done, clock.now_s) == ("received SIGTERM", 0, 0.0)


def ended(outcome: Outcome, simulated_s: float = 0.0, realization: str = "r1") -> SessionResult:
    return SessionResult(realization=realization, outcome=outcome, simulated_s=simulated_s)


@pytest.mark.parametrize(
    ("outcome", "session_s", "expected"),
    [
        (Outcome.SETUP_INVALID, 0.5, 5),
        (Outcome.WORKER_LOST, 30.0, 3),
        (Outcome.WALL_BUDGET, 120.0, 2),
        (Outcome.AGENT_NEVER_CONNECTED, 0.5, 2),
        (Outcome.AGENT_CRASHED, 0.5, 1),
        (Outcome.COMPLETED, 120.0, 1),
    ],
)
def test_long_sessions_and_agents_that_say_no_hello_are_tried_twice(
    outcome: Outcome, session_s: float, expected: int
) -> None:
    """A span and not a number of attempts: a session that always fails after minutes is not flown five times."""
    retries, now, flights = Retries(60.0), 1000.0, 0
    while True:
        flights += 1
        now += session_s
        pause_s = retries.pause_s(ended(outcome), now)
        if pause_s is None:
            break
        assert not retries.is_due("r1", now)
        assert retries.next_due_s(["r1"], now) == pytest.approx(pause_s)
        now += pause_s
        assert retries.is_due("r1", now + 1e-6)
    assert flights == expected


def test_without_a_span_one_retry_comes_at_once_and_what_no_longer_waits_is_not_waited_for() -> None:
    retries = Retries(0.0)
    for name in ("r1", "r2"):
        assert retries.pause_s(ended(Outcome.BENCH_ERROR, realization=name), 7.0) == 0.0
        assert retries.is_due(name, 7.0)
        assert retries.pause_s(ended(Outcome.BENCH_ERROR, realization=name), 7.0) is None
    slow = Retries(60.0)
    first_s = known(slow.pause_s(ended(Outcome.BENCH_ERROR), 0.0))
    assert slow.next_due_s(["r1", "r2"], 0.0) == first_s
    assert slow.next_due_s(["r2"], 0.0) is None
    assert slow.next_due_s(["r1"], first_s) is None
