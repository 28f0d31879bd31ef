"""Numbers of autopilots on one machine: ports, lock files and sockets of PX4 and ArduPilot follow from them."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from bench.errors import SetupError

# From 10 on, PX4's ports would run into each other.
INSTANCES = range(10)


# Where PX4 keeps its own lock: a fixed place, because workers of a campaign have temporary folders of their own.
_LOCKS = Path("/tmp")


@contextmanager
def claimed_instance(is_free: Callable[[int], bool], locks: Path = _LOCKS) -> Generator[int]:
    """The first number that nobody has on this machine and for which `is_free` holds.

    Sessions in network namespaces of their own need different numbers too: PX4 keeps a lock and a socket in /tmp.
    Raises SetupError when all ten are taken.
    """
    for number in INSTANCES:
        path = locks / f"rebar-autopilot-{number}.lock"
        try:
            handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        except PermissionError:
            # Another user's.
            continue
        try:
            if not _locked(handle, path):
                continue
            try:
                if _has_px4(number) or not is_free(number):
                    continue
                yield number
                return
            finally:
                # Nobody else may remove it: a stranger's lock on a file that is gone protects nothing.
                path.unlink()
        finally:
            os.close(handle)
    raise SetupError(
        "vehicle.autopilot",
        f"{len(INSTANCES)} autopilots run on this machine already, or other programs hold their ports",
        "fly fewer sessions at once (--workers), or end what uses UDP 14540 to 14549, TCP 4560 to 4569 and 5760 to 5853",
    )


def _locked(handle: int, path: Path) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    # The file may have been removed by its last owner between opening and locking it.
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False


def _has_px4(number: int) -> bool:
    """Whether a PX4 that is not the bench's runs under this number: it holds /tmp/px4_lock-N."""
    try:
        handle = os.open(f"/tmp/px4_lock-{number}", os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError:
        # Another user's.
        return True
    try:
        # Both kinds of lock, since only one of them shows the other's owner.
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(handle)
    return False
