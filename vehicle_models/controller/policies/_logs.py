"""What an autopilot logs, in which format, and how it hands its logs out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..state._flight_state import FlightState
from ..state._log_records import LogEncoder, LogOpening
from ..state._parameter_store import ParameterStore
from ..state._texts import StatusText


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockLogPolicy:
    """Logs that a client receives in REMOTE_LOG_DATA_BLOCK while they are recorded."""

    enabled: Callable[[ParameterStore], bool]
    """Whether a client may have one."""
    records: Callable[[FlightState, ParameterStore], bool]
    """Whether what happens at present is part of it."""
    buffer_kib: Callable[[ParameterStore], int]
    """Memory for blocks that wait for acknowledgements."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogPolicy:
    """Flight logs of an autopilot."""

    encoder: Callable[[LogOpening], LogEncoder]
    path: Callable[[int, LogOpening, int], str]
    """Where MAVLink FTP has a log, given its number, its beginning, and how many others began in the same second
    before.
    """
    first_number: int
    records: Callable[[FlightState, ParameterStore, bool], bool]
    """Whether something is recorded at present; the last argument is whether the vehicle has been armed since the
    autopilot started.
    """
    new_for_each_flight: Callable[[ParameterStore], bool]
    """Whether a log ends when recording does; else the next flight continues it."""
    new_after_erase: bool
    armed_text: StatusText | None
    busy_text: StatusText | None
    needs_list: bool
    blocks: BlockLogPolicy | None = None
    streams: Callable[[ParameterStore], bool] | None = None
    """Whether a log can be streamed at present; None for an autopilot without LOGGING_START."""
