"""Every sentence form of docs/controlled-language.md is read in full, alone and among all others."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.instance_analysis import load_vocabulary, read_prose

PAGE = (Path(__file__).parents[2] / "docs" / "controlled-language.md").read_text(encoding="utf-8")
ROWS = [line.split(" | ") for line in PAGE.splitlines() if re.match(r"\| \d+ \|", line)]
FORMS = [
    (form, re.findall(r"`([^`=]+?) = ([^`]+)`", row[2]))
    for row in ROWS
    for form in re.findall(r"`([^`]+)`", row[1])
]
VOCABULARY = load_vocabulary()


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
    forms = [form for form, fields in FORMS if any(path.startswith(kinds) for path, _ in fields)]
    result = read_prose(" ".join(forms), VOCABULARY)
    assert result.certain, result.not_understood
    told = {receipt.path for receipt in result.receipts if receipt.source == "prose"}
    for form in forms:
        alone = read_prose(form, VOCABULARY).receipts
        fields = {receipt.path for receipt in alone if receipt.source == "prose" and "[" not in receipt.path}
        assert fields <= told, form
