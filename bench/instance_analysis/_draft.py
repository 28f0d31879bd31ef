"""A base SimSpec under construction: fields with their source words, ranges, open questions, and text that
does not fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.documents import validate_document
from bench.errors import Fault
from bench.simspec import SimSpec

from ._result import Choice, Receipt, UnreadText, VariedField
from .language._tokens import Span

FieldPath = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class DraftField:
    """The value of a field and its origin. No span: a default of the vocabulary."""

    value: Any
    span: Span | None
    note: str = ""
    beside: Span | None = None
    """The phrase whose reading used a default."""


ChoiceKey = tuple[Span, str]
"""Where a choice stands, and what it asks."""


class Draft:
    """Collects fields, ranges, choices, and what the readers used of the text.

    `answers` holds the readings that a person chose, as indices from 0.
    """

    def __init__(self, text: str, answers: Mapping[ChoiceKey, int] | None = None) -> None:
        self.text = text
        self.answers = dict(answers or {})
        self.entries: dict[FieldPath, DraftField] = {}
        self.ranges: list[VariedField] = []
        self._choices: dict[ChoiceKey, Choice] = {}
        self.not_understood: list[UnreadText] = []
        self.remarks_by_place: dict[ChoiceKey, UnreadText] = {}
        """Passages that are read differently from how they are written."""
        self.faults: list[tuple[Span, Fault]] = []
        self.reading: Span | None = None
        """The phrase that is being read."""
        self.statements: list[tuple[FieldPath, Any, Span]] = []
        """Every field that a passage has set, also where another passage has set it since."""
        self.acknowledged: list[Span] = []
        """Passages that are read and need no field."""

    def quote(self, span: Span) -> str:
        return self.text[span.start : span.end]

    def fault(self, span: Span, what: str, remedy: str) -> None:
        """Record what cannot hold; the clause is then left out."""
        self.faults.append((span, Fault(f"{self.quote(span)[:80]!r}", what, remedy)))

    def remark(self, span: Span, why: str) -> None:
        """Record that a passage is read differently from how it is written."""
        self.remarks_by_place[span, why] = self._passage(span, why)

    @property
    def remarks(self) -> list[UnreadText]:
        return list(self.remarks_by_place.values())

    def describe(self) -> None:
        """Set the description: the whole text, which is no statement about any field."""
        self.entries["description",] = DraftField(self.text.strip(), Span(0, len(self.text)))

    def leave_out(self, span: Span, why: str) -> None:
        """List a passage that sets no field."""
        self.not_understood.append(self._passage(span, why))

    def acknowledge(self, span: Span) -> None:
        """Record that a passage is read, although it sets no field."""
        self.acknowledged.append(span)

    def _passage(self, span: Span, why: str) -> UnreadText:
        return UnreadText(quote=self.quote(span), start=span.start, end=span.end, why=why)

    def ask(self, span: Span, question: str, readings: Sequence[str]) -> int:
        """Index of the reading that a person chose, or else 0: the first one. Either way it is shown."""
        key = (span, question)
        chosen = self.answers.get(key, 0)
        self._choices[key] = Choice(
            quote=self.quote(span),
            start=span.start,
            end=span.end,
            ask=question,
            readings=tuple(readings),
            chosen=chosen + 1,
            answered=key in self.answers,
        )
        return chosen

    @property
    def choices(self) -> list[Choice]:
        """The choices in the order in which they arose."""
        return list(self._choices.values())

    def put(self, path: FieldPath, value: Any, span: Span | None, note: str = "") -> None:
        """Set a field. Two different statements about one field become a choice."""
        if span is not None:
            self.statements.append((path, value, span))
        previous = self.entries.get(path)
        if previous is not None and span is not None and self._holds_against(previous, path, value, span):
            return
        if span is not None or previous is None:
            self.entries[path] = DraftField(value, span, note, beside=self.reading)

    def _holds_against(self, previous: DraftField, path: FieldPath, value: Any, span: Span) -> bool:
        """Whether a field keeps its value although the text states another one; a default gives way without a question."""
        if previous.span is None or previous.value == value:
            return False
        readings = [f"{dotted(path)} = {stated}" for stated in (previous.value, value)]
        # Both are read: the choice shows them.
        self.acknowledged += [previous.span, span]
        conflict = f"{self.quote(previous.span)!r} and {self.quote(span)!r} say two things"
        if self.ask(previous.span.joined(span), f"{conflict}; which holds?", readings) == 0:
            return True
        # The range belonged to the reading that was not chosen.
        self.ranges = [varied for varied in self.ranges if dotted(path) not in varied.paths]
        return False

    def vary(
        self,
        path: FieldPath,
        low: float,
        high: float,
        span: Span | None,
        *,
        unit: str | None,
        integer: bool = False,
        note: str = "",
    ) -> None:
        """Set a field to a number or a range. The SimSpec itself holds the lower end of a range."""
        if span is not None:
            self._check_range(low, high, span, integer=integer)
        spanned = "" if low == high else f"{low:g} to {high:g}"
        self.put(path, int(low) if integer else float(low), span, ", ".join(filter(None, (note, spanned))))
        if low < high and self.entries[path].span == span:
            parts = [str(part) for part in path[-3:] if part not in ("actors", "placement")]
            name = "-".join(parts).replace("_", "-").lower()[:63]
            # A field has one range: the later statement about it holds.
            where = dotted(path)
            self.ranges = [varied for varied in self.ranges if where not in varied.paths]
            self.ranges.append(
                VariedField(name=name, paths=(where,), low=low, high=high, integer=integer, unit=unit)
            )

    def _check_range(self, low: float, high: float, span: Span, *, integer: bool) -> None:
        if low > high:
            self.fault(span, f"the range runs from {low:g} down to {high:g}", "write the lower number first")
        if integer and (low % 1 or high % 1):
            self.fault(span, "is counted in whole numbers", "write a whole number")

    def forget(self, path: FieldPath) -> None:
        """Remove a field, or all fields under a path, with their ranges."""
        removed = [entry_path for entry_path in self.entries if entry_path[: len(path)] == path]
        names = {dotted(entry_path) for entry_path in removed}
        for entry_path in removed:
            del self.entries[entry_path]
        self.ranges = [varied for varied in self.ranges if not names.intersection(varied.paths)]

    def document(self, changed: dict[FieldPath, Any] | None = None) -> dict[str, Any]:
        """Plain values of the SimSpec. Lists keep the order in which the text mentions their members."""
        root: dict[str, Any] = {}
        lists: dict[int, dict[str | int, dict[str, Any]]] = {}
        for path, value in (
            {path: entry.value for path, entry in self.entries.items()} | (changed or {})
        ).items():
            _set(root, path, value, lists)
        return root

    def checked(self) -> SimSpec:
        """The SimSpec, valid at both ends of every range. Raises SetupError with every fault."""
        paths = {dotted(path): path for path in self.entries}
        ends = {
            paths[where]: varied.high
            for varied in self.ranges
            if varied.high is not None
            for where in varied.paths
            if where in paths
        }
        # The document holds the lower ends. The upper ends are checked one at a time, so that a fault names
        # its field.
        simspec = validate_document(self.document(), SimSpec, source="")
        for path, high in ends.items():
            end = int(high) if isinstance(self.entries[path].value, int) else high
            validate_document(self.document({path: end}), SimSpec, source=f"{dotted(path)} at {high:g}")
        return simspec

    def receipts(self, simspec: SimSpec) -> Iterator[Receipt]:
        """A receipt for every field of the SimSpec that has a value: its words, or `default`."""
        by_path = {dotted(path): entry for path, entry in self.entries.items()}
        for where, value in _leaves(simspec.model_dump(mode="json"), ""):
            entry = next((by_path[prefix] for prefix in _prefixes(where) if prefix in by_path), None)
            if entry is None:
                yield Receipt(path=where, value=value, source="default")
                continue
            span = entry.span
            yield Receipt(
                path=where,
                value=value,
                source="prose" if span else "default",
                quote=self.quote(span) if span else "",
                start=span.start if span else None,
                end=span.end if span else None,
                note=entry.note,
            )


def dotted(path: FieldPath) -> str:
    """A path as campaigns write it, such as actors[radar].count: the part after a list's name is the member's
    id.
    """
    text, after_list = "", False
    for part in path:
        if after_list or isinstance(part, int):
            text += f"[{part}]"
            after_list = False
            continue
        text += f".{part}" if text else str(part)
        after_list = part in LISTS
    return text


LISTS = (
    "actors",
    "intelligence",
    "orders",
    "consents",
    "outages",
    "failures",
    "roads",
    "areas",
    "distances",
    "avoid",
    "no_fly",
    "report_windows",
)


def _set(
    root: dict[str, Any], path: FieldPath, value: Any, lists: dict[int, dict[str | int, dict[str, Any]]]
) -> None:
    here: Any = root
    index = 0
    while index < len(path) - 1:
        part = path[index]
        if part in LISTS:
            rows = here.setdefault(part, [])
            known = lists.setdefault(id(rows), {})
            key = path[index + 1]
            if key not in known:
                known[key] = {} if isinstance(key, int) else {"id": key}
                rows.append(known[key])
            here = known[key]
            index += 2
        else:
            here = here.setdefault(part, {})
            index += 1
    here[path[-1]] = value


def _leaves(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        for name, member in value.items():
            yield from _leaves(member, f"{where}.{name}" if where else name)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for index, member in enumerate(value):
            yield from _leaves(member, f"{where}[{member.get('id', index)}]")
    else:
        yield where, value


def _prefixes(where: str) -> Iterator[str]:
    yield where
    while where:
        cut = max(where.rfind("."), where.rfind("["))
        if cut < 0:
            return
        where = where[:cut]
        yield where
