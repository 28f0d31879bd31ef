"""Descriptions as users write them, with the documents that a person expects of each."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from expected_documents import Fields, expected_fields

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose
from bench.simspec import SimSpec

CORPUS = Path(__file__).parent / "corpus"
VOCABULARY = load_vocabulary()
SILENT: Fields = SimSpec(name="prose", world={"area": {"corners": [{"east_m": 0, "north_m": 0}, {"east_m": 9, "north_m": 0}, {"east_m": 0, "north_m": 9}]}}).model_dump(mode="json")  # type: ignore[arg-type]  # fmt: skip
ENTRIES = [(f"{file.stem}-{number}", one) for file in sorted(CORPUS.glob("*.yaml")) for number, one in enumerate(yaml.safe_load(file.read_text()), start=1)]  # fmt: skip


def found_fields(found: BaseSimSpec) -> Fields:
    """What the result says beyond a SimSpec's defaults: fields with a receipt of their own, and ranges."""
    assert found.simspec is not None
    spoken = {
        one.path: one.value
        for one in found.receipts
        if one.source != "default" or one.note or one.path.startswith("world.roads[")
    }
    spoken = {path: value for path, value in spoken.items() if path != "description" and value is not None}
    silent = {path: value for path, value in spoken.items() if path.endswith((".tolerance", ".within_deg", ".height_m"))}
    ranges = {f"~{path}": [one.low, one.high] for one in found.ranges if one.low is not None for path in one.paths}
    ranges |= {f"~{path}": list(one.levels) for one in found.ranges if one.levels for path in one.paths if "_level" in path}
    return {path: value for path, value in spoken.items() if path not in silent} | ranges


DEFAULTS: Fields = {
    "actors[].concealment": 0.0,
    "actors[].motion.kind": "still",
    "intelligence[].priority": 1,
    "intelligence[].latency_s": 0.0,
    "actors[].placement.distances[].whom": "every",
    "rules.no_mark_within_m": 50.0,
}


def is_default(path: str, value: Any) -> bool:
    """Whether a field has the value that a SimSpec gives it by itself: said or not, the document is the same."""
    plain = re.sub(r"\[[^]]*\]", "[]", path)
    if plain in DEFAULTS:
        return same(DEFAULTS[plain], value)
    here: Any = SILENT
    for part in path.split("."):
        if not isinstance(here, dict) or part not in here:
            return False
        here = here[part]
    return same(here, value)


def by_time(fields: Fields) -> Fields:
    """Orders named by their turn: which id one has is nobody's expectation."""
    at = {path.split("]")[0]: value for path, value in fields.items() if path.startswith("orders[") and path.endswith(".at_s")}
    turns = {one: f"orders[{turn}" for turn, one in enumerate(sorted(at, key=lambda one: float(at[one])))}
    renamed = {}
    for path, value in fields.items():
        head, bracket, rest = path.partition("]")
        if head in turns and rest == ".id":
            continue
        renamed[turns.get(head, head) + bracket + rest] = value
    return renamed


def same(a: Any, b: Any) -> bool:
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float) and not isinstance(a, bool):
        return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-3)
    return bool(a == b)


def wrong_in(entry: dict[str, Any]) -> tuple[int, list[str]]:
    """Number of fields compared, and what is wrong in each that is."""
    found = read_prose(entry["say"], VOCABULARY, entry.get("accept", ()))
    compared, wrong = 0, list[str]()
    for name, here in (("asks", len(found.questions)), ("unexpressed", len(found.not_expressible))):
        if name == "asks" or name in entry:
            compared += 1
            if here != entry.get(name, 0):
                wrong.append(
                    f"{name} {here}, expected {entry.get(name, 0)}: {[one.quote for one in found.not_expressible]} {[one.ask for one in found.questions]}"
                )
    compared += 1
    unread = bool(found.not_understood or (entry.get("listed") and found.not_expressible))
    if unread != bool(entry.get("unread") or entry.get("listed")):
        wrong.append(f"not understood: {[one.quote for one in found.not_understood]}")
    if found.questions and not entry.get("asks"):  # a document that is not there has none of its fields
        missing = expected_fields(entry["is"])
        return compared + len(missing), [*wrong, *(f"{path}: not there, a question is open" for path in missing)]
    if not entry.get("asks") and not found.questions:
        expected, here_is = by_time(expected_fields(entry["is"])), by_time(found_fields(found))
        others = [expected_fields({name: one}) for name, several in entry.get("also", {}).items() for one in several]
        for path in sorted(expected.keys() | here_is.keys()):
            only = expected.get(path, here_is.get(path))
            if (path in expected) != (path in here_is) and is_default(path, only):
                continue
            compared += 1
            right = [expected.get(path), *(other.get(path) for other in others if path in other)]
            if not any(same(one, here_is.get(path)) for one in right):
                wrong.append(f"{path}: {here_is.get(path)}, expected {expected.get(path)}")
    return compared, wrong


def test_the_corpus_is_large_enough() -> None:
    """At least 200 descriptions in several registers."""
    assert len(ENTRIES) >= 200
    assert len({name.rpartition("-")[0] for name, _ in ENTRIES}) >= 5


def test_at_least_95_percent_of_fields_are_exact(capsys: pytest.CaptureFixture[str]) -> None:
    """Every field that a person expects and every field that is there is compared; questions count as one each."""
    compared = 0
    missed: list[str] = []
    for name, entry in ENTRIES:
        number, wrong = wrong_in(entry)
        compared += number
        missed += [f"{name}: {entry['say']!r}: {one}" for one in wrong]
    share = 1.0 - len(missed) / compared
    with capsys.disabled():
        print(f"\n{len(ENTRIES)} descriptions, {compared} fields, {share:.2%} exact")
    assert share >= 0.95, "\n".join(missed)


def leaves(value: Any, where: str = "") -> Iterator[str]:
    if isinstance(value, dict) and value:
        for name, one in value.items():
            yield from leaves(one, f"{where}.{name}" if where else name)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for index, one in enumerate(value):
            yield from leaves(one, f"{where}[{one.get('id', index)}]")
    else:
        yield where


@pytest.mark.parametrize("entry", [entry for _, entry in ENTRIES], ids=[name for name, _ in ENTRIES])
def test_every_field_has_a_receipt(entry: dict[str, Any]) -> None:
    """Valid by the schema; every field has a receipt, whose quote stands in the text; nothing is filled in silently."""
    found = read_prose(entry["say"], VOCABULARY, entry.get("accept", ()))
    if found.simspec is None:
        assert found.questions
        return
    written = found.simspec.model_dump(mode="json")
    assert SimSpec.model_validate(written) == found.simspec
    assert [one.path for one in found.receipts] == list(leaves(written))
    defaults = SimSpec(name="prose", world={"area": written["world"]["area"]}).model_dump(mode="json")  # type: ignore[arg-type]
    for one in found.receipts:
        if one.source == "prose":
            assert one.start is not None
            assert entry["say"][one.start : one.end] == one.quote != ""
        elif not one.note and "[" not in one.path:
            here: Any = defaults
            for part in one.path.split("."):
                here = here[part]
            assert here == one.value, one.path
