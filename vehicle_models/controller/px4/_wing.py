"""PX4 on a fixed wing: its parameters and limits; all else is as on the quadrotor."""

from __future__ import annotations

import dataclasses
import math

from ..guidance._wing import WingLimits
from ..parameters._store import INT32, Parameter, ParameterStore
from ._personality import Px4

_OWN = (
    Parameter("FW_AIRSPD_MAX", 20.0),
    Parameter("FW_AIRSPD_MIN", 11.0),
    Parameter("FW_AIRSPD_TRIM", 15.0),
    Parameter("FW_LND_AIRSPD", -1.0),
    Parameter("FW_LND_ANG", 5.0),
    Parameter("FW_LND_FLALT", 2.5),
    Parameter("FW_LND_FL_SINK", 0.4),
    Parameter("FW_T_CLMB_R_SP", 3.0),
    Parameter("FW_T_SINK_R_SP", 2.0),
    Parameter("MAV_TYPE", 1, INT32),
    Parameter("MIS_TAKEOFF_ALT", 30.0),
    Parameter("NAV_LOITER_RAD", 80.0),
    Parameter("RTL_DESCEND_ALT", 60.0),
    Parameter("RTL_LAND_DELAY", -1.0),
    Parameter("RTL_LOITER_RAD", 80.0),
    Parameter("RTL_RETURN_ALT", 60.0),
    Parameter("SYS_AUTOSTART", 2100, INT32),
)
WING_LOWEST_M = 25.0  # circles are not flown lower
_ACROSS_M = (30.0, 500.0)  # radii that the airframe can fly


def _parameters() -> tuple[Parameter, ...]:
    """The quadrotor's, with the defaults of a fixed wing and what only that has."""
    own = {one.name: one for one in _OWN}
    common = tuple(
        dataclasses.replace(one, default=own.pop(one.name).default) if one.name in own else one for one in Px4.parameters
    )
    return (*common, *own.values())


class Px4Wing(Px4):
    vehicle_type = 1
    parameters = _parameters()

    def limits(self, parameters: ParameterStore) -> WingLimits:
        p, common = parameters, super().limits(parameters)
        shared = {field.name: getattr(common, field.name) for field in dataclasses.fields(common)}
        slowest = max(p["FW_AIRSPD_MIN"], 1.0)
        landing = p["FW_LND_AIRSPD"]
        return WingLimits(
            **{
                **shared,
                "sticks": dataclasses.replace(common.sticks, overrides=frozenset()),  # multicopters alone
                "cruise_mps": max(p["FW_AIRSPD_TRIM"], slowest),
                "speed_max_mps": max(p["FW_AIRSPD_MAX"], slowest),
                "climb_mps": max(p["FW_T_CLMB_R_SP"], 0.5),
                "descent_mps": max(p["FW_T_SINK_R_SP"], 0.5),
            },
            slowest_mps=slowest,
            landing_mps=landing if landing > 0.0 else 1.1 * slowest,
            loiter_radius_m=_radius_m(p["NAV_LOITER_RAD"]),
            return_radius_m=_radius_m(p["RTL_LOITER_RAD"]),
            descend_height_m=max(p["RTL_DESCEND_ALT"], WING_LOWEST_M),
            land_delay_s=p["RTL_LAND_DELAY"] if p["RTL_LAND_DELAY"] >= 0.0 else None,
            glide_rad=math.radians(min(max(p["FW_LND_ANG"], 2.0), 12.0)),
            flare_height_m=min(max(p["FW_LND_FLALT"], 0.5), 10.0),
            flare_sink_mps=min(max(p["FW_LND_FL_SINK"], 0.1), 1.0),
        )


def _radius_m(given: float) -> float:
    return math.copysign(min(max(abs(given), _ACROSS_M[0]), _ACROSS_M[1]), given)
