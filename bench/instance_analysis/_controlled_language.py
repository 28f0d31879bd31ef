"""Which sentences of a text are sentences of the controlled language.

A sentence is one of them when its statements, phrases and words are of the same kinds, in the same order, as those of a
sentence in `controlled_sentences.txt`; numbers, names and directions may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import resources

from .language._phrases import Phrase
from .language._tokens import Word
from .ledger._clauses import is_stop

Shape = tuple[str, ...]
"""The kinds of the items of a sentence, without filler words."""


def controlled(items: Sequence[Phrase | Word]) -> list[bool]:
    """For each sentence of a text, in order, whether it is one of the controlled language.

    Sentences are numbered as `Clause.sentence` numbers them: each full stop ends one, also an empty one.
    """
    return [shape in controlled_shapes() for shape in shapes_of(items)]


@cache
def controlled_shapes() -> frozenset[Shape]:
    """The shapes that the file of sentences states."""
    lines = (
        resources.files("bench.instance_analysis.language")
        .joinpath("controlled_sentences.txt")
        .read_text("utf-8")
    )
    stated = [line.rpartition(" = ")[2] for line in lines.splitlines() if not line.startswith("#")]
    return frozenset(tuple(shape.split(" ")) for shapes in stated for shape in shapes.split("; "))


def shapes_of(items: Sequence[Phrase | Word]) -> list[Shape]:
    """The shape of each sentence, with that after the last full stop."""
    shapes: list[list[str]] = [[]]
    for item in items:
        if is_stop(item):
            shapes.append([])
        else:
            shapes[-1] += _kinds(item)
    return [tuple(shape) for shape in shapes]


def _kinds(item: Phrase | Word) -> list[str]:
    if isinstance(item, Phrase):
        return [item.rule]
    if item.filler:
        return []
    # An unknown word is its own kind, so that no sentence with one is controlled.
    return ["|".join(sorted({meaning.kind for meaning in item.meanings})) or f"unknown:{item.text}"]
