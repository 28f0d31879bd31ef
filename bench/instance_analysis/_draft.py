"""A base SimSpec under construction: fields with their source words, ranges, open questions, and text that
does not fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from bench.documents import Document, validate_document
from bench.errors import Fault, SetupError
from bench.simspec import SimSpec

from .language._tokens import Span

FieldPath = tuple[str | int, ...]


class VariedField(Document):
    """A field with a range (`low`, `high`) or several values (`levels`), or fields that change together
    (`choices`).
    """

    name: str
    paths: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    integer: bool = False
    levels: tuple[float | str, ...] = ()
    choices: dict[str, dict[str, float]] = {}
    unit: Annotated[str | None, Field(description="None where the field's name states none.")] = None


class Receipt(Document):
    """Where one field's value comes from: characters `start` to `end` of the prose, or a default."""

    path: str
    value: Any
    source: Literal["prose", "default", "answer", "model"]
    quote: str = ""
    start: int | None = None
    end: int | None = None
    note: str = ""


class Question(Document):
    """A passage with several readings; `--accept K` takes the K-th reading, counted from 1."""

    quote: str
    start: int
    end: int
    ask: str
    readings: tuple[str, ...]


class UnreadText(Document):
    """A passage of the prose that is not in the SimSpec, and the reason."""

    quote: str
    start: int
    end: int
    why: str


class BaseSimSpec(Document):
    """The result for a text: a base SimSpec, its ranges, the source of every field, and the passages that
    were not used.
    """

    format: Literal["rebar.prose/1"] = "rebar.prose/1"
    prose: str
    simspec: Annotated[SimSpec | None, Field(description="None while questions are open.")] = None
    ranges: tuple[VariedField, ...] = ()
    receipts: tuple[Receipt, ...] = ()
    questions: Annotated[tuple[Question, ...], Field(description="Open ones.")] = ()
    not_expressible: tuple[UnreadText, ...] = ()
    not_understood: tuple[UnreadText, ...] = ()
    remarks: Annotated[
        tuple[UnreadText, ...], Field(description="What is read otherwise than it is written, and why.")
    ] = ()
    corrected: Annotated[
        dict[str, str], Field(description="Words taken for another that they are a letter or two off.")
    ] = {}


@dataclass(frozen=True, slots=True)
class DraftField:
    """The value of a field and its origin. No span: a default of the vocabulary."""

    value: Any
    span: Span | None
    note: str = ""
    answered: bool = False
    model: bool = False


class Draft:
    """Collects fields, ranges and questions.

    `answers` holds the readings chosen in advance, in order, counted from 1.
    """

    def __init__(self, text: str, answers: Sequence[int]) -> None:
        self.text = text
        self.answers = list(answers)
        self.entries: dict[FieldPath, DraftField] = {}
        self.ranges: list[VariedField] = []
        self.questions: list[Question] = []
        self.not_expressible: list[UnreadText] = []
        self.not_understood: list[UnreadText] = []
        self.remarks: list[UnreadText] = []
        self.faults: list[Fault] = []
        self._question_count = 0

    def quote(self, span: Span) -> str:
        return self.text[span.start : span.end]

    def fault(self, span: Span, what: str, remedy: str) -> None:
        self.faults.append(
            Fault(f"characters {span.start} to {span.end}", f"{self.quote(span)[:80]!r}: {what}", remedy)
        )

    def unread(self, span: Span, why: str, *, expressible: bool = False) -> None:
        (self.not_understood if expressible else self.not_expressible).append(
            UnreadText(quote=self.quote(span), start=span.start, end=span.end, why=why)
        )

    def remark(self, span: Span, why: str) -> None:
        """Record that a passage is read differently from how it is written."""
        remark = UnreadText(quote=self.quote(span), start=span.start, end=span.end, why=why)
        if remark not in self.remarks:
            self.remarks.append(remark)

    def ask(self, span: Span, question: str, readings: Sequence[str]) -> int:
        """Index of the reading chosen in advance.

        Without an answer the question stays open and the first reading is used.
        """
        self._question_count += 1
        if self._question_count <= len(self.answers):
            # Answers are matched by order, because the same text always asks the same questions in the same
            # order.
            chosen = self.answers[self._question_count - 1]
            if 1 <= chosen <= len(readings):
                return chosen - 1
            self.fault(
                span,
                f"question {self._question_count} has {len(readings)} readings, and not a {chosen}.",
                "accept one of them",
            )
        self.questions.append(
            Question(
                quote=self.quote(span), start=span.start, end=span.end, ask=question, readings=tuple(readings)
            )
        )
        return 0

    def put(self, path: FieldPath, value: Any, span: Span | None, note: str = "") -> None:
        """Set a field. Two different statements about one field become a question."""
        previous = self.entries.get(path)
        # Only two statements of the text can contradict each other: a default gives way without a question.
        if (
            previous is not None
            and previous.span is not None
            and span is not None
            and previous.value != value
        ):
            readings = [f"{dotted(path)} = {varied}" for varied in (previous.value, value)]
            conflict = f"{self.quote(previous.span)!r} and {self.quote(span)!r} say two things"
            if self.ask(previous.span.joined(span), f"{conflict}; which holds?", readings) == 0:
                return
            # The range belonged to the reading that was not chosen.
            self.ranges = [varied for varied in self.ranges if dotted(path) not in varied.paths]
        if span is not None or previous is None:
            self.entries[path] = DraftField(value, span, note)

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
        if low > high and span is not None:
            self.fault(span, f"the range runs from {low:g} down to {high:g}", "write the lower number first")
        clean = (lambda varied: int(varied)) if integer else float
        if integer and (low != int(low) or high != int(high)) and span is not None:
            self.fault(span, "is counted in whole numbers", "write a whole number")
        spanned = "" if low == high else f"{low:g} to {high:g}"
        self.put(path, clean(low), span, ", ".join(filter(None, (note, spanned))))
        if low < high and self.entries[path].span == span:
            name = (
                "-".join(str(varied) for varied in path[-3:] if varied not in ("actors", "placement"))
                .replace("_", "-")
                .lower()
            )
            # A field has one range: the later statement about it holds.
            where = dotted(path)
            self.ranges = [varied for varied in self.ranges if where not in varied.paths]
            self.ranges.append(
                VariedField(name=name[:63], paths=(where,), low=low, high=high, integer=integer, unit=unit)
            )

    def forget(self, path: FieldPath) -> None:
        """Remove a field, or all fields under a path, with their ranges."""
        removed = [entry_path for entry_path in self.entries if entry_path[: len(path)] == path]
        names = {dotted(entry_path) for entry_path in removed}
        for entry_path in removed:
            del self.entries[entry_path]
        self.ranges = [entry_path for entry_path in self.ranges if not names.intersection(entry_path.paths)]

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
            paths[field_path]: varied.high
            for varied in self.ranges
            if varied.high is not None
            for field_path in varied.paths
            if field_path in paths
        }
        whole = {
            path: int(high) if isinstance(self.entries[path].value, int) else high
            for path, high in ends.items()
            if high
        }
        # The document holds the lower ends. The upper ends are checked one at a time, so that a fault names
        # its
        # field.
        simspec = validate_document(self.document(), SimSpec, source="prose")
        for path, high in whole.items():
            validate_document(
                self.document({path: high}), SimSpec, source=f"prose, {dotted(path)} at {high:g}"
            )
        return simspec

    def receipts(self, simspec: SimSpec) -> Iterator[Receipt]:
        """A receipt for every field of the SimSpec that has a value: its words, or `default`."""
        by_path = {dotted(path): entry for path, entry in self.entries.items()}
        for where, value in _leaves(simspec.model_dump(mode="json"), ""):
            entry = next((by_path[prefix] for prefix in _prefixes(where) if prefix in by_path), None)
            if entry is None:
                yield Receipt(path=where, value=value, source="default")
            elif entry.model or entry.span is None:
                source: Literal["model", "default"] = "model" if entry.model else "default"
                span = entry.span
                quote = self.quote(span) if span else ""
                at = (span.start, span.end) if span else (None, None)
                yield Receipt(
                    path=where,
                    value=value,
                    source=source,
                    quote=quote,
                    start=at[0],
                    end=at[1],
                    note=entry.note,
                )
            else:
                quote, start, end = self.quote(entry.span), entry.span.start, entry.span.end
                yield Receipt(
                    path=where,
                    value=value,
                    source="prose",
                    quote=quote,
                    start=start,
                    end=end,
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


def raise_faults(faults: Sequence[Fault]) -> None:
    """Raise SetupError when there are faults."""
    if faults:
        raise SetupError(list(faults))
