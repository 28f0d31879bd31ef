"""Prose to base SimSpec by grammar and vocabulary alone: the same text always gives the same document.

A text is read as often as it takes until the ledger and the SimSpec's own checks find nothing more to leave
out. So a fault in one clause costs that clause and what depends on it, and never the document.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.errors import Fault, SetupError

from ._clause_readings import clause_readings
from ._controlled_language import controlled
from ._draft import ChoiceKey, Draft, dotted
from ._items import items_of
from ._result import BaseSimSpec, Choice
from .language._corrections import with_corrections
from .language._phrases import Phrase, with_quantities
from .language._tokens import Span, Word, headings_of, words_of
from .language._vocabulary import Vocabulary
from .ledger._clauses import Clause, clauses_of, is_stop
from .ledger._ledger import CLAIMING_RULES, UNUSED_WORD, Ledger, LedgerEntry, marked
from .ledger._loaded_words import hostile_words, loaded_words
from .readers._reader import TextReader

MAX_CHARACTERS = 20_000
MAX_SINGLE_CUTS = 40
"""Clauses that are left out one by one for a fault of the SimSpec; after these, all that set anything. Chosen."""


def read_prose(text: str, vocabulary: Vocabulary, answers: Sequence[int] = ()) -> BaseSimSpec:
    """Read a text into a base SimSpec with ranges, choices, and a receipt for every field.

    There is always a document: what is uncertain is a choice, what cannot hold is left out, and both are
    listed. `answers` take readings of the choices, in their order, counted from 1. Raises SetupError for a
    text without a word or of more than 20,000 characters, and for an answer that is no reading.
    """
    return Reading(text, vocabulary, answers).result()


_FIELD = re.compile(r"[a-z_0-9]+(?:(?:\.[a-z_0-9]+|\[[^]]*\])*(?:\.[a-z_0-9]+|\[[^]]*\]))")
"""A field as a fault names it: `rules.max_altitude_m`, `actors[truck].count`."""


@dataclass(frozen=True, slots=True)
class Cut:
    """A passage that sets no field, and why."""

    span: Span
    why: str


class Reading:
    """A text as grammar and vocabulary read it, with what had to be left out."""

    def __init__(self, text: str, vocabulary: Vocabulary, answers: Sequence[int] = ()) -> None:
        _check_length(text)
        self.text, self.vocabulary = text, vocabulary
        words = words_of(text, vocabulary)
        self.unknown_units: list[tuple[Word, Word]] = []
        self.words, self._corrections = with_corrections(with_quantities(words, self.unknown_units), text)
        self.items = items_of(self.words, text, vocabulary)
        claiming = [item for item in self.items if isinstance(item, Phrase) and item.rule in CLAIMING_RULES]
        claimed = marked(len(text), [part.span for phrase in claiming for part in phrase.leaves])
        # `rotor 3 quits`: what a statement has claimed is no unit.
        self.unknown_units = [pair for pair in self.unknown_units if not claimed[pair[1].span.start]]
        self.clauses: list[Clause] = clauses_of(text, self.items)
        self._headings = headings_of(text)
        self._ledger = Ledger(text, [*loaded_words(text), *hostile_words(text)], self.clauses)
        self.cuts: list[Cut] = []
        self._entries: list[LedgerEntry] = []
        self.draft = self._answered(answers)

    @property
    def corrected(self) -> dict[str, str]:
        """Misspelt words, and what each was read as."""
        return {word.span_text(self.text): word.mended for word in self.words if word.mended}

    def result(self) -> BaseSimSpec:
        """The finished document."""
        draft = self.draft
        simspec = draft.checked()
        return BaseSimSpec(
            prose=self.text,
            simspec=simspec,
            ranges=tuple(draft.ranges),
            receipts=tuple(draft.receipts(simspec)),
            choices=tuple(draft.choices),
            clauses=tuple(clause_readings(draft, self.clauses, controlled(self.items, self.words))),
            not_expressible=tuple(draft.not_expressible),
            not_understood=tuple(sorted(draft.not_understood, key=lambda item: item.start)),
            remarks=tuple(draft.remarks),
            corrected=self.corrected,
        )

    def read_characters(self) -> bytearray:
        """For each character of the text, whether a reader has used it for a field of the document."""
        return self._ledger.read_characters(self.draft)

    def _answered(self, answers: Sequence[int]) -> Draft:
        """Read with the answers of a person. An answer may raise further choices, which the next one takes."""
        taken: dict[ChoiceKey, int] = {}
        draft = self._settled(taken)
        for number, answer in enumerate(answers, start=1):
            choice = next((choice for choice in draft.choices if not choice.answered), None)
            if choice is None:
                raise SetupError(Fault("--accept", f"there is no choice {number}", "leave it out"))
            if not 1 <= answer <= len(choice.readings):
                raise SetupError(
                    Fault(
                        "--accept",
                        f"choice {number}, {choice.quote[:80]!r}, has {len(choice.readings)} readings, and no {answer}.",
                        "take one of them",
                    )
                )
            taken[_key(choice)] = answer - 1
            draft = self._settled(taken)
        return draft

    def _settled(self, answers: Mapping[ChoiceKey, int]) -> Draft:
        """The reading in which nothing has to be left out any more, with the choices of the ledger."""
        self.cuts, self._entries = self._cuts_of_units(), []
        while True:
            draft = self._read(answers)
            standing = self._ledger.audit(draft, [cut.span for cut in self.cuts])
            # The readings are numbered: the one that holds without an answer is the first.
            out = [
                entry
                for entry in standing
                if entry.left_out == (answers.get((entry.span, entry.ask), 0) == 0)
            ]
            faults = self._faults_of(draft)
            # What hangs on a condition goes with a fault in the condition.
            out = [entry for entry in out if entry.conditional or not faults]
            cuts = [*faults, *(Cut(entry.span, entry.ask) for entry in out)] or self._invalid(draft)
            if not cuts:
                break
            self.cuts += cuts
            self._entries += out
        for entry in sorted([*self._entries, *standing], key=lambda entry: entry.span.start):
            draft.ask(entry.span, entry.ask, entry.readings)
        for span in list(self._ledger.unused(draft, self.words, self.vocabulary.unused)):
            draft.leave_out(span, UNUSED_WORD)
        return draft

    def _cuts_of_units(self) -> list[Cut]:
        return [
            Cut(
                self._grown(number.span.joined(word.span)),
                f"there is no unit {word.text!r}: use m, km, ft, s, min, m/s, knots",
            )
            for number, word in self.unknown_units
        ]

    def _read(self, answers: Mapping[ChoiceKey, int]) -> Draft:
        for item in self.items:
            for part in item.leaves if isinstance(item, Phrase) else ():
                part.disown()
        draft = Draft(self.text, answers)
        draft.used_words += [*self._headings, *self._corrections]
        for span in self._corrections:
            draft.remark(span, "read as the number that holds, in the place of the one before it")
        self._gone = marked(len(self.text), [cut.span for cut in self.cuts])
        reader = TextReader(draft, self.vocabulary, [cut.span for cut in self.cuts])
        reader.read([item for item in self.items if is_stop(item) or not self._is_cut(item.span)])
        draft.put(("name",), "prose", None)
        draft.describe()
        for cut in self.cuts:
            draft.leave_out(cut.span, cut.why)
        return draft

    def _is_cut(self, span: Span) -> bool:
        return any(self._gone[span.start : span.end])

    def _faults_of(self, draft: Draft) -> list[Cut]:
        """The clauses of statements that cannot hold, as a range that runs downwards."""
        return [Cut(self._grown(span), f"{fault.what} ({fault.remedy})") for span, fault in draft.faults]

    def _grown(self, span: Span) -> Span:
        """A span, and the clauses that it touches: what stands beside a fault has lost its subject."""
        for clause in self.clauses:
            if clause.span.start < span.end and span.start < clause.span.end:
                span = span.joined(clause.span)
        return span

    def _invalid(self, draft: Draft) -> list[Cut]:
        """The clause that makes the SimSpec invalid; nothing when it is valid."""
        try:
            draft.checked()
        except SetupError as error:
            fault = error.faults[0]
            candidates = self._clauses_that_set(draft, f"{fault.where} {fault.what}")
            if not candidates:
                raise
            if len(self.cuts) > MAX_SINGLE_CUTS:
                return [Cut(clause.span, str(fault)) for clause in self._clauses_that_set(draft, "")]
            why = "; ".join(map(str, error.faults))
            return [Cut(clause.span, why) for clause in [candidates[0], *self._twins(candidates[0])]]
        return []

    def _twins(self, clause: Clause) -> list[Clause]:
        """The other clauses with the same words: what is wrong in one is wrong in all."""
        words = self.text[clause.span.start : clause.span.end]
        return [
            other
            for other in self.clauses
            if other is not clause
            and self.text[other.span.start : other.span.end] == words
            and not self._is_cut(other.span)
        ]

    def _clauses_that_set(self, draft: Draft, where: str) -> list[Clause]:
        """The clauses that set fields; first those of the fields that a fault names, from the last to the first."""
        names = [name for name in (where.split(" ")[0], *_FIELD.findall(where)) if name]
        # A list is named by numbers there and by ids here.
        blamed = _spans_of(draft, names) or _spans_of(
            draft, [re.sub(r"\[\d+\].*", "", name) for name in names]
        )
        setting = [
            clause
            for clause in reversed(self.clauses)
            if not all(self._gone[clause.span.start : clause.span.end])
            and any(
                span.start < clause.span.end and clause.span.start < span.end
                for path, _, span in draft.statements
                if path != ("description",)
            )
        ]
        return sorted(
            setting,
            key=lambda clause: (
                not any(
                    span is not None and span.start < clause.span.end and clause.span.start < span.end
                    for span in blamed
                )
            ),
        )


def _spans_of(draft: Draft, names: Sequence[str]) -> list[Span | None]:
    """Where the text states fields, the parts of them, or what they are parts of."""
    return [
        entry.span or entry.beside
        for path, entry in draft.entries.items()
        if any(dotted(path).startswith(name) or name.startswith(dotted(path)) for name in names)
    ]


def _key(choice: Choice) -> ChoiceKey:
    return Span(choice.start, choice.end), choice.ask


def _check_length(text: str) -> None:
    if len(text) > MAX_CHARACTERS:
        raise SetupError(
            Fault(
                "prose", f"has {len(text)} characters, more than {MAX_CHARACTERS}", "describe one situation"
            )
        )
    if not any(character.isalnum() for character in text):
        raise SetupError(
            Fault(
                "prose",
                "it is empty",
                "write who is where: 'a radar vehicle, five civilians within 50 m of it'",
            )
        )
