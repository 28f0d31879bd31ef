"""`rebar compare` of agents that flew at different paces, in one campaign and in two."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
import yaml
from command_line import json_of
from test_cli_compare_autopilots import carried_by
from test_cli_compare_sources import SCENES

from bench.cli._app import run
from bench.reporting import write_report
from bench.simspec import SimSpec

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, Made, make_campaign


def paced(folder: Path, paces: dict[str, str]) -> Path:
    """The made campaign, its agents with paces of their own."""
    make_campaign(folder, Made(scenes=3))
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    for agent in campaign["agents"]:
        agent["pace"] = paces[agent["manifest"]]
        for path in (folder / "simspecs").glob(f"*-{agent['manifest']}.json"):
            document = json.loads(path.read_text())
            document["pace"]["mode"] = agent["pace"]
            path.write_text(SimSpec.model_validate(document).model_dump_json())
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    return folder


def test_two_agents_of_one_campaign_at_two_paces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The difference has its name in the text, in JSON and in the report; at one pace there is none."""
    first, second = AGENTS
    different = paced(tmp_path / "different", {first: "lockstep", second: "warp"})
    note = f"{first} flew at the pace lockstep, {second} at warp: what differs may be the pace"
    assert run(["compare", str(different)]) == 0
    assert note in " ".join(capsys.readouterr().out.split())
    assert json_of(["compare", str(different), "--json"], capsys)["paces"] == ["lockstep", "warp"]
    page = write_report(different).read_text()
    assert note in page
    assert f"the runs of {first} at lockstep, the runs of {second} at warp" in page
    same = paced(tmp_path / "same", {first: "warp", second: "warp"})
    assert json_of(["compare", str(same), "--json"], capsys)["paces"] is None


def test_two_campaigns_at_two_paces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The scenes are paired, and the autopilot, which is the same, is not named for the difference."""
    folders = [str(carried_by(tmp_path / mode, "px4", {}, mode)) for mode in ("realtime", "warp")]
    document = json_of(["compare", *folders, "--json"], capsys)
    assert (document["scenes"], document["paces"], document["autopilots"]) == (
        SCENES,
        ["realtime", "warp"],
        None,
    )
    assert run(["compare", *folders]) == 0
    assert "realtime flew at the pace realtime, warp at warp" in " ".join(capsys.readouterr().out.split())
