"""The page of the controlled language is made of the forms, and every sentence on it is read in full."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.cli._app import run
from bench.instance_analysis import annotated_yaml, load_vocabulary, page, read_prose
from bench.instance_analysis.language._grammar import Form, forms
from bench.simspec import ASSETS

SHORT_PAGE = Path(__file__).parents[2] / "docs" / "controlled-language.md"
VOCABULARY = load_vocabulary()
FORMS = [form for section in forms().sections for form in section.forms]
SENTENCES = [(form, sentence) for form in FORMS for sentence in form.write]
ASKS = {"Do not mark near civilians."}
"""Sentences of the page that leave something open, as it says."""


def test_the_short_page_is_a_situation_whose_sentences_are_all_read() -> None:
    """Sentence by sentence, each as one of the controlled language, on a page of at most 400 words."""
    text = SHORT_PAGE.read_text(encoding="utf-8")
    assert len(text.split()) <= 400
    [situation] = re.findall(r"```\n(.*?)```", text, re.DOTALL)
    result = read_prose(situation, VOCABULARY)
    assert result.complete, [clause for clause in result.clauses if clause.notes]
    assert {clause.status for clause in result.clauses} == {"understood"}
    assert len(result.clauses) >= len(situation.split("\n")) - 8


def test_the_whole_page_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["prose", "--page"]) == 0
    assert capsys.readouterr().out == page()
    assert all(sentence in page() for _, sentence in SENTENCES)


def test_every_form_has_a_sentence_or_a_neighbour_that_shows_it() -> None:
    """Only the second half of a pair of sentences has none of its own."""
    without = [form.reader for form in FORMS if not form.write]
    assert set(without) <= {"escort", "order", "behind", "present", "sets", "moment"}
    assert len(SENTENCES) > 200


@pytest.mark.parametrize(("form", "sentence"), SENTENCES, ids=[sentence for _, sentence in SENTENCES])
def test_a_sentence_is_read_in_full(form: Form, sentence: str) -> None:
    """Nothing is left open or out; the first sentence of a form sets what the page says of it."""
    result = read_prose(sentence, VOCABULARY)
    assert result.complete or sentence in ASKS, [clause for clause in result.clauses if clause.notes]
    assert {clause.status for clause in result.clauses} <= {"understood", "default", "choice"}
    told = {receipt.path: receipt.value for receipt in result.receipts if receipt.source != "default"}
    if sentence == form.write[0]:
        shown = re.findall(r"`([a-z][^`= ]*) = ([^`]*)`", form.shows)
        assert {path: _plain(told[path]) for path, _ in shown} == {
            path: _plain(value) for path, value in shown
        }


def _plain(value: object) -> object:
    try:
        return round(float(str(value)), 5)
    except ValueError:
        return str(value)


def test_the_whole_situation_is_certain() -> None:
    """The example at the end of the page."""
    [situation] = re.findall(r"```\n(.*?)```", page(), re.DOTALL)
    result = read_prose(situation, VOCABULARY)
    assert result.certain
    assert [group.id for group in result.simspec.actors] == ["radar", "civilian", "soldier"]


def test_all_settings_together_are_read_as_they_are_alone() -> None:
    """Weather, rules, failures and the flight do not depend on what stands beside them."""
    kinds = ("environment", "mission.a", "mission.t", "rules", "vehicle.camera", "vehicle.battery")
    # The first form of each field: two values of one field are a choice.
    plain = [form for form in reversed(FORMS) if len(form.sets) == 1]
    of_field = {path: form.write[0] for form in plain for path in form.sets if path.startswith(kinds)}
    result = read_prose(" ".join(dict.fromkeys(of_field.values())), VOCABULARY)
    told = {receipt.path for receipt in result.receipts if receipt.source == "prose"}
    assert set(of_field) <= told
    assert not result.not_understood


@pytest.mark.parametrize("asset", ASSETS)
def test_every_asset_of_the_catalogue_is_a_thing(asset: str) -> None:
    """By its own name, with and without hyphens; `truck` alone is the military one."""
    name = {"truck": "civilian truck"}.get(asset, asset)
    for noun in (name, name.replace("-", " ")):
        result = read_prose(f"Two {noun}s at (20, 10).", VOCABULARY)
        assert [group.asset for group in result.simspec.actors] == [asset], noun
        assert result.complete


@pytest.mark.parametrize("ground", ["park", "depot", "refugee camp"])
def test_ground_without_coordinates_has_a_default_place(ground: str) -> None:
    """It is told, and never the whole area."""
    result = read_prose(f"A soldier inside the {ground}. The area is 900 by 500 m.", VOCABULARY)
    [area] = result.simspec.world.areas
    assert {abs(corner.east_m) for corner in area.corners} == {50.0}
    assert result.simspec.actors[0].placement.inside is not None
    assert [clause.status for clause in result.clauses] == ["default", "understood"]


def test_a_thing_that_the_catalogue_does_not_have_is_its_nearest() -> None:
    """By its size, which is asked; a target of no kind is asked too."""
    result = read_prose("A crane 12 by 3 by 30 m.", VOCABULARY)
    assert result.simspec.actors[0].asset in result.choices[0].readings[0]
    assert "the catalogue has no 'crane'" in result.choices[0].ask
    other = read_prose("A crane 12 by 3 by 30 m.", VOCABULARY, [2])
    assert other.simspec.actors[0].asset != result.simspec.actors[0].asset
    assert read_prose("A target.", VOCABULARY).choices[0].ask == "what is the target?"


@pytest.mark.parametrize(
    ("text", "free"),
    [
        ("A house. In the north two trucks are parked.", ["In the north two trucks are parked"]),
        ("A truck. A rdar vehicle.", []),
        ("A car. Fly at about 60 m.", ["Fly at about 60 m"]),
        ("A car. Fly at 60 m. No, sorry, 70 m.", []),
        ("Two hikers are missing, a man and a woman.", ["Two hikers are missing", "a man and a woman"]),
        ("A radar, dressed as a bus.", ["A radar"]),
    ],
)
def test_what_is_read_of_another_sentence_is_to_be_checked(text: str, free: list[str]) -> None:
    """The other sentences stay understood, and a person may check them all."""
    result = read_prose(text, VOCABULARY)
    assert [clause.quote for clause in result.unchecked] == free
    assert result.certain is (result.complete and not free)
    assert result.model_copy(update={"checked": True}).certain is result.complete
    assert all(f"# check: {quote!r}" in annotated_yaml(result) for quote in free)
