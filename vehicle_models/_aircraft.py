"""One simulated aircraft with its flight controller, which together fulfil the `Vehicle` contract."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import ClassVar, Protocol

from bench.contracts import (
    CompanionSample,
    MavlinkTap,
    SimTime,
    Vector,
    Vehicle,
    VehicleCondition,
    VehiclePlan,
    VehicleState,
)
from bench.errors import SetupError
from bench.simspec import PluginAutopilot, RealAutopilot, generator

from ._battery import BatteryModel
from ._geodesy import LocalFrame, TangentPlane
from ._gusts import mean_wind_ned_mps
from ._jsbsim import StartPose, VehicleMotion
from ._linked_vehicle import LinkedVehicle
from ._navigation import Navigation
from .controller import (
    AUTOPILOTS,
    Airframe,
    Autopilot,
    Controller,
    Equipment,
    FlightState,
    Link,
    Manoeuvres,
    PersistentState,
    ReferencePoint,
    attitude_quaternion,
    open_links,
)
from .x500 import HOVER_THRUST, X500Airframe, X500Plant, has_crashed

_TOUCH_M = 0.02
# Far more than anything falls in a step of 40 ms.
_SPEED_MATTERS_BELOW_M = 50.0


@contextmanager
def open_x500(plan: VehiclePlan, tap: MavlinkTap | None = None) -> Iterator[Vehicle]:
    """Yield an X500 standing at home, its links open; where the SimSpec names a firmware, a real autopilot flies it.

    Raises SetupError for a link that cannot be opened or an unknown parameter.
    """
    if isinstance(plan.simspec.vehicle.autopilot, RealAutopilot | PluginAutopilot):
        # Imported only now: most sessions need neither processes nor a magnetic field.
        from .firmware import open_firmware_x500

        with open_firmware_x500(plan, tap) as vehicle:
            yield vehicle
        return
    with open_links(plan.links) as links:
        yield X500(plan, links, tap)


class Plant(Protocol):
    """What the vehicle needs of its flight dynamics."""

    halfway: tuple[float, ...]

    @property
    def motion(self) -> VehicleMotion: ...

    def set_wind_ned_mps(self, wind: Vector) -> None: ...

    def set_gust_ned_mps(self, gust: Vector) -> None: ...

    def advance(self) -> None: ...

    def specific_force_mps2(self) -> Vector: ...

    def set_works(self, rotor: int, works: bool) -> None:
        """Let a rotor (numbered from 0) turn as commanded, or stop it."""


class SteeredAirframe(Airframe, Protocol):
    """An airframe that steers by an estimate: the true position plus `error_enu_m`."""

    error_enu_m: Vector


class Aircraft(LinkedVehicle, ABC):
    """A `Vehicle`: JSBSim flies, gusts blow, the battery empties, the flight controller talks MAVLink.

    Each kind of aircraft defines its plant, what steers it, which autopilots it can carry, and what it does
    not survive.
    """

    autopilots: ClassVar[Mapping[str, Autopilot]] = AUTOPILOTS
    manoeuvres: ClassVar[Manoeuvres] = Manoeuvres()
    hover_thrust: ClassVar[float]  # share of full thrust that carries it, or keeps it at its speed
    rotors: ClassVar[int]

    def __init__(self, plan: VehiclePlan, links: list[Link], tap: MavlinkTap | None = None) -> None:
        super().__init__(plan, links, tap)
        simspec = plan.simspec
        origin, home = simspec.world.origin, simspec.vehicle.home
        self._plane = TangentPlane(origin.latitude_deg, origin.longitude_deg)
        self._frame = LocalFrame(self._plane, home.east_m, home.north_m)
        self._ground_m = origin.altitude_m
        place = StartPose.of(simspec)
        self._plant, self._airframe = self._build(place)
        self._plant.set_wind_ned_mps(mean_wind_ned_mps(self._wind))
        self._navigation = Navigation(simspec.vehicle.gps, self.step_s, generator(simspec.seeds, "sensors"))
        self._autopilot = self._find_autopilot(simspec.vehicle.autopilot)
        # Simulated time at the flight controller's last start, which may lie before the session.
        self._booted_ns = -round(self._autopilot.modes.booted_s * 1e9)
        self._start_us = round(simspec.environment.start_utc.timestamp() * 1e6)
        self._parameters = simspec.vehicle.parameters
        self._flight = self._cold_flight()
        self._sense()
        self._failures = self._failures_of(plan, self._navigation, self.rotors, self._plant.set_works)
        truth = self._hil_state if simspec.vehicle.ground_truth else None
        self._equipment = Equipment(
            simspec.vehicle.camera,
            truth,
            self._failures.break_part,
            simspec.vehicle.simulation_control,
            plan.companion_topics,
        )
        self._controller = self._boot(None)

    def record_exposure(self, frame: int, time: SimTime) -> None:
        """The scene has made frame number `frame` of this vehicle's camera."""
        self._controller.record_exposure(frame)

    def take_samples(self, samples: Sequence[CompanionSample]) -> None:
        if topics := self._controller.topics:
            topics.inbox.extend(samples)

    def published_samples(self) -> list[CompanionSample]:
        return topics.take_published() if (topics := self._controller.topics) else []

    def step(self) -> None:
        self._failures.apply(self.time.ns)
        self._controller.control()
        self._apply_gusts()
        # What hits the ground within this step is near it now.
        near_ground = self._plant.motion.up_m < _SPEED_MATTERS_BELOW_M
        falling_mps = self._speed_mps() if near_ground else 0.0
        self._plant.advance()
        self.time = SimTime(self.time.ns + self._step_ns)
        self._update_battery()
        self._navigation.step()
        self._sense()
        if self._crashed(falling_mps):
            self._controller.crash()
        self._controller.report()
        # Now, not as the next step begins: inboxes fill between steps, and who answers the acknowledgement is heard.
        if self._controller.restart_requested:
            self._restart()

    def truth(self) -> VehicleState:
        return self._vehicle_state((0.0, 0.0, 0.0), (0.0, 0.0))

    def estimate(self) -> VehicleState:
        return self._vehicle_state(self._navigation.error_enu_m, self._navigation.velocity_error_en_mps)

    def condition(self) -> VehicleCondition:
        flight = self._flight
        landed = not flight.flying and flight.on_ground
        return VehicleCondition(
            flight.armed,
            landed,
            flight.crashed,
            flight.mode.name,
            flight.charge_fraction,
            flight.failsafe.value if flight.failsafe else "",
            self._failures.active,
        )

    def commands(self) -> frozenset[int]:
        """Numbers of the MAVLink commands that its flight controller carries out, with its equipment."""
        return self._controller.commands()

    def changed_parameters(self) -> Mapping[str, float]:
        """What a client or the SimSpec has set, by name."""
        return self._controller.changed_parameters()

    def counters(self) -> Mapping[str, int]:
        return self._controller.counters()

    def _cold_flight(self) -> FlightState:
        """The state of a flight controller that starts at the present moment."""
        latitude_e7, longitude_e7 = self._frame.to_geodetic_e7(0.0, 0.0)
        return FlightState(
            step_s=self.step_s,
            origin=ReferencePoint(latitude_e7, longitude_e7, self._ground_m),
            mode=self._autopilot.modes.initial,
            dead_reckoning_ns=round(self._autopilot.safety.dead_reckoning_s * 1e9),
            hover_thrust=self.hover_thrust,
            unix_start_us=self._start_us + self._booted_ns // 1000,
        )

    def _boot(self, persistent: PersistentState | None) -> Controller:
        return Controller(
            self._autopilot,
            self._flight,
            self._airframe,
            self._frame,
            self._links,
            self._parameters,
            self._tap,
            self.manoeuvres,
            self._equipment,
            persistent,
        )

    def _restart(self) -> None:
        """Start a new flight controller on the same aircraft and links; waiting messages are lost."""
        persistent, crashed = self._controller.persistent_state(), self._flight.crashed
        previous = self._controller
        self._airframe.disarm()
        for link in self._links:
            link.inbox.clear()
        self._booted_ns = self.time.ns
        self._flight = self._cold_flight()
        self._flight.crashed = crashed
        self._sense()
        self._controller = self._boot(persistent)
        self._controller.continue_from(previous)

    def _apply_gusts(self) -> None:
        if not self._gusts.calm:
            motion = self._plant.motion
            self._plant.set_gust_ned_mps(self._gusts.step(motion.up_m, motion.airspeed_mps))

    def _hil_state(self) -> tuple[float, ...]:
        """HIL_STATE_QUATERNION in wire order: the true motion."""
        motion = self._plant.motion
        latitude_e7, longitude_e7 = self._plane.geodetic_e7(motion.east_m, motion.north_m)
        altitude_mm = round((motion.up_m + self._ground_m) * 1000.0)
        speeds = (round(axis * 100.0) for axis in (motion.vn_mps, motion.ve_mps, motion.vd_mps))
        airspeed = min(round(motion.airspeed_mps * 100.0), 65535)
        forces = (
            round(min(max(axis / 9.80665 * 1000.0, -32768.0), 32767.0))
            for axis in self._plant.specific_force_mps2()
        )
        attitude = attitude_quaternion(motion.roll_rad, motion.pitch_rad, motion.yaw_rad)
        rates = (motion.p_radps, motion.q_radps, motion.r_radps)
        head = (self._flight.time_us, *attitude, *rates, latitude_e7, longitude_e7, altitude_mm)
        return (*head, *speeds, airspeed, airspeed, *forces)

    def _update_battery(self) -> None:
        self._drain(self._battery)
        if self._battery.fraction <= 0.0:
            # Nothing turns without power, whatever the flight controller commands.
            self._airframe.disarm()

    def _speed_mps(self) -> float:
        motion = self._plant.motion
        return math.sqrt(motion.vn_mps**2 + motion.ve_mps**2 + motion.vd_mps**2)

    @abstractmethod
    def _build(self, place: StartPose) -> tuple[Plant, SteeredAirframe]:
        """The plant standing at `place`, and what steers it."""

    @abstractmethod
    def _drain(self, battery: BatteryModel) -> None:
        """Take the energy of one step from the battery."""

    @abstractmethod
    def _crashed(self, speed_before_mps: float) -> bool:
        """Whether the last step broke the airframe; `speed_before_mps` is the speed before it."""

    def _find_autopilot(self, name: str | RealAutopilot | PluginAutopilot) -> Autopilot:
        if isinstance(name, RealAutopilot | PluginAutopilot):
            what = "real autopilots fly the model x500 alone"
            raise SetupError("vehicle.autopilot", what, "use it, or an imitation")
        if name not in self.autopilots:
            what = f"this aircraft does not carry {name!r}"
            raise SetupError("vehicle.autopilot", what, f"use {', '.join(self.autopilots)}")
        return self.autopilots[name]

    def _sense(self) -> None:
        """Write estimate and sensor readings into the state that the services read."""
        flight, motion, frame = self._flight, self._plant.motion, self._frame
        # The estimate is the truth plus the navigation error, and all that the services ever see.
        error = self._airframe.error_enu_m = self._navigation.error_enu_m
        east, north, up = motion.east_m + error[0], motion.north_m + error[1], motion.up_m + error[2]
        flight.time_ns = self.time.ns - self._booted_ns
        if self._navigation.off == flight.gps_ok:
            flight.gps_lost_ns = flight.time_ns if self._navigation.off else None
        flight.east_m, flight.north_m = east - frame.home_east_m, north - frame.home_north_m
        flight.down_m = -up
        flight.latitude_e7, flight.longitude_e7 = self._plane.geodetic_e7(east, north)
        flight.altitude_m = up + self._ground_m
        if flight.gps_epoch != self._navigation.fixes:
            flight.gps_epoch = self._navigation.fixes
            fix = self._navigation.fix_error_enu_m
            flight.fix_e7 = self._plane.geodetic_e7(motion.east_m + fix[0], motion.north_m + fix[1])
            flight.fix_altitude_m = motion.up_m + fix[2] + self._ground_m
            flight.fix_us = flight.time_us
        error_ve, error_vn = self._navigation.velocity_error_en_mps
        flight.vn_mps, flight.ve_mps = motion.vn_mps + error_vn, motion.ve_mps + error_ve
        flight.vd_mps = motion.vd_mps
        flight.roll_rad, flight.pitch_rad = motion.roll_rad, motion.pitch_rad
        flight.yaw_rad = _signed_heading(motion.yaw_rad)
        flight.p_radps, flight.q_radps, flight.r_radps = motion.p_radps, motion.q_radps, motion.r_radps
        flight.halfway = self._plant.halfway
        flight.airspeed_mps = motion.airspeed_mps
        flight.on_ground = motion.up_m < _TOUCH_M
        battery = self._battery
        flight.charge_fraction, flight.battery_used_wh = battery.fraction, battery.used_wh
        flight.battery_v, flight.battery_a = battery.terminals()

    def _vehicle_state(self, error: Vector, velocity_error_en_mps: tuple[float, float]) -> VehicleState:
        motion = self._plant.motion
        error_ve, error_vn = velocity_error_en_mps
        return VehicleState(
            time=self.time,
            position_enu_m=(motion.east_m + error[0], motion.north_m + error[1], motion.up_m + error[2]),
            velocity_enu_mps=(motion.ve_mps + error_ve, motion.vn_mps + error_vn, -motion.vd_mps),
            roll_rad=motion.roll_rad,
            pitch_rad=motion.pitch_rad,
            yaw_rad=_signed_heading(motion.yaw_rad),
            rates_body_radps=(motion.p_radps, motion.q_radps, motion.r_radps),
            camera_pan_rad=self._flight.camera_pan_rad,
            camera_tilt_rad=self._flight.camera_tilt_rad,
        )


class X500(Aircraft):
    """The quadrotor."""

    hover_thrust = HOVER_THRUST
    rotors = 4

    def _build(self, place: StartPose) -> tuple[Plant, SteeredAirframe]:
        self._x500 = X500Plant(place, self.step_s)
        return self._x500, X500Airframe(self._x500, self._frame, self.step_s)

    def _drain(self, battery: BatteryModel) -> None:
        battery.drain(self._x500.thrust_n(), self.step_s)

    def _crashed(self, speed_before_mps: float) -> bool:
        return has_crashed(self._plant.motion, speed_before_mps)


def _signed_heading(yaw_rad: float) -> float:
    """JSBSim's heading, 0 to 2 pi, as autopilots state it: -pi to pi."""
    return yaw_rad - 2.0 * math.pi if yaw_rad > math.pi else yaw_rad
