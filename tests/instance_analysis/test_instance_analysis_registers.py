"""Sixty descriptions in six registers: which share of their facts the documents hold, with recorded answers of a model and without."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from judged_facts import facts_of, holds, is_understood

from bench.instance_analysis import BaseSimSpec, Rewrite, load_vocabulary, page, read_prose, rewrite_prose
from bench.instance_analysis.rewriting._model import BRIEF, MAX_ROUNDS, Conversation, Judge

VOCABULARY = load_vocabulary()
FOLDER = Path(__file__).parent / "registers"
Row = Sequence[Any]
"""A pair of an answer: quote or quotes, sentence (or none, and why), and what it is taken to mean."""


def loaded(name: str) -> Any:
    return yaml.safe_load((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))


TEXTS: dict[str, list[dict[str, Any]]] = {name: loaded(name) for name in ("first", "second")}
ROUNDS: dict[str, list[dict[str, list[Row]]]] = {
    "first": [loaded("first_answers")],
    "second": [loaded("second_answers"), *loaded("second_again").values()],
}


def rewrite_of(rows: Sequence[Row]) -> Rewrite:
    names = ("quotes", "sentence", "taken_to_mean")
    pairs = [
        {"quotes": [quote], "cannot_say": rest[1]}
        if rest[0] is None
        else dict(zip(names, ([quote], *rest), strict=False))
        for quote, *rest in rows
    ]
    return Rewrite.model_validate({"pairs": pairs})


@dataclass
class Cassette:
    """A model whose answers are recorded: after the first one, the pairs that it wrote anew."""

    text: str
    rounds: Sequence[Sequence[Row]]
    model: str = "recorded"
    provider: str = "cassette"

    def ask(self, brief: str, question: str, judge: Judge) -> Conversation:
        # The page word for word, and the text alone.
        assert (brief, question) == (BRIEF + page(fields=False), self.text)
        for number, rewrite in enumerate(self._rewrites(), start=1):
            if not judge(rewrite) or number == MAX_ROUNDS:
                return Conversation(number)
        return Conversation(len(self.rounds))

    def _rewrites(self) -> Iterator[Rewrite]:
        rows: list[Row] = []
        for anew in self.rounds:
            kept = [row for row in rows if not any(self._overlap(row, other) for other in anew)]
            rows = sorted([*kept, *anew], key=self._place)
            yield rewrite_of(rows)

    def _place(self, row: Row) -> tuple[int, int]:
        plain, quote = (" ".join(words.split()) for words in (self.text, row[0]))
        assert quote in plain, quote
        return plain.index(quote), plain.index(quote) + len(quote)

    def _overlap(self, row: Row, other: Row) -> bool:
        (begin, end), (other_begin, other_end) = self._place(row), self._place(other)
        return begin < other_end and other_begin < end


@cache
def answered(name: str, number: int, rounds: int) -> BaseSimSpec:
    entry = TEXTS[name][number]
    answers = [answer[entry["id"]] for answer in ROUNDS[name][:rounds] if entry["id"] in answer]
    return rewrite_prose(entry["text"], VOCABULARY, Cassette(entry["text"], answers)).result


def counted(name: str, rounds: int, every: int = 1) -> Counter[str]:
    """Facts in all, those with a field, those that the documents hold, and those that are missing in silence."""
    counts: Counter[str] = Counter()
    for number in range(0, len(TEXTS[name]), every):
        entry = TEXTS[name][number]
        result = answered(name, number, rounds) if rounds else read_prose(entry["text"], VOCABULARY)
        counts["all"] += len(entry["facts"])
        for fact in facts_of(entry):
            counts["field"] += 1
            counts["held"] += holds(result, fact)
            counts["silent"] += not holds(result, fact) and is_understood(result, fact["words"])
    return counts


@pytest.mark.parametrize(
    ("name", "rounds"),
    [
        ("first", 0),
        ("second", 0),
        *(
            pytest.param(name, rounds, marks=pytest.mark.slow)
            for name, rounds in (("first", 1), ("second", 1), ("second", MAX_ROUNDS))
        ),
    ],
)
def test_the_share_of_facts_is_that_of_the_documentation(name: str, rounds: int) -> None:
    """Measured, not promised: docs/prose.md states it. No fact is wrong or missing unmarked."""
    counts = counted(name, rounds)
    assert counts["silent"] == 0
    docs = (Path(__file__).parents[2] / "docs" / "prose.md").read_text(encoding="utf-8")
    row = next(line for line in docs.splitlines() if line.startswith(f"| {name} half"))
    shown = row.split("|")[2:][{0: 0, 1: 1, MAX_ROUNDS: 2}[rounds]]
    assert f"{counts['held']} of {counts['field']} ({counts['all']})" == shown.strip()


def test_most_facts_of_a_sample_are_held_and_none_is_missing_in_silence() -> None:
    """One text of each register, with all answers: the short form of the shares above."""
    counts = counted("second", MAX_ROUNDS, every=5)
    assert counts["silent"] == 0
    assert counts["held"] > 0.75 * counts["field"] > 40


def test_what_a_rewrite_tells_is_never_understood() -> None:
    """It is checked, chosen, or listed."""
    for number in range(0, len(TEXTS["second"]), 5):
        for clause in answered("second", number, MAX_ROUNDS).clauses:
            assert not (clause.sentence and clause.status == "understood")


def test_six_registers_have_ten_texts_each() -> None:
    registers = Counter(entry["register"] for entries in TEXTS.values() for entry in entries)
    assert set(registers.values()) == {10}
    assert len(registers) == 6
