"""Tables of parameters: a CSV file for each autopilot, one row for each parameter, in the order of its list."""

from __future__ import annotations

import csv
from pathlib import Path

from ._parameter_store import INT8, INT16, INT32, REAL32, Parameter

KINDS_BY_NAME = {"float": REAL32, "int8": INT8, "int16": INT16, "int32": INT32}


def read_parameters(table: Path) -> tuple[Parameter, ...]:
    """The parameters of a table, in its order.

    The columns are name, type (float, int8, int16, int32), default, min, max, unit, group, flags (reboot,
    volatile), description. All but the first three may be empty.
    """
    with table.open(newline="", encoding="ascii") as file:
        return tuple(_parameter(row) for row in csv.DictReader(file))


def _parameter(row: dict[str, str]) -> Parameter:
    return Parameter(
        row["name"],
        float(row["default"]),
        KINDS_BY_NAME[row["type"]],
        low=float(row["min"]) if row["min"] else None,
        high=float(row["max"]) if row["max"] else None,
        unit=row["unit"],
        group=row["group"],
        description=row["description"],
        volatile="volatile" in row["flags"],
        needs_reboot="reboot" in row["flags"],
    )
