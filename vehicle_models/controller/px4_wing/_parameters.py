"""The parameters of PX4 on a fixed wing, and the flight limits that they give."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

from ..guidance._wing import WingLimits
from ..px4._parameters import PARAMETERS as MULTICOPTER_PARAMETERS
from ..state._parameter_store import Parameter, ParameterStore, read_parameters

# Circles are not flown lower.
MIN_CIRCLE_HEIGHT_M = 25.0
# What the airframe can fly.
_RADIUS_RANGE_M = (30.0, 500.0)


def _definitions() -> tuple[Parameter, ...]:
    """The quadrotor's, with the defaults of a fixed wing and what only that has, by name."""
    own = read_parameters(Path(__file__).with_name("parameters.csv"))
    remaining = {parameter.name: parameter for parameter in own}
    common = tuple(
        replace(parameter, default=remaining.pop(parameter.name).default)
        if parameter.name in remaining
        else parameter
        for parameter in MULTICOPTER_PARAMETERS.definitions
    )
    return tuple(sorted((*common, *remaining.values()), key=lambda parameter: parameter.name))


def limits(p: ParameterStore) -> WingLimits:
    common = MULTICOPTER_PARAMETERS.limits(p)
    shared = {field.name: getattr(common, field.name) for field in fields(common)}
    min_airspeed = max(p["FW_AIRSPD_MIN"], 1.0)
    landing_airspeed = p["FW_LND_AIRSPD"]
    return WingLimits(
        **{
            **shared,
            # PX4 lets sticks take over on multicopters alone.
            "sticks": replace(common.sticks, overrides=frozenset()),
            "cruise_mps": max(p["FW_AIRSPD_TRIM"], min_airspeed),
            "speed_max_mps": max(p["FW_AIRSPD_MAX"], min_airspeed),
            "climb_mps": max(p["FW_T_CLMB_R_SP"], 0.5),
            "descent_mps": max(p["FW_T_SINK_R_SP"], 0.5),
        },
        min_airspeed_mps=min_airspeed,
        landing_mps=landing_airspeed if landing_airspeed > 0.0 else 1.1 * min_airspeed,
        loiter_radius_m=_radius_m(p["NAV_LOITER_RAD"]),
        return_radius_m=_radius_m(p["RTL_LOITER_RAD"]),
        descend_height_m=max(p["RTL_DESCEND_ALT"], MIN_CIRCLE_HEIGHT_M),
        land_delay_s=p["RTL_LAND_DELAY"] if p["RTL_LAND_DELAY"] >= 0.0 else None,
        glide_rad=math.radians(min(max(p["FW_LND_ANG"], 2.0), 12.0)),
        flare_height_m=min(max(p["FW_LND_FLALT"], 0.5), 10.0),
        flare_sink_mps=min(max(p["FW_LND_FL_SINK"], 0.1), 1.0),
    )


def _radius_m(radius_m: float) -> float:
    return math.copysign(min(max(abs(radius_m), _RADIUS_RANGE_M[0]), _RADIUS_RANGE_M[1]), radius_m)


PARAMETERS = replace(MULTICOPTER_PARAMETERS, definitions=_definitions(), limits=limits)
