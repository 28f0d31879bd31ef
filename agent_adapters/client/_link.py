"""One MAVLink link, counted in whole messages so that lockstep can be exact.

Frames are cut by their headers and counted; only those that somebody asks for are decoded, because most of
what an autopilot streams by default is nothing to a given agent.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from bench.errors import LinkLost, SetupError
from bench.values import value_class

MAVLINK_1 = 0xFE
MAVLINK_2 = 0xFD
SIGNED = 0x01
RECEIVE_BYTES = 1 << 20
TIMEOUT_S = 10.0


@value_class(frozen=True, slots=True)
class MavlinkFrame:
    """One whole frame as it came; `data` is all of it, checksum included but not checked."""

    message_id: int
    system: int
    component: int
    data: bytes


class _Wire(Protocol):
    """Bytes in and out of one socket."""

    def receive(self, timeout_s: float) -> bytes | None:
        """What came, or None when nothing came in time. Raises LinkLost when the other side closed."""

    def send(self, data: bytes) -> bool:
        """Whether it went out."""


class MavlinkLink:
    """Whole MAVLink frames over one wire. `received` and `sent` count them since the start."""

    def __init__(self, name: str, wire: _Wire) -> None:
        self.name = name
        self.received = 0
        self.sent = 0
        self.garbage_bytes = 0
        self._wire = wire
        self._rest = b""
        self._frames: list[MavlinkFrame] = []

    def wait(self, received: int, timeout_s: float = TIMEOUT_S) -> None:
        """Return once `received` frames have come. Raises LinkLost when they do not come in time."""
        deadline = time.monotonic() + timeout_s
        while self.received < received:
            left_s = deadline - time.monotonic()
            if left_s <= 0.0:
                raise LinkLost(
                    f"MAVLink link {self.name}: {self.received} of {received} messages came in {timeout_s:g} s"
                    f" ({self.garbage_bytes} bytes belonged to no frame)"
                )
            self._take_in(left_s)

    def poll(self) -> None:
        """Take in what has come, without waiting."""
        while self._take_in(0.0):
            pass

    def take(self) -> list[MavlinkFrame]:
        """The frames that came since the last call, in order."""
        frames, self._frames = self._frames, []
        return frames

    def send(self, frame: bytes) -> bool:
        """Send one whole frame; False when nobody has been heard yet to send it to."""
        was_sent = self._wire.send(frame)
        self.sent += was_sent
        return was_sent

    def _take_in(self, timeout_s: float) -> bool:
        data = self._wire.receive(timeout_s)
        if data is None:
            return False
        before = len(self._frames)
        self._rest, garbage = _cut(self._rest + data, self._frames)
        self.received += len(self._frames) - before
        self.garbage_bytes += garbage
        return True


def _cut(data: bytes, frames: list[MavlinkFrame]) -> tuple[bytes, int]:
    """Append the whole frames of `data` to `frames`; the unfinished rest, and how many bytes belonged to
    none.
    """
    at = garbage = 0
    end = len(data)
    while end - at >= 8:
        magic = data[at]
        if magic == MAVLINK_2:
            if end - at < 12:
                break
            # MAVLink 2: a header of 10 bytes, a checksum of 2, and a signature of 13 on signed frames.
            length = data[at + 1] + (25 if data[at + 2] & SIGNED else 12)
            identity = int.from_bytes(data[at + 7 : at + 10], "little"), data[at + 5], data[at + 6]
        elif magic == MAVLINK_1:
            # MAVLink 1: a header of 6 bytes and a checksum of 2.
            length = data[at + 1] + 8
            identity = data[at + 5], data[at + 3], data[at + 4]
        else:
            at += 1
            garbage += 1
            continue
        if end - at < length:
            break
        frames.append(MavlinkFrame(*identity, data[at : at + length]))
        at += length
    return data[at:], garbage


class _Datagrams:
    """A UDP socket that talks to one peer: the first that it hears, or the one it was told."""

    def __init__(self, udp_socket: socket.socket, peer: tuple[str, int] | None) -> None:
        self._socket = udp_socket
        self._peer: Any = peer

    def receive(self, timeout_s: float) -> bytes | None:
        self._socket.settimeout(timeout_s)
        try:
            data, sender = self._socket.recvfrom(65536)
        except (TimeoutError, BlockingIOError):
            return None
        # An ICMP answer to an earlier datagram: nobody was bound to the peer's port then, which may change.
        except ConnectionRefusedError:
            return None
        if self._peer is None:
            self._peer = sender
        # A second sender would break the count of messages on which lockstep relies.
        return data if sender == self._peer else b""

    def send(self, data: bytes) -> bool:
        if self._peer is None:
            return False
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            return False
        return True


class _Stream:
    """A TCP connection."""

    def __init__(self, tcp_socket: socket.socket) -> None:
        self._socket = tcp_socket

    def receive(self, timeout_s: float) -> bytes | None:
        self._socket.settimeout(timeout_s)
        try:
            data = self._socket.recv(65536)
        except (TimeoutError, BlockingIOError):
            return None
        except OSError as error:
            raise LinkLost(f"the autopilot closed the MAVLink connection: {error}") from error
        if not data:
            raise LinkLost("the autopilot closed the MAVLink connection")
        return data

    def send(self, data: bytes) -> bool:
        self._socket.settimeout(TIMEOUT_S)
        try:
            self._socket.sendall(data)
        except OSError:
            return False
        return True


@contextmanager
def open_link(name: str, connection: str, timeout_s: float = TIMEOUT_S) -> Iterator[MavlinkLink]:
    """A link from a connection string as pymavlink takes it: `udpin:HOST:PORT`, `udpout:HOST:PORT` or
    `tcp:HOST:PORT`.

    Raises SetupError for any other string, LinkLost when a TCP connection cannot be made.
    """
    kind, _, rest = connection.partition(":")
    host, _, port = rest.rpartition(":")
    if ":" in host:
        raise SetupError(name, f"{connection!r}: links have no IPv6", "give an IPv4 address or a name")
    if kind not in ("udpin", "udp", "udpout", "tcp") or not host or not port.isdigit():
        raise SetupError(
            name,
            f"{connection!r} is not a MAVLink connection string",
            "for example udpin:127.0.0.1:14540 or tcp:127.0.0.1:5760",
        )
    with _open_socket(kind, (host, int(port)), timeout_s) as link_socket:
        wire = (
            _Stream(link_socket)
            if kind == "tcp"
            else _Datagrams(link_socket, (host, int(port)) if kind == "udpout" else None)
        )
        yield MavlinkLink(name, wire)


def _open_socket(kind: str, address: tuple[str, int], timeout_s: float) -> socket.socket:
    try:
        if kind == "tcp":
            link_socket = socket.create_connection(address, timeout_s)
            # Small frames must not wait for Nagle's algorithm: the other side waits for each of them.
            link_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return link_socket
        link_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        # The kernel drops datagrams that find the buffer full, and a dropped frame ends a lockstep session.
        link_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
        if kind in ("udpin", "udp"):
            link_socket.bind(address)
        return link_socket
    except OSError as error:
        raise LinkLost(f"MAVLink {kind}:{address[0]}:{address[1]} cannot be opened: {error}") from error
