"""UDP ports that agents will bind: no two sessions get the same one, though no socket holds them yet."""

from __future__ import annotations

import os
import socket
from collections.abc import Generator
from contextlib import contextmanager

from bench.errors import SetupError

# Below Linux's ephemeral ports (32768 on), so that no other program's client takes one by chance.
PORTS = range(14600, 30000)


@contextmanager
def reserved_udp_port() -> Generator[int]:
    """A UDP port that is free now and that no other session of this user reserves while the block lasts."""
    # Sessions start their search at different ports, so that many of them do not try the same locks.
    start = os.getpid() * 7 % len(PORTS)
    for offset in range(len(PORTS)):
        port = PORTS[(start + offset) % len(PORTS)]
        # An abstract name is a lock that leaves no file: it goes with its process, and belongs to a network, as ports do.
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as lock:
            if _binds(lock, f"\0rebar-port-{os.getuid()}-{port}") and _is_free(port):
                yield port
                return
    raise SetupError(
        "MAVLink", f"no UDP port in {PORTS.start} to {PORTS.stop - 1} is free", "end what uses them"
    )


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        return _binds(probe, ("127.0.0.1", port))


def _binds(probe: socket.socket, address: str | tuple[str, int]) -> bool:
    try:
        probe.bind(address)
    except OSError:
        return False
    return True
