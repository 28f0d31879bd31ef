"""MAVLink's enumerations: numbers by the specification's names, without the name of the enumeration."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from ._dialect import dialect


def _enumeration(name: str) -> Any:
    """One of pymavlink's, which is untyped: a misspelt entry is found where it is first used, and by the tests."""
    entries = {entry.name.removeprefix(f"{name}_"): number for number, entry in dialect.enums[name].items()}
    del entries["ENUM_END"]
    return IntEnum(name, entries)


GPS_FIX_TYPE = _enumeration("GPS_FIX_TYPE")
MAV_AUTOPILOT = _enumeration("MAV_AUTOPILOT")
MAV_CMD = _enumeration("MAV_CMD")
MAV_DATA_STREAM = _enumeration("MAV_DATA_STREAM")
MAV_FRAME = _enumeration("MAV_FRAME")
MAV_FTP_ERR = _enumeration("MAV_FTP_ERR")
MAV_FTP_OPCODE = _enumeration("MAV_FTP_OPCODE")
MAV_MODE_FLAG = _enumeration("MAV_MODE_FLAG")
MAV_MOUNT_MODE = _enumeration("MAV_MOUNT_MODE")
MAV_STATE = _enumeration("MAV_STATE")
MAV_TYPE = _enumeration("MAV_TYPE")
