"""A campaign's events in a file."""

from __future__ import annotations

from pathlib import Path

from bench.campaign import CampaignPlanned, RealizationFinished, RealizationStarted, SessionProgressed
from bench.cli._event_lines import open_event_lines
from bench.contracts import Outcome, ProgressUpdate
from bench.laboratory import CampaignMessage


def test_two_runs_append_to_one_file_and_number_their_own_events(tmp_path: Path) -> None:
    """A line is complete as soon as its event has happened, and is a message as on the MQTT bus."""
    path = tmp_path / "new" / "events.jsonl"
    for run in (1, 2):
        with open_event_lines(path, "demo") as observe:
            observe(CampaignPlanned(total=2, done=run - 1))
            observe(RealizationStarted("a", "w1", run))
            assert len(path.read_text().splitlines()) == 4 * run - 2
            observe(SessionProgressed("a", ProgressUpdate(12.5, 600.0, 2.0, 6.25)))
            observe(RealizationFinished("a", Outcome.COMPLETED, "", 1.5, run, 2))
    messages = [CampaignMessage.model_validate_json(line) for line in path.read_text().splitlines()]
    assert [message.number for message in messages] == [1, 2, 3, 4] * 2
    assert [message.event for message in messages] == ["planned", "started", "progress", "finished"] * 2
    assert [message.attempt for message in messages if message.event == "started"] == [1, 2]
    assert {message.campaign for message in messages} == {"demo"}
    assert [
        (message.simulated_s, message.speed, message.phase)
        for message in messages
        if message.event == "progress"
    ] == [(12.5, 6.25, None)] * 2
