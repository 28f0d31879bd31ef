"""Texts in which the reader once was wrong in silence: what is not in the document must be visible in its clause."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose

VOCABULARY = load_vocabulary()
ENTRIES: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("silent.yaml").read_text())
QUIET = ("understood", "default")


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
