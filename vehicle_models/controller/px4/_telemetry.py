"""PX4's streams, and what its messages report."""

from __future__ import annotations

from ..links._enums import GPS_FIX_TYPE
from ..policies._choices import choices
from ..policies._tables import messages_with, rates_hz
from ..policies._telemetry import SensorBits, TelemetryPolicy
from ..state._flight_state import FlightState, GpsQuality
from ._modes import knows_position, ready

_PREARM = 0x10000000
# 3D gyro, accelerometer, magnetometer, pressure, GPS, six kinds of control, motors, AHRS, battery.
_SENSORS = (
    0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000 | 0x200000 | 0x2000000
)
_GPS_AND_POSITION = 0x20 | 0x4000

_ONBOARD_RATES_HZ, _GCS_RATES_HZ = rates_hz("px4_onboard_hz"), rates_hz("px4_gcs_hz")


def _sensors(flight: FlightState) -> SensorBits:
    health = _SENSORS if knows_position(flight) else _SENSORS & ~_GPS_AND_POSITION
    return SensorBits(_SENSORS, _SENSORS, health | (_PREARM if flight.armed or ready(flight) else 0))


TELEMETRY = TelemetryPolicy(
    **choices(TelemetryPolicy, "px4"),
    # Every message of a stream set may also be requested. RAW_IMU is no silent one (source): FAILED.
    messages=messages_with("px4", "stream", "request"),
    silent_messages=messages_with("px4", "silent"),
    stream_sets={"onboard": _ONBOARD_RATES_HZ, "gcs": _GCS_RATES_HZ, "none": {}},
    gimbal_rates_hz={"GIMBAL_DEVICE_ATTITUDE_STATUS": 5.0, "GIMBAL_MANAGER_STATUS": 0.5},
    # MAV_BATTERY_TYPE_LION; GPS_FIX_TYPE_3D_FIX (no name in Python starts with a digit)
    battery_type=3,
    gps_quality=GpsQuality(fix_type=3, eph=70, epv=110, h_acc_mm=900, v_acc_mm=1780),
    lost_fix_type=GPS_FIX_TYPE.NO_GPS,
    sensors=_sensors,
)
