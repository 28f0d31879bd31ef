"""The parameters of ArduCopter that exist here, with its defaults."""

from __future__ import annotations

from .._parameters import INT8, INT16, INT32, Parameter

_RATES = ("RAW_SENS", "EXT_STAT", "RC_CHAN", "RAW_CTRL", "POSITION", "EXTRA1", "EXTRA2", "EXTRA3", "PARAMS", "ADSB")

PARAMETERS = (
    Parameter("ACRO_RP_RATE", 360.0),
    Parameter("ANGLE_MAX", 3000, INT16),
    Parameter("ARMING_CHECK", 1, INT32),
    Parameter("BATT_CAPACITY", 3300, INT32),
    Parameter("BATT_CRT_VOLT", 0.0),
    Parameter("BATT_FS_CRT_ACT", 0, INT8),
    Parameter("BATT_FS_LOW_ACT", 0, INT8),
    Parameter("BATT_LOW_TIMER", 10, INT8),
    Parameter("BATT_LOW_VOLT", 10.5),
    Parameter("BATT_MONITOR", 4, INT8),
    Parameter("CIRCLE_RADIUS", 1000.0),
    Parameter("CIRCLE_RATE", 20.0),
    Parameter("DISARM_DELAY", 10, INT8),
    Parameter("FENCE_ENABLE", 0, INT8),
    Parameter("FRAME_CLASS", 1, INT8),
    Parameter("FS_EKF_ACTION", 1, INT8),
    Parameter("FS_GCS_ENABLE", 0, INT8),
    Parameter("FS_GCS_TIMEOUT", 5.0),
    Parameter("FS_THR_ENABLE", 1, INT8),
    Parameter("GUID_OPTIONS", 0, INT32),
    Parameter("GUID_TIMEOUT", 3.0),
    Parameter("LAND_SPEED", 50, INT16),
    Parameter("LOIT_SPEED", 1250.0),
    Parameter("PILOT_SPEED_DN", 0, INT16),
    Parameter("PILOT_SPEED_UP", 250, INT16),
    Parameter("PILOT_Y_RATE", 202.5),
    Parameter("RC_OVERRIDE_TIME", 3.0),
    Parameter("RTL_ALT", 1500, INT32),
    Parameter("RTL_CLIMB_MIN", 0, INT16),
    Parameter("RTL_SPEED", 0, INT16),
    Parameter("SIM_BATT_VOLTAGE", 12.6),
    Parameter("SIM_RC_FAIL", 0, INT8),
    Parameter("SYSID_MYGCS", 255, INT16),
    Parameter("SYSID_THISMAV", 1, INT16),
    Parameter("WPNAV_SPEED", 1000.0),
    Parameter("WPNAV_SPEED_DN", 150.0),
    Parameter("WPNAV_SPEED_UP", 250.0),
    *(Parameter(f"SR0_{name}", 0, INT16) for name in _RATES),
)
