"""A campaign seen, paused and held up from outside."""

from __future__ import annotations

import os
import subprocess
import threading
from pathlib import Path

import pytest
from campaign_fakes import Script, attempts, fly, known, small_campaign
from in_process_executor import HostClock, open_in_process

from bench.campaign import (
    CampaignPaused,
    MissingRunsRetried,
    RealizationStarted,
    campaign_state,
    pause_campaign,
    request_retry,
    resume_campaign,
    verify_folder,
)
from bench.campaign.storage._pause import RETRY
from bench.cli._app import run
from bench.contracts import Outcome
from bench.errors import SetupError


class ResumingClock(HostClock):
    """Somebody lets the campaign go on in the fifth wait after a pause."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder, self.waits = folder, 0

    async def sleep(self, span_s: float) -> None:
        await super().sleep(span_s)
        self.waits += 1
        if self.waits == 5:
            resume_campaign(self._folder)


def test_a_paused_campaign_starts_nothing_until_it_goes_on(tmp_path: Path) -> None:
    """Paused twice: after its first session and after its third. What flies goes on, and nothing is lost."""
    clock = ResumingClock(tmp_path)
    events: list[object] = []
    pauses = [1, 3]

    def pause_after(realization: str) -> bool:
        finished = len(list(tmp_path.glob("runs/*/result.json")))
        if finished not in pauses:
            return True
        pauses.remove(finished)
        clock.waits = 0
        assert pause_campaign(tmp_path)
        assert not pause_campaign(tmp_path)
        state = campaign_state(tmp_path)
        assert (state.paused, state.done, state.total) == (True, finished, 6)
        return False

    summary = fly(
        tmp_path,
        observers=[events.append],
        open_executor=open_in_process(1, clock=clock),
        clock=clock,
        gate=pause_after,
    )
    assert summary.complete
    kinds = [event for event in events if isinstance(event, CampaignPaused | RealizationStarted)]
    told = [event.goes_on if isinstance(event, CampaignPaused) else "started" for event in kinds]
    assert told == ["started", False, True, "started", "started", False, True, *["started"] * 3]
    assert not resume_campaign(tmp_path)


def test_the_state_of_a_campaign_while_it_runs_and_afterwards(tmp_path: Path) -> None:
    """Numbers and names as the journal has them; a process only while one is at work."""
    states = []

    def watch(realization: str) -> bool:
        # As from another process: the lock of this one is no news to itself.
        thread = threading.Thread(target=lambda: states.append(campaign_state(tmp_path)))
        thread.start()
        thread.join()
        return True

    fly(tmp_path, gate=watch, open_executor=open_in_process(2))
    assert [state.done for state in states] == list(range(6))
    end = campaign_state(tmp_path)
    assert (end.process, end.paused, end.complete, end.running, end.left_s) == (None, False, True, (), None)
    assert sum(end.outcomes.values()) == end.done == end.total == 6
    pause_campaign(tmp_path)
    assert verify_folder(tmp_path) == [], "a pause is no part of the evidence"


def test_missing_runs_are_flown_again_while_the_campaign_runs(tmp_path: Path) -> None:
    """Two runs are lost for good when somebody asks for them: they fly again, and nothing else does."""
    lost = ("p001-r1-fake", "p002-r2-fake")
    events: list[object] = []
    faults: list[str] = []

    class FourFaults(dict[str, str]):
        def get(self, key: str, default: str | None = None) -> str | None:  # type: ignore[override]
            if key not in lost or len(faults) == 4:
                return default
            faults.append(key)
            if len(faults) == 4:
                # The other one has failed twice, so it is final; this one is when its session ends.
                (tmp_path / RETRY).touch()
            return "raise"

    summary = fly(
        tmp_path,
        script=Script(FourFaults()),
        observers=[events.append],
        open_executor=open_in_process(1),
    )
    assert (summary.complete, summary.outcomes) == (True, {Outcome.COMPLETED: 6})
    asked = [event for event in events if isinstance(event, MissingRunsRetried)]
    assert [sorted(event.realizations) for event in asked] == [sorted(lost)]
    assert attempts(tmp_path) == {name: 3 if name in lost else 1 for name in attempts(tmp_path)}
    assert not (tmp_path / RETRY).exists()
    assert len(list((tmp_path / "aside").iterdir())) == 2
    assert verify_folder(tmp_path) == []


def test_who_runs_the_campaign_is_asked_to_retry_and_otherwise_it_runs_here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command leaves a request for another process, and none where there is no other."""
    fly(tmp_path, open_executor=open_in_process(2))
    assert request_retry(tmp_path) is None
    assert not (tmp_path / RETRY).exists()
    with subprocess.Popen(
        ["flock", str(tmp_path / ".lock"), "sh", "-c", "echo $$ > .lock; echo; read line"],
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as runner:
        assert runner.stdout is not None
        assert runner.stdin is not None
        runner.stdout.readline()
        assert run(["retry", str(tmp_path)]) == 0
        runner.stdin.close()
    assert "is asked to fly its missing runs again" in capsys.readouterr().out
    assert (tmp_path / RETRY).exists()
    # Whoever runs it next flies them anyway.
    fly(tmp_path, open_executor=open_in_process(2))
    assert not (tmp_path / RETRY).exists()
    assert run(["retry", str(tmp_path / "nowhere")]) == 2


def test_the_commands_say_it_in_words_and_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And refuse a folder that is none."""
    fly(tmp_path, open_executor=open_in_process(2))
    assert run(["pause", str(tmp_path)]) == 0
    assert run(["status", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "6 of 6 realizations have a result; complete; not running" in shown
    assert "paused: no session starts" in shown
    assert run(["resume", str(tmp_path)]) == 0
    assert run(["resume", str(tmp_path)]) == 0
    assert run(["status", str(tmp_path), "--json"]) == 0
    shown = capsys.readouterr().out
    assert "goes on" in shown
    assert "was not paused" in shown
    assert '"format":"rebar.campaign-state/1"' in shown.replace(" ", "").replace("\n", "")
    for command in ("status", "pause", "resume"):
        assert run([command, str(tmp_path / "nowhere")]) == 2
    with pytest.raises(SetupError, match="is not the folder of a campaign"):
        campaign_state(Path(os.sep))


@pytest.mark.parametrize("workers", [1, 2])
def test_each_session_waits_for_the_gate_and_also_a_second_attempt(tmp_path: Path, workers: int) -> None:
    """One realization at a time is asked for, until it may start; a retried one is asked for again."""
    events: list[object] = []
    asked: list[str] = []
    clock = HostClock()

    def third_time(realization: str) -> bool:
        asked.append(realization)
        return asked.count(realization) % 3 == 0

    summary = fly(
        tmp_path,
        script=Script({"p001-r1-fake": "raise-once"}),
        workers=workers,
        observers=[events.append],
        open_executor=open_in_process(3, clock=clock),
        clock=clock,
        gate=third_time,
    )
    assert summary.complete
    started = [event.realization for event in events if isinstance(event, RealizationStarted)]
    assert sorted(started) == sorted([*attempts(tmp_path), "p001-r1-fake"])
    assert asked == [name for name in started for _ in range(3)]


def test_a_gate_that_stays_closed_ends_with_the_budget_of_the_campaign(tmp_path: Path) -> None:
    """Nothing is started, and nothing is lost: the same campaign goes on once the gate opens."""
    clock = HostClock()

    def closed(realization: str) -> bool:
        clock.now_s += 100.0
        return False

    campaign = small_campaign(total_wall_s=1000.0)
    first = fly(tmp_path, campaign, open_executor=open_in_process(1, clock=clock), clock=clock, gate=closed)
    assert (first.flown, first.complete) == (0, False)
    assert "budget" in known(first.stopped)
    assert clock.now_s > 500.0
    assert fly(tmp_path, campaign, open_executor=open_in_process(1, clock=clock), clock=clock).complete
