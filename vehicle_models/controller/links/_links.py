"""Links: sockets that never make the simulation wait.

Everything is non-blocking and bounded. One `poll` reads a bounded amount of each client, and nothing while
its queue is full: a flood then waits in the kernel, which discards what it cannot hold, and no other client
suffers. Clients are served in turn. A TCP client that does not read its data is dropped once `BACKLOG_BYTES`
wait for it; data that a datagram socket or a serial line does not accept is lost, as on a radio.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import termios
import tty
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bench.contracts import LinkSpec
from bench.errors import Fault, SetupError

from ._frames import FrameReader
from ._link import FRAMES_PER_POLL, GARBAGE_BYTES_PER_POLL, MAX_CLIENTS, Link
from ._serial import SequenceReader, SerialDevice

BACKLOG_BYTES = 1024 * 1024
_DATAGRAMS_PER_POLL = 64
# Datagrams discarded behind garbage.
_MAX_DISCARDED = 16
# TCP clients.
_ACCEPTED_PER_POLL = 4
# Requested of the kernel for each UDP socket; it may grant less.
_SOCKET_BYTES = 512 * 1024
# Sockets opened for new peers.
_SOCKETS_PER_POLL = 2
# Peers that have sent one datagram only share this queue.
_UNKNOWN_PEERS = "strangers"
# Linux: counts of a socket, 32 bits each.
_SO_MEMINFO, _MEMINFO_DROPS = 55, 8
# More than this is lost, as on a line without flow control.
_SERIAL_BACKLOG_BYTES = 16 * 1024
# A datagram holds several whole messages, never a part of one.
_DATAGRAM_BYTES = 1200


Address = tuple[str, int]


class UdpLink(Link):
    """`udp_out` sends to one address; `udp_in` to every peer that has sent something.

    A peer that has sent twice gets a connected socket at the same port, so that the kernel keeps one client's flood apart
    from the messages of the others.
    """

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        out = spec.kind == "udp_out"
        if out and not spec.port:
            raise SetupError(
                f"link {spec.name}", "udp_out needs a port to send to", "give one, for example 14540"
            )
        self._socket = _open_socket(spec, socket.SOCK_DGRAM, port=0 if out else spec.port)
        self._target: Address | None = None
        if out:
            address = socket.getaddrinfo(spec.host, spec.port, socket.AF_INET)[0][4]
            self._target = str(address[0]), int(address[1])
        # By peer, the one that has been silent longest first.
        self._peers: dict[Address, socket.socket | None] = {}
        self._dropped_in_closed = 0
        port = spec.port if out else self._socket.getsockname()[1]
        self.endpoint = f"{'udpin' if out else 'udpout'}:{spec.host}:{port}"
        self._reader = FrameReader()
        self._buffer = memoryview(bytearray(65536))
        self._poll_set = select.poll()
        self._poll_set.register(self._socket, select.POLLIN)

    @property
    def dropped(self) -> int:
        sockets = [self._socket, *filter(None, self._peers.values())]
        return self._dropped + self._dropped_in_closed + sum(_dropped_by_kernel(sock) for sock in sockets)

    def poll(self) -> None:
        ready = {number for number, _ in self._poll_set.poll(0)}
        if not ready:
            return
        for peer, peer_socket in list(self._peers.items()):
            if peer_socket and peer_socket.fileno() in ready and self.inbox.room(peer):
                self._read(peer_socket)
        newcomers = self._read(self._socket) if self._socket.fileno() in ready else []
        if newcomers:
            for peer in newcomers[:_SOCKETS_PER_POLL]:
                self._open_peer_socket(peer)
            # Take what came before the peer had a socket of its own; it would arrive out of order later.
            self._read(self._socket)

    def _read(self, sock: socket.socket) -> list[Address]:
        """Read a socket within the bounds of one poll; returns known peers without a socket of their own."""
        frames = garbage = discarded = 0
        returning: dict[Address, None] = {}
        for _ in range(_DATAGRAMS_PER_POLL):
            try:
                size, peer = sock.recvfrom_into(self._buffer)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:  # an ICMP answer to a datagram sent earlier
                continue
            source: object = peer
            if peer not in self._peers:
                source = _UNKNOWN_PEERS
            elif self._peers[peer] is None:
                returning[peer] = None
            self._note_speaker(peer)
            room = self.inbox.room(source)
            if not room or garbage >= GARBAGE_BYTES_PER_POLL:
                self._dropped += 1
                discarded += 1
                if discarded >= _MAX_DISCARDED and sock is not self._socket:
                    break
                continue
            count, bad_bytes = self._put_frames(source, self._reader, bytes(self._buffer[:size]), room)
            frames, garbage = frames + count, garbage + bad_bytes
            if frames >= FRAMES_PER_POLL or count >= room:
                break
        return list(returning)

    def _note_speaker(self, peer: Address) -> None:
        """Make this peer the latest; the one silent longest gives way, so that peers cannot fill the list."""
        peer_socket = self._peers.pop(peer, None)
        if len(self._peers) >= MAX_CLIENTS:
            oldest = next(iter(self._peers))
            self._close(self._peers.pop(oldest))
        self._peers[peer] = peer_socket

    def _open_peer_socket(self, peer: Address) -> None:
        """Open a socket for this peer alone; where the system cannot, the link's own receives it still."""
        if self._peers.get(peer, self._socket) is not None:
            # The peer was dropped meanwhile, or has a socket already.
            return
        peer_socket = self.spec.open_socket(socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            peer_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            peer_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SOCKET_BYTES)
            peer_socket.setblocking(False)
            peer_socket.bind(self._socket.getsockname())
            peer_socket.connect(peer)
        except OSError:
            peer_socket.close()
        else:
            self._peers[peer] = peer_socket
            self._poll_set.register(peer_socket, select.POLLIN)
        finally:
            # With the option still set, other processes could bind the port too.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)

    def _close(self, peer_socket: socket.socket | None) -> None:
        if peer_socket:
            self._dropped_in_closed += _dropped_by_kernel(peer_socket)
            self._poll_set.unregister(peer_socket)
            peer_socket.close()

    def _listeners(self) -> Iterable[Address]:
        return (self._target,) if self._target else self._peers

    def connected(self) -> bool:
        return bool(self._target or self._peers)

    def send(self, frames: list[bytes]) -> None:
        for datagram in _datagrams(frames):
            for peer in self._listeners():
                try:
                    self._socket.sendto(datagram, peer)
                except OSError:
                    self._dropped += 1

    def close(self) -> None:
        for peer_socket in self._peers.values():
            self._close(peer_socket)
        self._peers.clear()
        self._socket.close()


def _dropped_by_kernel(sock: socket.socket) -> int:
    """Datagrams that the kernel discarded for lack of space; 0 where it does not report that."""
    try:
        counts = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 4 * (_MEMINFO_DROPS + 1))
    except OSError:
        return 0
    return int.from_bytes(counts[4 * _MEMINFO_DROPS :], sys.byteorder)


class _TcpClient:
    """One TCP client: a reader of its frames, and the bytes that it has not accepted yet."""

    def __init__(self, sock: socket.socket) -> None:
        self.socket = sock
        self.reader = FrameReader()
        self.backlog = bytearray()

    def push(self, data: bytes) -> bool:
        """Send as much as the client accepts; False when it is gone or too far behind."""
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


class TcpLink(Link):
    """`tcp_in`: listens, and serves several clients the same messages."""

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        self._socket = _open_socket(spec, socket.SOCK_STREAM, port=spec.port)
        self._socket.listen(MAX_CLIENTS)
        self._clients: list[_TcpClient] = []
        self.endpoint = f"tcp:{spec.host}:{self._socket.getsockname()[1]}"

    def poll(self) -> None:
        self._accept()
        for client in list(self._clients):
            self._read(client)

    def _accept(self) -> None:
        for _ in range(min(MAX_CLIENTS - len(self._clients), _ACCEPTED_PER_POLL)):
            try:
                sock, _ = self._socket.accept()
            except OSError:
                return
            sock.setblocking(False)
            # A step is one write, which Nagle's algorithm would hold back until the last is acknowledged.
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(_TcpClient(sock))

    def _read(self, client: _TcpClient) -> None:
        try:
            self._read_stream(client, client.reader, client.socket.recv)
        except (BlockingIOError, InterruptedError):
            return
        except (OSError, EOFError):
            self._drop(client)

    def _drop(self, client: _TcpClient) -> None:
        self._clients.remove(client)
        client.socket.close()

    def connected(self) -> bool:
        return bool(self._clients)

    def send(self, frames: list[bytes]) -> None:
        data = b"".join(frames)
        for client in list(self._clients):
            if not client.push(data):
                self._dropped += 1
                self._drop(client)

    def close(self) -> None:
        for client in self._clients:
            client.socket.close()
        self._socket.close()


class TerminalLink(Link):
    """`serial`: a pseudo terminal whose other end a companion opens as its serial device.

    With the path `auto` the system names the device; any other path becomes a symbolic link to it. The line is raw, without flow control and speed: as on a UART, data that is not read is lost.
    """

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        self._symlink: Path | None = None
        # The far end is kept open, or the line would break when the companion closes it.
        self._terminal, far_end = self._terminal_ends = os.openpty()
        os.set_blocking(self._terminal, False)
        self.endpoint = os.ttyname(far_end)
        if spec.path not in ("", "auto"):
            self._link_path(Path(spec.path))
        with contextlib.suppress(termios.error):
            tty.setraw(self._terminal_ends[-1])
        self._reader = FrameReader()
        self._backlog = bytearray()

    def _link_path(self, path: Path) -> None:
        try:
            if path.is_symlink() and not path.exists():
                # A run that was killed has left a dangling link.
                path.unlink()
            path.symlink_to(self.endpoint)
        except OSError:
            self.close()
            raise
        self._symlink = path
        self.endpoint = str(path)

    def poll(self) -> None:
        # There is no data, or no companion has opened the other end.
        with contextlib.suppress(OSError, EOFError):
            self._read_stream(None, self._reader, lambda size: os.read(self._terminal, size))

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            if len(self._backlog) < _SERIAL_BACKLOG_BYTES:
                self._backlog += frame
            else:
                self._dropped += 1
        with contextlib.suppress(OSError):
            while self._backlog:
                del self._backlog[: os.write(self._terminal, self._backlog)]

    def close(self) -> None:
        if self._symlink:
            self._symlink.unlink(missing_ok=True)
        for end in self._terminal_ends:
            os.close(end)


class DeviceLink(Link):
    """`serial` on a device of this machine, with a companion at the other end of the cable."""

    def __init__(self, spec: LinkSpec) -> None:
        super().__init__(spec)
        self.device = SerialDevice(spec.path, spec.baud, f"link {spec.name}")
        self.endpoint = f"{spec.path}:{spec.baud}" if spec.baud else spec.path
        self.reader = SequenceReader()

    def poll(self) -> None:
        resets = self.device.resets
        with contextlib.suppress(EOFError):
            self._read_stream(None, self.reader, self.device.read)
        if self.device.resets > resets:
            self.reader.forget()

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            self._dropped += not self.device.send(frame)

    def close(self) -> None:
        self.device.close()


def link_counters(links: Iterable[Link]) -> dict[str, int]:
    """What was lost or damaged on these links, by name; of serial devices where there are some."""
    links = list(links)
    counts = {
        "mavlink_garbage_bytes": sum(link.garbage_bytes for link in links),
        "mavlink_dropped": sum(link.dropped for link in links),
    }
    devices = [link for link in links if isinstance(link, DeviceLink)]
    if devices:
        counts["serial_lost_bytes"] = sum(link.device.lost_bytes for link in devices)
        counts["serial_lost_messages"] = sum(link.reader.lost_messages for link in devices)
        counts["serial_resets"] = sum(link.device.resets for link in devices)
    return counts


@contextmanager
def open_links(specs: tuple[LinkSpec, ...]) -> Iterator[list[Link]]:
    """Yield every link, opened; leaving the block closes all. Raises SetupError with each fault."""
    with ExitStack() as stack:
        links: list[Link] = []
        faults: list[Fault] = []
        for spec in specs:
            try:
                link = _LINK_CLASSES[spec.kind](spec)
            except SetupError as error:
                faults += error.faults
            except OSError as error:
                remedy = "choose a free port and an address of this machine"
                address = spec.path if spec.kind == "serial" else f"{spec.host}:{spec.port}"
                what = f"{address} cannot be opened: {error.strerror}"
                faults.append(Fault(f"link {spec.name}", what, remedy))
            else:
                stack.callback(link.close)
                links.append(link)
        if faults:
            raise SetupError(faults)
        yield links


_LINK_CLASSES: Mapping[str, Callable[[LinkSpec], Link]] = {
    "udp_out": UdpLink,
    "udp_in": UdpLink,
    "tcp_in": TcpLink,
    "serial": lambda spec: _serial_link(spec),
}


def _serial_link(spec: LinkSpec) -> Link:
    """A device where one is meant: by its speed, or because it is there."""
    if spec.baud or (spec.path not in ("", "auto") and Path(spec.path).is_char_device()):
        return DeviceLink(spec)
    return TerminalLink(spec)


def _open_socket(spec: LinkSpec, kind: socket.SocketKind, port: int) -> socket.socket:
    with contextlib.ExitStack() as stack:
        opened = stack.enter_context(spec.open_socket(kind))
        if kind is socket.SOCK_STREAM:
            # A server that restarts must not wait for the old connections of its port to time out.
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        else:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _SOCKET_BYTES)
        # A sender need only be reachable from where it sends to; on loopback it binds there.
        local = spec.host.startswith("127.") or spec.host == "localhost"
        opened.bind((spec.host if local or spec.kind != "udp_out" else "", port))
        opened.setblocking(False)
        stack.pop_all()
    return opened


def _datagrams(frames: list[bytes]) -> Iterator[bytes]:
    """Frames joined to datagrams of at most 1200 bytes: a system call costs more than the message in it."""
    if 0 < sum(map(len, frames)) <= _DATAGRAM_BYTES:
        yield b"".join(frames)
        return
    joined: list[bytes] = []
    size = 0
    for frame in frames:
        if size + len(frame) > _DATAGRAM_BYTES and joined:
            yield b"".join(joined)
            joined, size = [], 0
        joined.append(frame)
        size += len(frame)
    if joined:
        yield b"".join(joined)
