"""The limits of one process."""

from __future__ import annotations

import resource

from bench.contracts import AgentLimits


def process_limits(limits: AgentLimits) -> dict[int, int]:
    """The limits of one process, by number of the resource.

    RLIMIT_DATA and not RLIMIT_AS: Node, Go and Java reserve much more address space than they use.
    """
    return {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_FSIZE: limits.file_mb << 20,
        resource.RLIMIT_NOFILE: limits.open_files,
        resource.RLIMIT_NPROC: limits.processes,
        resource.RLIMIT_DATA: limits.memory_mb << 20,
        resource.RLIMIT_MSGQUEUE: 0,
        # io_uring is denied, and locked memory is not swapped: none of an agent's needs. Node asks for some.
        resource.RLIMIT_MEMLOCK: 1 << 20,
    }
