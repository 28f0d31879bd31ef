"""Tables of parameters: a CSV file for each autopilot, with a row for one parameter or for several equal
ones.
"""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from ._store import INT8, INT16, INT32, REAL32, Parameter

KINDS_BY_NAME = {"float": REAL32, "int8": INT8, "int16": INT16, "int32": INT32}
_SPAN = re.compile(r"\{([^{}]*)\}")


def read_parameters(
    table: Path, extra: Iterable[Parameter] = (), by_name: bool = False
) -> tuple[Parameter, ...]:
    """The parameters of a table, in its order or by name, and those of `more` that it lacks.

    `{0-3}` in a name stands for each number, `{a|b}` for each text; `{}` in the default for the same one. The
    columns are name, type (float, int8, int16, int32), default, min, max, unit, group, flags (reboot,
    volatile), description.
    """
    with table.open(newline="", encoding="ascii") as file:
        parameters_by_name = {
            parameter.name: parameter for row in csv.DictReader(file) for parameter in _of_row(row)
        }
    for parameter in extra:
        parameters_by_name.setdefault(parameter.name, parameter)
    parameters = parameters_by_name.values()
    return tuple(sorted(parameters, key=lambda parameter: parameter.name) if by_name else parameters)


def _of_row(row: dict[str, str]) -> Iterator[Parameter]:
    pieces = _SPAN.split(row["name"])
    for chosen in itertools.product(*(_choices(span) for span in pieces[1::2])):
        name = "".join(
            itertools.chain.from_iterable(itertools.zip_longest(pieces[0::2], chosen, fillvalue=""))
        )
        yield Parameter(
            name,
            float(row["default"].replace("{}", chosen[0] if chosen else "")),
            KINDS_BY_NAME[row["type"]],
            low=float(row["min"]) if row["min"] else None,
            high=float(row["max"]) if row["max"] else None,
            unit=row["unit"],
            group=row["group"],
            description=row["description"],
            volatile="volatile" in row["flags"],
            needs_reboot="reboot" in row["flags"],
        )


def _choices(span: str) -> list[str]:
    first, dash, last = span.partition("-")
    if dash and first.isdigit() and last.isdigit():
        return [str(number) for number in range(int(first), int(last) + 1)]
    return span.split("|")
