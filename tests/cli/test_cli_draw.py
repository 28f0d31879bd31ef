"""`rebar draw`: runs of one scene from above, still and as a film."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from bench.cli._app import run

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import AGENTS, END_S, made_simspec, made_tape, write_recording

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
    """Alone, nothing in the file asks for anything outside of it."""
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
    flights = {
        line.get("stroke") for line in root.iter(f"{SVG}polyline") if line.get("stroke-width") == "2.5"
    }
    assert len(flights) == len(AGENTS)
    places = {
        text.text: float(text.attrib["y"])
        for text in root.iter(f"{SVG}text")
        if ", 60 s" in (text.text or "")
    }
    assert set(places) == {"marked, 60 s", "withheld mark, 60 s"}
    assert abs(places["marked, 60 s"] - places["withheld mark, 60 s"]) > 12


def test_a_film_moves_the_vehicle_as_it_flew(runs: dict[str, Path], tmp_path: Path) -> None:
    """The dot is where the recording has the vehicle, at every moment; a report appears at its time; people walk."""
    agent = AGENTS[0]
    root = drawing(tmp_path / "film.svg", str(runs[f"0-{agent}"]), "--film")
    tape = made_tape(made_simspec(0, agent))
    moving = [
        circle for circle in root.iter(f"{SVG}circle") if circle.find(f"{SVG}animateTransform") is not None
    ]
    walkers = sum(member.role.value == "bystander" for member in tape.cast)
    assert len(moving) == 1 + walkers
    (motion,) = next(circle for circle in moving if circle.get("r") == "6")
    places_px = np.array([pair.split() for pair in motion.attrib["values"].split(";")], dtype=float)
    moments_s = np.linspace(0.0, END_S, len(places_px))
    flown = np.stack(
        [np.interp(moments_s, tape.vehicle_time_s, tape.vehicle_position_enu_m[:, axis]) for axis in (0, 1)],
        axis=1,
    )
    # The map has one scale on both axes, north is up, and a pixel is written to a tenth.
    m_per_px = np.ptp(flown[:, 0]) / np.ptp(places_px[:, 0])
    assert np.allclose((places_px - places_px[0]) * m_per_px * (1, -1), flown - flown[0], atol=0.3)
    times = {
        animation.attrib["keyTimes"]
        for animation in root.iter(f"{SVG}animate")
        if animation.get("attributeName") == "visibility"
    }
    assert times == {f"0;{report.value.time_s / END_S:.4f}" for report in tape.reports}


def test_names_are_text(runs: dict[str, Path], tmp_path: Path) -> None:
    """The name of a folder that holds markup and a control character is shown, and is no element."""
    root = drawing(tmp_path / "name.svg", str(runs[f"1-{AGENTS[1]}"]))
    assert list(root.iter(f"{SVG}b")) == []
    assert any("<b>" in text for text in texts(root))
    assert "\x07" not in (tmp_path / "name.svg").read_text()


def test_what_cannot_be_drawn_is_refused(
    runs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Runs of two scenes, a folder without a recording, another kind of file; nothing is written."""
    scenes = [str(runs[f"{scene}-{AGENTS[0]}"]) for scene in (0, 1)]
    for line, expected in (
        ([*scenes, "--out", str(tmp_path / "a.svg")], "are not of one scene"),
        ([str(tmp_path), "--out", str(tmp_path / "a.svg")], "recording.mcap"),
        ([scenes[0], "--out", str(tmp_path / "a.png")], "does not end with .svg"),
    ):
        assert run(["draw", *line]) == 2
        assert expected in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
