"""A MAVLink client in lockstep with one vehicle: it sends, lets time pass, and keeps what it receives."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from fastcrc.crc16 import mcrf4xx

from bench.contracts import LinkSpec, MavlinkTap, Vehicle, VehiclePlan
from bench.simspec import SimSpec
from vehicle_models import TangentPlane, open_x500
from vehicle_models.controller.links._dialect import dialect

NAN = math.nan
mavlink = dialect


def simspec(autopilot: str = "px4", **changes: Any) -> SimSpec:
    """A bare SimSpec, in which clients may do what a SITL lets them; `changes` are the documents vehicle, environment,
    seeds.
    """
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (300, 0), (300, 300))]
    vehicle = {
        "autopilot": autopilot,
        "gps": {"wander_m": 0.0, "noise_m": 0.0},
        "simulation_control": True,
        **changes.pop("vehicle", {}),
    }
    return SimSpec.model_validate(
        {"name": "test", "world": {"area": {"corners": corners}}, "vehicle": vehicle, **changes}
    )


def of(kind: str, messages: Iterable[Any]) -> list[Any]:
    """The messages of one kind."""
    return [message for message in messages if message.get_type() == kind]


class Heard:
    """A packet that came, decoded when a field of it is looked at: of most there never is."""

    __slots__ = ("_kind", "_mav", "_message", "_packet")

    def __init__(self, mav: Any, kind: Any, packet: bytes) -> None:
        self._mav, self._kind, self._packet, self._message = mav, kind, packet, None

    def get_type(self) -> str:
        return str(self._kind.msgname)

    def __getattr__(self, name: str) -> Any:
        if self._message is None:
            self._message = self._mav.decode(bytearray(self._packet))
        return getattr(self._message, name)


class Client:
    """The other end of a `udp_out` link. `fly` steps the vehicle and collects every received message."""

    def __init__(self, system: int = 245, component: int = 190) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.received: list[Any] = []
        self.raw = b""
        self.peer: tuple[str, int] | None = None
        self.is_station = False  # beats once a second, as a ground station
        self._beat_s = -1.0
        self.vehicle: Vehicle

    def send(self, message: Any) -> None:
        self.send_bytes(bytes(message.pack(self.mav)))

    def send_bytes(self, data: bytes) -> None:
        assert self.peer, "let the vehicle speak first"
        self.socket.sendto(data, self.peer)

    def command(self, number: int, *params: float) -> list[int]:
        """Send a COMMAND_LONG, let one step pass, and return the results acknowledged."""
        padded = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        return [answer.result for answer in of("COMMAND_ACK", self.fly(0.02)) if answer.command == number]

    def command_int(self, number: int, frame: int, *params: float) -> list[int]:
        self.send(mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *params))
        return [answer.result for answer in of("COMMAND_ACK", self.fly(0.02)) if answer.command == number]

    def ask_for(self, name: str, hz: float = 10.0) -> None:
        """Messages of this name, so often."""
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        assert self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hz) == [0]

    def reposition(
        self, east_m: float, north_m: float, altitude_m: float, frame: int = 0, speed_mps: float = -1.0
    ) -> list[int]:
        """DO_REPOSITION to a place so far from home, whose height is above the sea in frame 0, above home in frame 6."""
        place = (*self.vehicle_goal(east_m, north_m), altitude_m)
        return self.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, speed_mps, 1, 0, NAN, *place)

    def beat(self) -> None:
        """The heartbeat of a ground station."""
        self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3))

    def put(self, **parameters: float) -> None:
        """Set parameters that are floats."""
        for name, value in parameters.items():
            self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))

    def setpoint(
        self, north: float, east: float, down: float, mask: int = 2552, frame: int = 1, **more: float
    ) -> None:
        v = (more.get("vn", 0.0), more.get("ve", 0.0), more.get("vd", 0.0))
        yaw = (more.get("yaw", 0.0), more.get("yawrate", 0.0))
        message = mavlink.MAVLink_set_position_target_local_ned_message
        self.send(message(0, 1, 1, frame, mask, north, east, down, *v, 0, 0, 0, *yaw))

    def fly(self, seconds: float, each: Callable[[], None] | None = None) -> list[Any]:
        """Let time pass, calling `each` ten times a second; returns the messages received meanwhile."""
        begun = len(self.received)
        for step in range(round(seconds * 50)):
            if each and step % 5 == 0:
                each()
            if self.is_station and self.peer and self.vehicle.time.s >= self._beat_s + 1.0:
                self._beat_s = self.vehicle.time.s
                self.beat()
            self.vehicle.receive()
            self.vehicle.step()
            self._listen()
        return self.received[begun:]

    def _listen(self) -> None:
        while True:
            try:
                data, self.peer = self.socket.recvfrom(65535)
            except BlockingIOError:
                return
            self.raw += data
            self.received += self._split(data)

    def _split(self, datagram: bytes) -> Iterator[Heard]:
        """The packets of a datagram, which holds whole ones; fails where pymavlink would not take one."""
        while datagram:
            is_second = datagram[0] == 0xFD
            assert is_second or datagram[0] == 0xFE, datagram
            end = datagram[1] + (10 if is_second else 6)
            number = int.from_bytes(datagram[7:10], "little") if is_second else datagram[5]
            kind = mavlink.mavlink_map[number]
            checksum = mcrf4xx(datagram[1:end] + bytes([kind.crc_extra]))
            assert datagram[end : end + 2] == checksum.to_bytes(2, "little"), kind.msgname
            end += 15 if is_second and datagram[2] & 1 else 2
            yield Heard(self.mav, kind, datagram[:end])
            datagram = datagram[end:]

    def vehicle_goal(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Latitude and longitude (1e-7 degree) so far from home."""
        home = self.last("HOME_POSITION")
        return TangentPlane(home.latitude * 1e-7, home.longitude * 1e-7).geodetic_e7(east_m, north_m)

    def learn_home(self) -> None:
        """Ask for home, which an ArduCopter has told before anybody was there."""
        assert self.command(mavlink.MAV_CMD_GET_HOME_POSITION) == [0]

    def last(self, name: str) -> Any:
        return next(message for message in reversed(self.received) if message.get_type() == name)

    def state(self) -> tuple[str, str]:
        """Mode and failsafe."""
        condition = self.vehicle.condition()
        return condition.mode, condition.failsafe

    def texts(self) -> list[str]:
        return [message.text for message in of("STATUSTEXT", self.received)]

    def airborne(self, height_m: float = 10.0) -> None:
        """Arm a PX4, take off, wait until it holds."""
        self.fly(5.0)
        assert self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        altitude = 488.0 + height_m
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, altitude) == [0]
        for _ in range(50):
            self.fly(0.5)
            if self.vehicle.condition().mode == "AUTO_LOITER":
                break
        self.fly(1.0)
        assert self.vehicle.condition().mode == "AUTO_LOITER"

    def guided(
        self,
        height_m: float = 10.0,
        risen_s: float = 11.0,
        each: Callable[[], None] | None = None,
    ) -> None:
        """Arm an ArduCopter in GUIDED, take off; `each` as in `fly`."""
        self.learn_home()
        assert self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == [0]
        assert self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m) == [0]
        self.fly(risen_s, each)

    def offboard(self, north: float, east: float, down: float) -> None:
        """Enter OFFBOARD with a position setpoint."""
        self.setpoint(north, east, down)
        self.fly(0.1)
        self.setpoint(north, east, down)
        assert self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == [0, 0]
        assert self.vehicle.condition().mode == "OFFBOARD"


Make = Callable[..., Client]


@pytest.fixture
def make() -> Iterator[Make]:
    """Build a client and the vehicle that talks to it; both are closed when the test ends."""
    with ExitStack() as stack:

        def build(
            spec: SimSpec | None = None,
            streams: str = "none",
            tap: MavlinkTap | None = None,
            system: int = 245,
            companion_topics: bool = False,
        ) -> Client:
            client = Client(system)
            # PX4 sends its texts to ground stations alone.
            client.is_station = spec is None or spec.vehicle.autopilot == "px4"
            stack.callback(client.socket.close)
            link = LinkSpec("onboard", "udp_out", port=client.port, streams=streams)
            plan = VehiclePlan(spec or simspec(), (link,), companion_topics=companion_topics)
            client.vehicle = stack.enter_context(open_x500(plan, tap))
            client.fly(1.1)
            return client

        yield build


@pytest.fixture
def px4(make: Make) -> Client:
    """A PX4 at 10 m, which sends what it is asked for alone."""
    client = make()
    client.airborne()
    client.learn_home()
    return client


@pytest.fixture
def copter(make: Make) -> Client:
    """An ArduCopter in GUIDED at 10 m."""
    client = make(simspec("ardupilot"), streams="onboard", system=255)
    client.guided()
    return client
