"""The manifest of the README, written beside a program of one's own and flown."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

from bench.cli._app import run

ROOT = Path(__file__).parents[2]
PROGRAM = f"""#!{sys.executable}
import os, sys, time
print("started with", sys.argv[1:], "for", os.environ["REBAR_VEHICLE"], flush=True)
time.sleep(600)
"""
SIMSPEC = """name: short
world: {area: {corners: [{east_m: -60, north_m: -60}, {east_m: 60, north_m: -60}, {east_m: 60, north_m: 60}]}}
mission: {altitude_m: 20, speed_mps: 5, time_limit_s: 1.0}
actors: [{id: radar, asset: radar-vehicle, role: adversary, count: 1}]
intelligence: [{id: sighting, about: radar}]
pace: {mode: realtime, max_late_share: 1.0}
"""


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A folder with the agent and its manifest as the README shows it, and two that name it."""
    (manifest,) = re.findall(r"```yaml\n(name: mine\n.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    for folder in ("agents", "situations"):
        (tmp_path / folder).mkdir()
    (tmp_path / "agents" / "mine.yaml").write_text(manifest)
    program = tmp_path / "agents" / "my_agent"
    program.write_text(PROGRAM)
    program.chmod(0o755)
    (tmp_path / "situations" / "short.yaml").write_text(
        f"{SIMSPEC}agent: {{manifest: ../agents/mine.yaml}}\n"
    )
    (tmp_path / "campaign.yaml").write_text(
        "name: mine\nbase_file: situations/short.yaml\nagents: [{manifest: agents/mine.yaml}]\nstudy: [KA-03]\n"
    )
    return tmp_path


def check(folder: Path) -> None:
    result = json.loads((folder / "result.json").read_text())
    assert result["outcome"] == "time_limit", result["reason"]
    assert "started with ['--verbose'] for vehicle_1" in (folder / "agent.log").read_text()


@pytest.mark.flight
@pytest.mark.process
def test_a_simspec_flies_it(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named relative to the SimSpec, from a present folder that is another one."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert run(["simulate", "../situations/short.yaml", "--out", "out"]) == 0
    check(tmp_path / "elsewhere" / "out")


@pytest.mark.flight
@pytest.mark.process
def test_a_campaign_flies_it(mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["run", "campaign.yaml", "--out", "out"]) == 0
    check(tmp_path / "out" / "runs" / "p001-r1-mine")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("name: again\n", "mine.yaml:4: the key 'name' stands here twice"),
        ("limits: {memory_mb: 0512}\n", "mine.yaml:4: limits.memory_mb: 0512 begins with 0"),
        ("limits: {cpus: yes}\n", "mine.yaml:4: limits.cpus: true (or yes, on) is a truth value"),
        (
            "environment: {{ environment }}\n",
            "mine.yaml:4: environment: a list or mapping stands where a key",
        ),
        ("environment: {1: x}\n", "mine.yaml:4: environment: the key 1 is not text"),
    ],
)
def test_a_wrong_manifest_is_told_before_anything_flies(
    line: str, words: str, mine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By a campaign as by a single session, whose outcome is `setup_invalid`: nothing is tried again."""
    manifest = mine / "agents" / "mine.yaml"
    manifest.write_text(manifest.read_text() + line)
    assert run(["run", str(mine / "campaign.yaml"), "--out", str(mine / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (mine / "out" / "runs").exists()
    assert run(["simulate", str(mine / "situations" / "short.yaml"), "--out", str(mine / "one")]) == 2
    result = json.loads((mine / "one" / "result.json").read_text())
    assert result["outcome"] == "setup_invalid"
    assert words in result["reason"]
