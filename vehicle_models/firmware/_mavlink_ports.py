"""The autopilot's own MAVLink ports, from the side of the bench: whole frames in both directions, never waiting."""

from __future__ import annotations

import socket
import time
from typing import Protocol

from bench.errors import FirmwareFault

from ..controller.links._frames import FrameReader
from ._px4_link import CheckAlive, report_closed

_READ_BYTES = 65536
_SOCKET_BYTES = 4 << 20
# More than this waits only for an autopilot that has stopped reading.
_BACKLOG_BYTES = 1 << 20
_RETRY_S = 0.02
# On loopback the answer is there at once.
_CONNECT_TRY_S = 1.0


class MavlinkPort(Protocol):
    """One MAVLink connection with the autopilot."""

    def read(self) -> list[bytes]:
        """Whole frames that have come since the last call."""

    def send(self, frames: list[bytes]) -> None: ...


class UdpPort:
    """PX4's: it sends to `port`, and hears what comes from there to `peer_port`."""

    def __init__(self, port: int, peer_port: int, unbound: socket.socket) -> None:
        self._socket = unbound
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError:
            self._socket.close()
            raise
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SOCKET_BYTES)
        self._socket.setblocking(False)
        self._peer = ("127.0.0.1", peer_port)
        self._reader = FrameReader()

    def read(self) -> list[bytes]:
        frames: list[bytes] = []
        while True:
            try:
                data, peer = self._socket.recvfrom(_READ_BYTES)
            except BlockingIOError:
                return frames
            except OSError:  # an ICMP answer to what was sent while the autopilot did not listen yet
                continue
            # Where the session shares the host's network, others can send here too.
            if peer == self._peer:
                frames += self._reader.feed(data, last=True)

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            try:
                self._socket.sendto(frame, self._peer)
            except OSError:
                # As on a radio: the autopilot reads too slowly, or not yet.
                return

    def close(self) -> None:
        self._socket.close()


class TcpPort:
    """ArduPilot's: it listens. `open` waits for the port; without it, each `read` tries again until somebody listens.

    Nothing of ArduPilot runs before somebody is on its first port, and it opens the others only when its world moves.
    """

    def __init__(self, port: int, unbound: socket.socket, check_alive: CheckAlive) -> None:
        self._socket = unbound
        self._check_alive = check_alive
        self._port = port
        self._reader = FrameReader()
        self._backlog = bytearray()
        self._connected = False

    def open(self, connect_s: float) -> None:
        """Wait until ArduPilot listens, and connect."""
        deadline_s = time.monotonic() + connect_s
        while not self._connect():
            self._check_alive()
            if time.monotonic() > deadline_s:
                raise FirmwareFault(
                    f"ArduPilot did not listen on TCP port {self._port} within {connect_s:g} s"
                )
            time.sleep(_RETRY_S)

    def read(self) -> list[bytes]:
        frames: list[bytes] = []
        while self._connected or self._connect():
            try:
                data = self._socket.recv(_READ_BYTES)
            except BlockingIOError:
                return frames
            except OSError:
                data = b""
            if not data:
                report_closed(f"ArduPilot closed TCP port {self._port}", self._check_alive)
            frames += self._reader.feed(data)
        return frames

    def send(self, frames: list[bytes]) -> None:
        if not self._connected:
            # As on a line that nobody has opened yet.
            return
        if len(self._backlog) < _BACKLOG_BYTES:
            self._backlog += b"".join(frames)
        try:
            while self._backlog:
                del self._backlog[: self._socket.send(self._backlog)]
        except BlockingIOError:
            return
        except OSError:
            report_closed(f"ArduPilot closed TCP port {self._port}", self._check_alive)

    def close(self) -> None:
        self._socket.close()

    def _connect(self) -> bool:
        self._socket.settimeout(_CONNECT_TRY_S)
        try:
            # Linux lets a socket that was refused try again.
            self._socket.connect(("127.0.0.1", self._port))
        except OSError:
            return False
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        self._connected = True
        return True
