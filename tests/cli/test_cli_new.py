"""`rebar new`: questions become sentences, sentences a SimSpec, and the SimSpec a picture."""

from __future__ import annotations

import io
import random
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from bench.cli._app import run
from bench.cli._situation_map import SituationMap, situation_svg, situation_text
from bench.simspec import load_simspec

ANSWERS = [
    "600 by 400",
    "A radar vehicle at (120, -40)",
    "Three civilians within 60 m of the radar",
    "a truck near a wombat",  # not read, and asked again
    "",
    "light",
    "none",
    "5 m/s from the west",
    "",
    "80",
    "",
    "8",
    "45",
    "30",
    "GPS jammed at 100 s for 20 s.",
    "",
]


def answered(monkeypatch: pytest.MonkeyPatch, *answers: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{answer}\n" for answer in answers)))


def test_answers_become_a_simspec_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is not read is told and asked again; what is left empty is a default; nothing is left open."""
    out, picture = tmp_path / "scene.yaml", tmp_path / "scene.svg"
    answered(monkeypatch, *ANSWERS)
    assert run(["new", "--out", str(out), "--picture", str(picture)]) == 0
    shown = capsys.readouterr().out
    simspec = load_simspec(out)
    assert [group.id for group in simspec.actors] == ["radar", "civilian"]
    assert (simspec.mission.altitude_m, simspec.mission.speed_mps, simspec.mission.time_limit_s) == (
        80,
        12,
        480,
    )
    assert (simspec.rules.no_mark_within_m, simspec.rules.bystander_standoff_m) == (45, 30)
    assert (simspec.environment.rain_level, simspec.environment.wind.speed_mps) == (2, 5)
    assert "not read: 'A truck near a wombat'" in shown
    assert "R radar, C civilian" in shown
    assert not [line for line in out.read_text().splitlines() if line.startswith("#")]
    circles = [node for node in ET.parse(picture).iter() if node.tag.endswith("circle")]
    assert len(circles) == 4


def test_an_interview_that_ends_early_says_what_was_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-D after two answers: the sentences so far are the start of the next interview."""
    answered(monkeypatch, *ANSWERS[:2])
    assert run(["new", "--out", str(tmp_path / "scene.yaml")]) != 0
    text = "The area is 600 by 400 m. A radar vehicle at (120, -40)."
    assert f"give --from-prose what was said: {text}" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_prose_fills_in_what_it_says_and_its_choices_are_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the text has set is not asked again; a number that is no reading is."""
    out = tmp_path / "scene.yaml"
    text = "Two vehicles. Light rain. Fly at 70 m. Time limit 4 minutes. The area is 500 by 300 m."
    answered(monkeypatch, "7", "2", "", "none", "none", "", "", "", "", "")
    assert run(["new", "--from-prose", text, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    simspec = load_simspec(out)
    assert "Answer with a number from 1 to 2" in shown
    assert [group.asset for group in simspec.actors] == ["military-truck"]
    assert simspec.mission.altitude_m == 70.0
    assert "Height of the flight" not in shown
    assert run(["new", "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_what_is_read_freely_is_compared_and_what_is_denied_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the text and of sentences that are added; the document says nothing of `check` then."""
    out = tmp_path / "scene.yaml"
    text = "A shed. In the north two trucks are parked. In the south four children. Fly at 70 m."
    answered(
        monkeypatch,
        *("no", ""),  # the trucks are denied, the children are right
        "",
        "In the east three crates",
        "no",
        "In the east five crates",
        "yes",
        *[""] * 12,
    )
    assert run(["new", "--from-prose", text, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    groups = {group.id: group.count for group in load_simspec(out).actors}
    assert groups == {"shed": 1, "child": 4, "crate": 5}
    assert "'In the north two trucks are parked' is read as: [truck].count 2" in shown
    assert "The same in words: A shed. In the south four children. Fly at 70 m. In the east" in shown
    assert not [line for line in out.read_text().splitlines() if line.startswith("#")]


def test_nothing_answered_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without one answer there is no situation."""
    answered(monkeypatch, *[""] * 12)
    assert run(["new", "--out", str(tmp_path / "scene.yaml")]) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("seed", range(3))
def test_the_map_has_every_actor_at_its_place(seed: int) -> None:
    """On the drawing by its coordinates; on the text by the row and column of its place in the box."""
    draw = random.Random(seed)
    corners = ((-300.0, -100.0), (300.0, -100.0), (300.0, 100.0), (-300.0, 100.0))
    actors = tuple(
        (group, role, (draw.uniform(-290, 290), draw.uniform(-90, 90)))
        for group, role in (("radar", "adversary"), ("child", "bystander"))
    )
    drawing = SituationMap(corners, (), (("zone", corners[:3]),), (), (-300.0, -100.0), actors)
    west, south, east, north = drawing.box
    *rows, legend = situation_text(drawing, columns=60)
    assert "R radar, C child" in legend
    for letter, (_, _, (x, y)) in zip("RC", actors, strict=True):
        [(row, column)] = [(at, line.index(letter)) for at, line in enumerate(rows) if letter in line]
        assert abs((column + 0.5) / 60 - (x - west) / (east - west)) < 1.01 / 60
        assert abs((row + 0.5) / len(rows) - (north - y) / (north - south)) < 1.01 / len(rows)
    circles = [node for node in ET.fromstring(situation_svg(drawing)).iter() if node.tag.endswith("circle")]
    scale = 800 / (east - west)
    drawn = [(float(node.attrib["cx"]), float(node.attrib["cy"])) for node in circles]
    expected = [((x - west) * scale, (north - y) * scale) for _, _, (x, y) in actors]
    assert drawn == [pytest.approx(place, abs=0.1) for place in expected]
