"""An agent has one name everywhere; node ids may be any line of text: all are shown as they are."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import polars as pl
import pytest
import yaml
from command_line import json_of
from made_campaign import AGENTS, Made, make_campaign
from test_reporting_page import page_of

from bench.agents import load_manifest
from bench.cli._app import run
from bench.documents import parse_text
from bench.reporting import graph_page, graph_svg, load_report_data
from bench.simspec import AgentSpec
from decompositions import load_decomposition

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
    """In the order of the campaign."""
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


IDS = {
    "KA-03": "\"quoted\" 'ka' <script>alert(1)</script>",
    "KA-05": 'a/b\\c & "x" </script>',
    "KA-09": "目標-ñ-🚁",
    "KA-18": "k" * 120,
    "KA-20": "-rf {{ x }} %s [b]bold[/b] :warning:",
    "OBS-031": "<img src=x onerror=alert(1)>",
    "P-RESPONSIBLE": "__proto__",
}
"""What breaks HTML, scripts, markup of terminals, templates, paths and options."""


@pytest.fixture(scope="module")
def odd_ids(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made campaign whose ids are replaced everywhere; JSON writes the emoji as two escapes."""
    folder = make_campaign(tmp_path_factory.mktemp("ids") / "c", Made(scenes=4))
    text = (folder / "decomposition.json").read_text()
    for old, new in IDS.items():
        text = text.replace(json.dumps(old), json.dumps(new))
    (folder / "decomposition.json").write_text(text)
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    study = [IDS.get(node, node) for node in campaign["study"]]
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign | {"study": study}))
    scores = pl.read_parquet(folder / "scores.parquet")
    scores.with_columns(node=pl.col("node").replace(IDS)).write_parquet(folder / "scores.parquet")
    return folder


def test_page_shows_every_id_and_runs_none(odd_ids: Path) -> None:
    page, text = page_of(odd_ids)
    assert page.open == []
    assert "<script>alert" not in text
    assert "<img src=x" not in text
    shown = {" ".join(row[0].split()) for row in page.tables["headline"]}
    for name in ("KA-03", "KA-05", "KA-09", "KA-18", "KA-20"):
        assert any(cell.startswith(IDS[name]) for cell in shown), name
    for name, script in page.scripts.items():
        if name.startswith("data-"):
            json.loads(script)
    # In the figures too.
    assert "&lt;script&gt;alert(1)&lt;/script&gt;</text>" in text


def test_drawings_hold_every_id(odd_ids: Path) -> None:
    decomposition = load_decomposition(odd_ids / "decomposition.json")
    drawing = ElementTree.fromstring(graph_svg(decomposition))
    texts = {text for text in drawing.itertext() if text.strip()}
    assert any(IDS["KA-09"] in text for text in texts)
    page = graph_page(decomposition)
    assert "<script>alert" not in page
    assert "<img src=x" not in page


@pytest.mark.parametrize("name", ["KA-03", "KA-05", "KA-09", "KA-20"])
def test_compare_takes_and_prints_an_id(odd_ids: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["compare", str(odd_ids), f"--node={IDS[name]}"]) == 0
    printed = capsys.readouterr().out
    assert printed.count(IDS[name]) >= 2, printed


def test_json_escapes_of_one_character_are_one_character() -> None:
    value, lines = parse_text(json.dumps({"a🚁": ["x🚁y"]}))
    assert value == {"a🚁": ["x🚁y"]}
    assert ("a🚁",) in lines
    # Half a pair is no character; validation refuses it, with its place in the file.
    assert parse_text('{"a": "\\ud83dx"}')[0] == {"a": "\ud83dx"}
