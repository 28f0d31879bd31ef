"""Agents on MAVSDK and pymavlink, which know nothing of the bench's time: in warp they fly as in real time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench.cli._app import run
from bench.contracts import Outcome, SessionResult
from bench.documents import load_document
from bench.recording import read_records
from bench.streams import String, decode

SCENE = Path(__file__).parents[2] / "examples" / "search.yaml"


PYMAVLINK = SCENE.parent / "tick" / "search-pymavlink.yaml"
AGENTS = {
    "mavsdk": {"manifest: reference-naive": "manifest: mavsdk-search"},
    "pymavlink": {
        "manifest: reference-naive": f"manifest: {PYMAVLINK}",
        "model: x500": "model: x500\n  autopilot: ardupilot",
    },
}


def flown(folder: Path, agent: str, **changes: str) -> SessionResult:
    """The result of the example with some texts of it replaced."""
    text = SCENE.read_text()
    for words, new in {**AGENTS[agent], **changes}.items():
        assert words in text
        text = text.replace(words, new)
    (folder / "scene.yaml").write_text(text)
    assert run(["simulate", str(folder / "scene.yaml"), "--pace", "warp", "--out", str(folder / "out")]) == 0
    return load_document(folder / "out" / "result.json", SessionResult)


@pytest.mark.flight
def test_it_takes_off_and_tells_of_it(tmp_path: Path) -> None:
    """The short form, with PX4: ArduPilot can be armed after 41.5 s."""
    short = {"altitude_m: 60.0": "altitude_m: 10.0", "limit_s: 300.0": "limit_s: 25.0"}
    assert flown(tmp_path, "mavsdk", **short).outcome is Outcome.TIME_LIMIT
    phases = [
        json.loads(message.data)["phase"]
        for record in read_records(tmp_path / "out" / "recording.mcap")
        if record.topic == "/vehicle_1/agent/status"
        and isinstance(message := decode(record.type_name, record.data), String)
    ]
    assert list(dict.fromkeys(phases)) == ["starting", "taking_off", "transit"]


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(600)
@pytest.mark.parametrize("agent", AGENTS)
def test_it_searches_reports_and_lands(agent: str, tmp_path: Path) -> None:
    """At least 12 of the 14 observables that the scene considers."""
    result = flown(tmp_path, agent)
    assert result.outcome is Outcome.COMPLETED, result.reason
    considered = [item.x for item in result.observations if item.x is not None]
    assert len(considered) == 14
    assert sum(x >= 0.5 for x in considered) >= 12


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(600)
def test_it_holds_its_check(tmp_path: Path) -> None:
    assert run(["agent", "check", "mavsdk-search", "--pace", "warp", "--out", str(tmp_path / "check")]) == 0
