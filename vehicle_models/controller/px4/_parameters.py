"""The parameters of PX4, and the flight limits that they give.

`parameters.csv` has every parameter that the SITL of PX4 (between 1.17 and 1.18, airframe `sihsim_quadx`) lists,
with the type and the value that it sends after its start; calibrations that it learned in its first seconds are
among them. One value differs: MAV_SYS_ID is 1, the number of a first instance.
"""

from __future__ import annotations

import math
from pathlib import Path

from .._flight_state import Behaviour
from ..guidance._limits import FlightLimits, FollowTargetLimits, StickLimits
from ..parameters._store import ParameterStore
from ..parameters._table import read_parameters
from ..policies._parameters import ParameterPolicy

_AUTOMATIC = frozenset(
    {Behaviour.TAKEOFF, Behaviour.HOLD, Behaviour.MISSION, Behaviour.RETURN, Behaviour.LAND}
)

# How long a return stands at RTL_DESCEND_ALT before it lands, s. Chosen so that one near home takes the 13.0 s to
# the ground that were observed of sihsim_quadx; from 20 m away it took 54.5 s, here 51 s. A PX4 flown with
# RTL_DESCEND_ALT at its return altitude did not stop. PX4's reason for the stop is not known.
_RETURN_SETTLES_S = 8.4


def limits(p: ParameterStore) -> FlightLimits:
    return FlightLimits(
        cruise_mps=max(p["MPC_XY_CRUISE"], 0.5),
        speed_max_mps=max(p["MPC_XY_VEL_MAX"], 0.5),
        setpoint_climb_mps=max(p["MPC_Z_VEL_MAX_UP"], 0.2),
        setpoint_descent_mps=max(p["MPC_Z_VEL_MAX_DN"], 0.2),
        climb_mps=max(p["MPC_Z_V_AUTO_UP"], 0.2),
        descent_mps=max(p["MPC_Z_V_AUTO_DN"], 0.2),
        takeoff_mps=max(p["MPC_TKO_SPEED"], 0.2),
        takeoff_spool_s=0.6,
        takeoff_ramp_s=5.5,
        takeoff_height_m=max(p["MIS_TAKEOFF_ALT"], 0.5),
        land_mps=max(p["MPC_LAND_SPEED"], 0.2),
        land_slow_below_m=p["MPC_LAND_ALT2"],
        land_fast_above_m=p["MPC_LAND_ALT1"],
        return_height_m=p["RTL_RETURN_ALT"],
        return_near_m=p["RTL_MIN_DIST"],
        return_climbs_by_m=None,
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
        goto_mps=max(p["MPC_XY_VEL_MAX"], 0.5),
        faces_beyond_m=max(p["NAV_ACC_RAD"], 0.5) if p["MPC_YAW_MODE"] == 0 else math.inf,
        return_faces_home=True,
        return_descends_to_m=p["RTL_DESCEND_ALT"] if _waits_in_return(p) else None,
        return_waits_s=_return_waits_s(p),
        orbit_radius_max_m=max(p["MC_ORBIT_RAD_MAX"], 1.0),
        circle_radius_m=20.0,
        circle_radps=0.05,
        # PX4 takes the thrust of an attitude setpoint as thrust.
        thrust_is_climb=False,
    )


def _waits_in_return(p: ParameterStore) -> bool:
    """A return stops on its way down only where RTL_DESCEND_ALT lies below its height."""
    return p["RTL_DESCEND_ALT"] < p["RTL_RETURN_ALT"]


def _return_waits_s(p: ParameterStore) -> float:
    delay_s = p["RTL_LAND_DELAY"] if p["RTL_LAND_DELAY"] >= 0.0 else math.inf
    return delay_s + (_RETURN_SETTLES_S if _waits_in_return(p) else 0.0)


def _overrides(bits: int) -> frozenset[Behaviour]:
    """COM_RC_OVERRIDE: bit 0 for the automatic modes, bit 1 for offboard."""
    return (_AUTOMATIC if bits & 1 else frozenset()) | (
        frozenset({Behaviour.OFFBOARD}) if bits & 2 else frozenset()
    )


PARAMETERS = ParameterPolicy(
    definitions=read_parameters(Path(__file__).with_name("parameters.csv")),
    system_id="MAV_SYS_ID",
    limits=limits,
    bytewise=True,
    hash_first=True,
    unknown="error",
    index_in_replies=True,
    any_case=False,
    changes_twice=True,
    checks_type=True,
    listed_per_step=20,
)
