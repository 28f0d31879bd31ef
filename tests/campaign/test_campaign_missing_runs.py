"""Runs that the host may have cost: flown again by themselves, never final without a person's word."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from campaign_fakes import Script, attempts, fly, small_campaign

from bench.campaign import CampaignFolder, Completeness, RealizationRetried
from bench.campaign.execution._attempts import is_worth_a_retry
from bench.campaign.execution._dispatcher import _is_full
from bench.contracts import AgentExit, Outcome, SessionResult, facts_of
from bench.errors import SetupError

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
    script = Script({LOST[0]: "vanish"})
    fly(tmp_path, small_campaign(points=2), script)
    events: list[object] = []
    again = fly(tmp_path, small_campaign(points=2), script, observers=[events.append])

    assert again.completeness.missing == {Outcome.SETUP_INVALID: 1}
    assert attempts(tmp_path)[LOST[0]] == 4
    assert [event.realization for event in events if isinstance(event, RealizationRetried)] == [LOST[0]]


def test_a_person_may_accept_what_is_missing_and_take_it_back(tmp_path: Path) -> None:
    """Accepted is what has the outcome now, by realization; the manifest names it, and `rerun` withdraws it."""
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
    with pytest.raises(SetupError, match="agent_crashed cannot be accepted"):
        fly(tmp_path, accept=[Outcome.AGENT_CRASHED])


def test_a_scene_without_room_is_missing_until_it_is_accepted(tmp_path: Path) -> None:
    """It is not flown again, since the same seeds find no room; the campaign still lacks the run."""
    campaign = small_campaign(points=1, replicates=1)
    assert campaign.base is not None
    crowd = campaign.base.actors[0].model_copy(update={"count": 5000})
    campaign = campaign.model_copy(update={"base": campaign.base.model_copy(update={"actors": (crowd,)})})

    assert fly(tmp_path, campaign).completeness.missing == {Outcome.PLACEMENT_INFEASIBLE: 1}
    assert fly(tmp_path, campaign).flown == 0
    assert fly(tmp_path, campaign, accept=[Outcome.PLACEMENT_INFEASIBLE]).complete


def test_an_agent_that_is_killed_before_its_first_tick_gets_a_second_attempt(tmp_path: Path) -> None:
    """The host may have killed it. The second end is its own, and counts."""
    script = Script({LOST[0]: "killed-once", LOST[1]: "killed"})
    summary = fly(tmp_path, script=script, workers=2)

    assert summary.complete
    assert summary.outcomes == {Outcome.COMPLETED: 5, Outcome.AGENT_CRASHED: 1}
    assert attempts(tmp_path) == dict.fromkeys(attempts(tmp_path), 1) | dict.fromkeys(LOST, 2)


def test_an_exit_code_of_an_agent_counts_at_once(tmp_path: Path) -> None:
    """An agent that fails at its first start and not at the second one has failed."""
    script = Script({LOST[0]: "crash-once", LOST[1]: "crash"})
    summary = fly(tmp_path, script=script, workers=2)

    assert summary.outcomes == {Outcome.COMPLETED: 4, Outcome.AGENT_CRASHED: 2}
    assert set(attempts(tmp_path).values()) == {1}


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


def test_a_crash_on_a_full_disk_is_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent that cannot write crashes: the disk is at fault, and the session is flown again."""
    with monkeypatch.context() as full:
        full.setattr("bench.campaign.execution._dispatcher.MIN_FREE_BYTES", 2**60)
        with pytest.raises(SetupError, match="the disk is full"):
            fly(tmp_path, script=Script({LOST[0]: "crash"}))
    assert CampaignFolder(tmp_path).run(LOST[0]).joinpath("result.json").exists() is False
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
