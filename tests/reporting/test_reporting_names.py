"""An agent has one name: in the score table, the terminal, the page, its figures, comparisons and JSON."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest
import yaml
from command_line import json_of
from made_campaign import AGENTS, Made, make_campaign
from test_reporting_page import page_of

from bench.agents import load_manifest
from bench.cli._app import run
from bench.reporting import load_report_data
from bench.simspec import AgentSpec

# Not in the order of the alphabet, so that the order of the campaign shows.
MANIFESTS = {"agents/Zeta_One.v2.yaml": "Zeta_One.v2", "alpha-v1.2": "alpha-v1.2"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made campaign of two agents with awkward names; one run has neither scores nor a SimSpec."""
    folder = make_campaign(tmp_path_factory.mktemp("names") / "c", Made(scenes=6))
    renamed = dict(zip(AGENTS, MANIFESTS, strict=True))
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    campaign["agents"] = [{"manifest": manifest} for manifest in MANIFESTS]
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    for path in (folder / "simspecs").iterdir():
        document = json.loads(path.read_text())
        document["agent"]["manifest"] = renamed[document["agent"]["manifest"]]
        path.write_text(json.dumps(document))
    scores = pl.read_parquet(folder / "scores.parquet")
    names = {old: AgentSpec(manifest=manifest).label for old, manifest in renamed.items()}
    scores.with_columns(pl.col("agent").replace(names)).write_parquet(folder / "scores.parquet")
    (folder / "runs" / "p099-r0-zeta_one-v2").mkdir()
    return folder


@pytest.mark.parametrize(("manifest", "name"), MANIFESTS.items())
def test_name_is_that_of_the_entry_point_or_file(manifest: str, name: str) -> None:
    assert AgentSpec(manifest=manifest).label == name
    assert AgentSpec(manifest=f"../x.y/{name}.json").label == name


def test_loaded_manifest_has_the_name_of_results(tmp_path: Path) -> None:
    """Messages before take-off use the manifest; two builds often have one name inside."""
    for build in ("build-1.0", "build-1.1"):
        path = tmp_path / f"{build}.yaml"
        path.write_text("format: rebar.agent/1\nname: my-agent\ncommand: [x]\n")
        assert load_manifest(path)[0].name == build == AgentSpec(manifest=str(path)).label


def test_every_place_has_the_same_names(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The page, its figures and keys, the comparison and both its forms, in the order of the campaign."""
    names = list(MANIFESTS.values())
    data = load_report_data(folder)
    assert list(data.agents) == names
    assert {run.agent for run in data.runs} == set(names)
    page, text = page_of(folder)
    assert [row[0].split()[1] for row in page.tables["ends"][1:]] == names
    document = json_of(["compare", str(folder), "--json"], capsys)
    assert [document["first"], document["second"]] == names
    assert run(["compare", str(folder)]) == 0
    assert f"{names[0]} and {names[1]} on 6 scenes" in capsys.readouterr().out
    # Another spelling stands only in ids and paths of manifests.
    shown = text.split("<script>")[0]
    for other in ("Zeta_One", "alpha-v1"):
        whole = names[0] if other == "Zeta_One" else names[1]
        rest = shown.replace(whole, "").replace(whole.lower().replace(".", "-"), "")
        assert other not in rest
