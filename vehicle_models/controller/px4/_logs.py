"""PX4's flight logs: ULog files, by the parameters SDLOG_*."""

from __future__ import annotations

import functools
from datetime import UTC, datetime

from ..logs._ulog import UlogEncoder, UlogIdentity
from ..policies._choices import choices
from ..policies._logs import LogPolicy
from ..state._flight_state import FlightState
from ..state._log_records import LogOpening
from ..state._parameter_store import ParameterStore
from ._identity import IDENTITY
from ._modes import MODES, NAV_STATES

# SDLOG_BACKEND
_FILE, _MAVLINK = 1, 2
# SDLOG_MODE
_BOOT_UNTIL_DISARM, _BOOT_UNTIL_SHUTDOWN = 1, 2

_ULOG = UlogIdentity(
    system="PX4",
    hardware="PX4_SITL",
    release=IDENTITY.flight_sw_version,
    git_hash=IDENTITY.flight_custom_version.hex(),
    system_uuid=f"{IDENTITY.uid:016x}",
    nav_states={mode.custom: NAV_STATES[mode.name] for mode in MODES.modes},
    thresholds=("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"),
)


def _path(number: int, opening: LogOpening, namesakes: int) -> str:
    """A folder for the day and a file for the time of the beginning, which PX4 shifts by SDLOG_UTC_OFFSET minutes.

    Of several logs of one second each later one gets a number, where PX4 would write over the first.
    """
    shift_min = dict(zip((p.name for p in opening.parameters), opening.values, strict=True))[
        "SDLOG_UTC_OFFSET"
    ]
    started = datetime.fromtimestamp((opening.boot_utc_us + opening.time_us) * 1e-6 + shift_min * 60.0, UTC)
    suffix = f"_{namesakes}" if namesakes else ""
    return started.strftime(f"log/%Y-%m-%d/%H_%M_%S{suffix}.ulg")


def _records(flight: FlightState, parameters: ParameterStore, flown: bool) -> bool:
    """With SDLOG_MODE 1, as the SITL has it, the first log begins with the start and ends with the first flight."""
    if not int(parameters["SDLOG_BACKEND"]) & _FILE:
        return False
    mode = parameters["SDLOG_MODE"]
    return flight.armed or mode == _BOOT_UNTIL_SHUTDOWN or (mode == _BOOT_UNTIL_DISARM and not flown)


def _streams(parameters: ParameterStore) -> bool:
    return bool(int(parameters["SDLOG_BACKEND"]) & _MAVLINK)


LOGS = LogPolicy(
    **choices(LogPolicy, "px4"),
    encoder=functools.partial(UlogEncoder, _ULOG),
    path=_path,
    records=_records,
    new_for_each_flight=lambda parameters: True,
    streams=_streams,
)
