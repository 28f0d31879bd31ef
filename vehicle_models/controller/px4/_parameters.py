"""The parameters of PX4, and the flight limits that they give.

`parameters.csv` has every parameter that the SITL of PX4 (between 1.17 and 1.18, airframe `sihsim_quadx`) lists,
with the type and the value that it sends after its start; calibrations that it learned in its first seconds are
among them. One value differs: MAV_SYS_ID is 1, the number of a first instance.
"""

from __future__ import annotations

import math
from pathlib import Path

from ..policies._choices import choices
from ..policies._parameters import ParameterPolicy
from ..state._flight_limits import FlightLimits, FollowTargetLimits, StickLimits
from ..state._flight_state import Behaviour
from ..state._parameter_store import ParameterStore, read_parameters
from ..state._shaping import UNSHAPED, AxisShaping, MotionShaping

_AUTOMATIC = frozenset(
    {Behaviour.TAKEOFF, Behaviour.HOLD, Behaviour.MISSION, Behaviour.RETURN, Behaviour.LAND}
)

# Until PX4's navigator has handed a reposition to the trajectory. Fitted to the first tenth of one step of 20 m.
_REPOSITION_DELAY_S = 0.15

# Of 45 degrees, MPC_TILTMAX_AIR's default and about what this airframe tilts at most.
_TILTED_MPS2 = 9.81
# This airframe flies no faster, whatever MPC_XY_VEL_MAX allows.
_FASTEST_MPS = 18.0

# A takeoff of PX4 slows down as if it went so much higher, until it is over. Fitted to one flight of PX4 on this
# plant; the reason is not known.
_TAKEOFF_BEYOND_M = 0.6


def limits(p: ParameterStore) -> FlightLimits:
    climb_shaping, setpoint_shaping = _shaping(p, p["MPC_ACC_UP_MAX"]), _setpoint_shaping(p)
    return_waits_s = p["RTL_LAND_DELAY"] if p["RTL_LAND_DELAY"] >= 0.0 else math.inf
    return FlightLimits(
        cruise_mps=max(p["MPC_XY_CRUISE"], 0.5),
        speed_max_mps=max(p["MPC_XY_VEL_MAX"], 0.5),
        setpoint_climb_mps=max(p["MPC_Z_VEL_MAX_UP"], 0.2),
        setpoint_descent_mps=max(p["MPC_Z_VEL_MAX_DN"], 0.2),
        climb_mps=max(p["MPC_Z_V_AUTO_UP"], 0.2),
        descent_mps=max(p["MPC_Z_V_AUTO_DN"], 0.2),
        takeoff_mps=max(p["MPC_TKO_SPEED"], 0.2),
        takeoff_spool_s=0.7,
        takeoff_ramp_s=max(p["MPC_TKO_RAMP_T"], 0.0),
        # The climb grows from the descent that would leave the rotors no thrust (source: PX4's TakeoffHandling).
        takeoff_ramp_from_mps=-9.81 / max(p["MPC_Z_VEL_P_ACC"], 0.1),
        takeoff_height_m=max(p["MIS_TAKEOFF_ALT"], 0.5),
        takeoff_reached_m=_reached_height_m(p),
        takeoff_beyond_m=_TAKEOFF_BEYOND_M,
        land_mps=max(p["MPC_LAND_SPEED"], 0.2),
        land_slow_below_m=p["MPC_LAND_ALT2"],
        land_fast_above_m=p["MPC_LAND_ALT1"],
        # Source: without a position PX4 descends at the speed of landing from any height.
        blind_land_mps=max(p["MPC_LAND_SPEED"], 0.2),
        return_height_m=p["RTL_RETURN_ALT"],
        return_mps=max(p["MPC_XY_CRUISE"], 0.5),
        return_path=None,
        return_arrives_m=max(p["NAV_ACC_RAD"], 0.5),
        return_arrives_height_m=_reached_height_m(p),
        return_near_m=p["RTL_MIN_DIST"],
        return_climbs_by_m=None,
        waypoint_turn_mps2=max(p["MPC_XY_TRAJ_P"], 0.1) * max(p["MPC_ACC_HOR"], 0.5),
        waypoint_path=None,
        waypoint_corner_mps2=0.0,
        # From one landing of PX4 on this plant: 1.15 s from the touch to its text.
        landing_settles_s=1.1,
        landed_disarm_s=p["COM_DISARM_LAND"] if p["COM_DISARM_LAND"] > 0 else None,
        idle_disarm_s=p["COM_DISARM_PRFLT"] if p["COM_DISARM_PRFLT"] > 0 else None,
        setpoint_timeout_s=max(p["COM_OF_LOSS_T"], 0.1),
        sticks=StickLimits(
            tilt_rad=math.radians(min(max(p["MPC_MAN_TILT_MAX"], 1.0), 45.0)),
            speed_mps=max(p["MPC_VEL_MANUAL"], 0.5),
            climb_mps=max(p["MPC_Z_VEL_MAX_UP"], 0.2),
            descent_mps=max(p["MPC_Z_VEL_MAX_DN"], 0.2),
            yaw_radps=math.radians(max(p["MPC_MAN_Y_MAX"], 0.0)),
            rates_radps=math.radians(100.0),
            dead=0.1,
            lost_after_s=max(p["COM_RC_LOSS_T"], 0.1),
            overrides=_overrides(int(p["COM_RC_OVERRIDE"])),
            overrides_from=min(max(p["COM_RC_STICK_OV"], 5.0), 80.0) / 100.0,
        ),
        follow_target=FollowTargetLimits(
            height_m=max(p["FLW_TGT_HT"], 1.0),
            distance_m=max(p["FLW_TGT_DST"], 1.0),
            angle_rad=math.radians(p["FLW_TGT_FA"]),
            speed_mps=max(p["FLW_TGT_MAX_VEL"], 0.5),
        ),
        reposition_delay_s=_REPOSITION_DELAY_S,
        goto_mps=max(p["MPC_XY_VEL_MAX"], 0.5),
        faces_beyond_m=max(p["NAV_ACC_RAD"], 0.5) if p["MPC_YAW_MODE"] == 0 else math.inf,
        return_faces_home=True,
        # Source, and three flights of PX4 on this plant: without a delay it lands from where it arrives.
        return_descends_to_m=p["RTL_DESCEND_ALT"] if return_waits_s else None,
        return_waits_s=return_waits_s,
        orbit_radius_max_m=max(p["MC_ORBIT_RAD_MAX"], 1.0),
        circle_radius_m=20.0,
        circle_radps=0.05,
        # PX4 takes the thrust of an attitude setpoint as thrust.
        thrust_is_climb=False,
        climb_shaping=climb_shaping,
        takeoff_shaping=climb_shaping.held(),
        descent_shaping=_shaping(p, p["MPC_ACC_DOWN_MAX"]),
        setpoint_shaping=setpoint_shaping,
        velocity_shaping=setpoint_shaping,
    )


def _reached_height_m(p: ParameterStore) -> float:
    return max(p["NAV_MC_ALT_RAD"], 0.3)


def _shaping(p: ParameterStore, vertical_mps2: float) -> MotionShaping:
    jerk_mps3 = max(p["MPC_JERK_AUTO"], 1.0)
    return MotionShaping(
        AxisShaping.with_braking_delay(max(p["MPC_ACC_HOR"], 0.5), jerk_mps3),
        AxisShaping.with_braking_delay(max(vertical_mps2, 0.5), jerk_mps3),
        velocity_p_per_s=max(p["MPC_XY_VEL_P_ACC"], 0.5),
        velocity_i_per_s2=max(p["MPC_XY_VEL_I_ACC"], 0.0),
    )


def _setpoint_shaping(p: ParameterStore) -> MotionShaping:
    """Setpoints of a companion pass the trajectories by: what limits them is the tilt."""
    return MotionShaping(
        AxisShaping.with_proportion(
            min(max(p["MPC_XY_VEL_MAX"], 0.5), _FASTEST_MPS),
            _TILTED_MPS2,
            max(p["MPC_XY_P"], 0.1),
            max(p["MPC_XY_VEL_P_ACC"], 0.5),
        ),
        UNSHAPED.vertical,
        velocity_p_per_s=max(p["MPC_XY_VEL_P_ACC"], 0.5),
        velocity_i_per_s2=max(p["MPC_XY_VEL_I_ACC"], 0.0),
    )


def _overrides(bits: int) -> frozenset[Behaviour]:
    """COM_RC_OVERRIDE: bit 0 for the automatic modes, bit 1 for offboard."""
    offboard = frozenset({Behaviour.OFFBOARD} if bits & 2 else ())
    return offboard | _AUTOMATIC if bits & 1 else offboard


PARAMETERS = ParameterPolicy(
    **choices(ParameterPolicy, "px4"),
    definitions=read_parameters(Path(__file__).with_name("parameters.csv")),
    limits=limits,
    # SYS_FAILURE_EN lets a client break parts of the vehicle, SYS_HITL replaces its sensors.
    simulation=("SIM_", "SIH_", "SYS_FAILURE_EN", "SYS_HITL"),
)
