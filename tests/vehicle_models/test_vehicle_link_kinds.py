"""Serial lines, MAVLink 1, signing, and clients that would like to have the vehicle for themselves."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import of, simspec

from bench.contracts import LinkSpec, Vehicle, VehiclePlan
from bench.errors import SetupError
from vehicle_models import open_x500

Open = Callable[..., Vehicle]
KEY = bytes(range(32))
BEAT = bytes(
    mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(
        mavlink.MAVLink(None, srcSystem=9, srcComponent=190)
    )
)


@pytest.fixture
def opened() -> Iterator[Open]:
    with ExitStack() as stack:
        yield lambda *links, autopilot="px4": stack.enter_context(
            open_x500(VehiclePlan(simspec(autopilot), links))
        )


@pytest.fixture
def peer(opened: Open) -> Iterator[Callable[..., Peer]]:
    with ExitStack() as stack:

        def build(vehicle: Vehicle, name: str = "air", system: int = 255) -> Peer:
            peer = Peer(vehicle, name, system)
            stack.callback(peer.socket.close)
            return peer

        yield build


class Peer:
    """One client of a `udp_in` link."""

    def __init__(self, vehicle: Vehicle, name: str, system: int) -> None:
        self.vehicle = vehicle
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.connect(("127.0.0.1", int(vehicle.endpoints()[name].split(":")[2])))
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.robust_parsing = True

    def send(self, message: Any, v1: bool = False) -> None:
        self.socket.send(bytes(message.pack(self.mav, force_mavlink1=v1)))

    def beat(self, v1: bool = False) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), v1)

    def fly(self, steps: int = 1) -> list[Any]:
        data = b""
        for _ in range(steps):
            self.vehicle.receive()
            self.vehicle.step()
            data += self.read()
        return self.mav.parse_buffer(data) or []

    def read(self) -> bytes:
        data = b""
        while True:
            try:
                data += self.socket.recv(65535)
            except BlockingIOError:
                return data


def names(messages: list[Any]) -> set[str]:
    return {message.get_type() for message in messages}


def test_a_companion_on_a_serial_line(opened: Open, tmp_path: Path) -> None:
    """The other end of the line is a device of the given name; a message that is written there is answered
    there.
    """
    device = tmp_path / "ttyCompanion"
    vehicle = opened(LinkSpec("telem2", "serial", path=str(device)))
    assert vehicle.endpoints() == {"telem2": str(device)}
    line = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    mav.robust_parsing = True
    os.write(line, bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1).pack(mav)))
    messages: list[Any] = []
    for _ in range(60):
        vehicle.receive()
        vehicle.step()
        messages += mav.parse_buffer(os.read(line, 1 << 16)) or []
    assert {"HEARTBEAT", "ATTITUDE", "PARAM_VALUE"} <= names(messages)
    os.close(line)


def test_an_unread_serial_line_loses_what_it_cannot_hold(opened: Open) -> None:
    """It does not stop the vehicle, and lost messages are counted; a later reader finds whole messages
    again.
    """
    vehicle = opened(LinkSpec("telem2", "serial"))
    for _ in range(300):
        vehicle.receive()
        vehicle.step()
    assert vehicle.counters()["mavlink_dropped"] > 100
    line = os.open(vehicle.endpoints()["telem2"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    mav = mavlink.MAVLink(None)
    mav.robust_parsing = True
    messages: list[Any] = []
    for _ in range(100):
        vehicle.receive()
        vehicle.step()
        messages += mav.parse_buffer(os.read(line, 1 << 16)) or []
    assert mav.total_receive_errors == 0
    assert [message.time_boot_ms for message in of("ATTITUDE", messages)][-1] > 7900
    os.close(line)


def test_the_device_goes_with_the_vehicle(tmp_path: Path) -> None:
    device = tmp_path / "tty"
    with open_x500(VehiclePlan(simspec(), (LinkSpec("telem2", "serial", path=str(device)),))):
        assert device.exists()
    assert not device.is_symlink()
    taken = tmp_path / "file"
    taken.write_text("mine")
    with (
        pytest.raises(SetupError, match="cannot be opened"),
        open_x500(VehiclePlan(simspec(), (LinkSpec("telem2", "serial", path=str(taken)),))),
    ):
        pass
    assert taken.read_text() == "mine"


def test_a_mavlink_1_client_is_answered_in_mavlink_1(opened: Open, peer: Callable[..., Peer]) -> None:
    """Payloads of their old length, nothing that has no place in it; a word of MAVLink 2 changes that for
    good.
    """
    vehicle = opened(LinkSpec("air", "udp_in"))
    old = peer(vehicle)
    old.beat(v1=True)
    vehicle.receive()
    vehicle.step()
    data = b""
    for _ in range(60):
        vehicle.step()
        data += old.read()
    assert data[0] == 0xFE
    messages = mavlink.MAVLink(None).parse_buffer(data)
    assert {"HEARTBEAT", "ATTITUDE", "SYS_STATUS"} <= names(messages)
    assert {message.get_msgbuf()[0] for message in messages} == {0xFE}
    assert max(message.get_msgId() for message in messages) < 256
    old.beat()
    old.fly()
    old.beat(v1=True)
    assert {message.get_msgbuf()[0] for message in old.fly(50)} == {0xFD}


def test_lengths_of_mavlink_1_are_those_of_its_own_dialect() -> None:
    """All messages that are in both, against the dialect generated without extensions."""
    from pymavlink.dialects.v10 import all as old

    from vehicle_models.controller.links._frames import KINDS, v1_length

    both = [kind for kind in KINDS.values() if kind.id < 256 and kind.id in old.mavlink_map]
    assert len(both) > 150
    assert {kind.id: v1_length(kind.id) for kind in both} == {
        kind.id: old.mavlink_map[kind.id].unpacker.size for kind in both
    }


def test_signing_is_required_and_kept(opened: Open, peer: Callable[..., Peer]) -> None:
    """Unsigned, wrongly signed and repeated messages are rejected and counted; the vehicle's own signature is
    valid.
    """
    vehicle = opened(LinkSpec("air", "udp_in", signing_key=KEY.hex()))
    client = peer(vehicle)
    client.beat()
    assert vehicle.counters().get("mavlink_unsigned") is None
    ask = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1)
    client.send(ask)
    messages = client.fly(60)
    assert vehicle.counters()["mavlink_unsigned"] == 2
    assert "PARAM_VALUE" not in names(messages)
    client.mav.signing.secret_key = bytes(32)
    client.mav.signing.link_id = 3
    client.mav.signing.sign_outgoing = True
    client.mav.signing.timestamp = messages[-1].get_msgbuf() and int.from_bytes(
        bytes(messages[-1].get_msgbuf())[-12:-6], "little"
    )
    client.send(ask)
    client.fly()
    assert vehicle.counters()["mavlink_bad_signature"] == 1
    client.mav.signing.secret_key = KEY
    refused = client.mav.signing.badsig_count
    frame = bytes(ask.pack(client.mav))
    client.socket.send(frame)
    client.socket.send(frame)
    messages = client.fly(5)
    assert len(of("PARAM_VALUE", messages)) == 1
    assert vehicle.counters()["mavlink_old_timestamp"] == 1
    # This pymavlink cannot tell what it does not know, such as ESC_INFO.
    known = [message for message in messages if not message.get_type().startswith("UNKNOWN")]
    assert all(message.get_signed() for message in known)
    assert client.mav.signing.badsig_count == refused


def signed(mav: Any, key: bytes, message: Any) -> bytes:
    """The message, signed by a partner whose clock is a little ahead of the vehicle's."""
    mav.signing.secret_key, mav.signing.link_id, mav.signing.sign_outgoing = key, 3, True
    mav.signing.timestamp = max(mav.signing.timestamp, 10**14)
    return bytes(message.pack(mav))


@pytest.mark.parametrize("kind", ["udp_in", "tcp_in"])
@pytest.mark.parametrize("signing", ["require", "accept"])
def test_which_frames_are_accepted(
    opened: Open, kind: Literal["udp_in", "tcp_in"], signing: Literal["require", "accept"]
) -> None:
    """A good signature is; a bad one, a repeated message, one from before, and an unsigned one where signing
    is required are not, and each kind is counted. It is the same over TCP, where many messages come in one
    piece.
    """
    vehicle = opened(LinkSpec("air", kind, streams="none", signing_key=KEY.hex(), signing=signing))
    host, port = vehicle.endpoints()["air"].split(":")[1:]
    ask = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1)
    mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    with socket.socket(
        socket.AF_INET, socket.SOCK_DGRAM if kind == "udp_in" else socket.SOCK_STREAM
    ) as client:
        client.connect((host, int(port)))
        plain = bytes(ask.pack(mav))
        first, second, wrong = signed(mav, KEY, ask), signed(mav, KEY, ask), signed(mav, bytes(32), ask)
        client.sendall(plain + second + wrong + second + first + signed(mav, KEY, ask))
        for _ in range(3):
            vehicle.receive()
            vehicle.step()
        data = client.recv(65536)
    messages = mavlink.MAVLink(None).parse_buffer(data) or []
    unsigned = 1 if signing == "require" else 0
    assert [message.get_type() for message in messages].count("PARAM_VALUE") == 3 - unsigned
    assert {message.get_msgbuf()[2] for message in messages} == {1}  # signed
    counters = vehicle.counters()
    assert (counters["mavlink_bad_signature"], counters["mavlink_old_timestamp"]) == (1, 2)
    assert counters.get("mavlink_unsigned", 0) == unsigned


def test_signing_where_unsigned_is_accepted(opened: Open, peer: Callable[..., Peer]) -> None:
    """An unsigned request is answered, in a signed frame; a bad signature is still refused."""
    vehicle = opened(LinkSpec("air", "udp_in", signing_key=KEY.hex(), signing="accept"))
    client = peer(vehicle)
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1))
    messages = client.fly(3)
    (answer,) = of("PARAM_VALUE", messages)
    assert answer.get_msgbuf()[2] == 1
    assert "mavlink_unsigned" not in vehicle.counters()


def test_setup_signing_brings_a_key_and_takes_it_away(opened: Open, peer: Callable[..., Peer]) -> None:
    """With it, what is unsigned falls silent; a key of zeros, signed by the old one, ends it.

    Nobody else gets to see the key.
    """
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
    client.mav.signing.secret_key, client.mav.signing.sign_outgoing = KEY, True
    client.mav.signing.timestamp = 10**14
    client.send(mavlink.MAVLink_setup_signing_message(1, 1, [0] * 32, 0))
    client.fly()
    client.mav.signing.sign_outgoing = False
    client.beat()
    client.fly()
    assert vehicle.counters()["mavlink_unsigned"] == 2


@pytest.mark.parametrize("key", ["xyz", "00" * 31])
def test_a_key_that_is_none_is_named(opened: Open, key: str) -> None:
    with pytest.raises(SetupError, match="not a key"):
        opened(LinkSpec("air", "udp_in", signing_key=key))


def test_a_flood_does_not_delay_another_client(opened: Open, peer: Callable[..., Peer]) -> None:
    """While one client sends full datagrams, far more than a step handles and than any socket holds, the
    other's every request is answered in the step it came; what was thrown away is counted.
    """
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"))
    flood, client = peer(vehicle, system=9), peer(vehicle)
    for _ in range(2):
        flood.beat()
        client.beat()
        client.fly()
    beat = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(flood.mav))
    ask = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1)
    for _ in range(60):
        for _ in range(20):
            flood.socket.send(beat * 50)
        for _ in range(3):
            client.send(ask)
        assert [message.get_type() for message in client.fly()].count("PARAM_VALUE") == 3
    assert vehicle.counters()["mavlink_dropped"] > 500


def test_a_flood_over_tcp_does_not_delay_another_client(opened: Open) -> None:
    """Nothing that a TCP client sends is thrown away: it is made to wait, and the other one is answered at
    once.
    """
    vehicle = opened(LinkSpec("serial0", "tcp_in", streams="none"))
    host, port = vehicle.endpoints()["serial0"].split(":")[1:]
    with (
        socket.create_connection((host, int(port))) as flood,
        socket.create_connection((host, int(port))) as client,
    ):
        flood.setblocking(False)
        mav, answers = mavlink.MAVLink(None, srcSystem=255, srcComponent=190), 0
        rest, sent = b"", 0
        beats = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mav)) * 100
        for _ in range(60):
            with contextlib.suppress(BlockingIOError):
                while True:
                    rest = rest or beats
                    sent += (went := flood.send(rest))
                    rest = rest[went:]
            client.sendall(
                bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1).pack(mav))
            )
            vehicle.receive()
            vehicle.step()
            messages = mav.parse_buffer(client.recv(65536)) or []
            answers += [message.get_type() for message in messages].count("PARAM_VALUE")
        assert answers == 60
        assert 2000 < vehicle.receive()["serial0"] < sent // 21
        assert vehicle.counters()["mavlink_dropped"] == 0


@pytest.mark.parametrize("kind", ["udp_in", "tcp_in"])
def test_every_message_of_a_burst_is_counted_and_answered(
    opened: Open, kind: Literal["udp_in", "tcp_in"]
) -> None:
    """More than a step handles, sent within one tick: every message is counted before time advances, none is
    lost.
    """
    vehicle = opened(LinkSpec("air", kind, streams="none"))
    host, port = vehicle.endpoints()["air"].split(":")[1:]
    with socket.socket(
        socket.AF_INET, socket.SOCK_DGRAM if kind == "udp_in" else socket.SOCK_STREAM
    ) as client:
        client.connect((host, int(port)))
        mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        for _ in range(200):
            client.send(
                bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1).pack(mav))
            )
        for _ in range(4):
            client.send(
                bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1).pack(mav)) * 60
            )
        polls = 0
        while vehicle.receive()["air"] < 440:
            polls += 1
            assert polls < 100
        client.setblocking(False)
        answers = 0
        for _ in range(20):
            vehicle.step()
            with contextlib.suppress(BlockingIOError):
                while True:
                    messages = mav.parse_buffer(client.recv(65536)) or []
                    answers += [message.get_type() for message in messages].count("PARAM_VALUE")
        assert answers == 440
        assert vehicle.counters()["mavlink_dropped"] == 0


def test_the_port_stays_the_links_own(opened: Open, peer: Callable[..., Peer]) -> None:
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


def test_clients_that_come_and_go_do_not_push_out_an_active_one(
    opened: Open, peer: Callable[..., Peer]
) -> None:
    """Forty that say one thing and vanish; the one that goes on speaking goes on hearing."""
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"))
    client = peer(vehicle)
    for number in range(40):
        client.beat()
        client.fly()
        newcomer = Peer(vehicle, "air", number)
        newcomer.beat()
        newcomer.socket.close()
        client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1))
        assert "PARAM_VALUE" in names(client.fly(2))


@pytest.mark.parametrize(
    "rubbish", [b"\xfd\xff\x00" * 400, b"\x00" * 1400, b"\xfe\x21\x00\x01\x01\x00" * 200, BEAT * 60, BEAT]
)
def test_a_flood_costs_little(opened: Open, peer: Callable[..., Peer], rubbish: bytes) -> None:
    """A second of steps, each with as many datagrams as a socket holds, of rubbish or of sense, takes less
    than half a second of CPU time.
    """
    vehicle = opened(LinkSpec("air", "udp_in", streams="none"))
    flood = peer(vehicle)
    spent = 0.0
    for _ in range(50):
        for _ in range(400):
            flood.socket.send(rubbish)
        begun = time.process_time()
        vehicle.receive()
        vehicle.step()
        spent += time.process_time() - begun
    assert spent < 0.5
    counters = vehicle.counters()
    assert counters["mavlink_garbage_bytes"] + counters["mavlink_dropped"] > 0
