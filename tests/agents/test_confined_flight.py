"""A session with a confined agent is the session: the same records, whichever rung it is on; and the manifest of the README
is flown.
"""

from __future__ import annotations

import json
import re
import sys
from functools import cache
from pathlib import Path

import pytest
import zenoh
from host_image import PYTHON, image_or_skip
from rungs import CONFINING, rung_or_skip

import bench
from bench.agents import load_manifest, open_agent
from bench.cli._app import run
from bench.contracts import Outcome, Record
from bench.errors import SetupError
from bench.realization import place
from bench.simspec import load_simspec
from bench.simulation import SessionPlan, run_session

ROOMS = ("bench", "agent_adapters", "vehicle_models")
EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"


@cache
def flown(rung: str, folder: Path) -> list[Record]:
    """The records of 15 simulated seconds with the reference agent."""
    spec = load_simspec(EXAMPLE)
    spec = place(spec.model_copy(update={"mission": spec.mission.model_copy(update={"time_limit_s": 15.0})}))
    manifest, manifest_folder = load_manifest(spec.agent.manifest)
    records: list[Record] = []
    confined = manifest
    if rung == "container":
        # The image has Python alone: packages come from this host, as a developer's image would not.
        source = Path(bench.__file__).parents[1]
        packages = Path(zenoh.__file__).parents[1]
        confined = confined.model_copy(
            update={
                "image": image_or_skip(),
                "command": (PYTHON, *manifest.command[1:]),
                "environment": manifest.environment | {"PYTHONPATH": f"{source}:{packages}"},
                "read": (*(str(source / room) for room in ROOMS), str(packages)),
            }
        )
    with rung_or_skip(rung) as isolation:
        confined = confined.model_copy(update={"isolation": isolation})
        end = run_session(SessionPlan(spec, confined, manifest_folder, open_agent, folder, records.append))
    assert end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), end.reason
    return records


@pytest.mark.parametrize("rung", [*CONFINING, "container"])
def test_confinement_changes_no_record(rung: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Each rung against none, record by record; imports of an editable installation work in each."""
    free = flown("none", tmp_path_factory.getbasetemp() / "free")
    assert len(free) > 100
    assert flown(rung, tmp_path_factory.mktemp(rung)) == free


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


@pytest.mark.flight
@pytest.mark.process
@pytest.mark.parametrize(
    ("command", "out"),
    [
        (["simulate", "../situations/short.yaml"], "out"),
        (["run", "../campaign.yaml"], "out/runs/p001-r1-mine"),
    ],
    ids=["simspec", "campaign"],
)
def test_simspec_and_campaign_fly_it(
    mine: Path, monkeypatch: pytest.MonkeyPatch, command: list[str], out: str
) -> None:
    """Named relative to the document, from a present folder that is another one."""
    (mine / "elsewhere").mkdir()
    monkeypatch.chdir(mine / "elsewhere")
    assert run([*command, "--out", "out"]) == 0
    folder = mine / "elsewhere" / out
    result = json.loads((folder / "result.json").read_text())
    assert result["outcome"] == "time_limit", result["reason"]
    assert "started with ['--verbose'] for vehicle_1" in (folder / "agent.log").read_text()


WRONG = {
    "name: again": "the key 'name' stands here twice",
    "limits: {memory_mb: 0512}": "limits.memory_mb: 0512 begins with 0",
    "limits: {cpus: yes}": "limits.cpus: true (or yes, on) is a truth value",
    "environment: {{ environment }}": "environment: a list or mapping stands where a key",
    "environment: {1: x}": "environment: the key 1 is not text",
}


def test_a_wrong_manifest_is_told_before_anything_flies(
    mine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By a campaign as by a single session, whose outcome is `setup_invalid`: nothing is tried again."""
    manifest = mine / "agents" / "mine.yaml"
    right = manifest.read_text()
    for line, fault in WRONG.items():
        manifest.write_text(f"{right}{line}\n")
        with pytest.raises(SetupError) as refusal:
            load_manifest(str(manifest))
        words = f"mine.yaml:4: {fault}"
        assert words in str(refusal.value)
    # The last of them.
    assert run(["run", str(mine / "campaign.yaml"), "--out", str(mine / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (mine / "out" / "runs").exists()
    assert run(["simulate", str(mine / "situations" / "short.yaml"), "--out", str(mine / "one")]) == 2
    result = json.loads((mine / "one" / "result.json").read_text())
    assert result["outcome"] == "setup_invalid"
    assert words in result["reason"]
