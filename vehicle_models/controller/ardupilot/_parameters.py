"""The parameters of ArduCopter that exist here, and the flight limits that they give."""

from __future__ import annotations

import math
from pathlib import Path

from ..guidance._limits import FlightLimits, FollowTargetLimits, StickLimits
from ..parameters._store import INT8, INT16, INT32, Parameter, ParameterStore
from ..parameters._table import read_parameters
from ..policies._parameters import ParameterPolicy, ParameterPush

_RATE_PARAMETERS = (
    "RAW_SENS",
    "EXT_STAT",
    "RC_CHAN",
    "RAW_CTRL",
    "POSITION",
    "EXTRA1",
    "EXTRA2",
    "EXTRA3",
    "PARAMS",
    "ADSB",
)

# Parameters with an effect here and some that clients look for; where parameters.csv has a row of the same
# name, that one counts.
_EXTRA = (
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
    Parameter("FENCE_ACTION", 1, INT8),
    Parameter("FENCE_ALT_MAX", 100.0),
    Parameter("FENCE_MARGIN", 2.0),
    Parameter("FENCE_RADIUS", 300.0),
    Parameter("FENCE_TYPE", 7, INT8),
    Parameter("RALLY_INCL_HOME", 1, INT8),
    Parameter("RALLY_LIMIT_KM", 0.3),
    Parameter("WPNAV_RADIUS", 200.0),
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
    *(Parameter(f"SR0_{name}", 0, INT16) for name in _RATE_PARAMETERS),
)


def limits(p: ParameterStore) -> FlightLimits:
    # ArduPilot's parameters are in centimetres, centidegrees and milliseconds.
    cruise_mps = max(p["WPNAV_SPEED"], 20.0) / 100.0
    climb_mps = max(p["WPNAV_SPEED_UP"], 10.0) / 100.0
    descent_mps = max(p["WPNAV_SPEED_DN"], 10.0) / 100.0
    return FlightLimits(
        cruise_mps=cruise_mps,
        speed_max_mps=max(cruise_mps, 10.0),
        setpoint_climb_mps=climb_mps,
        setpoint_descent_mps=descent_mps,
        climb_mps=climb_mps,
        descent_mps=descent_mps,
        takeoff_mps=climb_mps,
        takeoff_spool_s=2.6,
        takeoff_ramp_s=1.0,
        takeoff_height_m=2.5,
        land_mps=max(p["LAND_SPEED"], 20.0) / 100.0,
        land_slow_below_m=10.0,
        land_fast_above_m=10.0,
        return_height_m=p["RTL_ALT"] / 100.0,
        return_near_m=0.0,
        return_climbs_by_m=max(p["RTL_CLIMB_MIN"], 0.0) / 100.0,
        landed_disarm_s=0.4,
        idle_disarm_s=p["DISARM_DELAY"] if p["DISARM_DELAY"] > 0 else None,
        setpoint_timeout_s=max(p["GUID_TIMEOUT"], 0.1),
        sticks=StickLimits(
            tilt_rad=math.radians(min(max(p["ANGLE_MAX"] / 100.0, 10.0), 45.0)),
            speed_mps=max(p["LOIT_SPEED"], 20.0) / 100.0,
            climb_mps=max(p["PILOT_SPEED_UP"], 50.0) / 100.0,
            descent_mps=max(p["PILOT_SPEED_DN"] or p["PILOT_SPEED_UP"], 50.0) / 100.0,
            yaw_radps=math.radians(max(p["PILOT_Y_RATE"], 1.0)),
            rates_radps=math.radians(max(p["ACRO_RP_RATE"], 1.0)),
            dead=0.05,
            lost_after_s=p["RC_OVERRIDE_TIME"] if p["RC_OVERRIDE_TIME"] > 0 else math.inf,
        ),
        follow_target=FollowTargetLimits(height_m=8.0, distance_m=8.0, angle_rad=math.pi, speed_mps=5.0),
        goto_mps=cruise_mps,
        faces_beyond_m=None,
        return_faces_home=False,
        return_waits_s=max(p["RTL_LOIT_TIME"], 0.0) / 1000.0,
        orbit_radius_max_m=math.inf,
        circle_radius_m=max(p["CIRCLE_RADIUS"], 100.0) / 100.0,
        circle_radps=math.radians(p["CIRCLE_RATE"]),
        # Bit 3 of GUID_OPTIONS (SetAttitudeTarget_ThrustAsThrust) turns climb rate into thrust.
        thrust_is_climb=not int(p["GUID_OPTIONS"]) & 8,
    )


PARAMETERS = ParameterPolicy(
    definitions=read_parameters(Path(__file__).with_name("parameters.csv"), _EXTRA),
    system_id="SYSID_THISMAV",
    limits=limits,
    bytewise=False,
    hash_first=False,
    unknown="silence",
    index_in_replies=False,
    any_case=True,
    changes_twice=False,
    checks_type=False,
    pushes=(
        ParameterPush("BARO1_GND_PRESS", 20.0),
        ParameterPush("BARO2_GND_PRESS", 20.0),
        ParameterPush("STAT_RUNTIME", 30.0, every_s=30.0, counts_seconds=True),
    ),
)
