"""Links: several clients, clients that misbehave, and the counts that a lockstep session relies on."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import simspec

from bench.contracts import LinkSpec, Vehicle, VehiclePlan
from bench.errors import SetupError
from vehicle_models import open_x500
from vehicle_models.controller.links._link import INBOX_FRAMES
from vehicle_models.controller.links._links import BACKLOG_BYTES
from vehicle_models.controller.links._radio import MESSAGES_PER_STEP


def beat(system: int = 255) -> bytes:
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mav))


@contextmanager
def flown(*links: LinkSpec, autopilot: str = "px4") -> Iterator[Vehicle]:
    with open_x500(VehiclePlan(simspec(autopilot), links)) as vehicle:
        yield vehicle


@contextmanager
def tcp_client(vehicle: Vehicle, name: str = "serial0") -> Iterator[socket.socket]:
    _, host, port = vehicle.endpoints()[name].split(":")
    with socket.create_connection((host, int(port))) as client:
        client.setblocking(False)
        yield client


def run(vehicle: Vehicle, steps: int) -> None:
    for _ in range(steps):
        vehicle.receive()
        vehicle.step()


def read(client: socket.socket) -> bytes:
    data = b""
    while True:
        try:
            more = client.recv(1 << 20)
        except BlockingIOError:
            return data
        if not more:
            return data
        data += more


def test_tcp_serves_several_clients_the_same_bytes() -> None:
    """Nothing is sent or counted without a client; two clients then receive the same."""
    with flown(LinkSpec("serial0", "tcp_in")) as vehicle:
        run(vehicle, 60)
        assert vehicle.sent() == {"serial0": 0}
        with tcp_client(vehicle) as first, tcp_client(vehicle) as second:
            run(vehicle, 100)
            data = read(first)
            assert len(data) > 1000
            assert data == read(second)
            first.sendall(beat() + beat())
            second.sendall(beat())
            assert vehicle.receive() == {"serial0": 3}


def test_a_client_that_stops_reading_is_dropped() -> None:
    """It costs bounded memory and no other client's data; the drop is counted."""
    with (
        flown(LinkSpec("serial0", "tcp_in")) as vehicle,
        tcp_client(vehicle) as greedy,
        tcp_client(vehicle) as silent,
    ):
        silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        data = 0
        while vehicle.counters()["mavlink_dropped"] == 0:
            run(vehicle, 500)
            data += len(read(greedy))
            assert vehicle.time.s < 1000.0
        assert data > BACKLOG_BYTES
        run(vehicle, 50)
        assert read(greedy)


def test_a_flood_is_bounded_and_garbage_is_counted() -> None:
    """Five thousand datagrams of rubbish and as many heartbeats: what is taken is counted, and bounded; time
    goes on.
    """
    with (
        flown(LinkSpec("air", "udp_in")) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        _, host, port = vehicle.endpoints()["air"].split(":")
        for _ in range(100):
            for _ in range(50):
                client.sendto(b"\xfd\x09rubbish", (host, int(port)))
                client.sendto(beat(), (host, int(port)))
            vehicle.receive()
        vehicle.step()
        counters = vehicle.counters()
        assert INBOX_FRAMES <= vehicle.receive()["air"] <= INBOX_FRAMES + MESSAGES_PER_STEP
        assert INBOX_FRAMES * 9 <= counters["mavlink_garbage_bytes"] <= 5000 * 9
        assert counters["mavlink_dropped"] > 1000
        assert vehicle.time.ns == 20_000_000


def test_udp_in_answers_every_peer_that_has_sent() -> None:
    """Silent until a peer sends something; then that peer receives, and its message is counted once."""
    with (
        flown(LinkSpec("air", "udp_in")) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        client.setblocking(False)
        run(vehicle, 60)
        assert vehicle.sent() == {"air": 0}
        _, host, port = vehicle.endpoints()["air"].split(":")
        client.sendto(beat(), (host, int(port)))
        run(vehicle, 60)
        assert vehicle.sent()["air"] > 50
        assert client.recv(65535)[0] == 0xFD


def test_messages_for_others_are_forwarded_between_links() -> None:
    """A heartbeat on one link shows on the other as it was; what is for the vehicle alone does not."""
    with (
        flown(LinkSpec("a", "udp_in", streams="none"), LinkSpec("b", "udp_in", streams="none")) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        second.setblocking(False)
        ports = {name: int(end.split(":")[2]) for name, end in vehicle.endpoints().items()}
        second.sendto(beat(7), ("127.0.0.1", ports["b"]))
        run(vehicle, 1)
        mav = mavlink.MAVLink(None, srcSystem=9, srcComponent=8)
        private = bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"MAV_TYPE", -1).pack(mav))
        other = bytes(
            mavlink.MAVLink_command_long_message(
                77, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0
            ).pack(mav)
        )
        first.sendto(beat(9) + private + other, ("127.0.0.1", ports["a"]))
        run(vehicle, 1)
        assert second.recv(65535) == beat(9)  # nobody has ever heard of system 77 there
        second.sendto(beat(77), ("127.0.0.1", ports["b"]))
        run(vehicle, 1)
        first.sendto(private + other, ("127.0.0.1", ports["a"]))
        run(vehicle, 1)
        assert second.recv(65535) == other


def test_the_tap_has_both_directions_whole() -> None:
    """The tap has what the client sent and received."""
    tapped: dict[str, bytes] = {"to_agent": b"", "from_agent": b""}

    def tap(link: str, direction: str, data: bytes) -> None:
        assert link == "serial0"
        tapped[direction] += data

    with (
        open_x500(VehiclePlan(simspec(), (LinkSpec("serial0", "tcp_in"),)), tap) as vehicle,
        tcp_client(vehicle) as client,
    ):
        client.sendall(beat())
        run(vehicle, 100)
        assert tapped["from_agent"] == beat()
        assert tapped["to_agent"] == read(client)


def test_links_that_cannot_be_opened_are_named_all_at_once() -> None:
    """A taken port and a missing port are two faults of one error."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        links = (LinkSpec("one", "tcp_in", port=taken.getsockname()[1]), LinkSpec("two", "udp_out"))
        with pytest.raises(SetupError) as caught, flown(*links):
            pass
        assert [fault.where for fault in caught.value.faults] == ["link one", "link two"]


def test_an_unknown_stream_set_is_named() -> None:
    with (
        pytest.raises(SetupError, match="no stream set 'al'"),
        flown(LinkSpec("one", "tcp_in", streams="al")),
    ):
        pass
