"""`rebar draw`: runs of one scene from above, still and as a film; `rebar graph` and `rebar camera`."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import networkx as nx
import numpy as np
import pytest
from command_line import Rebar
from made_campaign import AGENTS, END_S, Made, made_simspec, made_tape, make_campaign, write_recording

from bench.camera.sheet import asset_sheet
from bench.cli._app import run
from decompositions import excerpt, load_decomposition

TREE = "search-and-report"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Two scenes, each flown by two agents; one folder has markup in its name."""
    folder = tmp_path_factory.mktemp("runs")
    made = {}
    for scene in (0, 1):
        for agent in AGENTS:
            name = f"p{scene}-{agent}" if (scene, agent) != (1, AGENTS[1]) else "p1-<b>\x07"
            simspec = made_simspec(scene, agent)
            made[f"{scene}-{agent}"] = folder / name
            made[f"{scene}-{agent}"].mkdir()
            write_recording(folder / name / "recording.mcap", simspec, made_tape(simspec))
    return made


def drawing(out: Path, *line: str) -> ElementTree.Element:
    assert run(["draw", *line, "--out", str(out)]) == 0
    return ElementTree.parse(out).getroot()


def texts(root: ElementTree.Element) -> list[str]:
    return [element.text or "" for element in root.iter(f"{SVG}text")]


def test_a_run_is_drawn_with_its_key(runs: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "new" / "one.svg"
    root = drawing(out, str(runs[f"0-{AGENTS[0]}"]))
    assert {"marked, 60 s", "too near a bystander", "area of interest", "home", "bystander"} <= set(
        texts(root)
    )
    assert re.findall(r"(?:href|url)[=(]", out.read_text()) == []
    assert list(root.iter(f"{SVG}animateTransform")) == []


def test_two_agents_in_one_scene(runs: dict[str, Path], tmp_path: Path) -> None:
    """Each flight has a colour of its own, and the labels of both can be read: none lies on another."""
    root = drawing(tmp_path / "two.svg", *(str(runs[f"0-{agent}"]) for agent in AGENTS))
    assert {f"flight of p0-{agent}" for agent in AGENTS} <= set(texts(root))
    lines = [line for line in root.iter(f"{SVG}polyline") if line.get("stroke-width") == "2.5"]
    assert len({line.get("stroke") for line in lines}) == len(AGENTS)
    labels = [text for text in root.iter(f"{SVG}text") if ", 60 s" in (text.text or "")]
    places = {text.text: float(text.attrib["y"]) for text in labels}
    assert set(places) == {"marked, 60 s", "withheld mark, 60 s"}
    assert abs(places["marked, 60 s"] - places["withheld mark, 60 s"]) > 12


def test_a_film_moves_the_vehicle_as_it_flew(runs: dict[str, Path], tmp_path: Path) -> None:
    """The dot is where the recording has the vehicle, at every moment; a report appears at its time; people walk."""
    agent = AGENTS[0]
    root = drawing(tmp_path / "film.svg", str(runs[f"0-{agent}"]), "--film")
    tape = made_tape(made_simspec(0, agent))
    circles = root.iter(f"{SVG}circle")
    moving = [circle for circle in circles if circle.find(f"{SVG}animateTransform") is not None]
    assert len(moving) == 1 + sum(member.role.value == "bystander" for member in tape.cast)
    (motion,) = next(circle for circle in moving if circle.get("r") == "6")
    places_px = np.array([pair.split() for pair in motion.attrib["values"].split(";")], dtype=float)
    moments_s = np.linspace(0.0, END_S, len(places_px))
    east_m, north_m, _ = tape.vehicle_position_enu_m.T
    flown = np.stack([np.interp(moments_s, tape.vehicle_time_s, at) for at in (east_m, north_m)], axis=1)
    # The map has one scale on both axes, north is up, and a pixel is written to a tenth.
    m_per_px = np.ptp(flown[:, 0]) / np.ptp(places_px[:, 0])
    assert np.allclose((places_px - places_px[0]) * m_per_px * (1, -1), flown - flown[0], atol=0.3)
    shown = [step for step in root.iter(f"{SVG}animate") if step.get("attributeName") == "visibility"]
    assert {step.attrib["keyTimes"] for step in shown} == {
        f"0;{report.value.time_s / END_S:.4f}" for report in tape.reports
    }


def test_names_are_text(runs: dict[str, Path], tmp_path: Path) -> None:
    root = drawing(tmp_path / "name.svg", str(runs[f"1-{AGENTS[1]}"]))
    assert list(root.iter(f"{SVG}b")) == []
    assert any("<b>" in text for text in texts(root))
    assert "\x07" not in (tmp_path / "name.svg").read_text()


def test_what_cannot_be_drawn_is_refused(runs: dict[str, Path], tmp_path: Path, rebar: Rebar) -> None:
    scenes = [str(runs[f"{scene}-{AGENTS[0]}"]) for scene in (0, 1)]
    for line, expected in (
        ([*scenes, "--out", str(tmp_path / "a.svg")], "are not of one scene"),
        ([str(tmp_path), "--out", str(tmp_path / "a.svg")], "recording.mcap"),
        ([scenes[0], "--out", str(tmp_path / "a.png")], "does not end with .svg"),
    ):
        assert expected in rebar.refused("draw", *line)
    assert list(tmp_path.iterdir()) == []


def test_both_files_by_the_name_of_the_decomposition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar
) -> None:
    monkeypatch.chdir(tmp_path)
    assert rebar("graph", TREE).split() == [f"{TREE}.html", f"{TREE}.svg"]
    for end, begins in (("html", "<!DOCTYPE html>"), ("svg", "<svg ")):
        assert (tmp_path / f"{TREE}.{end}").read_text().startswith(begins)


def test_a_graph_is_coloured_by_a_campaign(tmp_path: Path, rebar: Rebar) -> None:
    """One file of the kind that its end says, with the agent's numbers, in a folder that is made."""
    folder = make_campaign(tmp_path / "made", Made(scenes=3))
    out = tmp_path / "new" / "graph.svg"
    coloured = ["--campaign", folder, "--agent", AGENTS[1], "--by", "score"]
    rebar("graph", folder / "decomposition.json", *coloured, "--out", out)
    assert [path.name for path in out.parent.iterdir()] == ["graph.svg"]
    assert f"ARL score of {AGENTS[1]}, made-up" in out.read_text()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (["graph", TREE, "--out", "graph.pdf"], ["has an unknown suffix"]),
        (["graph", TREE, "--agent", "mine"], ["there is no campaign to take results from"]),
        (["graph", TREE, "--node", "KA-99"], ["KA-99"]),
        (["graph", TREE, "--campaign", "nowhere"], ["holds no campaign.yaml"]),
        (
            ["camera", "sheet", "--out", "sheet.gif"],
            ["--out: cannot write pictures as .gif (use .png, .jpg, .webp)"],
        ),
        (
            ["camera", "sheet", "--out", "sheet.png", "--renderer", "crayons"],
            ["--renderer: there is no renderer 'crayons' (installed: ", "opencv"],
        ),
    ],
)
def test_what_cannot_be_shown_is_refused(
    line: list[str], expected: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rebar: Rebar
) -> None:
    monkeypatch.chdir(tmp_path)
    refusal = rebar.refused(*line)
    assert [words for words in expected if words not in refusal] == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["KA-18", "OBS-181", "responsible"])
def test_an_excerpt_holds_what_a_node_serves_and_what_is_below_it(name: str, tmp_path: Path) -> None:
    """By the ancestors and descendants of its graph, with their edges and no others; as a drawing too."""
    whole = load_decomposition(TREE)
    graph = whole.graph()
    part = excerpt(whole, name)
    kept = {name, *nx.ancestors(graph, name), *nx.descendants(graph, name)}
    assert set(part.nodes) == kept
    assert set(part.graph().edges) == {edge for edge in graph.edges if kept.issuperset(edge)}
    assert list(part.nodes) == [node for node in whole.nodes if node in kept]
    assert run(["graph", TREE, "--node", name, "--out", str(tmp_path / "part.svg")]) == 0
    text = (tmp_path / "part.svg").read_text()
    assert all((node in text) == (node in kept) for node in whole.key_attributes)


def test_a_sheet_shows_each_asset_in_a_cell_of_its_own() -> None:
    sheet = asset_sheet(("soldier", "ambulance"))
    cells = [sheet[:180, left : left + 240].astype(float) for left in range(0, 1440, 240)]
    assert sheet.shape == (198, 1440, 3)
    assert [cell.std() > 15.0 for cell in cells] == [True, True, False, False, False, False]
    assert np.abs(cells[0] - cells[1]).mean() > 10.0
