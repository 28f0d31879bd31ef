"""Facts that people judged in 30 descriptions in nine registers: none is wrong unmarked, and true rewrites hold them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from judged_facts import can_be_judged, holds, is_understood

from bench.instance_analysis import BaseSimSpec, Rewrite, load_vocabulary, read_prose
from bench.instance_analysis.rewriting._rewrite import RewriteJudge

VOCABULARY = load_vocabulary()
FOLDER = Path(__file__).parent


def loaded(name: str) -> Any:
    return yaml.safe_load((FOLDER / name).read_text(encoding="utf-8"))


NINTH: dict[str, dict[str, Any]] = {entry["id"]: entry for entry in loaded("judged/ninth.yaml")}


def counted(results: Mapping[str, BaseSimSpec]) -> Counter[str]:
    """How many facts are judged, held, and neither held nor marked in any way."""
    counts: Counter[str] = Counter()
    for name, result in results.items():
        for fact in filter(can_be_judged, NINTH[name]["facts"]):
            counts["all"] += 1
            counts["held"] += holds(result, fact)
            counts["silent"] += not holds(result, fact) and is_understood(result, fact["words"])
    return counts


def test_no_fact_is_wrong_or_missing_unmarked() -> None:
    """What a clause that is `understood` says stands in the document."""
    assert (
        counted({name: read_prose(entry["text"], VOCABULARY) for name, entry in NINTH.items()})["silent"] == 0
    )


def test_rewrites_that_are_right_pass_and_hold_their_facts() -> None:
    """Eight texts in as many registers: nothing of them is refused, and the documents hold what the page can say."""
    results = {}
    for name, pairs in loaded("rewrites.yaml").items():
        text, rewrite = NINTH[name]["text"], Rewrite.model_validate({"pairs": pairs})
        assert RewriteJudge(text, VOCABULARY).judge(rewrite).faults == []
        results[name] = read_prose(text, VOCABULARY, rewrite=rewrite)
        assert all(clause.status != "understood" or not clause.sentence for clause in results[name].clauses)
    counts = counted(results)
    assert counts["silent"] == 0
    assert counts["held"] >= 0.85 * counts["all"], counts
