"""The parameters of PX4 that exist here, and the flight limits that they give."""

from __future__ import annotations

import math
from pathlib import Path

from .._flight_state import Behaviour
from ..guidance._limits import FlightLimits, FollowTargetLimits, StickLimits
from ..parameters._store import INT32, Parameter, ParameterStore
from ..parameters._table import read_parameters
from ..policies._parameters import ParameterPolicy

_AUTOMATIC = frozenset(
    {Behaviour.TAKEOFF, Behaviour.HOLD, Behaviour.MISSION, Behaviour.RETURN, Behaviour.LAND}
)

# Parameters with an effect here and some that clients look for; where parameters.csv has a row of the same
# name, that one counts.
_EXTRA = (
    Parameter("BAT1_CAPACITY", -1.0),
    Parameter("BAT1_N_CELLS", 4, INT32),
    Parameter("BAT_CRIT_THR", 0.07),
    Parameter("BAT_EMERGEN_THR", 0.05),
    Parameter("BAT_LOW_THR", 0.15),
    Parameter("COM_DISARM_LAND", 2.0),
    Parameter("COM_DISARM_PRFLT", 10.0),
    Parameter("COM_DL_LOSS_T", 10, INT32),
    Parameter("COM_FAIL_ACT_T", 5.0),
    Parameter("COM_LOW_BAT_ACT", 0, INT32),
    Parameter("COM_OBL_RC_ACT", 0, INT32),
    Parameter("COM_OF_LOSS_T", 1.0),
    Parameter("COM_RC_IN_MODE", 1, INT32),
    Parameter("COM_RC_LOSS_T", 1.0),
    Parameter("GF_ACTION", 2, INT32),
    Parameter("GF_MAX_HOR_DIST", 0.0),
    Parameter("GF_MAX_VER_DIST", 0.0),
    Parameter("MAV_COMP_ID", 1, INT32),
    Parameter("MAV_SYS_ID", 1, INT32),
    Parameter("MAV_TYPE", 2, INT32),
    Parameter("MIS_TAKEOFF_ALT", 2.5),
    Parameter("MC_ORBIT_RAD_MAX", 1000.0),
    Parameter("MPC_LAND_ALT1", 10.0),
    Parameter("MPC_LAND_ALT2", 5.0),
    Parameter("MPC_LAND_SPEED", 0.7),
    Parameter("MPC_MAN_TILT_MAX", 35.0),
    Parameter("MPC_MAN_Y_MAX", 150.0),
    Parameter("MPC_TKO_SPEED", 1.5),
    Parameter("MPC_VEL_MANUAL", 10.0),
    Parameter("MPC_XY_CRUISE", 5.0),
    Parameter("MPC_XY_VEL_MAX", 12.0),
    Parameter("MPC_YAW_MODE", 0, INT32),
    Parameter("MPC_Z_VEL_MAX_DN", 1.5),
    Parameter("MPC_Z_VEL_MAX_UP", 3.0),
    Parameter("MPC_Z_V_AUTO_DN", 1.5),
    Parameter("MPC_Z_V_AUTO_UP", 3.0),
    Parameter("NAV_ACC_RAD", 10.0),
    Parameter("NAV_DLL_ACT", 0, INT32),
    Parameter("NAV_RCL_ACT", 2, INT32),
    Parameter("RTL_DESCEND_ALT", 30.0),
    Parameter("RTL_MIN_DIST", 10.0),
    Parameter("RTL_RETURN_ALT", 30.0),
    Parameter("RTL_TYPE", 0, INT32),
    Parameter("SYS_AUTOSTART", 10040, INT32),
)


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
        return_waits_s=0.0,
        orbit_radius_max_m=max(p["MC_ORBIT_RAD_MAX"], 1.0),
        circle_radius_m=20.0,
        circle_radps=0.05,
        # PX4 takes the thrust of an attitude setpoint as thrust.
        thrust_is_climb=False,
    )


def _overrides(bits: int) -> frozenset[Behaviour]:
    """COM_RC_OVERRIDE: bit 0 for the automatic modes, bit 1 for offboard."""
    return (_AUTOMATIC if bits & 1 else frozenset()) | (
        frozenset({Behaviour.OFFBOARD}) if bits & 2 else frozenset()
    )


PARAMETERS = ParameterPolicy(
    definitions=read_parameters(Path(__file__).with_name("parameters.csv"), _EXTRA, by_name=True),
    system_id="MAV_SYS_ID",
    limits=limits,
    bytewise=True,
    hash_first=True,
    unknown="error",
    index_in_replies=True,
    any_case=False,
    changes_twice=True,
    checks_type=True,
)
