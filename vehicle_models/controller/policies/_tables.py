"""Commands and mission items of the autopilots: `commands.csv`, a row for each that one of them knows.

- `px4_result`, `ardupilot_result`: what a command without an effect is answered with (MAV_RESULT), or silence; a
  service that carries a command out comes first
- `px4_item`: how an item is taken: with a place, placeless, or either
- `ardupilot_item`: its name in the text that is sent as the item begins; an item without one is not taken
- `ardupilot_place`: x, y and z are a place, or x and y are other numbers, in a MISSION_ITEM as well; AP_Mission keeps
  no place of other items, and checks none (source)
- `ardupilot_keeps`: the parameters that AP_Mission's store has room for, where it has not for all; the others come back
  as 0
- `ardupilot_nan`: the parameters that may be NaN; no other may, and none may be infinite
- `ardupilot_turn`: skipped, where AP_Mission takes the item and ArduCopter does not know it when its turn comes

Messages of the autopilots: `messages.csv`, in the order in which a step sends those that are due.

Recordings hold them in this order, so rows do not move; those that nothing here fills stand last. The cells of an
autopilot:

- `px4`: stream, request (on request alone), or silent; `px4_onboard_hz` and `px4_gcs_hz` are the rates of its links
- `ardupilot`: its group of streams (MAV_DATA_STREAM), request, or silent

A silent message is a stream of the real autopilot that nothing here fills: an interval is accepted, nothing is sent.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..._read_table import read_table
from ..state._service import CommandResult

_COMMANDS = {int(row["number"]): row for row in read_table(Path(__file__).with_name("commands.csv"))}

COMMAND_NAMES: Mapping[int, str] = {number: row["command"] for number, row in _COMMANDS.items()}
"""Names as in MAV_CMD."""


def commands_with(column: str, *cells: str) -> frozenset[int]:
    """Commands that have one of these cells in a column."""
    return frozenset(number for number, row in _COMMANDS.items() if row[column] in cells)


def cells_by_command(column: str) -> dict[int, str]:
    """What stands in a column, where something does."""
    return {number: row[column] for number, row in _COMMANDS.items() if row[column]}


def parameter_indices(column: str) -> dict[int, tuple[int, ...]]:
    """Numbers of parameters, counted from 0, of the commands that name some or `none`."""
    return {
        number: tuple(int(digit) - 1 for digit in cell.split() if digit != "none")
        for number, cell in cells_by_command(column).items()
    }


def fixed_results(column: str) -> dict[int, CommandResult | None]:
    """Results of commands that have no effect; None: no answer."""
    return {
        number: None if cell == "silence" else CommandResult[cell]
        for number, cell in cells_by_command(column).items()
    }


_MESSAGES = read_table(Path(__file__).with_name("messages.csv"))

SENDING_ORDER = tuple(row["message"] for row in _MESSAGES)


def messages_with(column: str, *cells: str) -> frozenset[str]:
    """Messages that have one of these cells in a column."""
    return frozenset(row["message"] for row in _MESSAGES if row[column] in cells)


def rates_hz(column: str) -> dict[str, float]:
    """Rates by message, of those that have one."""
    return {row["message"]: float(row[column]) for row in _MESSAGES if row[column]}
