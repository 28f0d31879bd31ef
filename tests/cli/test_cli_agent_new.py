"""`rebar agent new`: a folder with an agent that flies at once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bench.agents import load_manifest
from bench.campaign import load_campaign
from bench.cli._app import run
from bench.contracts import SessionResult
from bench.documents import load_document

PROGRAMS = {"python": ("search.py", "rebar_air.py"), "node": ("search.js", "rebar_air.js")}


@pytest.mark.parametrize("language", PROGRAMS)
def test_the_folder_holds_an_agent_a_scene_and_a_campaign_of_two(
    language: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "scout-2"
    assert run(["agent", "new", str(folder), "--language", language]) == 0
    assert str(folder / "scene.yaml") in capsys.readouterr().out
    files = {path.name for path in folder.iterdir()}
    assert files == {"scout-2.yaml", "campaign.yaml", "scene.yaml", "README.md", *PROGRAMS[language]}
    manifest, _ = load_manifest(str(folder / "scout-2.yaml"))
    assert (manifest.name, manifest.air, manifest.pace) == ("scout-2", "tick", ("lockstep",))
    campaign = load_campaign(folder / "campaign.yaml")
    assert [Path(agent.manifest).name for agent in campaign.agents] == [
        "scout-2.yaml",
        "reference-bystander-aware",
    ]
    assert len(campaign.design.factors[0].levels or ()) == 2
    assert "manifest: scout-2.yaml" in (folder / "scene.yaml").read_text()
    assert all(name in (folder / "README.md").read_text() for name in files - {"README.md", "scene.yaml"})


def test_nothing_is_overwritten_and_a_name_has_to_be_an_agents(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scout").mkdir()
    for name, words in (("scout", "this path exists"), ("My Agent", "its name is no agent's")):
        assert run(["agent", "new", str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
    assert list((tmp_path / "scout").iterdir()) == []
    assert not (tmp_path / "My Agent").exists()


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(600)
@pytest.mark.parametrize("language", PROGRAMS)
def test_the_new_agent_flies_at_once_and_twice_alike(language: str, tmp_path: Path) -> None:
    """It finds, reports and comes home: at least 12 of the 14 observables that the scene considers."""
    if language == "node" and shutil.which("node") is None:
        pytest.skip("node is not installed")
    folder = tmp_path / "scout"
    assert run(["agent", "new", str(folder), "--language", language]) == 0
    digests = []
    for name in ("first", "second"):
        out = tmp_path / name
        assert run(["simulate", str(folder / "scene.yaml"), "--out", str(out)]) == 0
        result = load_document(out / "result.json", SessionResult)
        digests.append(result.recording_sha256)
        considered = [item.x for item in result.observations if item.x is not None]
        assert len(considered) == 14
        assert sum(x >= 0.5 for x in considered) >= 12
    assert digests[0] == digests[1]
