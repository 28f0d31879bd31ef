"""ArduCopter's flight logs: DataFlash files, by the parameters LOG_*."""

from __future__ import annotations

import functools

from .._flight_state import FlightState
from ..logs._dataflash import DataflashEncoder
from ..logs._records import LogOpening
from ..parameters._store import ParameterStore
from ..policies._logs import LogPolicy
from ..telemetry._texts import ERROR, INFO
from ._commands import BANNER

# LOG_BACKEND_TYPE
_FILE = 1


def _path(number: int, opening: LogOpening, namesakes: int) -> str:
    return f"logs/{number:08}.BIN"


def _records(flight: FlightState, parameters: ParameterStore, flown: bool) -> bool:
    if not int(parameters["LOG_BACKEND_TYPE"]) & _FILE:
        return False
    return flight.armed or parameters["LOG_DISARMED"] == 1


# By ArduPilot's source, where nothing was observed.
LOGS = LogPolicy(
    encoder=functools.partial(DataflashEncoder, BANNER),
    path=_path,
    first_number=1,
    records=_records,
    new_for_each_flight=lambda parameters: parameters["LOG_FILE_DSRMROT"] != 0,
    new_after_erase=True,
    armed_text=(ERROR, "Disarm for log download"),
    busy_text=(INFO, "Log download in progress"),
    needs_list=False,
)
