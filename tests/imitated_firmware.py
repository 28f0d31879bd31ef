"""The bench's imitated autopilot as firmware: a program in the place of PX4 or ArduCopter that an agent can fly a mission with.

The stand-in of `firmware_stand_in` checks the physics link and keeps the vehicle in the air; modes, commands, telemetry and
missions are those of the bench's own flight controller, on the autopilot's own ports. So agents meet the autopilot that they
know, behind the path that a real one takes.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from firmware_stand_in import Pilot, State
from firmware_stand_in._ardupilot import fly_ardupilot
from firmware_stand_in._px4 import HELLO_S, fly_px4

from bench.contracts import LinkSpec, Vector, VehiclePlan
from bench.documents import validate_document
from bench.simspec import SimSpec
from vehicle_models._aircraft import Aircraft, Plant, SteeredAirframe
from vehicle_models._battery import BatteryModel
from vehicle_models._jsbsim import StartPose, VehicleMotion
from vehicle_models.controller import AUTOPILOTS, FlightTarget, open_links
from vehicle_models.x500 import HOVER_THRUST, ROTOR_ARM_M, ROTOR_TORQUE_M

CONTROLLER_HZ = 50
# By which the bench makes BATT_CAPACITY of its battery's energy, and its current of the power.
NOMINAL_V = 14.8
# Almost its defaults, with which it would have the vehicle's own battery: the real one's simulation has one of its own.
SITL_BATTERY = {"SIM_BAT_DRAIN": 60.001, "SIM_BAT_MIN_PCT": 50.0}
# As fast as the X500 of the bench turns.
TURN_MAX_RADPS = 1.0
# Positions come with rounding and with a receiver's error: below this it stands.
NEAR_GROUND_M = 0.03


def main() -> None:
    """Fly as the autopilot by whose name the program was started."""
    with ExitStack() as stack:
        if Path(sys.argv[0]).name == "px4":
            fly_px4(partial(_px4, stack))
        else:
            fly_ardupilot(partial(ImitatedArduPilot, stack))


class TruePlant:
    """The vehicle as the physics link shows it."""

    def __init__(self, state: State, place: StartPose) -> None:
        self._state, self._place = state, place
        self.motion = VehicleMotion()
        # The link shows no moments between its samples.
        self.halfway: tuple[float, ...] = ()
        self.advance()

    def advance(self) -> None:
        state, motion = self._state, self.motion
        motion.north_m, motion.east_m, down_m = state.position
        motion.up_m = 0.0 if -down_m < NEAR_GROUND_M else -down_m
        motion.vn_mps, motion.ve_mps, motion.vd_mps = state.velocity
        motion.roll_rad, motion.pitch_rad, motion.yaw_rad = state.euler()
        motion.p_radps, motion.q_radps, motion.r_radps = state.rates

    def set_wind_ned_mps(self, wind: Vector) -> None:
        """The wind is the bench's."""

    def set_gust_ned_mps(self, gust: Vector) -> None:
        """So are gusts."""

    def specific_force_mps2(self) -> Vector:
        return (0.0, 0.0, -9.81)

    def set_works(self, rotor: int, works: bool) -> None:
        """So are rotors that fail."""


class CrudeAirframe:
    """Turns targets of the flight controller into rotor speeds, in place of PX4's and ArduPilot's inner loops."""

    def __init__(self, state: State, step_s: float) -> None:
        self._state, self._step_s = state, step_s
        self._pilot = Pilot(ROTOR_ARM_M, ROTOR_TORQUE_M)
        self._armed = False
        self._target: FlightTarget | None = None
        self.error_enu_m: Vector = (0.0, 0.0, 0.0)

    def arm(self) -> None:
        self._armed = True
        self._pilot.heading_rad = self._state.euler()[2]

    def disarm(self) -> None:
        self._armed, self._target = False, None

    def rest(self) -> None:
        self._target = None
        self._pilot.heading_rad = self._state.euler()[2]

    def fly(self, target: FlightTarget) -> None:
        self._target = target
        turn_rad = target.yawrate_radps * self._step_s
        if target.yaw_rad is not None:
            turn_rad = math.remainder(target.yaw_rad - self._pilot.heading_rad, 2 * math.pi)
        limit_rad = TURN_MAX_RADPS * self._step_s
        self._pilot.heading_rad += min(max(turn_rad, -limit_rad), limit_rad)

    def rotors(self) -> list[float]:
        """Speeds for the present state, 0 to 1."""
        target = self._target
        if target is None:
            return [0.1 if self._armed else 0.0] * 4
        north, east, down = self._state.position
        north, east = north + self.error_enu_m[1], east + self.error_enu_m[0]
        velocity_n, velocity_e, velocity_d = target.velocity_ned_mps
        if target.north_east_m is not None:
            to_north, to_east = target.north_east_m[0] - north, target.north_east_m[1] - east
            share = min(1.0, target.speed_max_mps / max(1e-6, 0.8 * math.hypot(to_north, to_east)))
            velocity_n += 0.8 * share * to_north
            velocity_e += 0.8 * share * to_east
        if target.down_m is not None:
            climb = 1.0 * (target.down_m - down)
            velocity_d += min(max(climb, -target.climb_max_mps), target.descent_max_mps)
        return self._pilot.rotors_for(self._state, (velocity_n, velocity_e, velocity_d))

    def outputs(self) -> list[float]:
        return self.rotors()

    def commanded_attitude(self) -> tuple[float, float, float, float]:
        return (*self._state.euler(), HOVER_THRUST)

    def test_rotor(self, number: int, share: float) -> None:
        """Not part of any flight here."""

    def specific_force_mps2(self) -> Vector:
        return (0.0, 0.0, -9.81)


class Imitation(Aircraft):
    """The bench's flight controller on a vehicle that somebody else simulates."""

    autopilots = AUTOPILOTS
    hover_thrust = HOVER_THRUST
    rotors = 4

    def __init__(self, plan: VehiclePlan, links: list[Any], state: State) -> None:
        self._state = state
        super().__init__(plan, links)

    @property
    def armed(self) -> bool:
        return self._flight.armed

    @property
    def has_outputs(self) -> bool:
        """None in OFFBOARD on the ground, nor behind the end of a flight, as observed of PX4."""
        mode = self._flight.mode.name
        return mode != "TERMINATION" and (mode != "OFFBOARD" or self._plant.motion.up_m > 0.0)

    def rotor_speeds(self) -> list[float]:
        return self._crude.rotors()

    def _build(self, place: StartPose) -> tuple[Plant, SteeredAirframe]:
        self._crude = CrudeAirframe(self._state, self.step_s)
        return TruePlant(self._state, place), self._crude

    def _drain(self, battery: BatteryModel) -> None:
        """By the current that the link of ArduPilot tells; PX4's simulation drains by the clock."""
        battery.spend(self._state.amperes * NOMINAL_V, self.step_s)

    def _crashed(self, speed_before_mps: float) -> bool:
        return False


class ImitatedSide:
    """PX4's or ArduPilot's side of `firmware_stand_in`: built when the link has told where the vehicle stands."""

    def __init__(
        self,
        kind: str,
        parameters: Mapping[str, float],
        links: list[Any],
        specs: list[LinkSpec],
        state: State,
        rate_hz: int,
    ) -> None:
        battery = {name: parameters.get(name, value) for name, value in SITL_BATTERY.items()}
        self._parameters = battery if kind == "px4" else {}
        self._capacity_wh = parameters.get("BATT_CAPACITY", 3300.0) / 1000.0 * NOMINAL_V
        self._hello_s = HELLO_S if kind == "px4" else 0.0
        self._kind, self._links, self._specs, self._state = kind, links, specs, state
        self._every = rate_hz // CONTROLLER_HZ
        self._samples = 0
        self._has_all_ports = True
        self._imitation: Imitation | None = None

    @property
    def armed(self) -> bool:
        return self._imitation is not None and self._imitation.armed

    @property
    def has_outputs(self) -> bool:
        return self._imitation is None or self._imitation.has_outputs

    def rotors(self) -> list[float]:
        return self._imitation.rotor_speeds() if self._imitation else [0.0] * 4

    def serve(self) -> None:
        self._samples += 1
        if self._imitation is None:
            is_late = self._state.time_s < self._hello_s
            if is_late or not (self._state.latitude_deg and self._has_all_ports):
                return
            self._imitation = self._build_imitation()
        if self._samples % self._every == 0:
            self._imitation.receive()
            self._imitation.step()

    def _build_imitation(self) -> Imitation:
        state = self._state
        corners = [
            {"east_m": e, "north_m": n} for e, n in ((-9e3, -9e3), (9e3, -9e3), (9e3, 9e3), (-9e3, 9e3))
        ]
        origin = {
            "latitude_deg": state.latitude_deg,
            "longitude_deg": state.longitude_deg,
            "altitude_m": state.altitude_m,
        }
        document = {
            "name": "imitated-firmware",
            "world": {"area": {"corners": corners}, "origin": origin},
            "vehicle": {
                "autopilot": self._kind,
                "parameters": self._parameters,
                "battery": {"capacity_wh": self._capacity_wh},
            },
        }
        plan = VehiclePlan(validate_document(document, SimSpec), tuple(self._specs), CONTROLLER_HZ)
        return Imitation(plan, self._links, state)


class ImitatedArduPilot(ImitatedSide):
    def __init__(
        self, stack: ExitStack, instance: int, parameters: Mapping[str, float], state: State
    ) -> None:
        spec = LinkSpec("first", "tcp_in", port=5760 + 10 * instance)
        links = stack.enter_context(open_links((spec,)))
        while not links[0].connected():
            links[0].poll()
            time.sleep(0.001)
        super().__init__("ardupilot", parameters, links, [spec], state, int(parameters["SIM_RATE_HZ"]))
        self._instance, self._stack = instance, stack
        self._has_all_ports = False

    def open_other_ports(self) -> None:
        specs = [LinkSpec(f"tcp-{port}", "tcp_in", port=port + 10 * self._instance) for port in (5762, 5763)]
        self._links += self._stack.enter_context(open_links(tuple(specs)))
        self._specs += specs
        self._has_all_ports = True


def _px4(stack: ExitStack, instance: int, parameters: Mapping[str, float], state: State) -> ImitatedSide:
    specs = [
        LinkSpec("onboard", "udp_in", port=14580 + instance),
        LinkSpec("gcs", "udp_in", port=18570 + instance, streams="gcs"),
    ]
    links = stack.enter_context(open_links(tuple(specs)))
    return ImitatedSide("px4", parameters, links, specs, state, 200)
