"""A reading of prose, clause by clause, as lines for a terminal."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.instance_analysis import BaseSimSpec, Choice, ClauseReading, VariedField

STATUS_COLUMNS = 16
MIN_COLUMNS = 60
"""Narrower terminals wrap lines themselves."""
SHOWN_FIELDS = 6
_IDENTITY = (".asset", ".role")
"""Fields of a group that stand beside its `count` in the view."""


def clause_lines(result: BaseSimSpec, columns: int) -> Iterator[str]:
    """The text clause by clause, then the choices with the readings that --accept takes."""
    width = max(columns, MIN_COLUMNS)
    values = {receipt.path: receipt.value for receipt in result.receipts}
    shown_notes: set[str] = set()
    for clause in result.clauses:
        yield from _reading_lines(clause, values, width)
        # A passage that is left out may reach over several clauses; its reason is told once.
        new = [note for note in clause.notes if note not in shown_notes and "Read as: " not in note]
        shown_notes.update(new)
        yield from (line for note in dict.fromkeys(new) for line in _wrapped(f"! {note}", width))
    for number, choice in enumerate(result.choices, start=1):
        yield from _wrapped_choice(number, choice, width)
    if result.open_choices:
        yield "take other readings with --accept NUMBER, once for each choice in this order"
    if result.unchecked:
        yield "check: the clause is no sentence of the controlled language; compare sentence and values with its words (then --checked)"
    for varied in result.ranges:
        yield f"varies: {range_text(varied)}"
    counts = Counter(clause.status for clause in result.clauses)
    totals = ", ".join(f"{count} {status}" for status, count in counts.items())
    yield f"{len(result.clauses)} clauses: {totals}"


def _reading_lines(clause: ClauseReading, values: dict[str, Any], width: int) -> Iterator[str]:
    head = f"{clause.status:{STATUS_COLUMNS}}{_one_line(clause.quote)}"
    yield head if len(head) <= width else f"{head[: width - 3]}..."
    if clause.sentence:
        yield from _wrapped(f"-> {clause.sentence}", width)
    if summary := field_summary(clause, values):
        yield from _wrapped(f"= {summary}", width)


def field_summary(clause: ClauseReading, values: dict[str, Any]) -> str:
    """The fields that a clause sets, without those that only name a group.

    A clause to be checked that sets none says so: what it tells may be lost.
    """
    if clause.status == "check" and not clause.fields:
        return "nothing"
    changes = [
        path
        for path in clause.fields
        if not path.endswith(".id")
        and not (path.endswith(_IDENTITY) and f"{path.rpartition('.')[0]}.count" in clause.fields)
    ]
    parts = [
        f"{_short_path(path)} {_value(values, path)}{_identity(values, path)}"
        for path in changes[:SHOWN_FIELDS]
    ]
    more = [f"and {len(changes) - SHOWN_FIELDS} more"] if len(changes) > SHOWN_FIELDS else []
    return ", ".join([*parts, *more])


def _identity(values: dict[str, Any], path: str) -> str:
    """Asset and role of a group beside its count, since both may be read wrongly."""
    group, _, field = path.rpartition(".")
    if field != "count" or f"{group}.asset" not in values:
        return ""
    return f" {values[f'{group}.asset']} ({values[f'{group}.role']})"


def _short_path(path: str) -> str:
    return path.removeprefix("actors").replace(".placement.", ".").replace(".motion.", ".")


def _value(values: dict[str, Any], path: str) -> str:
    if path in values:
        value = values[path]
        return f"{value:g}" if isinstance(value, float) else str(value)
    # A list of corners or points has a receipt for each number.
    points = sum(name.startswith(f"{path}[") and name.endswith(".east_m") for name in values)
    return f"({points} points)" if points else ""


def _wrapped_choice(number: int, choice: Choice, width: int) -> Iterator[str]:
    quote = textwrap.shorten(_one_line(choice.quote), 60, placeholder="...")
    yield from _wrapped(f"choice {number}: {quote!r} {choice.ask}", width, indent=0)
    order = sorted(range(1, len(choice.readings) + 1), key=lambda reading: reading != choice.chosen)
    for reading in order:
        mark = "*" if reading == choice.chosen else " "
        yield f"  {mark} {reading}. {choice.readings[reading - 1]}"


def range_text(varied: VariedField) -> str:
    """A range as `path: 2 to 5 m`."""
    if varied.choices:
        return " or ".join(varied.choices)
    values = " or ".join(map(str, varied.levels)) if varied.levels else f"{varied.low:g} to {varied.high:g}"
    return f"{', '.join(varied.paths)}: {values}{f' {varied.unit}' if varied.unit else ''}"


def _wrapped(text: str, width: int, indent: int = STATUS_COLUMNS) -> list[str]:
    spaces = " " * indent
    return textwrap.wrap(text, width, initial_indent=spaces, subsequent_indent=f"{spaces}  ")


def _one_line(text: str) -> str:
    return " ".join(text.split())
