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

import asyncio
import json
import os
import resource
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

# For names and first connections, of all services at once; then for each later connection. A DNS client of Linux gives
# up after 10 s by default (resolv.conf: two attempts of 5 s).
CHECK_BUDGET_S = 12.0
CONNECT_BUDGET_S = 10.0
# Chosen: an agent with a pool of HTTP connections has ten or so, and each direction may hold this much. Fewer where this
# process may have fewer files.
MAX_CONNECTIONS = 64
OTHER_FILES = 64
BUFFER_BYTES = 65536
# After a connection that could not be taken; chosen.
ACCEPT_AGAIN_S = 0.01
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


async def relay(
    control: socket.socket, listeners: list[socket.socket], services: list[Service], most: int
) -> None:
    """Carry connections until the session is over, at most so many at once over each service."""
    control.setblocking(False)
    loop = asyncio.get_running_loop()
    async with asyncio.TaskGroup() as tasks:
        accepting = [
            tasks.create_task(accept(listener, service, most))
            for listener, service in zip(listeners, services, strict=True)
        ]
        while await loop.sock_recv(control, 1):
            pass
        for task in accepting:
            task.cancel()


async def accept(listener: socket.socket, service: Service, most: int) -> None:
    """Take the connections of one listener."""
    listener.setblocking(False)
    loop = asyncio.get_running_loop()
    async with asyncio.TaskGroup() as connections:
        while True:
            try:
                inner, _ = await loop.sock_accept(listener)
            except OSError:
                # The client may have gone already. Without a wait a lack of files would keep this loop busy.
                await asyncio.sleep(ACCEPT_AGAIN_S)
                continue
            if service.open >= most:
                service.counts["refused"] += 1
                reset(inner)
            else:
                service.open += 1
                connections.create_task(carry(inner, service))


async def carry(inner: socket.socket, service: Service) -> None:
    """Carry one connection of the agent on to the service, until both sides have sent their last byte."""
    outer = None
    try:
        outer = await connected(service)
        service.counts["connections"] += 1
        for end in (inner, outer):
            # Small requests and answers are not held back for the sake of fewer packets.
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        async with asyncio.TaskGroup() as directions:
            directions.create_task(pump(inner, outer, service.counts, "bytes_sent"))
            directions.create_task(pump(outer, inner, service.counts, "bytes_received"))
    except* OSError:
        # So that neither side takes it for a regular end.
        for end in filter(None, (inner, outer)):
            reset(end)
    finally:
        service.open -= 1
        for end in filter(None, (inner, outer)):
            end.close()


async def connected(service: Service) -> socket.socket:
    """A connection to the first address of a service that takes one. Raises OSError, and counts it, where none does."""
    for family, address in service.addresses:
        # Out of descriptors, a host without IPv6, or nobody there.
        with suppress(OSError):
            outer = socket.socket(family, socket.SOCK_STREAM)
            try:
                outer.setblocking(False)
                async with asyncio.timeout(CONNECT_BUDGET_S):
                    await asyncio.get_running_loop().sock_connect(outer, address)
            except BaseException:
                outer.close()
                raise
            return outer
    service.counts["failed"] += 1
    raise ConnectionRefusedError


async def pump(source: socket.socket, sink: socket.socket, counts: dict[str, int], count: str) -> None:
    """Send on what comes, up to its end. A side that reads too slowly makes the other one wait: nothing piles up here."""
    loop = asyncio.get_running_loop()
    while data := await loop.sock_recv(source, BUFFER_BYTES):
        await loop.sock_sendall(sink, data)
        counts[count] += len(data)
    sink.shutdown(socket.SHUT_WR)


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
            asyncio.run(relay(control, listeners, services, most_open(len(services))))
            control.send(json.dumps([service.counts for service in services]).encode())
    # A thread may still wait for a name.
    os._exit(0)


if __name__ == "__main__":
    main()
