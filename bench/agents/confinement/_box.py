"""What one agent may see and use of the host."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import AgentLimits

# The user and group of confined agents where they get one of their own: above the users that distributions
# give out, and within what container engines map.
AGENT_UID = 60001
# As many follow it; the next numbers are those of systemd's dynamic users. Chosen.
_AGENT_USERS = 500


def agent_user() -> int:
    """The user of this process's agents on the host.

    The kernel counts inotify instances, queued signals and pages of pipes for each user, over all sessions: what one agent
    uses up, agents of another worker must not miss.
    """
    return AGENT_UID + os.getpid() % _AGENT_USERS


@dataclass(frozen=True, slots=True)
class Place:
    """Where an agent finds things: its HOME and working folder, and the folder of the files that the bench gives it."""

    home: str
    files: str


# On rungs with a root of their own both are one folder in memory, which nothing else can open.
BOX_PLACE = Place("/scratch", "/scratch")


def host_place(scratch: Path) -> Place:
    """In a root that the agent shares with the bench: nothing but its HOME is the agent's to write, and the bench opens
    nothing in there once the agent has started.
    """
    return Place(str(scratch / "home"), str(scratch))


def box_files(paths: Iterable[Path]) -> dict[str, str]:
    """The place of files of the host in a root of its own."""
    return {str(path): f"{BOX_PLACE.files}/{path.name}" for path in paths}


def name_files(hosts: Mapping[str, str], user: int = AGENT_UID) -> dict[str, str]:
    """The files in /etc of a root of its own by which names are looked up; `hosts` are addresses by host name, `user` is
    the agent's there.
    """
    # The first line that has a name decides.
    lines = "".join(f"{address} {name}\n" for name, address in hosts.items())
    return {
        "passwd": f"agent:x:{user}:{user}::{BOX_PLACE.home}:/bin/sh\n",
        "group": f"agent:x:{user}:\n",
        "hosts": f"{lines}127.0.0.1 localhost agent\n::1 localhost\n",
        "nsswitch.conf": "passwd: files\ngroup: files\nhosts: files\n",
    }


@dataclass(frozen=True, slots=True)
class Box:
    """What one agent may see and use. `command` holds absolute paths that are readable in the box.

    `scratch` is the host's folder of the session, in which no agent may write but on a rung with the host's root, there
    in its HOME. `files` are files and folders of the host that the agent finds by name in the folder of `Place.files`,
    `shared` those that it may also write, so that both sides have the same file. `hosts` are addresses by host name, for rungs with a file system of their own.
    """

    command: tuple[str, ...]
    environment: Mapping[str, str]
    scratch: Path
    read: tuple[Path, ...] = ()
    files: tuple[Path, ...] = ()
    shared: tuple[Path, ...] = ()
    tcp_ports: frozenset[int] = frozenset()
    limits: AgentLimits = field(default_factory=AgentLimits)
    gpu: bool = False
    image: str = ""
    hosts: Mapping[str, str] = field(default_factory=dict)
