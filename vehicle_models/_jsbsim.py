"""One aircraft in JSBSim, loaded from its file in this package. Setters and motion are in SI units."""

from __future__ import annotations

import importlib.resources
import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Self

import jsbsim

from bench.contracts import Vector
from bench.errors import SetupError, VehicleFault
from bench.simspec import SimSpec

from ._geodesy import TangentPlane

_FT = 0.3048
_READ = (
    "position/lat-geod-rad",
    "position/long-gc-rad",
    "position/h-sl-ft",
    "velocities/v-north-fps",
    "velocities/v-east-fps",
    "velocities/v-down-fps",
    "attitude/phi-rad",
    "attitude/theta-rad",
    "attitude/psi-rad",
    "velocities/p-rad_sec",
    "velocities/q-rad_sec",
    "velocities/r-rad_sec",
    "velocities/vt-fps",
)


@dataclass(frozen=True, slots=True)
class StartPose:
    """Where the vehicle is at the start; `altitude_m` is that of the ground above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    east_m: float = 0.0
    north_m: float = 0.0
    heading_rad: float = 0.0

    @classmethod
    def of(cls, simspec: SimSpec) -> Self:
        """At the home of the SimSpec's vehicle."""
        origin, home = simspec.world.origin, simspec.vehicle.home
        heading_rad = math.radians(home.heading_deg)
        place = (origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
        return cls(*place, home.east_m, home.north_m, heading_rad)


@dataclass(slots=True)
class VehicleMotion:
    """Motion of the plant: ENU metres around the origin (the feet's), attitude of body FRD against NED."""

    east_m: float = 0.0
    north_m: float = 0.0
    up_m: float = 0.0
    vn_mps: float = 0.0
    ve_mps: float = 0.0
    vd_mps: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    p_radps: float = 0.0
    q_radps: float = 0.0
    r_radps: float = 0.0
    airspeed_mps: float = 0.0


class JsbsimPlant:
    """The aircraft `name` standing at `place`, its centre of gravity `feet_m` high, advanced by `step_s` at a
    time.

    Raises SetupError when the step is not a whole number of physics steps.
    """

    def __init__(
        self, name: str, place: StartPose, feet_m: float, step_s: float, physics_hz: int = 200
    ) -> None:
        self.runs = round(step_s * physics_hz)
        if self.runs < 1 or abs(self.runs - step_s * physics_hz) > 1e-9:
            what = f"{1 / step_s:g} Hz does not divide {physics_hz} Hz"
            raise SetupError("controller_hz", what, "use 25, 50, 100 or 200")
        self._plane = TangentPlane(place.latitude_deg, place.longitude_deg)
        self._ground_m = place.altitude_m + feet_m
        self._fdm = _load(name, place, self._plane, feet_m, physics_hz)
        self._run: Callable[[], bool] = self._fdm.run
        self._getters = [self.node(read).get_double_value for read in _READ]
        self._force = [self.node(f"accelerations/a-pilot-{axis}-ft_sec2").get_double_value for axis in "xyz"]
        self._setters: dict[str, Callable[[float], object]] = {}  # of what has been written
        self._wind, self._gust = (
            [self.node(f"atmosphere/{air}-{axis}-fps").set_double_value for axis in ("north", "east", "down")]
            for air in ("wind", "gust")
        )
        self._turns = self._getters[6:12]
        self.motion = VehicleMotion()
        # Roll, pitch, yaw and body rates in the middle of the last step; empty where a step is one of physics.
        self.halfway: tuple[float, ...] = ()
        self._read()

    def write(self, name: str, value: float) -> None:
        """Set one of the properties under `ap/` that the aircraft file lists under "target"; KeyError for any other."""
        put = self._setters.get(name)
        if put is None:
            put = self._setters[name] = self.node(f"ap/{name}", create=False).set_double_value
        put(value)

    def set_wind_ned_mps(self, wind: Vector) -> None:
        for put, value in zip(self._wind, wind, strict=True):
            put(value / _FT)

    def set_gust_ned_mps(self, gust: Vector) -> None:
        put_north, put_east, put_down = self._gust
        north, east, down = gust
        put_north(north / _FT)
        put_east(east / _FT)
        put_down(down / _FT)

    def specific_force_mps2(self) -> Vector:
        """What an accelerometer at the centre of gravity feels, body FRD; (0, 0, -9.81) at rest."""
        x, y, z = self._force
        return x() * _FT, y() * _FT, z() * _FT

    def advance(self) -> None:
        """Fly one step. Raises VehicleFault when the state is no longer finite."""
        run, middle = self._run, self.runs // 2
        try:
            for _ in range(middle):
                run()
            if middle:
                self.halfway = tuple([get() for get in self._turns])
            for _ in range(self.runs - middle):
                run()
        except Exception as error:
            # JSBSim has no exception class of its own for a state that diverges.
            raise VehicleFault(f"the flight dynamics stopped: {error}") from error
        self._read()

    def node(self, name: str, create: bool = True) -> jsbsim.FGPropertyNode:
        """A property of JSBSim. Raises KeyError for one that is missing and not to be created."""
        node = self._fdm.get_property_manager().get_node(name, create)
        if node is None:
            raise KeyError(name)
        return node

    def _read(self) -> None:
        (lat, lon, height, vn, ve, vd, phi, theta, psi, p, q, r, airspeed) = [get() for get in self._getters]
        motion = self.motion
        motion.east_m, motion.north_m = east, north = self._plane.east_north_m(lat, lon)
        motion.up_m = height * _FT - self._ground_m
        motion.vn_mps, motion.ve_mps, motion.vd_mps = vn * _FT, ve * _FT, vd * _FT
        motion.roll_rad, motion.pitch_rad, motion.yaw_rad = phi, theta, psi
        motion.p_radps, motion.q_radps, motion.r_radps = p, q, r
        motion.airspeed_mps = airspeed * _FT
        # One sum finds a NaN or an infinity in any of them.
        if not math.isfinite(east + north + motion.up_m + vn + ve + vd + phi + theta + psi + p + q + r):
            raise VehicleFault("the state of the flight dynamics is no longer finite")


def _load(
    name: str, place: StartPose, plane: TangentPlane, feet_m: float, physics_hz: int
) -> jsbsim.FGFDMExec:
    """A silent JSBSim standing on the ground; fresh, because a reset one does not repeat its first flight."""
    # The logger holds for the present thread alone, so it is set for every aircraft.
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))
    with ExitStack() as stack:
        folder = stack.enter_context(importlib.resources.as_file(importlib.resources.files("vehicle_models")))
        fdm = jsbsim.FGFDMExec(str(folder))
        fdm.set_debug_level(0)
        fdm.set_dt(1.0 / physics_hz)
        fdm.set_aircraft_path(".")
        if not fdm.load_model(name):
            raise SetupError(f"{name}.xml", "JSBSim does not take the aircraft", "reinstall the package")
    fdm.disable_output()
    # Nothing here draws random numbers from JSBSim, but without a seed it reads the host's clock.
    fdm["simulation/randomseed"] = 1
    latitude, longitude = plane.geodetic_rad(place.east_m, place.north_m)
    fdm["ic/lat-geod-deg"], fdm["ic/long-gc-deg"] = math.degrees(latitude), math.degrees(longitude)
    fdm["ic/terrain-elevation-ft"] = place.altitude_m / _FT
    fdm["ic/h-agl-ft"] = feet_m / _FT
    fdm["ic/psi-true-deg"] = math.degrees(place.heading_rad)
    # WGS84
    fdm["simulation/gravity-model"] = 1
    fdm["atmosphere/turb-type"] = 0
    fdm.run_ic()
    return fdm
