"""ArduCopter's streams, and what its messages report."""

from __future__ import annotations

import math

from ..links._enums import GPS_FIX_TYPE, MAV_DATA_STREAM
from ..links._frames import KINDS
from ..policies._choices import choices
from ..policies._tables import messages_with
from ..policies._telemetry import SensorBits, TelemetryPolicy
from ..state._flight_state import Behaviour, FlightState, GpsQuality
from ._modes import AHRS_S, ESTIMATOR_S, RECEIVER_S, STANDBY_S, USES_GPS_S, ready, steers_position

# ArduCopter 4.6 streams these (source) for devices and procedures that do not exist here. It accepts intervals for them,
# and requests: the messages never come.
_SILENT = messages_with("ardupilot", "silent")
_GROUPS = {int(group): messages_with("ardupilot", group.name) for group in MAV_DATA_STREAM if group.value}
_RATE_PARAMETERS = {
    "RAW_SENS": MAV_DATA_STREAM.RAW_SENSORS,
    "EXT_STAT": MAV_DATA_STREAM.EXTENDED_STATUS,
    "RC_CHAN": MAV_DATA_STREAM.RC_CHANNELS,
    "POSITION": MAV_DATA_STREAM.POSITION,
    "EXTRA1": MAV_DATA_STREAM.EXTRA1,
    "EXTRA2": MAV_DATA_STREAM.EXTRA2,
    "EXTRA3": MAV_DATA_STREAM.EXTRA3,
}

# present, enabled and health of SYS_STATUS as they went by while the SITL started, without its bit of logging.
_BEFORE_STANDBY = SensorBits(0x5231FC0F, 0x52019C0F, 0x44119C0B)
_BEFORE_RECEIVER = SensorBits(0x5271FC0F, 0x52419C0F, 0x46519C0F)
_BEFORE_AHRS = SensorBits(0x5271FC2F, 0x52419C2F, 0x46519C2F)
_AHRS, _PREARM, _POSITION_CONTROL = 0x200000, 0x10000000, 0x6000

# EKF_STATUS_FLAGS
_UNINITIALISED, _CONSTANT_POSITION, _ALL = 1024, 167, 831


def _sensors(flight: FlightState) -> SensorBits:
    now_s = flight.time_s
    if now_s < RECEIVER_S:
        return _BEFORE_STANDBY if now_s < STANDBY_S else _BEFORE_RECEIVER
    bits = _BEFORE_AHRS
    enabled, health = bits.enabled, bits.health
    if now_s >= AHRS_S:
        enabled, health = enabled | _AHRS, health | _AHRS
    # A return steers position too, though the heartbeat shows that only while it is flown.
    if steers_position(flight) or flight.mode.behaviour is Behaviour.RETURN:
        enabled, health = enabled | _POSITION_CONTROL, health | _POSITION_CONTROL
    return SensorBits(bits.present, enabled, health | (_PREARM if flight.armed or ready(flight) else 0))


def _estimator_flags(flight: FlightState) -> int:
    if flight.time_s < ESTIMATOR_S:
        return _UNINITIALISED
    return _CONSTANT_POSITION if flight.time_s < USES_GPS_S or not flight.position_ok else _ALL


def _knows_local_position(flight: FlightState) -> bool:
    """The estimator has an origin earlier, but no position in its frame before it uses the receiver."""
    return flight.home is not None and flight.time_s >= USES_GPS_S


def _ground_speed_mps(flight: FlightState) -> float:
    """Without a sensor ArduPilot shows the receiver's ground speed as airspeed (source)."""
    return math.hypot(flight.vn_mps, flight.ve_mps)


def _wind(flight: FlightState) -> tuple[float, float, float] | None:
    # Without an airspeed sensor the filter holds the wind at zero, which comes out as a wind from the south.
    return (-180.0, 0.0, 0.0) if flight.time_s >= USES_GPS_S and flight.position_ok else None


TELEMETRY = TelemetryPolicy(
    **choices(TelemetryPolicy, "ardupilot"),
    messages=messages_with("ardupilot", "request").union(*_GROUPS.values()),
    silent_messages=_SILENT,
    # ArduPilot streams nothing until a client asks, except its TIMESYNC every 10 s.
    stream_sets={"onboard": {"TIMESYNC": 0.1}, "gcs": {"TIMESYNC": 0.1}, "none": {}},
    stream_groups=_GROUPS,
    stream_parameters=_RATE_PARAMETERS,
    max_rates_hz={"TERRAIN_REQUEST": 0.5},
    promised_messages=frozenset(KINDS[name].id for name in _SILENT),
    battery_type=0,
    gps_quality=GpsQuality(fix_type=GPS_FIX_TYPE.RTK_FIXED, eph=121, epv=200, h_acc_mm=300, v_acc_mm=300),
    lost_fix_type=GPS_FIX_TYPE.NO_FIX,
    sensors=_sensors,
    estimator_flags=_estimator_flags,
    knows_local_position=_knows_local_position,
    airspeed_mps=_ground_speed_mps,
    wind=_wind,
)
