"""PX4's streams, and what its messages report."""

from __future__ import annotations

from ..links._enums import GPS_FIX_TYPE
from ..policies._telemetry import SensorBits, TelemetryPolicy
from ..state._flight_state import FlightState, GpsQuality
from ..state._service import CommandResult
from ._modes import knows_position, ready

_PREARM = 0x10000000
# 3D gyro, accelerometer, magnetometer, pressure, GPS, rate and attitude and yaw and z and xy control, motors,
# AHRS, battery.
_SENSORS = (
    0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000 | 0x200000 | 0x2000000
)
_GPS_AND_POSITION = 0x20 | 0x4000

_COMMON_RATES_HZ = {
    "ATTITUDE_QUATERNION": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "SCALED_PRESSURE": 1.0,
    "MISSION_CURRENT": 1.0,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "CURRENT_MODE": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "LINK_NODE_STATUS": 1.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
}
_ONBOARD_RATES_HZ = {
    **_COMMON_RATES_HZ,
    "ATTITUDE": 100.0,
    "LOCAL_POSITION_NED": 30.0,
    "ODOMETRY": 30.0,
    "HIGHRES_IMU": 50.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "ATTITUDE_TARGET": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "GPS_RAW_INT": 8.0,
    "VFR_HUD": 10.0,
    "ALTITUDE": 10.0,
    "DISTANCE_SENSOR": 10.0,
    "TIMESYNC": 10.0,
    "SYS_STATUS": 5.0,
    "EXTENDED_SYS_STATE": 5.0,
    "SYSTEM_TIME": 1.0,
    "PING": 1.0,
    "ESTIMATOR_STATUS": 1.0,
    "ORBIT_EXECUTION_STATUS": 5.0,
    "VIBRATION": 0.5,
    "ESC_INFO": 10.0,
    "ESC_STATUS": 10.0,
}
_GCS_RATES_HZ = {
    **_COMMON_RATES_HZ,
    "ATTITUDE": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "ATTITUDE_TARGET": 50.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "POSITION_TARGET_GLOBAL_INT": 1.0,
    "GPS_RAW_INT": 5.0,
    "VFR_HUD": 4.0,
    "ALTITUDE": 1.0,
    "DISTANCE_SENSOR": 0.5,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "PING": 0.1,
    "ESTIMATOR_STATUS": 0.5,
    "ORBIT_EXECUTION_STATUS": 2.0,
    "VIBRATION": 0.1,
}


_ON_REQUEST = (
    "HEARTBEAT",
    "GPS_GLOBAL_ORIGIN",
    "SCALED_IMU",
    "SCALED_IMU2",
    "SCALED_IMU3",
    "NAV_CONTROLLER_OUTPUT",
)
# Streams of PX4 (source) for devices and estimates that do not exist here. RAW_IMU is none of them: FAILED.
_SILENT = frozenset(
    {
        "ADSB_VEHICLE",
        "ATT_POS_MOCAP",
        "CAMERA_IMAGE_CAPTURED",
        "CAMERA_TRIGGER",
        "COLLISION",
        "DEBUG",
        "DEBUG_FLOAT_ARRAY",
        "DEBUG_VECT",
        "EFI_STATUS",
        "GPS2_RAW",
        "GPS_STATUS",
        "HIGH_LATENCY2",
        "HYGROMETER_SENSOR",
        "MAG_CAL_REPORT",
        "MANUAL_CONTROL",
        "MOUNT_ORIENTATION",
        "NAMED_VALUE_FLOAT",
        "OBSTACLE_DISTANCE",
        "OPEN_DRONE_ID_BASIC_ID",
        "OPTICAL_FLOW_RAD",
        "RAW_RPM",
        "RC_CHANNELS",
        "SCALED_PRESSURE2",
        "SCALED_PRESSURE3",
        "UTM_GLOBAL_POSITION",
        "WIND_COV",
    }
)


def _sensors(flight: FlightState) -> SensorBits:
    health = _SENSORS if knows_position(flight) else _SENSORS & ~_GPS_AND_POSITION
    return SensorBits(_SENSORS, _SENSORS, health | (_PREARM if flight.armed or ready(flight) else 0))


TELEMETRY = TelemetryPolicy(
    # Every message of a stream set may also be requested.
    messages=frozenset({*_ONBOARD_RATES_HZ, *_GCS_RATES_HZ, *_ON_REQUEST}),
    silent_messages=_SILENT,
    stream_sets={"onboard": _ONBOARD_RATES_HZ, "gcs": _GCS_RATES_HZ, "none": {}},
    gimbal_rates_hz={"GIMBAL_DEVICE_ATTITUDE_STATUS": 5.0, "GIMBAL_MANAGER_STATUS": 0.5},
    waits_for_client=False,
    unknown_interval=CommandResult.FAILED,
    unknown_interval_text=None,
    unknown_get_interval=CommandResult.ACCEPTED,
    unknown_request=CommandResult.DENIED,
    min_interval_us=0,
    load_permille=130,
    # MAV_BATTERY_TYPE_LION
    battery_type=3,
    vtol_state=0,
    gps_quality=GpsQuality(fix_type=GPS_FIX_TYPE.FIX_3D, eph=70, epv=110, h_acc_mm=900, v_acc_mm=1780),
    lost_fix_type=GPS_FIX_TYPE.NO_GPS,
    sensors=_sensors,
)
