"""Texts that once were read as something else, or in silence: what is not read must be visible in its clause."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
import yaml

from bench.campaign import load_campaign
from bench.cli._app import run
from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose
from bench.simspec import SimSpec

VOCABULARY = load_vocabulary()
QUIET = ("understood", "default")


def read(text: str) -> BaseSimSpec:
    return read_prose(text, VOCABULARY)


def groups(simspec: SimSpec) -> list[tuple[str, Any]]:
    return [(group.asset, group.count) for group in simspec.actors]


def test_enemies_are_counted() -> None:
    """`enemy` before a noun takes nothing from its number, and a hostile van is in the scene without a question."""
    result = read("Three enemy vans.")
    assert groups(result.simspec) == [("van", 3)]
    assert result.simspec.actors[0].role == "adversary"
    assert read("An enemy van.").choices == ()


@pytest.mark.parametrize(
    "text",
    [
        "Two technicals drive along the road.",
        "Five percent GPS dropout.",
        "A number of trucks drawn from {1, 4, 9}.",
        "One bus 9 m long across the lane.",
        "Patrol by night, 2200-2330.",
    ],
)
def test_what_has_no_sentence_sets_nothing_unmarked(text: str) -> None:
    """No technician, no dead GPS, no single truck, no road of nine metres, no start before midnight."""
    result = read(f"A house. {text}")
    sets = {path for clause in result.clauses if clause.status in QUIET for path in clause.fields}
    assert {path.split(".")[0] for path in sets} <= {"actors[house]"}
    assert not result.complete
    assert not result.simspec.vehicle.failures
    assert not result.simspec.world.roads
    assert all(group.asset not in ("civilian", "aid-worker") for group in result.simspec.actors)


@pytest.mark.parametrize(
    ("text", "asks"), [("No civilians. Two children.", True), ("No civilians. Two dogs.", False)]
)
def test_nobody_and_somebody_is_a_contradiction(text: str, asks: bool) -> None:
    """Children are civilians too."""
    choices = read(text).choices
    assert bool(choices) is asks
    assert not asks or "child" in choices[0].ask


def test_the_target_is_one_that_the_text_has_named() -> None:
    """`The target is the van` adds no third one, and whether `a van` is one is asked."""
    result = read("Two hostile vans. The target is the van.")
    assert groups(result.simspec) == [("van", 2)]
    result = read("Two hostile vans. The target is a van.")
    assert groups(result.simspec) == [("van", 2)]
    assert result.choices[0].readings == ("van", "no, another one")


@pytest.mark.parametrize(
    ("text", "readings"),
    [("Fly at 1.500 m.", (1.5, 1500.0)), ("Wind 12.250 m/s.", (12.25, 12250.0))],
)
def test_a_number_with_three_decimals_may_be_thousands(text: str, readings: tuple[float, float]) -> None:
    """Half of the world writes thousands so; a coordinate in degrees, 0.500 and 1.50 are plain."""
    choice = read(text).choices[0]
    assert "is a decimal" in choice.ask
    shown = [float(reading.rpartition(" m")[0].rpartition(" ")[2]) for reading in choice.readings[:2]]
    assert tuple(shown) == readings
    for plain in ("A truck at 47.398 N, 8.546 E.", "Visibility 0.500 km.", "Visibility 1.50 km."):
        assert read(plain).choices == ()


def test_a_motor_is_one_of_the_vehicle() -> None:
    """Four of the quadrotor, one of the wing, whatever the text tells first."""
    assert read("Motor 4 fails at 60 s.").simspec.vehicle.failures[0].instance == 4
    assert read("Fixed wing. Motor 1 fails at 60 s.").complete
    for text in ("Motor 5 fails at 60 s.", "Motor 0 fails at 60 s.", "Motor 2 fails at 60 s. Fixed wing."):
        result = read(text)
        assert result.simspec.vehicle.failures == ()
        assert "the vehicle has no motor" in result.not_understood[0].why


@pytest.mark.parametrize("text", ["4 or 4 civilians.", "1.5 or 2 civilians.", "3 or more civilians."])
def test_a_set_of_numbers_has_different_whole_ones(text: str) -> None:
    assert read(text).simspec.actors == ()
    assert not read(text).complete


def test_a_number_from_a_set_is_a_factor_of_the_design() -> None:
    """The SimSpec holds the first one."""
    result = read("A house. 4, 9 or 1 civilians.")
    assert groups(result.simspec)[1] == ("civilian", 4)
    assert [(item.paths, item.levels) for item in result.ranges] == [(("actors[civilian].count",), (4, 9, 1))]


def test_visibility_and_fog_are_one_thing() -> None:
    """Both stated, it is asked which holds; either answer gives a document."""
    for answer, fields in ((1, (2000.0, 0.0)), (2, (None, 3.0))):
        environment = read_prose("Fog level 3. Visibility 2 km.", VOCABULARY, [answer]).simspec.environment
        assert (environment.visibility_m, environment.fog_level) == fields


def test_gusts_are_stronger_than_the_wind() -> None:
    """A range of gusts is a factor; what the wind reaches anyway is left out."""
    [varied] = read("Gusts of 8 to 12 m/s. Wind 3 m/s.").ranges
    assert varied.paths == ("environment.wind.turbulence_mps",)
    assert not read("Wind 5 m/s. Gusts of 5 m/s.").complete


def test_where_somebody_was_last_seen_contradicts_no_place() -> None:
    """A place of its own beyond the accuracy costs the report, not the document."""
    result = read("A radar at (10, 10). The radar was last seen at (200, 0), accurate to 60 m.")
    assert not result.complete
    assert result.simspec.intelligence == () or result.simspec.intelligence[0].at is None
    result = read("A radar at (10, 10). The radar was last seen at (50, 0), accurate to 60 m.")
    assert result.complete
    assert result.simspec.intelligence[0].at is not None


def test_a_colour_of_people_may_be_none_of_their_clothes() -> None:
    assert "of what does 'white' tell?" in read("A white man.").choices[0].ask
    assert read_prose("A white man.", VOCABULARY, [2]).simspec.actors[0].color is None
    assert read("A red man. A white van.").choices == ()


@pytest.mark.parametrize(
    ("text", "remark"),
    [
        ("Five civilians. Two civilians walk at 1 m/s.", "read as others than civilian"),
        ("Three to five cars. Four cars are parked.", "read as others than car"),
        ("Two houses. The house is 40 m from home.", "read as all of house"),
        ("Five civilians. Two of them walk at 1 m/s.", ""),
        ("Two civilians. Five civilians walk at 1 m/s.", ""),
        ("Two civilians. Two civilians walk at 1 m/s.", ""),
        ("Two houses. The houses are 40 m from home.", ""),
        ("A house. The house is 40 m from home.", ""),
    ],
)
def test_a_number_that_may_be_meant_otherwise_is_told(text: str, remark: str) -> None:
    """Two civilians after five may be two of the five; `the house` of two houses may be one of them."""
    result = read(text)
    remarks = [item.why for item in result.remarks if item.why.startswith("read as")]
    assert len(remarks) == bool(remark)
    assert all(why.startswith(remark) for why in remarks)
    assert result.clauses[-1].status == ("default" if remark else result.clauses[-1].status)


def test_a_number_is_not_lost_to_a_density() -> None:
    """Six civilians are six, whatever is said of their density; without a number the density holds."""
    result = read("A house. Six civilians at a density of 120 per km2.")
    assert not result.complete
    assert all(group.density_per_km2 is None for group in result.simspec.actors)
    result = read("Civilians at a density of 120 per km2.")
    assert result.complete
    assert result.simspec.actors[0].density_per_km2 == 120


def test_a_ban_near_people_is_a_rule_whose_distance_is_asked() -> None:
    """And never its opposite."""
    result = read("A radar. Without marking it near civilians.")
    [choice] = result.choices
    assert all(reading.startswith("within") for reading in choice.readings)
    assert result.simspec.rules.no_mark_within_m == 50.0


def test_a_text_without_intelligence_has_a_default_that_is_told() -> None:
    """For each target the document has a report, and says which sentence is missing."""
    result = read("A radar. A truck. Five civilians.")
    assert [report.about for report in result.simspec.intelligence] == ["radar", "truck"]
    assert all("Intelligence on the" in clause.notes[0] for clause in result.clauses[:2])
    assert len(read("A radar. Intelligence on the radar, 2 minutes old.").simspec.intelligence) == 1
    assert read("Five civilians.").simspec.intelligence == ()


def test_a_campaign_has_its_agents_its_name_and_the_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the text that it was made of, with what is open in it."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "deep" / "campaign.yaml"
    path.parent.mkdir()
    text = "A radar. 3 to 9 civilians within 50 m of the radar. Rain. Wombats."
    assert run(["prose", text, "--campaign", str(path), "--agent", "a.yaml", "--agent", "reference"]) == 0
    campaign = load_campaign(path)
    assert campaign.name == "a-radar-3-to-9"
    manifests = [os.path.normpath(agent.manifest) for agent in campaign.agents]
    assert manifests == [str(tmp_path / "a.yaml"), "reference"]
    assert campaign.description.startswith(text)
    assert "Open: 'Rain': how much rain? Read as: level 2, light" in campaign.description
    assert "Not read: 'Wombats'" in campaign.description


ENTRIES: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("silent.yaml").read_text())


def is_quiet(result: BaseSimSpec, begin: int, end: int) -> bool:
    """Whether a passage lies in clauses of which none tells that something is open, to be checked or not read."""
    clauses = [item for item in result.clauses if item.start < end and begin < item.end]
    return bool(clauses) and all(clause.status in QUIET for clause in clauses)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["say"][:40])
def test_what_is_not_read_is_visible(entry: dict[str, Any]) -> None:
    """`marked` words are told; a field that nothing marks holds what the text says."""
    result = read_prose(entry["say"], VOCABULARY)
    begins = {words: entry["say"].index(words) for words in entry.get("marked", ())}
    assert [words for words, begin in begins.items() if is_quiet(result, begin, begin + len(words))] == []
    told = [receipt for receipt in result.receipts if receipt.source == "prose" and receipt.start is not None]
    quiet = {item.path: item.value for item in told if is_quiet(result, item.start or 0, item.end or 0)}
    expected = entry.get("is", {})
    assert {path: quiet[path] for path in expected if path in quiet} == {
        path: expected[path] for path in expected if path in quiet
    }
