"""Links: sockets that never make the simulation wait.

Everything is non-blocking and bounded. A link reads at most `READ_BYTES` from a client in one `poll`, and little more of
one that has sent garbage; what clients say waits in a queue of each, and they are heard in turn. A TCP client that does
not take its data is dropped once `BACKLOG_BYTES` wait for it; what a datagram socket or a serial line does not take is
lost, as on a radio.
"""

from __future__ import annotations

import contextlib
import os
import socket
import termios
import tty
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Protocol

from bench.contracts import LinkSpec
from bench.errors import Fault, SetupError

from ._frames import FrameReader

READ_BYTES = 256 * 1024
BACKLOG_BYTES = 1024 * 1024
INBOX_FRAMES = 4096
MAX_CLIENTS = 8
_GARBAGE_BYTES = 4096  # of one client in one poll; then it is not listened to until the next
_DATAGRAMS = 2048  # taken from a socket in one poll
_SERIAL_BYTES = 16 * 1024  # what waits for a serial line; more is lost, as on a line without flow control
_DATAGRAM = 1200  # what goes out in one datagram: several whole messages, never half of one


class Link(Protocol):
    """One opened link."""

    spec: LinkSpec
    endpoint: str
    inbox: Inbox
    received: int
    garbage_bytes: int
    dropped: int

    def poll(self) -> None:
        """Move what waits in the sockets to the inbox as whole frames."""

    def connected(self) -> bool:
        """Whether anybody would get what is sent now."""

    def send(self, frames: list[bytes]) -> None:
        """Send whole frames to everybody on the link."""

    def close(self) -> None: ...


class Inbox:
    """Frames that wait, a queue for each client. They are taken in turn, so that nobody's flood delays another's message."""

    def __init__(self) -> None:
        self._queues: dict[object, deque[bytes]] = {}
        self._waiting = 0

    def __len__(self) -> int:
        return self._waiting

    def put(self, source: object, frame: bytes) -> bool:
        """False when too much of this client waits, or of too many clients."""
        queue = self._queues.get(source)
        if queue is None:
            if len(self._queues) >= 4 * MAX_CLIENTS:
                return False
            queue = self._queues[source] = deque()
        if len(queue) >= INBOX_FRAMES:
            return False
        queue.append(frame)
        self._waiting += 1
        return True

    def popleft(self) -> bytes:
        """The next client's eldest frame; IndexError when nothing waits."""
        source = next(iter(self._queues), None)
        queue = self._queues.pop(source) if self._waiting else deque()
        frame = queue.popleft()
        self._waiting -= 1
        if queue:
            self._queues[source] = queue  # behind the others
        return frame

    def clear(self) -> None:
        self._queues.clear()
        self._waiting = 0


class _Counted:
    """What the kinds of link share: frames that wait, and what was lost."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.inbox = Inbox()
        self.received = 0
        self.garbage_bytes = 0
        self.dropped = 0

    def _take(self, source: object, reader: FrameReader, data: bytes, last: bool = False) -> int:
        """Put what is whole into the inbox; the bytes of garbage met."""
        before = reader.garbage_bytes
        for frame in reader.feed(data, last, _GARBAGE_BYTES):
            self.received += 1
            if not self.inbox.put(source, frame):
                self.dropped += 1
        garbage = reader.garbage_bytes - before
        self.garbage_bytes += garbage
        return garbage


class UdpLink(_Counted):
    """`udp_out` sends to one address; `udp_in` to everybody who has written to it."""

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        out = spec.kind == "udp_out"
        if out and not spec.port:
            raise SetupError(Fault(f"link {spec.name}", "udp_out needs a port to send to", "give one, for example 14540"))
        self._socket = _bound(spec, socket.SOCK_DGRAM, port=0 if out else spec.port)
        self._peers: dict[tuple[str, int], None] = {}
        if out:
            address = socket.getaddrinfo(spec.host, spec.port, socket.AF_INET)[0][4]
            self._peers[(str(address[0]), int(address[1]))] = None
        self._learns = not out
        port = spec.port if out else self._socket.getsockname()[1]
        self.endpoint = f"{'udpin' if out else 'udpout'}:{spec.host}:{port}"
        self._reader = FrameReader()

    def poll(self) -> None:
        """Everything that waits is taken from the socket, or one that floods it would push the others out of it; but of
        each peer only so much is looked at."""
        left: dict[object, int] = {}
        for _ in range(_DATAGRAMS):
            try:
                data, peer = self._socket.recvfrom(65535)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an answer of the network to something sent earlier
                continue
            if self._learns:
                self._learn(peer)
            share = left.get(peer, READ_BYTES)
            if share <= 0 or len(left) > 4 * MAX_CLIENTS:
                self.dropped += 1
                continue
            garbage = self._take(peer, self._reader, data, last=True)
            left[peer] = share - max(len(data), 64) - garbage * (READ_BYTES // _GARBAGE_BYTES)

    def _learn(self, peer: tuple[str, int]) -> None:
        """Who has not written for longest gives way, so that somebody who comes and goes cannot fill the list."""
        self._peers.pop(peer, None)
        if len(self._peers) >= MAX_CLIENTS:
            del self._peers[next(iter(self._peers))]
        self._peers[peer] = None

    def connected(self) -> bool:
        return bool(self._peers)

    def send(self, frames: list[bytes]) -> None:
        for datagram in _datagrams(frames):
            for peer in self._peers:
                try:
                    self._socket.sendto(datagram, peer)
                except OSError:
                    self.dropped += 1

    def close(self) -> None:
        self._socket.close()


class _Client:
    """One TCP client: its frames as they come, its bytes as it takes them."""

    def __init__(self, taken: socket.socket) -> None:
        self.socket = taken
        self.reader = FrameReader()
        self.backlog = bytearray()

    def push(self, data: bytes) -> bool:
        """Send as much as it takes; False when it is gone or too far behind."""
        self.backlog += data
        try:
            while self.backlog:
                sent = self.socket.send(self.backlog)
                del self.backlog[:sent]
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            return False
        return len(self.backlog) <= BACKLOG_BYTES


class TcpLink(_Counted):
    """`tcp_in`: listens, and serves several clients the same messages."""

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        self._socket = _bound(spec, socket.SOCK_STREAM, port=spec.port)
        self._socket.listen(MAX_CLIENTS)
        self._clients: list[_Client] = []
        self.endpoint = f"tcp:{spec.host}:{self._socket.getsockname()[1]}"

    def poll(self) -> None:
        self._accept()
        for client in list(self._clients):
            self._read(client)

    def _accept(self) -> None:
        while len(self._clients) < MAX_CLIENTS:
            try:
                taken, _ = self._socket.accept()
            except OSError:
                return
            taken.setblocking(False)
            taken.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(_Client(taken))

    def _read(self, client: _Client) -> None:
        left = READ_BYTES
        while left > 0:
            try:
                data = client.socket.recv(65536)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                data = b""
            if not data:
                self._drop(client)
                return
            garbage = self._take(client, client.reader, data)
            left -= len(data) + garbage * (READ_BYTES // _GARBAGE_BYTES)

    def _drop(self, client: _Client) -> None:
        self._clients.remove(client)
        client.socket.close()

    def connected(self) -> bool:
        return bool(self._clients)

    def send(self, frames: list[bytes]) -> None:
        data = b"".join(frames)
        for client in list(self._clients):
            if not client.push(data):
                self.dropped += 1
                self._drop(client)

    def close(self) -> None:
        for client in self._clients:
            client.socket.close()
        self._socket.close()


class SerialLink(_Counted):
    """`serial`: a pseudo terminal whose other end a companion opens as its serial device, or a device that exists.

    `auto` as a path names whatever the system gives; any other path of no device becomes a link to it. The line is raw,
    it has no flow control and no speed: as on a UART, what is not read is lost.
    """

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        self._link: Path | None = None
        self._open_ends: list[int] = []
        path = Path(spec.path)
        if spec.path not in ("", "auto") and path.is_char_device():
            self._line = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            self._open_ends = [self._line]
            self.endpoint = spec.path
        else:
            self._line, there = os.openpty()
            self._open_ends = [self._line, there]  # ours stays open, or the line would break when the companion leaves
            os.set_blocking(self._line, False)
            self.endpoint = os.ttyname(there)
            if spec.path not in ("", "auto"):
                self._name(path)
        with contextlib.suppress(termios.error):
            tty.setraw(self._open_ends[-1])
        self._reader = FrameReader()
        self._backlog = bytearray()

    def _name(self, path: Path) -> None:
        try:
            if path.is_symlink() and not path.exists():
                path.unlink()  # of a run that was ended by force
            path.symlink_to(self.endpoint)
        except OSError:
            self.close()
            raise
        self._link = path
        self.endpoint = str(path)

    def poll(self) -> None:
        left = READ_BYTES
        while left > 0:
            try:
                data = os.read(self._line, 4096)
            except OSError:  # nothing there, or nobody
                return
            if not data:
                return
            left -= len(data) + self._take(None, self._reader, data) * (READ_BYTES // _GARBAGE_BYTES)

    def connected(self) -> bool:
        return True

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            if len(self._backlog) < _SERIAL_BYTES:
                self._backlog += frame
            else:
                self.dropped += 1
        with contextlib.suppress(OSError):
            while self._backlog:
                del self._backlog[: os.write(self._line, self._backlog)]

    def close(self) -> None:
        if self._link:
            self._link.unlink(missing_ok=True)
        for one in self._open_ends:
            os.close(one)


@contextmanager
def open_links(specs: tuple[LinkSpec, ...]) -> Iterator[list[Link]]:
    """Yield every link, opened; leaving the block closes them all. Raises SetupError with one fault for each that fails."""
    with ExitStack() as stack:
        links: list[Link] = []
        faults: list[Fault] = []
        for spec in specs:
            try:
                link = _KINDS[spec.kind](spec)
            except SetupError as error:
                faults += error.faults
            except OSError as error:
                mend = "choose a free port and an address of this machine"
                where = spec.path if spec.kind == "serial" else f"{spec.host}:{spec.port}"
                faults.append(Fault(f"link {spec.name}", f"{where} cannot be opened: {error.strerror}", mend))
            else:
                stack.callback(link.close)
                links.append(link)
        if faults:
            raise SetupError(faults)
        yield links


_KINDS: Mapping[str, Callable[[LinkSpec], Link]] = {
    "udp_out": UdpLink,
    "udp_in": UdpLink,
    "tcp_in": TcpLink,
    "serial": SerialLink,
}


def _bound(spec: LinkSpec, kind: socket.SocketKind, port: int) -> socket.socket:
    with contextlib.ExitStack() as stack:
        opened = stack.enter_context(socket.socket(socket.AF_INET, kind))
        if kind is socket.SOCK_STREAM:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # A sender need not be reachable from elsewhere than where it sends to; on loopback it binds there.
        host = spec.host if spec.kind != "udp_out" or spec.host.startswith("127.") or spec.host == "localhost" else ""
        opened.bind((host, port))
        opened.setblocking(False)
        stack.pop_all()
    return opened


def _datagrams(frames: list[bytes]) -> Iterator[bytes]:
    """Frames joined to datagrams of at most 1200 bytes: a system call costs more than the message in it."""
    joined: list[bytes] = []
    size = 0
    for frame in frames:
        if size + len(frame) > _DATAGRAM and joined:
            yield b"".join(joined)
            joined, size = [], 0
        joined.append(frame)
        size += len(frame)
    if joined:
        yield b"".join(joined)
