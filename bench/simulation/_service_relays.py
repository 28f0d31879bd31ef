"""Services outside of the session, let in for the agent where the SimSpec asks for it."""

from __future__ import annotations

import ipaddress
import json
import os
import socket
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from bench.contracts import ServicesLetIn, ServiceUse
from bench.errors import Fault, SetupError
from bench.network_namespace import namespace_fault, start_outside
from bench.simspec import OutsideService

from . import _service_relay

_LOCALHOST = "127.0.0.1"
_MESSAGE_BYTES = 65536
# Beyond what the relay takes for its checks, and for its last message: generous for a busy host.
_PATIENCE_S = 30.0


@dataclass(slots=True)
class Services:
    """The services of one session.

    `endpoints` holds host:port for each variable of the agent, `hosts` the address in the session for each host name
    that leads to a service under the service's own port; it is empty where the session has no network of its own.
    """

    endpoints: Mapping[str, str] = field(default_factory=dict)
    hosts: Mapping[str, str] = field(default_factory=dict)


@contextmanager
def open_services(
    services: Sequence[OutsideService], on_end: Callable[[ServicesLetIn], None] = lambda used: None
) -> Generator[Services]:
    """Let these services in: a listener for each in the session's network, and a process on the host's network that
    carries each connection on. Leaving the block closes all connections; `on_end` learns what went over them.

    Raises SetupError with every service that cannot be reached now.
    """
    if not services:
        yield Services()
        return
    own_network = namespace_fault() is None
    addresses = _session_addresses(services)
    with ExitStack() as stack:
        listeners = [
            # Other sessions share the host's network where there is no own one, so the system chooses the port.
            stack.enter_context(
                _listener(service, addresses[service.host], service.port)
                if own_network
                else _listener(service, _LOCALHOST, 0)
            )
            for service in services
        ]
        opened = Services(
            {
                service.variable: "{}:{}".format(*listener.getsockname())
                for service, listener in zip(services, listeners, strict=True)
            },
            {service.host: addresses[service.host] for service in services if service.has_host_name}
            if own_network
            else {},
        )
        relay = stack.enter_context(_open_relay(services, listeners))
        # The relay has copies. When it is gone nothing listens, so that the agent is refused and does not hang.
        for listener in listeners:
            listener.close()
        try:
            yield opened
        finally:
            on_end(ServicesLetIn(uses=relay.end()))


def service_faults(services: Sequence[OutsideService]) -> list[Fault]:
    """Why services cannot be reached from this host now."""
    try:
        with open_services(services):
            return []
    except SetupError as error:
        return list(error.faults)


def _session_addresses(services: Sequence[OutsideService]) -> dict[str, str]:
    """A loopback address of the session for each host: this host's own are the same in the session, and two others may
    have services on one port.
    """
    hosts = {service.host: service.canonical_host for service in services}
    local = {host: canonical for host, canonical in hosts.items() if _is_loopback(canonical)}
    free = (address for number in range(2, 255) if (address := f"127.0.0.{number}") not in local.values())
    return local | {host: next(free) for host in hosts if host not in local}


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.IPv4Address(host).is_loopback
    except ValueError:
        return False


def _listener(service: OutsideService, address: str, port: int) -> socket.socket:
    try:
        return socket.create_server((address, port))
    except OSError as error:
        what = f"no listener on port {port} of the session: {error.strerror}"
        raise SetupError(_where(service), what, "give the service another port") from None


def _where(service: OutsideService) -> str:
    return f"agent.services[{service.name}]"


class _Relay:
    """The process that carries connections, seen from the session."""

    def __init__(self, control: socket.socket, services: Sequence[OutsideService]) -> None:
        self._control, self._services = control, services

    def check(self) -> None:
        """Have all services looked up and tried. Raises SetupError."""
        request = [(service.host, service.port) for service in self._services]
        self._control.settimeout(_service_relay.CHECK_BUDGET_S + _PATIENCE_S)
        texts = None
        with suppress(OSError):
            self._control.send(json.dumps(request).encode())
            texts = self._receive()
        if texts is None:
            raise SetupError(
                "agent.services", "the process that carries connections did not start", "fly again"
            )
        faults = [
            Fault(
                _where(service),
                f"{service.host}:{service.port} {text}",
                "start the service, correct host and port, or remove it from the SimSpec",
            )
            for service, text in zip(self._services, texts, strict=True)
            if text
        ]
        if faults:
            raise SetupError(faults)

    def end(self) -> tuple[ServiceUse, ...]:
        """Close all connections and return what went over them."""
        counts = None
        self._control.settimeout(_PATIENCE_S)
        with suppress(OSError):
            self._control.shutdown(socket.SHUT_WR)
            counts = self._receive()
        return tuple(
            ServiceUse(name=service.name, host=service.host, port=service.port, **use)
            for service, use in zip(
                self._services, counts or [{"counted": False}] * len(self._services), strict=True
            )
        )

    def wait(self) -> None:
        """Wait until the process has closed everything, which it does with its end."""
        with suppress(OSError):
            while self._control.recv(_MESSAGE_BYTES):
                pass

    def _receive(self) -> list[Any] | None:
        message = self._control.recv(_MESSAGE_BYTES)
        return json.loads(message) if message else None


@contextmanager
def _open_relay(services: Sequence[OutsideService], listeners: Sequence[socket.socket]) -> Generator[_Relay]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        with theirs:
            try:
                child = start_outside(
                    [sys.executable, "-I", "-S", _service_relay.__file__],
                    [theirs.fileno(), *(listener.fileno() for listener in listeners)],
                )
            except OSError as error:
                remedy = "fly again, or remove the services from the SimSpec"
                raise SetupError("agent.services", f"cannot be let in: {error}", remedy) from None
        relay = _Relay(ours, services)
        try:
            relay.check()
            yield relay
        finally:
            with suppress(OSError):
                ours.shutdown(socket.SHUT_WR)
            relay.wait()
            if child is not None:
                os.waitpid(child, 0)
