"""Links: sockets that never make the simulation wait.

Everything is non-blocking and bounded. A link reads at most `READ_BYTES` in one `poll`; a TCP client that does not take
its data is dropped once `BACKLOG_BYTES` wait for it; a datagram that the kernel refuses is lost, as on a radio.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Protocol

from bench.contracts import LinkSpec
from bench.errors import Fault, SetupError

from ._frames import FrameReader

READ_BYTES = 256 * 1024
BACKLOG_BYTES = 1024 * 1024
INBOX_FRAMES = 4096
MAX_CLIENTS = 8
_DATAGRAM = 1200  # what goes out in one datagram: several whole messages, never half of one


class Link(Protocol):
    """One opened link."""

    spec: LinkSpec
    endpoint: str
    inbox: deque[bytes]
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


class _Inbox:
    """What the kinds of link share: frames that wait, and what was lost."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.inbox: deque[bytes] = deque()
        self.received = 0
        self.garbage_bytes = 0
        self.dropped = 0

    def _take(self, reader: FrameReader, data: bytes, last: bool = False) -> None:
        before = reader.garbage_bytes
        for frame in reader.feed(data, last):
            self.received += 1
            if len(self.inbox) < INBOX_FRAMES:
                self.inbox.append(frame)
            else:
                self.dropped += 1
        self.garbage_bytes += reader.garbage_bytes - before


class UdpLink(_Inbox):
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
        left = READ_BYTES
        while left > 0:
            try:
                data, peer = self._socket.recvfrom(65535)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an answer of the network to something sent earlier
                left -= 1024
                continue
            left -= max(len(data), 64)
            if self._learns and peer not in self._peers:
                self._learn(peer)
            self._take(self._reader, data, last=True)

    def _learn(self, peer: tuple[str, int]) -> None:
        """The eldest peer gives way, so that somebody who comes and goes cannot fill the list."""
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


class TcpLink(_Inbox):
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
            left -= len(data)
            self._take(client.reader, data)

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


@contextmanager
def open_links(specs: tuple[LinkSpec, ...]) -> Iterator[list[Link]]:
    """Yield every link, opened; leaving the block closes them all. Raises SetupError with one fault for each that fails."""
    with ExitStack() as stack:
        links: list[Link] = []
        faults: list[Fault] = []
        for spec in specs:
            try:
                link: Link = TcpLink(spec) if spec.kind == "tcp_in" else UdpLink(spec)
            except SetupError as error:
                faults += error.faults
            except OSError as error:
                mend = "choose a free port and an address of this machine"
                faults.append(Fault(f"link {spec.name}", f"{spec.host}:{spec.port} cannot be opened: {error.strerror}", mend))
            else:
                stack.callback(link.close)
                links.append(link)
        if faults:
            raise SetupError(faults)
        yield links


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
