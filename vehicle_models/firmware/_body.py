"""The simulated aircraft as an autopilot's sensors meet it."""

from __future__ import annotations

import math

from bench.contracts import Vector
from bench.simspec import SimSpec, generator

from .._geodesy import LocalFrame, TangentPlane
from .._jsbsim import StartPose
from .._navigation import Navigation
from ..controller import attitude_quaternion
from ..x500 import X500Plant
from ._hil import Place

_SETTLING_S = 0.5


class Body:
    """The X500 by rotor, `samples_hz` times a second. Raises SetupError unless `controller_hz` divides that."""

    def __init__(self, simspec: SimSpec, samples_hz: int, controller_hz: int) -> None:
        origin, home = simspec.world.origin, simspec.vehicle.home
        self.plane = TangentPlane(origin.latitude_deg, origin.longitude_deg)
        self.frame = LocalFrame(self.plane, home.east_m, home.north_m)
        self.ground_m = origin.altitude_m
        self.heading_deg = home.heading_deg
        self.samples_hz = samples_hz
        self.plant = X500Plant(StartPose.of(simspec), 1.0 / samples_hz, samples_hz, cascade=False)
        # The legs give by 3 mm in the first tenth of a second, and until then nothing carries the aircraft: an
        # accelerometer would show free fall to an autopilot that takes its first samples for those of a still vehicle.
        for _ in range(round(_SETTLING_S * samples_hz)):
            self.plant.advance()
        self.navigation = Navigation(
            simspec.vehicle.gps, 1.0 / controller_hz, generator(simspec.seeds, "sensors")
        )
        self.home_e7 = self.frame.to_geodetic_e7(0.0, 0.0)

    def attitude(self) -> tuple[float, float, float, float]:
        motion = self.plant.motion
        w, x, y, z = attitude_quaternion(motion.roll_rad, motion.pitch_rad, motion.yaw_rad)
        return w, x, y, z

    def rates_radps(self) -> Vector:
        motion = self.plant.motion
        return motion.p_radps, motion.q_radps, motion.r_radps

    def velocity_ned_mps(self) -> Vector:
        motion = self.plant.motion
        return motion.vn_mps, motion.ve_mps, motion.vd_mps

    def altitude_m(self) -> float:
        """Above mean sea level."""
        return self.plant.motion.up_m + self.ground_m

    def place(self) -> Place:
        return self._place((0.0, 0.0, 0.0))

    def fix(self) -> Place:
        """What the receiver says: the last error of its fixes, at the present place."""
        return self._place(self.navigation.fix_error_enu_m)

    def seen_latitude_longitude_deg(self) -> tuple[float, float]:
        """Where the receiver sees the aircraft."""
        motion = self.plant.motion
        east_m, north_m, _ = self.navigation.fix_error_enu_m
        latitude, longitude = self.plane.geodetic_rad(motion.east_m + east_m, motion.north_m + north_m)
        return math.degrees(latitude), math.degrees(longitude)

    def _place(self, error_enu_m: Vector) -> Place:
        motion = self.plant.motion
        east_m, north_m, up_m = error_enu_m
        latitude_e7, longitude_e7 = self.plane.geodetic_e7(motion.east_m + east_m, motion.north_m + north_m)
        return Place(latitude_e7, longitude_e7, self.altitude_m() + up_m, self.velocity_ned_mps())
