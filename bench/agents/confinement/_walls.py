"""What each rung holds and what it leaves open: the one table that docs, `rebar doctor`, results and tests use."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from bench.network_namespace import namespace_fault

from . import _landlock
from ._cgroup import can_limit


class Wall(StrEnum):
    """Something that a wall may stand before; values are the words of the table."""

    FILES = "files of campaigns, SimSpecs, recordings, other users"
    WRITING = "writing outside its own folders"
    PROCESSES = "environments and command lines of other processes"
    SIGNALS = "signals to other processes"
    TCP = "TCP to the bench, neighbours, the internet"
    UDP = "UDP to the same"
    ABSTRACT_SOCKETS = "abstract Unix sockets of others"
    SHARED_MEMORY = "shared memory of others"
    KERNEL = "keyring, ptrace, namespaces, io_uring, bpf, vsock"
    RIGHTS = "capabilities and setuid programs"
    SETTINGS = "settings of the kernel"
    HOST_NAME = "the name of the host"
    USER = "a user of its own"
    DESCRIPTORS = "open files of the bench"
    DISK = "quota of its folders"
    PROCESS_COUNT = "number of processes and threads"
    MEMORY = "memory of one process"
    MEMORY_OF_ALL = "memory of all its processes together"
    DAEMONS = "processes that it leaves behind"


@dataclass(frozen=True, slots=True)
class Host:
    """What of this host decides whether a wall holds."""

    root: bool
    landlock: int
    memory_groups: bool
    process_groups: bool
    own_network: bool
    own_user: bool
    """Root gives the agent another user; not where that one cannot reach the agent's files."""
    own_root: bool
    """The rung `landlock` gives the agent namespaces, and a root folder in them."""


def this_host(*, own_network: bool | None = None, own_user: bool = False) -> Host:
    """The facts of this process's host; `own_network` None asks whether this process has one."""
    return Host(
        root=os.getuid() == 0,
        landlock=_landlock.landlock_version(),
        memory_groups=can_limit("memory"),
        process_groups=can_limit("pids"),
        own_network=namespace_fault() is None if own_network is None else own_network,
        own_user=own_user,
        own_root=_landlock.namespaces_fault() is None,
    )


@dataclass(frozen=True, slots=True)
class Holding:
    """How a rung stands to a wall. `text` is for the table; `holds` decides for a host."""

    text: str
    holds: Callable[[Host], bool]


_YES = Holding("yes", lambda host: True)
_NO = Holding("no", lambda host: False)
_NETWORK = Holding("in a network of its own", lambda host: host.own_network)
_BY_NETWORK = dict.fromkeys((Wall.TCP, Wall.UDP, Wall.ABSTRACT_SOCKETS), _NETWORK)
_OWN_USER = Holding("as root, where strangers may read its files", lambda host: host.own_user)
# RLIMIT_NPROC does not hold the root user.
_PROCESS_COUNT = Holding(
    "yes; for the root user by cgroup", lambda host: host.process_groups or not host.root or host.own_user
)
_MEMORY_OF_ALL = Holding("by cgroup", lambda host: host.memory_groups)
_ENGINE = Holding("yes, by the engine", lambda host: True)

HOLDINGS: Mapping[str, Mapping[Wall, Holding]] = {
    "landlock": {
        **dict.fromkeys(Wall, _YES),
        Wall.SIGNALS: Holding(
            "in namespaces, else from Linux 6.12", lambda host: host.own_root or host.landlock >= 6
        ),
        Wall.TCP: Holding(
            "in a network of its own, else by port from Linux 6.7",
            lambda host: host.landlock >= 4 or host.own_network,
        ),
        Wall.UDP: _NETWORK,
        Wall.ABSTRACT_SOCKETS: Holding(
            "from Linux 6.12, or in a network of its own",
            lambda host: host.landlock >= 6 or host.own_network,
        ),
        Wall.HOST_NAME: Holding("in namespaces", lambda host: host.own_root),
        Wall.USER: _OWN_USER,
        Wall.DISK: Holding("yes; without namespaces by a watch that ends it", lambda host: True),
        Wall.PROCESS_COUNT: _PROCESS_COUNT,
        Wall.MEMORY_OF_ALL: _MEMORY_OF_ALL,
    },
    "container": {
        **dict.fromkeys(Wall, _YES),
        **_BY_NETWORK,
        Wall.PROCESS_COUNT: _ENGINE,
        Wall.MEMORY_OF_ALL: _ENGINE,
    },
    "none": {
        **dict.fromkeys(Wall, _NO),
        **_BY_NETWORK,
        Wall.SETTINGS: Holding("unless the bench is root", lambda host: not host.root),
        Wall.DESCRIPTORS: _YES,
        Wall.DAEMONS: Holding("unless they change their HOME", lambda host: False),
    },
}


def leaves_open(rung: str, host: Host) -> tuple[Wall, ...]:
    """The walls that a rung does not hold on a host."""
    return tuple(wall for wall, holding in HOLDINGS[rung].items() if not holding.holds(host))


def wall_name(wall: Wall) -> str:
    """What a result calls a wall: it stays when the words of the table change."""
    return wall.name.lower()


def wall_text(name: str) -> str:
    """The words of the table for a name in a result; the name itself where no such wall is known."""
    return Wall.__members__.get(name.upper(), name)


def walls_table() -> str:
    """The table of docs/agents-confinement.md."""
    rows = [["wall", *HOLDINGS], ["---"] * (1 + len(HOLDINGS))]
    rows += [[wall, *(holdings[wall].text for holdings in HOLDINGS.values())] for wall in Wall]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
