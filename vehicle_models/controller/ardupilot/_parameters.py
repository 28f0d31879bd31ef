"""The parameters of ArduCopter, and the flight limits that they give.

`parameters.csv` has every parameter that the SITL of ArduCopter 4.6.3 (`--model +`) lists with no optional device
enabled, with the type and the value that it sends after its start from an empty memory; calibrations and device
numbers that it stored in its first seconds are among them. The order of the list is our own.
"""

from __future__ import annotations

import math
from pathlib import Path

from ..policies._choices import choices
from ..policies._parameters import ParameterPolicy, ParameterPush
from ..state._flight_limits import FlightLimits, FollowTargetLimits, PathLimits, StickLimits
from ..state._parameter_store import ParameterStore, read_parameters
from ..state._shaping import AxisShaping, MotionShaping


def limits(p: ParameterStore) -> FlightLimits:
    # ArduPilot's parameters are in centimetres, centidegrees and milliseconds.
    cruise_mps = max(p["WPNAV_SPEED"], 20.0) / 100.0
    climb_mps = max(p["WPNAV_SPEED_UP"], 10.0) / 100.0
    descent_mps = max(p["WPNAV_SPEED_DN"], 10.0) / 100.0
    accel_mps2 = max(p["WPNAV_ACCEL"], 50.0) / 100.0
    vertical_accel_mps2 = max(p["WPNAV_ACCEL_Z"], 50.0) / 100.0
    return_mps = max(p["RTL_SPEED"], 20.0) / 100.0 if p["RTL_SPEED"] > 0 else cruise_mps
    jerk_mps3 = max(p["WPNAV_JERK"], 1.0)
    # Source: without a parameter for corners they may have twice the acceleration of straight ways.
    corner_mps2 = p["WPNAV_ACCEL_C"] / 100.0 if p["WPNAV_ACCEL_C"] > 0.0 else 2.0 * accel_mps2
    land_low_m = max(p["LAND_ALT_LOW"], 100.0) / 100.0
    shaping = MotionShaping(
        AxisShaping.with_square_root(accel_mps2, max(p["PSC_JERK_XY"], 1.0)),
        AxisShaping.with_square_root(vertical_accel_mps2, max(p["PSC_JERK_Z"], 1.0)),
        velocity_p_per_s=max(p["PSC_VELXY_P"], 0.5),
        velocity_i_per_s2=max(p["PSC_VELXY_I"], 0.0),
    )
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
        takeoff_ramp_from_mps=0.0,
        takeoff_height_m=2.5,
        takeoff_reached_m=0.3,
        takeoff_beyond_m=0.0,
        land_mps=max(p["LAND_SPEED"], 20.0) / 100.0,
        land_slow_below_m=land_low_m,
        # Where ArduPilot's square root begins to slow the descent; linear in between here.
        land_fast_above_m=land_low_m + 0.5 + 0.5 * descent_mps**2 / vertical_accel_mps2,
        blind_land_mps=None,
        return_height_m=p["RTL_ALT"] / 100.0,
        return_mps=return_mps,
        return_path=PathLimits(return_mps, accel_mps2, vertical_accel_mps2, jerk_mps3),
        return_arrives_m=0.5,
        return_arrives_height_m=max(p["WPNAV_RADIUS"], 5.0) / 100.0,
        return_near_m=0.0,
        return_climbs_by_m=max(p["RTL_CLIMB_MIN"], 0.0) / 100.0,
        waypoint_turn_mps2=0.0,
        waypoint_path=PathLimits(cruise_mps, accel_mps2, vertical_accel_mps2, jerk_mps3),
        waypoint_corner_mps2=corner_mps2,
        # Observed of the SITL's own model: landed 1.6 s after the touch, disarmed 0.4 s later.
        landing_settles_s=1.6,
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
        reposition_delay_s=0.0,
        goto_mps=cruise_mps,
        faces_beyond_m=None,
        return_faces_home=False,
        return_descends_to_m=None,
        return_waits_s=max(p["RTL_LOIT_TIME"], 0.0) / 1000.0,
        orbit_radius_max_m=math.inf,
        circle_radius_m=max(p["CIRCLE_RADIUS"], 100.0) / 100.0,
        circle_radps=math.radians(p["CIRCLE_RATE"]),
        # Bit 3 of GUID_OPTIONS (SetAttitudeTarget_ThrustAsThrust) turns climb rate into thrust.
        thrust_is_climb=not int(p["GUID_OPTIONS"]) & 8,
        climb_shaping=shaping,
        takeoff_shaping=shaping.held(),
        descent_shaping=shaping,
        setpoint_shaping=shaping,
    )


PARAMETERS = ParameterPolicy(
    **choices(ParameterPolicy, "ardupilot"),
    definitions=read_parameters(Path(__file__).with_name("parameters.csv")),
    limits=limits,
    simulation=("SIM_",),
    pushes=(
        ParameterPush("BARO1_GND_PRESS", 20.0),
        ParameterPush("BARO2_GND_PRESS", 20.0),
        ParameterPush("STAT_RUNTIME", 30.0, every_s=30.0, counts_seconds=True),
    ),
)
