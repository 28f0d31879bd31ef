"""Whether the host ran out of memory while a session flew."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

_VMSTAT = Path("/proc/vmstat")


def count_memory_kills(vmstat: Path = _VMSTAT) -> int:
    """How many processes the kernel killed for want of memory since it started, in containers too.

    0 where the system does not tell (Linux before 4.13, another system).
    """
    with suppress(OSError, ValueError):
        for line in vmstat.read_text(encoding="ascii").splitlines():
            name, _, count = line.partition(" ")
            if name == "oom_kill":
                return int(count)
    return 0
