"""The tricks by name, and how a session with each ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from . import _files, _mavlink, _network, _processes, _resources, _ticks
from ._cheat import Trick
from ._ticks import ProtocolBreach

Wall = Literal["rung", "network", "bench"]
"""What holds a trick: the rung that confines the agent, the network of the session, or the bench itself, always."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One trick, or one breach of the tick protocol; `outcome` is a value of bench.contracts.Outcome."""

    trick: Trick | None = None
    breach: ProtocolBreach | None = None
    outcome: str = "time_limit"
    held_by: Wall = "bench"


CHEATS: Mapping[str, Entry] = {
    "read-files": Entry(_files.read_files, held_by="rung"),
    "read-descriptors": Entry(_files.read_descriptors, held_by="rung"),
    "read-memory": Entry(_files.read_memory, held_by="rung"),
    "read-environment": Entry(_files.read_environment, held_by="rung"),
    "trace-processes": Entry(_files.trace_processes, held_by="rung"),
    "write-campaigns": Entry(_files.write_campaigns, held_by="rung"),
    "kill-bench": Entry(_processes.kill_bench, held_by="rung"),
    "kill-everything": Entry(_processes.kill_everything, held_by="rung"),
    "leave-daemon": Entry(_processes.leave_daemon, held_by="rung"),
    "leave-files": Entry(_processes.leave_files, held_by="rung"),
    "renice": Entry(_processes.renice, held_by="rung"),
    "set-clock": Entry(_processes.set_clock, held_by="rung"),
    "exit-early": Entry(_processes.exit_early, outcome="agent_crashed"),
    "fork-bomb": Entry(_resources.fork_bomb, held_by="rung"),
    "hog-memory": Entry(_resources.hog_memory, held_by="rung"),
    "fill-disk": Entry(_resources.fill_disk, held_by="rung"),
    "fill-shared-memory": Entry(_resources.fill_shared_memory, held_by="rung"),
    "flood-output": Entry(_resources.flood_output),
    "dawdle": Entry(_resources.dawdle, outcome="agent_timeout"),
    "connect-out": Entry(_network.connect_out, held_by="network"),
    "connect-neighbours": Entry(_network.connect_neighbours, held_by="network"),
    "subscribe-truth": Entry(_network.subscribe_truth),
    "forge-streams": Entry(_network.forge_streams),
    "flood-reports": Entry(_network.flood_reports),
    "flood-decisions": Entry(_network.flood_decisions, outcome="agent_flooded"),
    "set-simulation": Entry(_mavlink.set_simulation),
    "spoof-sender": Entry(_mavlink.spoof_sender),
    "inject-failure": Entry(_mavlink.inject_failure),
    "ask-truth": Entry(_mavlink.ask_truth),
    "feed-sensors": Entry(_mavlink.feed_sensors),
    "send-garbage": Entry(_mavlink.send_garbage),
    "flood-link": Entry(_mavlink.flood_link, outcome="agent_flooded"),
    "connect-strangers": Entry(_ticks.connect_strangers),
    "acknowledge-ahead": Entry(breach=_ticks.acknowledge_ahead, outcome="agent_protocol"),
    "skip-tick": Entry(breach=_ticks.skip_tick, outcome="agent_protocol"),
    "say-hello-twice": Entry(breach=_ticks.say_hello_twice, outcome="agent_protocol"),
    "send-nonsense": Entry(breach=_ticks.send_nonsense, outcome="agent_protocol"),
    "send-endless-line": Entry(breach=_ticks.send_endless_line, outcome="agent_protocol"),
}
