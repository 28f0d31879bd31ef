"""`rebar run` on a terminal: sessions in flight, outcomes so far and time left, whole at 80 columns; elsewhere plain lines; events in a file."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import redirect_stderr
from pathlib import Path

import pytest

from bench.campaign import (
    CampaignEvent,
    CampaignPlanned,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    SessionProgressed,
)
from bench.cli._event_lines import open_event_lines
from bench.cli._progress import MAX_SESSION_LINES, open_progress
from bench.contracts import Outcome, ProgressUpdate
from bench.laboratory import CampaignMessage

CODES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")
LONG = "-r1-reference-bystander-aware-of-the-second-edition"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def frames(events: Sequence[CampaignEvent], name: str = "rebar-standard-of-a-long-name") -> list[str]:
    """Every line that a terminal was sent, the last frame at the end."""
    with redirect_stderr(Terminal()) as terminal, open_progress(name) as show:
        for event in events:
            show(event)
    return [line.rstrip() for line in re.split(r"[\r\n]+", CODES.sub("", terminal.getvalue()))]


def finished(name: str, outcome: Outcome, done: int) -> RealizationFinished:
    return RealizationFinished(name, outcome, "exit 1", 3.0, done, 10_080)


def flying(name: str, phase: str | None, simulated_s: float, speed: float) -> SessionProgressed:
    return SessionProgressed(name, ProgressUpdate(simulated_s, 600.0, 2.0, speed, phase))


@pytest.mark.parametrize("columns", [80, 120])
def test_a_terminal_shows_what_flies_and_how_it_ended(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "xterm")
    lines = frames(
        [
            CampaignPlanned(10_080, 8_000),
            flying(f"p0001{LONG}", "searching", 31.4, 14.2),
            flying(f"p0002{LONG}", None, 599.6, 0.4),
            flying(f"p0003{LONG}", "returning", 12.0, 100.0),
            flying(f"p0004{LONG}", "starting", 12.0, 7.0),
            finished("a", Outcome.COMPLETED, 8_001),
            finished("b", Outcome.COMPLETED, 8_002),
            finished(f"p0003{LONG}", Outcome.AGENT_CRASHED, 8_003),
            RealizationRetried(f"p0004{LONG}", Outcome.WORKER_LOST, "lost", 1.0),
        ]
    )
    assert max(map(len, lines)) <= columns
    bar, outcomes, *sessions = [line for line in lines if line][-4:]
    wanted = r"rebar-standard-of-a-long-name +\S+ +8003/10080 \d:\d\d:\d\d [-\d]:[-\d]+:[-\d]+"
    assert re.fullmatch(wanted, bar)
    assert outcomes.split(", ") == ["  flown now: 2 completed", "1 agent_crashed"]
    for line, place, states in zip(
        sessions, (1, 2), (r"searching +31 of 600 s, 14x", r"flying +600 of 600 s, 0x"), strict=True
    ):
        assert re.fullmatch(rf"  p000{place}-r1-reference-\S+ +{states}", line), line


def test_of_many_sessions_some_are_shown_and_the_rest_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")
    events = [flying(f"p{place:03d}", "searching", 1.0, 2.0) for place in range(MAX_SESSION_LINES + 3)]
    lines = [line for line in frames([CampaignPlanned(99, 0), *events]) if line]
    assert lines[-1] == "  and 3 more in flight"
    shown = [line.split()[0] for line in lines[-1 - MAX_SESSION_LINES : -1]]
    assert shown == [f"p{place:03d}" for place in range(MAX_SESSION_LINES)]


def test_elsewhere_there_are_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress("small") as show:
        show(CampaignPlanned(3, 1))
        show(flying("a", "searching", 1.0, 2.0))
        show(RealizationFinished("a", Outcome.COMPLETED, "", 3.04, 2, 3))
    assert capsys.readouterr().err.splitlines() == [
        "3 realizations, 1 of them with a result",
        "[2/3] a: completed (3.0 s)",
    ]


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
    progress = [message for message in messages if message.event == "progress"]
    assert [(said.simulated_s, said.speed, said.phase) for said in progress] == [(12.5, 6.25, None)] * 2
