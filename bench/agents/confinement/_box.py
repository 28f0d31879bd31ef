"""What one agent may see and use of the host."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import AgentLimits

# The user and group of confined agents where they get one of their own: above the users that distributions
# give out, and within what container engines map.
AGENT_UID = 60001


@dataclass(frozen=True, slots=True)
class Box:
    """What one agent may see and use. `command` holds absolute paths that are readable in the box.

    `scratch` is the host's folder of the session: a rung with a file system of its own gives the agent
    another one. `warm` is what of `environment` an interpreter starts with that is forked for each session; None: the
    agent is a fresh process. `files` are files of the host that the agent finds by name in its scratch folder, `shared` those that it may also
    write, so that both sides have the same file. `hosts` are addresses by
    host name, for rungs with a file system of their own.
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
    warm: Mapping[str, str] | None = None
