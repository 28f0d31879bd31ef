"""Descriptions as users write them, with the documents that a person expects of each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from compared_fields import wrong_in

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose
from bench.simspec import SimSpec

CORPUS = Path(__file__).parent / "corpus"
VOCABULARY = load_vocabulary()
ENTRIES = [(f"{file.stem}-{number}", entry) for file in sorted(CORPUS.glob("*.yaml")) for number, entry in enumerate(yaml.safe_load(file.read_text()), start=1)]  # fmt: skip
FLOORS = {"outside_a": 0.87, "outside_b": 0.82, "outside_c": 0.76}
"""The least share of fields exact for texts of outside authors; all other files together have 95 %."""


def test_the_corpus_is_large_enough() -> None:
    """At least 200 descriptions in several registers."""
    assert len(ENTRIES) >= 200
    assert len({name.rpartition("-")[0] for name, _ in ENTRIES}) >= 5


@pytest.fixture(scope="session")
def readings() -> dict[str, BaseSimSpec]:
    """The corpus as it is read, once for all tests; None for what is refused."""
    return {name: _read(entry) for name, entry in ENTRIES}


def _read(entry: dict[str, Any]) -> BaseSimSpec:
    return read_prose(entry["say"], VOCABULARY, entry.get("accept", ()))


@pytest.mark.parametrize("file", [*FLOORS, "all others"])
def test_fields_are_exact(
    file: str, readings: dict[str, BaseSimSpec], capsys: pytest.CaptureFixture[str]
) -> None:
    """Every field that a person expects and every field that is there is compared; questions count as one
    each.
    """
    compared = 0
    missed: list[str] = []
    for name, entry in ENTRIES:
        stem = name.rpartition("-")[0]
        if file != (stem if stem in FLOORS else "all others"):
            continue
        number, wrong = wrong_in(entry, readings[name])
        compared += number
        missed += [f"{name}: {entry['say']!r}: {difference}" for difference in wrong]
    share = 1.0 - len(missed) / compared
    with capsys.disabled():
        print(f"\n{file}: {compared} fields, {share:.2%} exact")
    assert share >= FLOORS.get(file, 0.95), "\n".join(missed)


def test_what_is_read_wrong_is_hardly_ever_silent(readings: dict[str, BaseSimSpec]) -> None:
    """Where a field is not what a person expects, something is listed or a choice: of all texts at most 1 %
    come out wrong without a word.
    """
    silent = []
    for name, entry in ENTRIES:
        if readings[name].complete:
            _, wrong = wrong_in(entry, readings[name])
            fields = [
                difference
                for difference in wrong
                if not difference.startswith(("unexpressed", "not understood"))
            ]
            silent += [f"{name}: {entry['say']!r}: {fields}"] if fields else []
    assert len(silent) <= 0.01 * len(ENTRIES), "\n".join(silent)


def test_every_text_has_a_document(readings: dict[str, BaseSimSpec]) -> None:
    """Whatever a text holds, there is a valid SimSpec, and every clause of it has a status."""
    assert all(reading.clauses for reading in readings.values())


def leaves(value: Any, where: str = "") -> Iterator[str]:
    if isinstance(value, dict) and value:
        for name, entry in value.items():
            yield from leaves(entry, f"{where}.{name}" if where else name)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for index, entry in enumerate(value):
            yield from leaves(entry, f"{where}[{entry.get('id', index)}]")
    else:
        yield where


@pytest.mark.parametrize(("name", "entry"), ENTRIES, ids=[name for name, _ in ENTRIES])
def test_every_field_has_a_receipt(
    name: str, entry: dict[str, Any], readings: dict[str, BaseSimSpec]
) -> None:
    """Valid by the schema; every field has a receipt, whose quote stands in the text; nothing is filled in
    silently.
    """
    result = readings[name]
    written = result.simspec.model_dump(mode="json")
    assert SimSpec.model_validate(written) == result.simspec
    assert [receipt.path for receipt in result.receipts] == list(leaves(written))
    defaults = SimSpec(name="prose", world={"area": written["world"]["area"]}).model_dump(mode="json")
    for receipt in result.receipts:
        if receipt.source == "prose":
            assert receipt.start is not None
            assert entry["say"][receipt.start : receipt.end] == receipt.quote != ""
        elif not receipt.note and "[" not in receipt.path:
            here: Any = defaults
            for part in receipt.path.split("."):
                here = here[part]
            assert here == receipt.value, receipt.path
