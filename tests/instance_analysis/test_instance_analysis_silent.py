"""Texts in which the reader once was wrong in silence: what is not in the document must be visible in its clause."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose

VOCABULARY = load_vocabulary()
ENTRIES: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("silent.yaml").read_text())
QUIET = ("understood", "default", "check")


def is_marked(result: BaseSimSpec, words: str) -> bool:
    """Whether words stand in clauses that are all marked as a choice, or as not read in part or whole."""
    begin = result.prose.index(words)
    clauses = [item for item in result.clauses if item.start < begin + len(words) and begin < item.end]
    return bool(clauses) and all(clause.status not in QUIET for clause in clauses)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["say"][:40])
def test_what_is_not_read_is_visible(entry: dict[str, Any]) -> None:
    """`marked` words are told, `quiet` words are not, and the fields hold what the text says."""
    result = read_prose(entry["say"], VOCABULARY)
    values = {receipt.path: receipt.value for receipt in result.receipts}
    assert [words for words in entry.get("marked", ()) if not is_marked(result, words)] == []
    assert [words for words in entry.get("quiet", ()) if is_marked(result, words)] == []
    expected = entry.get("is", {})
    assert {path: values.get(path) for path in expected} == expected
