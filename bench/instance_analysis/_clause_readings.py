"""What became of each clause of a text: its status, the fields that it sets, and what is not read in it."""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from ._draft import Draft, dotted
from ._result import Choice, ClauseReading, ClauseStatus, UnreadText
from .language._phrases import Phrase
from .language._tokens import Span
from .ledger._clauses import Clause

_Passage = Span | UnreadText | Choice
"""What has a place in the text, from `start` to `end`."""


@dataclass(slots=True)
class _Account:
    """What the reading holds about one clause."""

    fields: list[str] = field(default_factory=list)
    defaults: list[str] = field(default_factory=list)
    unread: list[UnreadText] = field(default_factory=list)
    choices: list[Choice] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    read: list[Span] = field(default_factory=list)


def clause_readings(
    draft: Draft, clauses: Sequence[Clause], controlled: Sequence[bool]
) -> Iterator[ClauseReading]:
    """The account of each clause, in the order of the text.

    `controlled` says for each sentence, by its number, whether it is one of the controlled language.
    """
    for clause, account in zip(clauses, _accounts(draft, clauses), strict=True):
        notes = [f"{_short(item.quote)!r}: {item.why}" for item in account.unread]
        notes += [f"{choice.ask} Read as: {choice.readings[choice.chosen - 1]}" for choice in account.choices]
        yield ClauseReading(
            quote=draft.quote(clause.span),
            start=clause.span.start,
            end=clause.span.end,
            status=_status(clause, account, controlled=controlled[clause.sentence]),
            fields=tuple(account.fields),
            notes=tuple(dict.fromkeys([*notes, *account.remarks, *account.defaults])),
        )


def _status(clause: Clause, account: _Account, *, controlled: bool) -> ClauseStatus:
    if account.unread:
        return "in part" if account.fields else "not understood"
    if any(not choice.answered for choice in account.choices):
        return "choice"
    # Words that set nothing and are not listed describe nothing, as `good morning`; a phrase says something.
    says_nothing = not any(isinstance(item, Phrase) for item in clause.items)
    told = account.fields or account.read or account.defaults or account.remarks
    if not told:
        return "understood" if says_nothing else "not understood"
    if not controlled:
        return "check"
    return "default" if account.defaults or account.remarks else "understood"


def _accounts(draft: Draft, clauses: Sequence[Clause]) -> list[_Account]:
    """What the reading holds, divided among the clauses that it touches."""
    accounts = [_Account() for _ in clauses]
    starts, ends = [clause.span.start for clause in clauses], [clause.span.end for clause in clauses]
    for passage, part, item in _passages(draft):
        first, last = bisect.bisect_right(ends, passage.start), bisect.bisect_left(starts, passage.end)
        for account in accounts[first:last]:
            getattr(account, part).append(item)
    return accounts


def _passages(draft: Draft) -> Iterator[tuple[_Passage, str, object]]:
    """Every passage that the reading holds something about, the part of an account that it is for, and the entry."""
    for path, entry in draft.entries.items():
        if entry.span is not None and path != ("description",):
            yield entry.span, "fields", dotted(path)
        elif entry.span is None and entry.note and entry.beside is not None:
            yield entry.beside, "defaults", f"{dotted(path)} = {entry.value}: {entry.note}"
    yield from ((item, "unread", item) for item in (*draft.not_understood, *draft.not_expressible))
    yield from ((choice, "choices", choice) for choice in draft.choices)
    yield from ((remark, "remarks", remark.why) for remark in draft.remarks)
    yield from ((span, "read", span) for span in (*draft.acknowledged, *draft.references))


def _short(quote: str) -> str:
    quote = " ".join(quote.split())
    return quote if len(quote) <= 60 else f"{quote[:57]}..."
