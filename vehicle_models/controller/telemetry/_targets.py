"""Messages about what the vehicle is steered to."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..policies._setpoints import SetpointPolicy
from ..state._service import Stream, Values
from ..state._service_context import ServiceContext
from ._attitude import attitude_quaternion

_NAN = math.nan
# MAV_FRAME
_LOCAL_NED, _GLOBAL = 1, 0
# Bits of POSITION_TARGET_TYPEMASK.
_NO_HORIZONTAL, _NO_VERTICAL = 3, 4
# Position alone.
_GLOBAL_MASK = 65016


class TargetTelemetry:
    """The target of the present step, in wire order."""

    def __init__(self, context: ServiceContext, policy: SetpointPolicy) -> None:
        self._context = context
        self._flight = context.flight
        self._policy = policy

    def streams(self) -> Mapping[str, Stream]:
        return {
            "ATTITUDE_TARGET": self._attitude_target,
            "POSITION_TARGET_LOCAL_NED": self._local_target,
            "POSITION_TARGET_GLOBAL_INT": self._global_target,
            "NAV_CONTROLLER_OUTPUT": self._navigation_output,
            "TIME_ESTIMATE_TO_TARGET": lambda: (-1, -1, -1, -1, -1),  # -1: no estimate
        }

    def _attitude_target(self) -> Values | None:
        f = self._flight
        roll, pitch, yaw, thrust = self._context.airframe.commanded_attitude()
        given = f.target.attitude.rates_radps if f.target.attitude else None
        rates = given or (0.0, 0.0, f.target.yawrate_radps)
        return (f.time_ms, *attitude_quaternion(roll, pitch, yaw), *rates, thrust, 0)

    def _local_target(self) -> Values | None:
        """NaN for what is not controlled, which the mask marks as well."""
        f, target, policy = self._flight, self._flight.target, self._policy
        if not f.armed and policy.echo_behaviours is None:
            return (f.time_ms, *(_NAN,) * 11, _NO_HORIZONTAL | _NO_VERTICAL, _LOCAL_NED)
        if not f.armed or not self._echoes():
            return None
        place = target.north_east_m or (_NAN, _NAN)
        down = target.down_m if target.down_m is not None else _NAN
        mask = (_NO_HORIZONTAL if target.north_east_m is None else 0) | (
            _NO_VERTICAL if target.down_m is None else 0
        )
        fixed_mask = policy.echo_velocity_mask if mask else policy.echo_position_mask
        yaw = target.yaw_rad if target.yaw_rad is not None else _NAN
        motion = (*target.velocity_ned_mps, *target.acceleration_ned_mps2)
        shown_mask = mask if fixed_mask is None else fixed_mask
        return (f.time_ms, *place, down, *motion, yaw, target.yawrate_radps, shown_mask, _LOCAL_NED)

    def _echoes(self) -> bool:
        behaviours = self._policy.echo_behaviours
        return behaviours is None or self._flight.mode.behaviour in behaviours

    def _global_target(self) -> Values | None:
        f, target = self._flight, self._flight.target
        if not f.armed or target.north_east_m is None or target.down_m is None or not self._echoes():
            return None
        latitude, longitude = self._context.frame.to_geodetic_e7(*target.north_east_m)
        altitude = f.origin.altitude_m - target.down_m
        yaw = target.yaw_rad if target.yaw_rad is not None else _NAN
        motion = (*target.velocity_ned_mps, *target.acceleration_ned_mps2)
        place = (latitude, longitude, altitude)
        return (f.time_ms, *place, *motion, yaw, target.yawrate_radps, _GLOBAL_MASK, _GLOBAL)

    def _navigation_output(self) -> Values:
        f, target = self._flight, self._flight.target
        place = target.north_east_m or (f.north_m, f.east_m)
        north, east = place[0] - f.north_m, place[1] - f.east_m
        rise = f.down_m - target.down_m if target.down_m is not None else 0.0
        # What is steered to, as MAVLink defines it, not what is flown; the first bearing is the desired heading.
        roll, pitch, yaw = (math.degrees(angle) for angle in self._context.airframe.commanded_attitude()[:3])
        bearings = (round(yaw), round(math.degrees(math.atan2(east, north))))
        return (roll, pitch, rise, 0.0, 0.0, *bearings, min(round(math.hypot(north, east)), 65535))
