"""ArduCopter's flight logs: DataFlash files, by the parameters LOG_*."""

from __future__ import annotations

import functools

from ..logs._dataflash import DataflashEncoder
from ..policies._choices import choices
from ..policies._logs import BlockLogPolicy, LogPolicy
from ..state._flight_state import FlightState
from ..state._log_records import LogOpening
from ..state._parameter_store import ParameterStore
from ._commands import BANNER

# LOG_BACKEND_TYPE
_FILE, _MAVLINK = 1, 2


def _path(number: int, opening: LogOpening, namesakes: int) -> str:
    return f"logs/{number:08}.BIN"


def _records(flight: FlightState, parameters: ParameterStore, flown: bool) -> bool:
    return bool(int(parameters["LOG_BACKEND_TYPE"]) & _FILE) and _logs_now(flight, parameters)


def _logs_now(flight: FlightState, parameters: ParameterStore) -> bool:
    return flight.armed or parameters["LOG_DISARMED"] == 1


def _sends_blocks(parameters: ParameterStore) -> bool:
    return bool(int(parameters["LOG_BACKEND_TYPE"]) & _MAVLINK)


# By ArduPilot's source, where nothing was observed.
LOGS = LogPolicy(
    **choices(LogPolicy, "ardupilot"),
    encoder=functools.partial(DataflashEncoder, BANNER),
    path=_path,
    records=_records,
    new_for_each_flight=lambda parameters: parameters["LOG_FILE_DSRMROT"] != 0,
    blocks=BlockLogPolicy(
        enabled=_sends_blocks,
        records=_logs_now,
        buffer_kib=lambda parameters: int(parameters["LOG_MAV_BUFSIZE"]),
    ),
)
