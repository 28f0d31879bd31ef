"""The X500 in JSBSim: from setpoints to motion, with the cascade in the aircraft's XML. SI outside, JSBSim's units inside."""

from __future__ import annotations

import importlib.resources
import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import jsbsim

from bench.contracts import Vector
from bench.errors import Fault, SetupError, VehicleFault

from .._geodesy import TangentPlane

_FT = 0.3048
_OUTER_EVERY = 4  # execrate of the outer channel in x500.xml
_FEET_M = 0.1507  # height of the centre of gravity when the feet carry the weight
_MAX_THRUST_N = 8.5486
FULL_THRUST_N = 4.0 * _MAX_THRUST_N
HOVER_THRUST = 2.0643 * 9.81 / FULL_THRUST_N  # share of full thrust that carries the vehicle
ROTORS = ("front-right", "rear-left", "front-left", "rear-right")  # PX4's order, motors 1 to 4

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
    "position/from-start-neu-n-ft",
    "position/from-start-neu-e-ft",
)
_WANTED = ("target-roll-rad", "target-pitch-rad", "target-yaw-rad", "thrust-n")
_FORCES = tuple(f"accelerations/a-pilot-{axis}-ft_sec2" for axis in "xyz")


@dataclass(frozen=True, slots=True)
class Place:
    """Where the vehicle stands at the start; `altitude_m` is that of the ground above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    east_m: float = 0.0
    north_m: float = 0.0
    heading_rad: float = 0.0


@dataclass(slots=True)
class Motion:
    """Motion of the plant at one moment; ENU metres around the place's origin, attitude of body FRD against NED.

    `up_m` is that of the feet: 0 on the ground.
    """

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


class X500Plant:
    """One quadrotor standing at `place`, advanced by `step_s` at a time in steps of 1 / `physics_hz`.

    Raises SetupError when the step is not a whole number of physics steps.
    """

    def __init__(self, place: Place, step_s: float, physics_hz: int = 200) -> None:
        self.runs = round(step_s * physics_hz)
        if self.runs < 1 or abs(self.runs - step_s * physics_hz) > 1e-9:
            raise SetupError(
                Fault("controller_hz", f"{1 / step_s:g} Hz does not divide {physics_hz} Hz", "use 25, 50, 100 or 200")
            )
        self._plane = TangentPlane(place.latitude_deg, place.longitude_deg)
        self._ground_m = place.altitude_m + _FEET_M
        self._fdm = _load(place, self._plane, physics_hz)
        self._run: Callable[[], bool] = self._fdm.run
        self._get = [self._node(name).get_double_value for name in _READ]
        self._motors = [self._node(f"motor/{name}").get_double_value for name in ROTORS]
        self._force = [self._node(name).get_double_value for name in _FORCES]
        self._wanted = [self._node(f"ap/{name}").get_double_value for name in _WANTED]
        self._put = {name: self._node(f"ap/{name}").set_double_value for name in _WRITTEN}
        self._wind = [self._node(f"atmosphere/wind-{axis}-fps").set_double_value for axis in ("north", "east", "down")]
        self._gust = [self._node(f"atmosphere/gust-{axis}-fps").set_double_value for axis in ("north", "east", "down")]
        self._put["ground-m"](self._ground_m)
        self._put["outer-dt-s"](_OUTER_EVERY / physics_hz)
        self._written: dict[str, float] = {}
        self.motion = Motion()
        self.shift_ne_m = (0.0, 0.0)
        self._read()

    def write(self, name: str, value: float) -> None:
        """Set one of the properties that x500.xml lists under "target"; only changes cost anything."""
        if self._written.get(name) != value:
            self._written[name] = value
            self._put[name](value)

    def set_wind_ned_mps(self, wind: Vector) -> None:
        for put, value in zip(self._wind, wind, strict=True):
            put(value / _FT)

    def set_gust_ned_mps(self, gust: Vector) -> None:
        a, b, c = self._gust
        a(gust[0] / _FT)
        b(gust[1] / _FT)
        c(gust[2] / _FT)

    def thrust_n(self) -> list[float]:
        """Thrust of each rotor, in PX4's order."""
        return [_MAX_THRUST_N * get() ** 2 for get in self._motors]

    def specific_force_mps2(self) -> Vector:
        """What an accelerometer at the centre of gravity feels, body FRD; (0, 0, -9.81) at rest."""
        x, y, z = (get() * _FT for get in self._force)
        return x, y, z

    def rotor_commands(self) -> list[float]:
        """Speed of each rotor as a share of its greatest, 0 to 1."""
        return [get() for get in self._motors]

    def set_works(self, number: int, works: bool) -> None:
        """Let a rotor (by its place in ROTORS) turn as it is told, or not at all."""
        self.write(f"works-{ROTORS[number]}", 1.0 if works else 0.0)

    def wanted_attitude(self) -> tuple[float, float, float, float]:
        """Roll, pitch and yaw that the cascade steers to, radians; thrust as a share of all that the rotors can give."""
        roll, pitch, yaw, thrust_n = (get() for get in self._wanted)
        return roll, pitch, yaw, thrust_n / FULL_THRUST_N

    def advance(self) -> None:
        """Fly one step. Raises VehicleFault when the state is no longer finite."""
        run = self._run
        try:
            for _ in range(self.runs):
                run()
        except Exception as error:  # JSBSim has no exception of its own for a state that ran away
            raise VehicleFault(f"the flight dynamics stopped: {error}") from error
        self._read()

    def _read(self) -> None:
        (lat, lon, height, vn, ve, vd, phi, theta, psi, p, q, r, airspeed, start_n, start_e) = [get() for get in self._get]
        motion = self.motion
        motion.east_m, motion.north_m = east, north = self._plane.east_north_m(lat, lon)
        motion.up_m = height * _FT - self._ground_m
        motion.vn_mps, motion.ve_mps, motion.vd_mps = vn * _FT, ve * _FT, vd * _FT
        motion.roll_rad, motion.pitch_rad, motion.yaw_rad = phi, theta, psi
        motion.p_radps, motion.q_radps, motion.r_radps = p, q, r
        motion.airspeed_mps = airspeed * _FT
        # What the cascade measures from the start of the flight, against metres in the plane of the origin.
        self.shift_ne_m = (start_n * _FT - north, start_e * _FT - east)
        if not math.isfinite(east + north + motion.up_m + vn + ve + vd + phi + theta + psi + p + q + r):
            raise VehicleFault("the state of the flight dynamics is no longer finite")

    def _node(self, name: str) -> jsbsim.FGPropertyNode:
        node = self._fdm.get_property_manager().get_node(name, True)
        assert node is not None  # it is created when it is missing
        return node


_WRITTEN = (
    "flying",
    "armed",
    "position-mode",
    "height-mode",
    "target-n-m",
    "target-e-m",
    "target-u-m",
    "target-vn-mps",
    "target-ve-mps",
    "target-vu-mps",
    "target-an-mps2",
    "target-ae-mps2",
    "target-au-mps2",
    "tilt-mode",
    "thrust-mode",
    "rate-mode",
    "given-roll-rad",
    "given-pitch-rad",
    "given-thrust-n",
    "given-p-radps",
    "given-q-radps",
    "given-r-radps",
    "target-yaw-rad",
    "target-yawrate-radps",
    *(f"works-{name}" for name in ROTORS),
    "speed-max-mps",
    "climb-max-mps",
    "descent-max-mps",
    "accel-max-mps2",
    "tilt-max-rad",
    "ground-m",
    "outer-dt-s",
)


def _load(place: Place, plane: TangentPlane, physics_hz: int) -> jsbsim.FGFDMExec:
    """A fresh, silent JSBSim standing on the ground. Fresh, because a reset one does not repeat its first flight."""
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))  # holds for this thread alone
    with ExitStack() as stack:
        folder = stack.enter_context(importlib.resources.as_file(importlib.resources.files("vehicle_models")))
        fdm = jsbsim.FGFDMExec(str(folder))
        fdm.set_debug_level(0)
        fdm.set_dt(1.0 / physics_hz)
        fdm.set_aircraft_path(".")
        if not fdm.load_model("x500"):
            raise SetupError(Fault("x500.xml", "JSBSim does not take the aircraft", "reinstall the package"))
    fdm.disable_output()
    fdm["simulation/randomseed"] = 1  # nothing here draws from it; unseeded it would read the host's clock
    latitude, longitude = plane.geodetic_rad(place.east_m, place.north_m)
    fdm["ic/lat-geod-deg"], fdm["ic/long-gc-deg"] = math.degrees(latitude), math.degrees(longitude)
    fdm["ic/terrain-elevation-ft"] = place.altitude_m / _FT
    fdm["ic/h-agl-ft"] = _FEET_M / _FT
    fdm["ic/psi-true-deg"] = math.degrees(place.heading_rad)
    fdm["simulation/gravity-model"] = 1  # WGS84
    fdm["atmosphere/turb-type"] = 0
    fdm.run_ic()
    return fdm
