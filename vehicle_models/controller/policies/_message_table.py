"""Messages of the autopilots: `messages.csv`, in the order in which a step sends those that are due.

Recordings hold them in this order, so rows do not move; those that nothing here fills stand last. The cells of an
autopilot:

- `px4`: stream, request (on request alone), or silent; `px4_onboard_hz` and `px4_gcs_hz` are the rates of its links
- `ardupilot`: its group of streams (MAV_DATA_STREAM), request, or silent

A silent message is a stream of the real autopilot that nothing here fills: an interval is accepted, nothing is sent.
"""

from __future__ import annotations

from pathlib import Path

from ..._read_table import read_table

_ROWS = read_table(Path(__file__).with_name("messages.csv"))

SENDING_ORDER = tuple(row["message"] for row in _ROWS)


def messages_with(column: str, *cells: str) -> frozenset[str]:
    """Messages that have one of these cells in a column."""
    return frozenset(row["message"] for row in _ROWS if row[column] in cells)


def rates_hz(column: str) -> dict[str, float]:
    """Rates by message, of those that have one."""
    return {row["message"]: float(row[column]) for row in _ROWS if row[column]}
