"""How the autopilots differ, where a word, a number or a text says it: `choices.csv`.

A row holds one field of a policy (by the name of its class) with the value of each autopilot and its meaning. An empty cell
is None, or no text; a text for clients begins with its severity.
"""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

from ..._read_table import read_table
from ..state._texts import SEVERITIES, FlightEvent, StatusText

_ROWS = read_table(Path(__file__).with_name("choices.csv"))


def choices(policy: type[Any], autopilot: str) -> dict[str, Any]:
    """What the table gives the fields of a policy, as their annotations have it."""
    hints = get_type_hints(policy)
    return {
        row["choice"]: _value(hints[row["choice"]], row[autopilot])
        for row in _ROWS
        if row["policy"] == policy.__name__
    }


def announcements(autopilot: str) -> dict[FlightEvent, StatusText]:
    """Texts for moments of the flight: `texts.csv`. The two of PX4 about low takeoffs are its source's, not observed."""
    rows = read_table(Path(__file__).with_name("texts.csv"))
    return {FlightEvent[row["event"]]: _status_text(row[autopilot]) for row in rows if row[autopilot]}


def _status_text(cell: str) -> StatusText:
    severity, _, text = cell.partition(" ")
    return SEVERITIES.index(severity), text


def _value(hint: Any, cell: str) -> Any:
    if NoneType in get_args(hint):
        (hint,) = (kind for kind in get_args(hint) if kind is not NoneType)
        if not cell:
            return None
    if hint == StatusText:
        return _status_text(cell)
    if hint is bool:
        return {"yes": True, "no": False}[cell]
    if hint is int:
        return int(cell, 0)
    if hint is float:
        return float(cell)
    return hint[cell] if isinstance(hint, type) and issubclass(hint, IntEnum) else cell
