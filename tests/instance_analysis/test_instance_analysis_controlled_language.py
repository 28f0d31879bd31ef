"""Every sentence form of docs/controlled-language.md is read in full, alone and among all others."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest
import yaml

from bench import instance_analysis
from bench.instance_analysis import annotated_yaml, load_vocabulary, read_prose
from bench.instance_analysis._controlled_language import Shape, controlled, shapes_of
from bench.instance_analysis._items import items_of
from bench.instance_analysis.language._phrases import with_quantities
from bench.instance_analysis.language._tokens import words_of
from bench.instance_analysis.ledger._clauses import is_stop

PAGE = (Path(__file__).parents[2] / "docs" / "controlled-language.md").read_text(encoding="utf-8")
ROWS = [line.split(" | ") for line in PAGE.splitlines() if re.match(r"\| \d+ \|", line)]
FORMS = [
    (form, re.findall(r"`([^`=]+?) = ([^`]+)`", row[2]))
    for row in ROWS
    for form in re.findall(r"`([^`]+)`", row[1])
]
VOCABULARY = load_vocabulary()
JUDGED = Path(__file__).parent / "judged"


def test_the_page_has_the_forms() -> None:
    """Some 25 of them, each with what it sets."""
    assert len(ROWS) >= 25
    assert len(FORMS) >= len(ROWS)


@pytest.mark.parametrize(("form", "fields"), FORMS, ids=[form for form, _ in FORMS])
def test_a_form_is_read_in_full(form: str, fields: list[tuple[str, str]]) -> None:
    """Nothing is left open or out, and one of the fields of its row has the value that the page states."""
    result = read_prose(form, VOCABULARY)
    assert result.certain, [clause for clause in result.clauses if clause.status != "understood"]
    told = {receipt.path: str(receipt.value) for receipt in result.receipts if receipt.source == "prose"}
    assert not fields or any(_same(told.get(path, ""), value) for path, value in fields)


def _same(told: str, stated: str) -> bool:
    try:
        return float(told) == float(stated)
    except ValueError:
        return told == stated


def test_the_file_of_sentences_has_those_of_the_page() -> None:
    """Each with the shapes that grammar and vocabulary give it now."""
    fillers = sorted(
        {word.text.lower() for form, _ in FORMS for word in words_of(form, VOCABULARY) if word.filler}
    )
    lines = [f"{form} = {'; '.join(' '.join(shape) for shape in shapes(form) if shape)}" for form, _ in FORMS]
    path = Path(instance_analysis.__file__).with_name("language") / "controlled_sentences.txt"
    stated = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    lines.insert(0, f"fillers: {', '.join(fillers)}")
    assert stated == lines, f"write these lines to {path}:\n" + "\n".join(lines)


def shapes(text: str) -> list[Shape]:
    """The kinds of what each sentence of a text consists of."""
    return shapes_of(items_of(with_quantities(words_of(text, VOCABULARY), []), text, VOCABULARY))


@pytest.mark.parametrize(
    ("text", "free"),
    [
        (
            "Five civilians within 60 m of home. Ten people walk, three of them to the north.",
            ["Ten people walk"],
        ),
        ("A house. In the north two trucks are parked.", ["In the north two trucks are parked"]),
        ("A truck. A rdar vehicle.", ["A rdar vehicle"]),
        (
            "A radar. At 90 s the operator retasks the drone to the radar.",
            ["90 s the operator retasks the drone to the radar"],
        ),
        ("A car. One enemy mobile radar.", ["One enemy mobile radar"]),
        ("A car. Fly at 60 m. No, sorry, 70 m.", ["Fly at 60 m", "No", "sorry", "70 m"]),
        ("Good morning. Light rain. Hello.", []),
    ],
)
def test_what_is_read_of_another_sentence_is_to_be_checked(text: str, free: list[str]) -> None:
    """Also where a word was misspelt; the other sentences stay understood, and a person may check them all."""
    result = read_prose(text, VOCABULARY)
    assert [clause.quote for clause in result.unchecked] == free
    assert result.certain is (result.complete and not free)
    assert result.model_copy(update={"checked": True}).certain is result.complete
    assert all(f"# check: {quote!r}" in annotated_yaml(result) for quote in free)


def test_no_fact_that_judges_found_wrong_stands_in_a_controlled_sentence() -> None:
    """Judges of eight sets of 30 descriptions found 54 facts silently wrong or missing, and others wrong under a mark."""
    counts: Counter[tuple[str, bool]] = Counter()
    for verdicts in JUDGED.glob("*_verdicts.yaml"):
        name = verdicts.name.replace("_verdicts", "")
        texts = {entry["id"]: entry["text"] for entry in yaml.safe_load((JUDGED / name).read_text("utf-8"))}
        for judged in yaml.safe_load(verdicts.read_text("utf-8")):
            text = texts[judged["id"]]
            sentences = controlled_in(text)
            for fact in judged["facts"]:
                at = text.lower().find(fact["words"].lower())
                in_controlled = next((controlled for end, controlled in sentences if at < end), False)
                verdict = str(fact["verdict"])
                is_wrong = verdict.startswith("SILENT") or verdict.endswith("WRONG")
                counts["wrong" if is_wrong else verdict, in_controlled] += 1
    assert counts["wrong", True] == 0
    assert counts["wrong", False] >= 50
    assert counts["RIGHT", True] >= 120


def controlled_in(text: str) -> list[tuple[int, bool]]:
    """The end of each sentence of a text, and whether the sentence is one of the controlled language."""
    words = with_quantities(words_of(text, VOCABULARY), [])
    items = items_of(words, text, VOCABULARY)
    ends = [*(item.span.end for item in items if is_stop(item)), len(text)]
    return list(zip(ends, controlled(items, words), strict=True))


def test_the_whole_situation_is_certain() -> None:
    """The example at the end of the page."""
    [situation] = re.findall(r"```\n(.*?)```", PAGE, re.DOTALL)
    result = read_prose(situation, VOCABULARY)
    assert result.certain
    assert {clause.status for clause in result.clauses} == {"understood"}
    assert [group.id for group in result.simspec.actors] == ["radar", "civilian", "soldier"]


def test_all_forms_together_are_read_as_they_are_alone() -> None:
    """Weather, rules, failures and the flight do not depend on what stands beside them."""
    kinds = ("environment", "mission", "rules", "outages", "orders", "vehicle.failures")
    # The first form of each field: two values of one field are a choice.
    of_field = {fields[0][0]: form for form, fields in reversed(FORMS) if fields}
    forms = [form for path, form in of_field.items() if path.startswith(kinds)]
    result = read_prose(" ".join(forms), VOCABULARY)
    assert result.certain, result.not_understood
    told = {receipt.path for receipt in result.receipts if receipt.source == "prose"}
    for form in forms:
        alone = read_prose(form, VOCABULARY).receipts
        fields = {receipt.path for receipt in alone if receipt.source == "prose" and "[" not in receipt.path}
        assert fields <= told, form
