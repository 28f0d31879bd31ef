"""The process that carries the agent's connections to services outside; a script of the standard library alone.

Run on the host's network as `python -I -S _service_relay.py CONTROL LISTENER...`, where the listeners are sockets of the
session's network, one for each service. It is a process of its own so that traffic takes no time from the session, and
it ends when the other side of CONTROL (SOCK_SEQPACKET, JSON) does:

    -> [["api.example.org", 443], ...]       the services, in the order of the listeners
    <- [null, "does not answer: ..."]        why each cannot be reached; with one such text the process ends
    -> (end of stream)
    <- [{"connections": 1, ...}, ...]        what went over each
"""

from __future__ import annotations

import errno
import json
import os
import resource
import selectors
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

# For names and first connections, of all services at once; then for each later connection. A DNS client of Linux gives
# up after 10 s by default (resolv.conf: two attempts of 5 s).
CHECK_BUDGET_S = 12.0
CONNECT_BUDGET_S = 10.0
# Chosen: an agent with a pool of HTTP connections has ten or so, and each direction may hold this much. Fewer where this
# process may have fewer files: a listener whose connections cannot be accepted would keep the loop busy.
MAX_CONNECTIONS = 64
OTHER_FILES = 64
BUFFER_BYTES = 65536
# struct linger: close at once, and tell the peer by a reset that this was no regular end.
RESET = struct.pack("ii", 1, 0)

Address = tuple[socket.AddressFamily, Any]


@dataclass(slots=True)
class Service:
    """One service: where it is, and what went over its listener."""

    host: str
    port: int
    addresses: list[Address] = field(default_factory=list)
    fault: str | None = f"does not answer within {CHECK_BUDGET_S:g} s"
    counts: dict[str, int] = field(
        default_factory=lambda: {
            "connections": 0,
            "failed": 0,
            "refused": 0,
            "bytes_sent": 0,
            "bytes_received": 0,
        }
    )
    open: int = 0

    def check(self) -> None:
        """Look the host up once for the whole session, and connect to the first address that answers."""
        try:
            infos = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)
        except OSError as error:
            self.fault = f"the name does not resolve: {error.strerror}"
            return
        addresses: list[Address] = list(dict.fromkeys((info[0], info[4]) for info in infos))
        fault = ""
        for index, (family, address) in enumerate(addresses):
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                probe.settimeout(CONNECT_BUDGET_S)
                try:
                    probe.connect(address)
                except OSError as error:
                    fault = fault or f"does not answer: {error.strerror or error}"
                    continue
            self.addresses, self.fault = [*addresses[index:], *addresses[:index]], None
            return
        self.fault = fault


class Relay:
    """Listeners and connections, served by one loop."""

    def __init__(self, control: socket.socket, most_open: int) -> None:
        self.selector = selectors.DefaultSelector()
        # Connections at once over one service.
        self.most_open = most_open
        self.connecting: set[Connection] = set()
        self.connections: set[Connection] = set()
        self._control = control
        self._ended = False

    def run(self, listeners: list[socket.socket], services: list[Service]) -> None:
        """Carry connections until the session is over."""
        self._control.setblocking(False)
        self.selector.register(self._control, selectors.EVENT_READ, self._end)
        for listener, service in zip(listeners, services, strict=True):
            listener.setblocking(False)
            accept = Accept(self, listener, service)
            self.selector.register(listener, selectors.EVENT_READ, accept)
        while not self._ended:
            for key, _ in self.selector.select(self._patience_s()):
                # An earlier event of this round may have closed what this one is about.
                if self.selector.get_map().get(key.fd) is key:
                    key.data()
            now = time.monotonic()
            for connection in list(self.connecting):
                if connection.deadline <= now:
                    connection.next_address()
        for connection in list(self.connections):
            connection.close()

    def watch(self, sock: socket.socket, events: int, act: Callable[[], None]) -> None:
        """Call `act` at these events; at none of them with 0."""
        known = sock.fileno() in self.selector.get_map()
        if known and events:
            self.selector.modify(sock, events, act)
        elif known:
            self.selector.unregister(sock)
        elif events:
            self.selector.register(sock, events, act)

    def _patience_s(self) -> float | None:
        deadline = min((connection.deadline for connection in self.connecting), default=None)
        return None if deadline is None else max(deadline - time.monotonic(), 0.0)

    def _end(self) -> None:
        with suppress(BlockingIOError):
            self._ended = not self._control.recv(1)


@dataclass(frozen=True, slots=True)
class Accept:
    """Takes the connections of one listener."""

    relay: Relay
    listener: socket.socket
    service: Service

    def __call__(self) -> None:
        # The client may have gone already.
        with suppress(OSError):
            inner = self.listener.accept()[0]
            inner.setblocking(False)
            if self.service.open >= self.relay.most_open:
                self.service.counts["refused"] += 1
                reset(inner)
            else:
                Connection(self.relay, self.service, inner).next_address()


@dataclass(slots=True)
class End:
    """One of the two sockets of a connection, and what is to be sent over it."""

    sock: socket.socket
    # The count that grows by what is sent here.
    count: str
    pending: bytearray = field(default_factory=bytearray)
    # It has sent its last byte; we have sent ours.
    finished: bool = False
    shut: bool = False


class Connection:
    """A connection of the agent, and the one to the service that answers it."""

    def __init__(self, relay: Relay, service: Service, inner: socket.socket) -> None:
        self.deadline = 0.0
        self._relay, self._service = relay, service
        self._waiting = list(service.addresses)
        self._inner = End(inner, "bytes_received")
        self._outer: End | None = None
        service.open += 1
        relay.connections.add(self)
        relay.connecting.add(self)

    def next_address(self) -> None:
        """Try the next address of the service; without one the connection ends."""
        if self._outer is not None:
            self._relay.watch(self._outer.sock, 0, self._connected)
            self._outer.sock.close()
            self._outer = None
        if not self._waiting:
            self._service.counts["failed"] += 1
            self.abort()
            return
        family, address = self._waiting.pop(0)
        try:
            outer = socket.socket(family, socket.SOCK_STREAM)
        except OSError:
            # Out of descriptors, or a host without IPv6.
            self.next_address()
            return
        self._outer = End(outer, "bytes_sent")
        outer.setblocking(False)
        self.deadline = time.monotonic() + CONNECT_BUDGET_S
        if outer.connect_ex(address) in (0, errno.EINPROGRESS):
            self._relay.watch(outer, selectors.EVENT_WRITE, self._connected)
        else:
            self.next_address()

    def close(self) -> None:
        """Close both sides."""
        self._forget()
        for end in self._ends():
            end.sock.close()

    def abort(self) -> None:
        """Close both sides so that neither takes it for a regular end."""
        self._forget()
        for end in self._ends():
            reset(end.sock)

    def _connected(self) -> None:
        assert self._outer is not None
        if self._outer.sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.next_address()
            return
        self._relay.connecting.discard(self)
        self._service.counts["connections"] += 1
        for end in self._ends():
            # Small requests and answers are not held back for the sake of fewer packets.
            end.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._watch()

    def _serve(self) -> None:
        """Move what can be moved, in both directions."""
        assert self._outer is not None
        try:
            self._move(self._inner, self._outer)
            self._move(self._outer, self._inner)
        except OSError:
            self.abort()
            return
        if self._inner.shut and self._outer.shut:
            self.close()
        else:
            self._watch()

    def _move(self, source: End, sink: End) -> None:
        with suppress(BlockingIOError):
            if not source.finished and len(sink.pending) < BUFFER_BYTES:
                data = source.sock.recv(BUFFER_BYTES - len(sink.pending))
                sink.pending += data
                source.finished = not data
        with suppress(BlockingIOError):
            if sink.pending:
                sent = sink.sock.send(sink.pending)
                self._service.counts[sink.count] += sent
                del sink.pending[:sent]
        if source.finished and not sink.pending and not sink.shut:
            sink.shut = True
            sink.sock.shutdown(socket.SHUT_WR)

    def _watch(self) -> None:
        assert self._outer is not None
        for source, sink in ((self._inner, self._outer), (self._outer, self._inner)):
            events = 0
            # A side that reads too slowly makes the other one wait: nothing piles up here.
            if not source.finished and len(sink.pending) < BUFFER_BYTES:
                events |= selectors.EVENT_READ
            if source.pending:
                events |= selectors.EVENT_WRITE
            self._relay.watch(source.sock, events, self._serve)

    def _forget(self) -> None:
        self._service.open -= 1
        self._relay.connections.discard(self)
        self._relay.connecting.discard(self)
        for end in self._ends():
            self._relay.watch(end.sock, 0, self._serve)

    def _ends(self) -> list[End]:
        return [self._inner] if self._outer is None else [self._inner, self._outer]


def reset(sock: socket.socket) -> None:
    """Close a connection by a reset."""
    with suppress(OSError):
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
    sock.close()


def check(services: list[Service]) -> None:
    """Check all services at once, each in a thread: the look-up of a name cannot be interrupted."""
    threads = [threading.Thread(target=service.check, daemon=True) for service in services]
    deadline = time.monotonic() + CHECK_BUDGET_S
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(max(deadline - time.monotonic(), 0.0))


def most_open(services: int) -> int:
    """Connections at once over each of so many services, two files each."""
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    files = OTHER_FILES + services * (1 + 2 * MAX_CONNECTIONS)
    if hard != resource.RLIM_INFINITY:
        files = min(files, hard)
    # The soft limit of most systems, 1,024, is less than what 16 services need.
    resource.setrlimit(resource.RLIMIT_NOFILE, (files, hard))
    return min((files - OTHER_FILES) // services // 2, MAX_CONNECTIONS)


def main() -> None:
    """Check the services, carry connections, and say what went over them."""
    control, *listeners = (socket.socket(fileno=int(word)) for word in sys.argv[1:])
    services = [Service(host, port) for host, port in json.loads(control.recv(65536))]
    check(services)
    faults = [service.fault for service in services]
    with suppress(OSError):
        control.send(json.dumps(faults).encode())
        if not any(faults):
            Relay(control, most_open(len(services))).run(listeners, services)
            control.send(json.dumps([service.counts for service in services]).encode())
    # A thread may still wait for a name.
    os._exit(0)


if __name__ == "__main__":
    main()
