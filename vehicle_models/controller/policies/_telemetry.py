"""What an autopilot streams, how it handles requests for messages, and what its messages report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from ..state._flight_state import FlightState, GpsQuality
from ..state._service import CommandResult
from ..state._texts import StatusText


@dataclass(frozen=True, slots=True)
class SensorBits:
    """present, enabled, health of SYS_STATUS."""

    present: int
    enabled: int
    health: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryPolicy:
    """Streams and contents of an autopilot's messages."""

    messages: frozenset[str]
    """Everything that may be streamed or requested."""
    stream_sets: Mapping[str, Mapping[str, float]]
    """Rates in Hz by message, by name of the set that a link asks for."""
    stream_groups: Mapping[int, frozenset[str]] = field(default_factory=dict)
    """Messages by MAV_DATA_STREAM; empty: REQUEST_DATA_STREAM has no effect."""
    stream_parameters: Mapping[str, int] = field(default_factory=dict)
    """Group by ending of its rate's parameter: SR0_ and the ending for the first link, SR1_ for the second."""

    max_rates_hz: Mapping[str, float] = field(default_factory=dict)
    """The rate that a message's stream never exceeds."""
    gimbal_rates_hz: Mapping[str, float] = field(default_factory=dict)
    """Rates of the gimbal's messages on a vehicle that has one."""
    waits_for_client: bool
    silent_messages: frozenset[str] = frozenset()
    """Streams that the real autopilot has and that nothing here fills: an interval is accepted, nothing is sent."""
    promised_messages: frozenset[int] = frozenset()
    """Ids of messages whose request is accepted but which never come."""
    unknown_interval: CommandResult
    unknown_interval_text: StatusText | None
    unknown_get_interval: CommandResult
    unknown_request: CommandResult
    min_interval_us: int
    answers_after_acknowledgement: bool
    load_permille: int
    battery_type: int
    vtol_state: int
    gps_quality: GpsQuality
    lost_fix_type: int
    """GPS_RAW_INT.fix_type without fixes."""
    sensors: Callable[[FlightState], SensorBits]
    estimator_flags: Callable[[FlightState], int] = lambda flight: 0
    """EKF_STATUS_REPORT.flags."""
    knows_local_position: Callable[[FlightState], bool] = lambda flight: flight.home is not None
    """Whether LOCAL_POSITION_NED is sent."""
    airspeed_mps: Callable[[FlightState], float] = lambda flight: 0.0
    """VFR_HUD.airspeed; a multicopter has no sensor for it, and the true one would tell agents the wind."""
    wind: Callable[[FlightState], tuple[float, float, float] | None] = lambda flight: None
    """WIND: degrees that it comes from, speed, speed downwards, all estimated; None without an estimate."""
