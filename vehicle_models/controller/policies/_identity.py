"""What an autopilot is, and the texts that it sends without being asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto

from ..files._metadata import Metadata
from ..files._served_files import FileContent
from ..links._enums import MAV_TYPE
from ..state._flight_state import FlightState
from ..state._parameter_store import ParameterStore
from ..state._texts import EventName, FlightEvent, StatusText

Seconds = float


@dataclass(frozen=True, slots=True)
class BootText:
    """A text that is sent while the autopilot starts, at a running time."""

    at_s: Seconds
    severity: int
    text: str


class CalibrationProtocol(Enum):
    """How a client follows a calibration of sensors."""

    TEXTS = auto()
    """PX4: texts that begin with [cal]."""
    MESSAGES = auto()
    """ArduPilot: MAG_CAL_PROGRESS, ACCELCAL_VEHICLE_POS and acknowledgements."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentityPolicy:
    """Version, texts, events and files of an autopilot.

    `texts` gives the text of an event; an event that is missing there has none. `event_names` are PX4's
    machine-readable events; an autopilot without them leaves it empty.
    """

    name: str
    autopilot: int
    """MAV_AUTOPILOT."""
    vehicle_type: int = MAV_TYPE.QUADROTOR
    """MAV_TYPE."""
    capabilities: int
    flight_sw_version: int
    flight_custom_version: bytes
    board_version: int
    uid: int
    uid2: bytes = b""
    protocol_versions: tuple[int, int, int] | None = None
    """Version in use, lowest and highest; None for an autopilot without PROTOCOL_VERSION."""
    texts: Mapping[FlightEvent, StatusText]
    text_ending: str
    """Put behind every text: PX4 ends a text that is an event as well with a tab."""
    texts_for_stations_s: float | None
    texts_follow_answers: bool
    boot_texts: Callable[[FlightState], Sequence[BootText]] = lambda flight: ()
    climbed_clear_texts: tuple[StatusText, ...] = ()
    """Sent when the vehicle has risen clear of the ground."""
    ground_contact_text: StatusText | None
    event_names: tuple[EventName, ...] = ()
    metadata: Metadata | None = None
    files: Callable[[ParameterStore], Mapping[str, FileContent]] = lambda parameters: {}
    """What MAVLink FTP serves beside the metadata."""
    folders: tuple[str, ...] = ()
    """Empty folders that MAVLink FTP lists from the start."""
    memory_card: str
    has_shell: bool
    reports_flight: bool
    calibration: CalibrationProtocol = CalibrationProtocol.TEXTS
    file_sessions: int
    files_writable: bool
