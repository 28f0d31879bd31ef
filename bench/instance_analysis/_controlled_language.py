"""Which sentences of a text are sentences of the controlled language.

A sentence is one of them when its statements, phrases and words are of the same kinds, in the same order, as those of a
sentence in `controlled_sentences.txt`; numbers, names and directions may differ. Nothing in it may be misspelt, and
words that the readers pass over are only those that pass for nothing there too: `hostile` or `new` may change a sense.
A sentence before one that takes something back (`No, sorry, 120 ft`) is none of them either.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

from .language._phrases import Phrase
from .language._tokens import Word
from .language._vocabulary import EventForm, RuleForm
from .ledger._clauses import is_stop

_RETRACTIONS = frozenset(
    [
        "sorry",
        "correction",
        "corrected",
        "correcting",
        "scratch",
        "actually",
        "instead",
        "rather",
        "oops",
        "wait",
    ]
)
"""Words that may take back what was said just before them, also in the sentence before."""

Shape = tuple[str, ...]
"""The kinds of the items of a sentence, without filler words."""


@dataclass(frozen=True, slots=True)
class ControlledLanguage:
    """What the sentences of the file consist of."""

    shapes: frozenset[Shape]
    fillers: frozenset[str]
    """The words in them that say nothing, in lower case."""


def controlled(items: Sequence[Phrase | Word], words: Sequence[Word]) -> list[bool]:
    """For each sentence of a text, in order, whether it is one of the controlled language.

    Sentences are numbered as `Clause.sentence` numbers them: each full stop ends one, also an empty one.
    """
    language = controlled_language()
    stops = [item.span.end for item in items if is_stop(item)]
    unusual = {
        bisect.bisect_right(stops, word.span.start)
        for word in words
        if word.mended or (word.filler and word.text.lower() not in language.fillers)
    }
    for word in words:
        if word.text.lower() in _RETRACTIONS:
            number = bisect.bisect_right(stops, word.span.start)
            unusual |= {number - 1, number}
    return [
        shape in language.shapes and number not in unusual for number, shape in enumerate(shapes_of(items))
    ]


@cache
def controlled_language() -> ControlledLanguage:
    """The shapes and fillers that the file states beside its sentences."""
    path = resources.files("bench.instance_analysis.language").joinpath("controlled_sentences.txt")
    lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
    fillers, stated = lines[0], [line.rpartition(" = ")[2] for line in lines[1:]]
    return ControlledLanguage(
        frozenset(tuple(shape.split(" ")) for shapes in stated for shape in shapes.split("; ")),
        frozenset(fillers.removeprefix("fillers: ").split(", ")),
    )


def shapes_of(items: Sequence[Phrase | Word]) -> list[Shape]:
    """The shape of each sentence, with that after the last full stop."""
    shapes: list[list[str]] = [[]]
    for item in items:
        if is_stop(item):
            shapes.append([])
        else:
            shapes[-1] += _kinds(item)
    return [tuple(shape) for shape in shapes]


def _form_name(form: RuleForm | EventForm) -> str:
    if isinstance(form, EventForm):
        return form.kind
    return form.window or "+".join(name.rpartition(".")[2] for name in form.sets)


def _kinds(item: Phrase | Word) -> list[str]:
    if isinstance(item, Phrase):
        # Rules and events are read in any wording, so their kind says what they set.
        forms = [part.value for part in item.leaves if isinstance(part.value, RuleForm | EventForm)]
        return [":".join([item.rule, *map(_form_name, forms)])]
    if item.filler:
        return []
    # An unknown word is its own kind, so that no sentence with one is controlled.
    return ["|".join(sorted({meaning.kind for meaning in item.meanings})) or f"unknown:{item.text}"]
