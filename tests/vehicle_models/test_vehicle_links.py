"""Links over UDP, TCP and serial lines: MAVLink 1, signing, and clients that misbehave."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import pytest
from pymavlink.dialects.v10 import all as old
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import of, simspec

from bench.contracts import LinkSpec, Vehicle, VehiclePlan
from bench.errors import SetupError
from vehicle_models import open_x500
from vehicle_models.controller.links import _frames
from vehicle_models.controller.links._link import INBOX_FRAMES
from vehicle_models.controller.links._links import BACKLOG_BYTES
from vehicle_models.controller.links._radio import MESSAGES_PER_STEP

Open = Callable[..., Vehicle]
Join = Callable[..., "Peer"]
Kind = Literal["udp_in", "tcp_in"]
KINDS = pytest.mark.parametrize("kind", ["udp_in", "tcp_in"])
KEY = bytes(range(32))
ASK = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1)


def beat(system: int = 255) -> bytes:
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mav))


@pytest.fixture
def opened() -> Iterator[Open]:
    with ExitStack() as stack:
        yield lambda *links: stack.enter_context(open_x500(VehiclePlan(simspec(), links)))


@pytest.fixture
def peer(opened: Open) -> Iterator[Join]:
    with ExitStack() as stack:

        def build(vehicle: Vehicle, name: str = "air", system: int = 255) -> Peer:
            peer = Peer(vehicle, name, system)
            stack.callback(peer.socket.close)
            return peer

        yield build


class Peer:
    """One client of a link that clients come to, over UDP or TCP."""

    def __init__(self, vehicle: Vehicle, name: str, system: int) -> None:
        self.vehicle = vehicle
        kind, host, port = vehicle.endpoints()[name].split(":")
        self.socket = socket.socket(
            socket.AF_INET, socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM
        )
        self.socket.connect((host, int(port)))
        self.socket.setblocking(False)
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.robust_parsing = True

    def send(self, message: Any, v1: bool = False) -> None:
        self.socket.send(bytes(message.pack(self.mav, force_mavlink1=v1)))

    def beat(self, v1: bool = False) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), v1)

    def fly(self, steps: int = 1) -> list[Any]:
        data = b""
        for _ in range(steps):
            run(self.vehicle, 1)
            data += self.read()
        return self.mav.parse_buffer(data) or []

    def read(self) -> bytes:
        data = b""
        with contextlib.suppress(BlockingIOError):
            while more := self.socket.recv(1 << 20):
                data += more
        return data

    def hear(self) -> list[Any]:
        """Messages that are on their way."""
        select.select([self.socket], [], [], 10.0)
        return self.mav.parse_buffer(self.read()) or []


def run(vehicle: Vehicle, steps: int) -> None:
    for _ in range(steps):
        vehicle.receive()
        vehicle.step()


def names(messages: list[Any]) -> list[str]:
    return [message.get_type() for message in messages]


@contextlib.contextmanager
def reading(path: str | Path) -> Iterator[tuple[int, Any, Callable[[Vehicle, int], list[Any]]]]:
    """A serial line, a MAVLink of it, and what flies so many steps and returns the messages read there."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    mav.robust_parsing = True

    def fly(vehicle: Vehicle, steps: int) -> list[Any]:
        messages: list[Any] = []
        for _ in range(steps):
            run(vehicle, 1)
            messages += mav.parse_buffer(os.read(line, 1 << 16)) or []
        return messages

    yield line, mav, fly
    os.close(line)


def test_a_companion_on_a_serial_line(opened: Open, tmp_path: Path) -> None:
    """The other end of the line is a device of the given name, where a message is answered."""
    device = tmp_path / "ttyCompanion"
    vehicle = opened(LinkSpec("telem2", "serial", path=str(device)))
    assert vehicle.endpoints() == {"telem2": str(device)}
    with reading(device) as (line, mav, fly):
        os.write(line, bytes(ASK.pack(mav)))
        assert {"HEARTBEAT", "ATTITUDE", "PARAM_VALUE"} <= {*names(fly(vehicle, 60))}


def test_an_unread_serial_line_loses_what_it_cannot_hold(opened: Open) -> None:
    """The vehicle goes on, lost messages are counted; a later reader finds whole messages again."""
    vehicle = opened(LinkSpec("telem2", "serial"))
    run(vehicle, 300)
    assert vehicle.counters()["mavlink_dropped"] > 100
    with reading(vehicle.endpoints()["telem2"]) as (_, mav, fly):
        messages = fly(vehicle, 100)
        assert mav.total_receive_errors == 0
    assert of("ATTITUDE", messages)[-1].time_boot_ms > 7900


def test_the_device_goes_with_the_vehicle(opened: Open, tmp_path: Path) -> None:
    device = tmp_path / "tty"
    with open_x500(VehiclePlan(simspec(), (LinkSpec("telem2", "serial", path=str(device)),))):
        assert device.exists()
    assert not device.is_symlink()
    taken = tmp_path / "file"
    taken.write_text("mine")
    with pytest.raises(SetupError, match="cannot be opened"):
        opened(LinkSpec("telem2", "serial", path=str(taken)))
    assert taken.read_text() == "mine"


def test_a_mavlink_1_client_is_answered_in_mavlink_1(opened: Open, peer: Join) -> None:
    """Nothing that has no place in it is sent; a word of MAVLink 2 changes that for good."""
    old = peer(opened(LinkSpec("air", "udp_in")))
    old.beat(v1=True)
    messages = old.fly(60)
    assert {"HEARTBEAT", "ATTITUDE", "SYS_STATUS"} <= {*names(messages)}
    assert {message.get_msgbuf()[0] for message in messages} == {0xFE}
    assert max(message.get_msgId() for message in messages) < 256
    old.beat()
    old.fly()
    old.beat(v1=True)
    assert {message.get_msgbuf()[0] for message in old.fly(50)} == {0xFD}


def test_lengths_of_mavlink_1_are_those_of_its_own_dialect() -> None:
    """All messages that are in both, against the dialect generated without extensions."""
    kinds = [kind.id for kind in _frames.KINDS.values()]
    both = [number for number in kinds if number < 256 and number in old.mavlink_map]
    assert len(both) > 150
    for number in both:
        assert _frames.v1_length(number) == old.mavlink_map[number].unpacker.size, number


def signed(mav: Any, key: bytes, message: Any) -> bytes:
    """The message, signed by a partner whose clock is a little ahead of the vehicle's."""
    mav.signing.secret_key, mav.signing.link_id, mav.signing.sign_outgoing = key, 3, True
    mav.signing.timestamp = max(mav.signing.timestamp, 10**14)
    return bytes(message.pack(mav))


@KINDS
@pytest.mark.parametrize("signing", ["require", "accept"])
def test_which_frames_are_accepted(
    opened: Open, peer: Join, kind: Kind, signing: Literal["require", "accept"]
) -> None:
    """A good signature is; a bad one, a repeated message, one from before, and an unsigned one where signing
    is required are not, and each kind is counted. It is the same over TCP, where many messages come in one
    piece. The vehicle's own signatures are valid.
    """
    vehicle = opened(LinkSpec("air", kind, streams="none", signing_key=KEY.hex(), signing=signing))
    client, mav = peer(vehicle), mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    plain = bytes(ASK.pack(mav))
    first, second, wrong = signed(mav, KEY, ASK), signed(mav, KEY, ASK), signed(mav, bytes(32), ASK)
    client.socket.sendall(plain + second + wrong + second + first + signed(mav, KEY, ASK))
    run(vehicle, 3)
    client.mav.signing.secret_key = KEY
    messages = client.hear()
    unsigned = 1 if signing == "require" else 0
    assert names(messages).count("PARAM_VALUE") == 3 - unsigned
    assert all(message.get_signed() for message in messages)
    assert client.mav.signing.badsig_count == 0
    counters = vehicle.counters()
    assert (counters["mavlink_bad_signature"], counters["mavlink_old_timestamp"]) == (1, 2)
    assert counters.get("mavlink_unsigned", 0) == unsigned


def test_setup_signing_brings_a_key_and_takes_it_away(opened: Open, peer: Join) -> None:
    """Unsigned messages fall silent; a key of zeros, signed by the old one, ends it. Nobody else sees the key."""
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"), LinkSpec("ground", "udp_in", streams="none"))
    client, other = peer(vehicle), peer(vehicle, "ground", 7)
    other.beat()
    client.fly()
    client.send(mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), 0))
    client.fly()
    client.send(mavlink.MAVLink_ping_message(0, 1, 0, 0))
    client.beat()
    client.fly()
    assert vehicle.counters()["mavlink_unsigned"] == 2
    assert "SETUP_SIGNING" not in names(other.mav.parse_buffer(other.read()) or [])
    client.socket.send(signed(client.mav, KEY, mavlink.MAVLink_setup_signing_message(1, 1, [0] * 32, 0)))
    client.fly()
    client.mav.signing.sign_outgoing = False
    client.beat()
    client.fly()
    assert vehicle.counters()["mavlink_unsigned"] == 2


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"signing_key": "xyz"}, "not a key"),
        ({"signing_key": "00" * 31}, "not a key"),
        ({"streams": "al"}, "no stream set 'al'"),
    ],
)
def test_what_a_link_cannot_be_is_named(opened: Open, more: dict[str, str], said: str) -> None:
    with pytest.raises(SetupError, match=said):
        opened(LinkSpec("air", "udp_in", **more))  # type: ignore[arg-type]


def test_links_that_cannot_be_opened_are_named_all_at_once(opened: Open) -> None:
    """A taken port and a missing port are two faults of one error."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        links = (LinkSpec("one", "tcp_in", port=taken.getsockname()[1]), LinkSpec("two", "udp_out"))
        with pytest.raises(SetupError) as caught:
            opened(*links)
    assert [fault.where for fault in caught.value.faults] == ["link one", "link two"]


def test_a_flood_does_not_delay_another_client(opened: Open, peer: Join) -> None:
    """More than a step handles and a socket holds; the other's requests are answered in the step they came."""
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"))
    flood, client = peer(vehicle, system=9), peer(vehicle)
    for _ in range(2):
        flood.beat()
        client.beat()
        client.fly()
    for _ in range(60):
        for _ in range(20):
            flood.socket.send(beat(9) * 50)
        for _ in range(3):
            client.send(ASK)
        assert names(client.fly()).count("PARAM_VALUE") == 3
    assert vehicle.counters()["mavlink_dropped"] > 500


def test_a_flood_over_tcp_does_not_delay_another_client(opened: Open, peer: Join) -> None:
    """Nothing that a TCP client sends is thrown away: it is made to wait, the other one is answered at once."""
    vehicle = opened(LinkSpec("air", "tcp_in", streams="none"))
    flood, client = peer(vehicle), peer(vehicle)
    answers, rest, sent = 0, b"", 0
    for _ in range(60):
        with contextlib.suppress(BlockingIOError):
            while True:
                rest = rest or beat() * 100
                sent += (went := flood.socket.send(rest))
                rest = rest[went:]
        client.send(ASK)
        run(vehicle, 1)
        answers += names(client.hear()).count("PARAM_VALUE")
    assert answers == 60
    assert 2000 < vehicle.receive()["air"] < sent // 21
    assert vehicle.counters()["mavlink_dropped"] == 0


@KINDS
def test_every_message_of_a_burst_is_counted_and_answered(opened: Open, peer: Join, kind: Kind) -> None:
    """More than a step handles, sent within one tick: all are counted before time advances, none is lost."""
    vehicle = opened(LinkSpec("air", kind, streams="none"))
    client = peer(vehicle)
    for _ in range(200):
        client.send(ASK)
    for _ in range(4):
        client.socket.send(bytes(ASK.pack(client.mav)) * 60)
    polls = 0
    while vehicle.receive()["air"] < 440:
        polls += 1
        assert polls < 100
    answers = 0
    for _ in range(20):
        vehicle.step()
        answers += names(client.mav.parse_buffer(client.read()) or []).count("PARAM_VALUE")
    assert answers == 440
    assert vehicle.counters()["mavlink_dropped"] == 0


def test_the_port_stays_the_links_own(opened: Open, peer: Join) -> None:
    """An active client has a socket of its own at the same port, but no other process can bind the port."""
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"))
    client = peer(vehicle)
    for _ in range(3):
        client.beat()
        client.fly()
    port = int(vehicle.endpoints()["air"].split(":")[2])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            other.bind(("127.0.0.1", port))


def test_clients_that_come_and_go_do_not_push_out_an_active_one(opened: Open, peer: Join) -> None:
    """Forty that say one thing and vanish; the one that goes on speaking goes on hearing."""
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"))
    client = peer(vehicle)
    for number in range(40):
        client.beat()
        client.fly()
        newcomer = Peer(vehicle, "air", number)
        newcomer.beat()
        newcomer.socket.close()
        client.send(ASK)
        assert "PARAM_VALUE" in names(client.fly(2))


RUBBISH = (b"\xfd\xff\x00" * 400, b"\x00" * 1400, b"\xfe\x21\x00\x01\x01\x00" * 200)


@pytest.mark.parametrize("rubbish", [*RUBBISH, beat(9) * 60])
def test_a_flood_costs_little(opened: Open, peer: Join, rubbish: bytes) -> None:
    """Steps that each meet as much rubbish as a socket holds cost less than three times those that meet as many
    heartbeats, whatever the host; measured, they cost half.
    """
    spent_s = {rubbish: 0.0, beat(9): 0.0}
    vehicles = {flood: opened(LinkSpec("air", "udp_in", streams="none")) for flood in spent_s}
    peers = {flood: peer(vehicle) for flood, vehicle in vehicles.items()}
    for _ in range(50):
        for flood, vehicle in vehicles.items():
            for _ in range(400):
                peers[flood].socket.send(flood)
            begun_s = time.process_time()
            run(vehicle, 1)
            spent_s[flood] += time.process_time() - begun_s
    assert spent_s[rubbish] < 3.0 * spent_s[beat(9)]
    counters = vehicles[rubbish].counters()
    assert counters["mavlink_garbage_bytes"] + counters["mavlink_dropped"] > 0


def test_a_flood_is_bounded_and_garbage_is_counted(opened: Open, peer: Join) -> None:
    """Of five thousand datagrams of rubbish and as many heartbeats, what is taken is counted, and bounded."""
    vehicle = opened(LinkSpec("air", "udp_in"))
    client = peer(vehicle)
    for _ in range(100):
        for _ in range(50):
            client.socket.send(b"\xfd\x09rubbish")
            client.beat()
        vehicle.receive()
    vehicle.step()
    counters = vehicle.counters()
    assert INBOX_FRAMES <= vehicle.receive()["air"] <= INBOX_FRAMES + MESSAGES_PER_STEP
    assert INBOX_FRAMES * 9 <= counters["mavlink_garbage_bytes"] <= 5000 * 9
    assert counters["mavlink_dropped"] > 1000
    assert vehicle.time.ns == 20_000_000


def test_tcp_serves_several_clients_the_same_bytes(opened: Open, peer: Join) -> None:
    """Nothing is sent or counted without a client; two clients then receive the same."""
    vehicle = opened(LinkSpec("air", "tcp_in"))
    run(vehicle, 60)
    assert vehicle.sent() == {"air": 0}
    first, second = peer(vehicle), peer(vehicle)
    run(vehicle, 100)
    data = first.read()
    assert len(data) > 1000
    assert data == second.read()
    first.socket.sendall(beat() + beat())
    second.beat()
    assert vehicle.receive() == {"air": 3}


def test_a_client_that_stops_reading_is_dropped(opened: Open, peer: Join) -> None:
    """It costs bounded memory and no other client's data; the drop is counted."""
    vehicle = opened(LinkSpec("air", "tcp_in"))
    greedy, silent = peer(vehicle), peer(vehicle)
    silent.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    data = 0
    while vehicle.counters()["mavlink_dropped"] == 0:
        run(vehicle, 500)
        data += len(greedy.read())
        assert vehicle.time.s < 1000.0
    assert data > BACKLOG_BYTES
    run(vehicle, 50)
    assert greedy.read()


def test_udp_in_answers_every_peer_that_has_sent(opened: Open, peer: Join) -> None:
    """Silent until a peer sends something; then that peer receives."""
    vehicle = opened(LinkSpec("air", "udp_in"))
    client = peer(vehicle)
    run(vehicle, 60)
    assert vehicle.sent() == {"air": 0}
    client.beat()
    messages = client.fly(60)
    assert len(messages) == vehicle.sent()["air"] > 50
    assert messages[0].get_msgbuf()[0] == 0xFD


def test_messages_for_others_are_forwarded_between_links(opened: Open, peer: Join) -> None:
    """A heartbeat on one link shows on the other as it was; what is for the vehicle alone does not."""
    vehicle = opened(LinkSpec("a", "udp_in", streams="none"), LinkSpec("b", "udp_in", streams="none"))
    first, second = peer(vehicle, "a", 9), peer(vehicle, "b", 7)
    second.beat()
    run(vehicle, 1)
    arm = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    private = bytes(ASK.pack(first.mav))
    other = bytes(mavlink.MAVLink_command_long_message(77, 1, *arm).pack(first.mav))
    first.socket.send(beat(9) + private + other)
    run(vehicle, 1)
    assert second.socket.recv(65535) == beat(9)  # nobody has ever heard of system 77 there
    second.socket.send(beat(77))
    run(vehicle, 1)
    first.socket.send(private + other)
    run(vehicle, 1)
    assert second.socket.recv(65535) == other


def test_the_tap_has_both_directions_whole(peer: Join) -> None:
    tapped: dict[str, bytes] = {"to_agent": b"", "from_agent": b""}

    def tap(link: str, direction: str, data: bytes) -> None:
        assert link == "air"
        tapped[direction] += data

    with open_x500(VehiclePlan(simspec(), (LinkSpec("air", "tcp_in"),)), tap) as vehicle:
        client = peer(vehicle)
        client.beat()
        run(vehicle, 100)
        assert tapped == {"to_agent": client.read(), "from_agent": beat()}
