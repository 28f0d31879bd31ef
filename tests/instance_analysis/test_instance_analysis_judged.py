"""Facts that people judged in 30 descriptions in nine registers: none is wrong unmarked, and true rewrites hold them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from judged_facts import can_be_judged, holds, is_understood

from bench.instance_analysis import Rewrite, load_vocabulary, read_prose
from bench.instance_analysis.rewriting._rewrite import RewriteJudge

VOCABULARY = load_vocabulary()
JUDGED = sorted((Path(__file__).parent / "judged").glob("*.yaml"))
DESCRIPTIONS: list[dict[str, Any]] = [
    entry for path in JUDGED for entry in yaml.safe_load(path.read_text("utf-8"))
]


@pytest.fixture(scope="module")
def verdicts() -> Counter[str]:
    """How many facts are held, and how many are neither held nor marked in any way."""
    counts: Counter[str] = Counter()
    for entry in DESCRIPTIONS:
        result = read_prose(entry["text"], VOCABULARY)
        for fact in filter(can_be_judged, entry["facts"]):
            counts["all"] += 1
            counts["held"] += holds(result, fact)
            counts["silent"] += not holds(result, fact) and is_understood(result, fact["words"])
    return counts


def test_no_fact_is_wrong_or_missing_unmarked(verdicts: Counter[str]) -> None:
    """What a clause that is `understood` says stands in the document."""
    assert verdicts["silent"] == 0


REWRITES: dict[str, list[dict[str, Any]]] = yaml.safe_load(
    Path(__file__).with_name("rewrites.yaml").read_text("utf-8")
)
NINTH = {entry["id"]: entry for entry in yaml.safe_load((JUDGED[-1]).read_text("utf-8"))}


def test_rewrites_that_are_right_pass_and_hold_their_facts() -> None:
    """Eight texts in as many registers: nothing of them is refused, and the documents hold what the page can say."""
    counts: Counter[str] = Counter()
    for name, pairs in REWRITES.items():
        entry, rewrite = NINTH[name], Rewrite.model_validate({"pairs": pairs})
        assert RewriteJudge(entry["text"], VOCABULARY).judge(rewrite).faults == []
        result = read_prose(entry["text"], VOCABULARY, rewrite=rewrite)
        assert all(clause.status != "understood" or not clause.sentence for clause in result.clauses)
        for fact in filter(can_be_judged, entry["facts"]):
            counts["all"] += 1
            counts["held"] += holds(result, fact)
            counts["silent"] += not holds(result, fact) and is_understood(result, fact["words"])
    assert counts["silent"] == 0
    assert counts["held"] >= 0.85 * counts["all"], counts
