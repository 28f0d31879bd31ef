"""Node ids may be any line of text: the page, the drawings and the terminal show them as they are."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import polars as pl
import pytest
import yaml
from made_campaign import Made, make_campaign
from test_reporting_page import page_of

from bench.cli._app import run
from bench.documents import parse_text
from bench.reporting import graph_page, graph_svg
from decompositions import load_decomposition

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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_page_shows_every_id_and_runs_none(folder: Path) -> None:
    page, text = page_of(folder)
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


def test_drawings_hold_every_id(folder: Path) -> None:
    decomposition = load_decomposition(folder / "decomposition.json")
    drawing = ElementTree.fromstring(graph_svg(decomposition))
    texts = {text for text in drawing.itertext() if text.strip()}
    assert any(IDS["KA-09"] in text for text in texts)
    page = graph_page(decomposition)
    assert "<script>alert" not in page
    assert "<img src=x" not in page


@pytest.mark.parametrize("name", ["KA-03", "KA-05", "KA-09", "KA-20"])
def test_compare_takes_and_prints_an_id(folder: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["compare", str(folder), f"--node={IDS[name]}"]) == 0
    printed = capsys.readouterr().out
    assert printed.count(IDS[name]) >= 2, printed


def test_json_escapes_of_one_character_are_one_character() -> None:
    value, lines = parse_text(json.dumps({"a🚁": ["x🚁y"]}))
    assert value == {"a🚁": ["x🚁y"]}
    assert ("a🚁",) in lines
    # Half a pair is no character; validation refuses it, with its place in the file.
    assert parse_text('{"a": "\\ud83dx"}')[0] == {"a": "\ud83dx"}
