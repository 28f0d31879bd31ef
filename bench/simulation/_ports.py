"""UDP ports that agents will bind: no two sessions get the same one, though no socket holds them yet."""

from __future__ import annotations

import fcntl
import os
import socket
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import Fault, SetupError

# Below the range from which Linux picks ephemeral ports (32768 on), so that no other program's client takes
# one by chance.
PORTS = range(14600, 30000)


@contextmanager
def reserved_udp_port(host: str = "127.0.0.1") -> Generator[int]:
    """A UDP port that is free now and that no other session of this user reserves while the block lasts."""
    folder = Path(tempfile.gettempdir(), f"rebar-ports-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    # Sessions start their search at different ports, so that many of them do not try the same locks.
    start = os.getpid() * 7 % len(PORTS)
    for offset in range(len(PORTS)):
        port = PORTS[(start + offset) % len(PORTS)]
        handle = os.open(folder / str(port), os.O_CREAT | os.O_RDWR, 0o600)
        try:
            if _lock(handle) and _is_free(host, port):
                yield port
                return
        finally:
            os.close(handle)
    raise SetupError(
        Fault("MAVLink", f"no UDP port in {PORTS.start} to {PORTS.stop - 1} is free", "end what uses them")
    )


def _lock(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is_free(host: str, port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True
