"""A campaign seen and paused from outside."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from campaign_fakes import fly
from in_process_executor import HostClock, open_in_process

from bench.campaign import (
    CampaignPaused,
    RealizationStarted,
    campaign_state,
    pause_campaign,
    resume_campaign,
    verify_folder,
)
from bench.cli._app import run
from bench.errors import SetupError


class ToldClock(HostClock):
    """Tells somebody of each wait in which nothing flies."""

    def __init__(self, folder: Path, waits: int) -> None:
        self._now_s, self._folder, self._waits, self.waited = 0.0, folder, waits, 0
        super().__init__()

    @property
    def now_s(self) -> float:
        return self._now_s

    @now_s.setter
    def now_s(self, value: float) -> None:
        self.waited += value > self._now_s
        self._now_s = value
        if self.waited == self._waits:
            resume_campaign(self._folder)


def test_a_paused_campaign_starts_nothing_until_it_goes_on(tmp_path: Path) -> None:
    """Paused twice: after its first session and after its third. What flies goes on, and nothing is lost."""
    clock = ToldClock(tmp_path, waits=5)
    events: list[object] = []

    pauses = [1, 3]

    def pause_after(realization: str) -> bool:
        finished = len(list(tmp_path.glob("runs/*/result.json")))
        if finished not in pauses:
            return True
        pauses.remove(finished)
        clock.waited = 0
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
