"""A vehicle without physics, for tests of everything around it: it stays at its home, or turns above it."""

from __future__ import annotations

import math
import socket
from collections.abc import Generator, Mapping
from contextlib import contextmanager

from bench.contracts import START, MavlinkTap, SimTime, VehicleCondition, VehiclePlan, VehicleState


class StillVehicle:
    """Stays at home, disarmed, `STILL_UP_M` above it and turning at `STILL_TURN_DEGPS`, with its gimbal turned to
    `STILL_PAN_DEG`, if it has one: parameters of the SimSpec, all 0 when absent.

    It has no socket, so messages that an agent claims to have sent never arrive.
    """

    def __init__(self, plan: VehiclePlan) -> None:
        self._plan = plan
        self._time = START
        # A port that the session reserved, or a free one: any user may bind it, unlike one below 1024.
        self._ports = {link.name: link.port or _free_udp_port() for link in plan.links}

    @property
    def time(self) -> SimTime:
        return self._time

    @property
    def step_s(self) -> float:
        return 1.0 / self._plan.controller_hz

    def endpoints(self) -> Mapping[str, str]:
        """Where an agent may listen; nothing ever comes."""
        return {name: f"udpin:127.0.0.1:{port}" for name, port in self._ports.items()}

    def receive(self) -> Mapping[str, int]:
        return {link.name: 0 for link in self._plan.links}

    def sent(self) -> Mapping[str, int]:
        return {link.name: 0 for link in self._plan.links}

    def step(self) -> None:
        self._time = self._time.after(self.step_s)

    def truth(self) -> VehicleState:
        vehicle = self._plan.simspec.vehicle
        home, turn_degps = vehicle.home, vehicle.parameters.get("STILL_TURN_DEGPS", 0.0)
        pan_deg = vehicle.parameters.get("STILL_PAN_DEG", 0.0)
        return VehicleState(
            time=self._time,
            position_enu_m=(home.east_m, home.north_m, vehicle.parameters.get("STILL_UP_M", 0.0)),
            velocity_enu_mps=(0.0, 0.0, 0.0),
            roll_rad=0.0,
            pitch_rad=0.0,
            yaw_rad=math.radians(home.heading_deg + turn_degps * self._time.s),
            rates_body_radps=(0.0, 0.0, math.radians(turn_degps)),
            camera_pan_rad=math.radians(pan_deg) if vehicle.camera.gimbal else None,
            camera_tilt_rad=math.radians(vehicle.camera.tilt_deg) if vehicle.camera.gimbal else None,
        )

    def estimate(self) -> VehicleState:
        return self.truth()

    def condition(self) -> VehicleCondition:
        return VehicleCondition(armed=False, landed=True, crashed=False, mode="STILL", battery_fraction=1.0)

    def counters(self) -> Mapping[str, int]:
        return {}


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def open_still_vehicle(plan: VehiclePlan, tap: MavlinkTap | None = None) -> Generator[StillVehicle]:
    """The entry point `still` of group rebar.vehicles."""
    yield StillVehicle(plan)
