"""Messages about attitude, position and motion, as the vehicle estimates them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..links._frames import heading_cdeg, hundredths
from ..policies._telemetry import TelemetryPolicy
from ..state._service import HalfwayStream, Stream, Values
from ..state._service_context import ServiceContext
from ._attitude import AttitudeCache

_NAN = math.nan
# Of pose and velocity: NaN in the first element means unknown.
_UNKNOWN_COVARIANCES = (_NAN, *(0.0,) * 20) * 2
# MAV_FRAME of ODOMETRY.
_LOCAL_NED = 1
_ESTIMATOR_AUTOPILOT, _QUALITY_PERCENT = 8, 100


class MotionTelemetry:
    """In wire order; SIMSTATE, in a SITL the truth, is the estimate: agents must not learn the truth."""

    def __init__(self, context: ServiceContext, policy: TelemetryPolicy, attitude: AttitudeCache) -> None:
        self._context = context
        self._policy = policy
        self._flight = context.flight
        self._body = attitude

    def streams(self) -> Mapping[str, Stream | HalfwayStream]:
        return {
            "ATTITUDE": HalfwayStream(self._attitude, self._halfway_attitude),
            "ATTITUDE_QUATERNION": self._attitude_quaternion,
            "LOCAL_POSITION_NED": self._local_position,
            "GLOBAL_POSITION_INT": self._global_position,
            "ODOMETRY": self._odometry,
            "VFR_HUD": self._hud,
            "ALTITUDE": self._altitude,
            "AHRS": lambda: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            "AHRS2": self._ahrs2,
            "SIMSTATE": self._simstate,
        }

    def _attitude(self) -> Values:
        f = self._flight
        return (f.time_ms, f.roll_rad, f.pitch_rad, f.yaw_rad, f.p_radps, f.q_radps, f.r_radps)

    def _halfway_attitude(self) -> Values | None:
        f = self._flight
        if not f.halfway:
            return None
        roll_rad, pitch_rad, yaw_rad, *rates = f.halfway
        time_ms = f.time_ms - round(500.0 * f.step_s)
        return (time_ms, roll_rad, pitch_rad, math.remainder(yaw_rad, 2.0 * math.pi), *rates)

    def _attitude_quaternion(self) -> Values:
        f = self._flight
        return (f.time_ms, *self._body.now(), f.p_radps, f.q_radps, f.r_radps, 0.0, 0.0, 0.0, 0.0)

    def _local_position(self) -> Values | None:
        f = self._flight
        if not self._policy.knows_local_position(f):
            return None
        return (f.time_ms, f.north_m, f.east_m, f.down_m, f.vn_mps, f.ve_mps, f.vd_mps)

    def _global_position(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        return (
            f.time_ms,
            f.latitude_e7,
            f.longitude_e7,
            round(f.altitude_m * 1000.0),
            round(f.height_m * 1000.0),
            hundredths(f.vn_mps),
            hundredths(f.ve_mps),
            hundredths(f.vd_mps),
            heading_cdeg(f.yaw_rad),
        )

    def _odometry(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        # MAVLink's default child frame is the body; PX4 gives velocities in the local frame, and names it.
        pose = (f.north_m, f.east_m, f.down_m, *self._body.now())
        velocity = (f.vn_mps, f.ve_mps, f.vd_mps)
        rates = (f.p_radps, f.q_radps, f.r_radps)
        frames = (_LOCAL_NED, _LOCAL_NED, 0, _ESTIMATOR_AUTOPILOT, _QUALITY_PERCENT)
        return (f.time_us, *pose, *velocity, *rates, *_UNKNOWN_COVARIANCES, *frames)

    def _hud(self) -> Values:
        f = self._flight
        outputs = self._context.airframe.outputs()
        heading = round(math.degrees(f.yaw_rad)) % 360
        throttle = round(100.0 * sum(outputs) / len(outputs))
        airspeed_mps = self._policy.airspeed_mps(f)
        return (airspeed_mps, math.hypot(f.vn_mps, f.ve_mps), f.altitude_m, -f.vd_mps, heading, throttle)

    def _altitude(self) -> Values:
        f = self._flight
        above_m = -f.down_m
        return (f.time_us, f.altitude_m, f.altitude_m, above_m, f.height_m, _NAN, above_m)

    def _ahrs2(self) -> Values:
        f = self._flight
        return (f.roll_rad, f.pitch_rad, f.yaw_rad, f.altitude_m, f.latitude_e7, f.longitude_e7)

    def _simstate(self) -> Values:
        f = self._flight
        attitude = (f.roll_rad, f.pitch_rad, f.yaw_rad)
        force = self._context.airframe.specific_force_mps2()
        return (*attitude, *force, f.p_radps, f.q_radps, f.r_radps, f.latitude_e7, f.longitude_e7)
