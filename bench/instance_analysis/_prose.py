"""Prose to base SimSpec by grammar and vocabulary alone: the same text always gives the same document."""

from __future__ import annotations

from collections.abc import Sequence

from bench.errors import Fault, SetupError
from bench.simspec import SimSpec

from ._draft import BaseSimSpec, Draft, raise_faults
from .language._phrases import phrases_of, with_quantities
from .language._tokens import Span, Word, words_of
from .language._vocabulary import Vocabulary
from .readers._reader import TextReader

MAX_CHARACTERS = 20_000


def read_prose(text: str, vocabulary: Vocabulary, answers: Sequence[int] = ()) -> BaseSimSpec:
    """Read a text into a base SimSpec with ranges and a receipt for every field.

    `answers` choose readings for the text's questions, in order, counted from 1. While a question is open the
    result has no SimSpec. Raises SetupError with every fault: ranges that run downwards, units that do not
    fit, a text in which nothing is a scenario, a text of more than 20,000 characters.
    """
    draft, corrected = draft_of(text, vocabulary, answers)
    return finished(draft, corrected)


def draft_of(text: str, vocabulary: Vocabulary, answers: Sequence[int] = ()) -> tuple[Draft, dict[str, str]]:
    """The draft of a text, and its corrected words.

    Raises as `read_prose` does, except for an invalid SimSpec.
    """
    if len(text) > MAX_CHARACTERS:
        raise SetupError(
            Fault(
                "prose", f"has {len(text)} characters, more than {MAX_CHARACTERS}", "describe one situation"
            )
        )
    draft = Draft(text, answers)
    words = words_of(text, vocabulary)
    unknown: list[tuple[Word, Word]] = []
    quantified = with_quantities(words, unknown)
    for number, word in unknown:
        span = Span(number.span.start, word.span.end)
        draft.fault(
            span,
            f"there is no unit {word.text!r}",
            "use metres, kilometres, feet, seconds, minutes, m/s, knots",
        )
    reader = TextReader(draft, vocabulary)
    reader.read(list(phrases_of(quantified)))
    if (
        not draft.entries.keys() - {("world", "area", "corners")}
        and not draft.faults
        and not draft.not_expressible
    ):
        raise SetupError(
            Fault(
                "prose",
                "it describes no scenario",
                "write who is where: 'a radar vehicle, five civilians within 50 m of it'",
            )
        )
    return draft, {word.span_text(text): word.mended for word in quantified if word.mended}


def finished(draft: Draft, corrected: dict[str, str]) -> BaseSimSpec:
    """The result of a draft."""
    raise_faults(draft.faults)
    name: tuple[str | int, ...] = ("name",)
    draft.put(name, "prose", None)
    draft.put(("description",), draft.text.strip(), Span(0, len(draft.text)))
    simspec: SimSpec | None = None if draft.questions else draft.checked()
    return BaseSimSpec(
        prose=draft.text,
        simspec=simspec,
        ranges=tuple(draft.ranges),
        receipts=tuple(draft.receipts(simspec)) if simspec else (),
        questions=tuple(draft.questions),
        not_expressible=tuple(draft.not_expressible),
        not_understood=tuple(draft.not_understood),
        remarks=tuple(draft.remarks),
        corrected=corrected,
    )
