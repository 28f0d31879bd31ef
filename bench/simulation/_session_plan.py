"""What a session is asked for, and what is known of it while it flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import (
    START,
    AgentManifest,
    Fact,
    OnProgress,
    OpenAgent,
    OpenPixelDetector,
    OpenRenderer,
    SimTime,
    Tap,
    facts_of,
    ignore_progress,
)
from bench.simspec import SimSpec

from ._host_clock import HOST_CLOCK, HostClock
from ._host_memory import count_memory_kills


@dataclass(frozen=True, slots=True)
class SessionPlan:
    """All that one session needs.

    `scratch` is an empty folder for the agent, `tap` receives every record, and budgets are measured by
    `clock`. `memory_kills` counts the processes that the kernel killed for want of memory. The agent reads
    no file in `hidden`. `open_renderer` draws the pictures of every camera; None: the plug-in that each one names. `open_on_pixels` is the
    detector on them; None: the plug-in that the SimSpec names. `artefacts` is where a real autopilot's console and logs
    are left; None: they are discarded. `on_progress` learns every two host seconds how far the session is.
    """

    simspec: SimSpec
    manifest: AgentManifest
    manifest_folder: Path
    open_agent: OpenAgent
    scratch: Path
    tap: Tap
    clock: HostClock = HOST_CLOCK
    memory_kills: Callable[[], int] = count_memory_kills
    hidden: tuple[Path, ...] = ()
    open_renderer: OpenRenderer | None = None
    open_on_pixels: OpenPixelDetector | None = None
    artefacts: Path | None = None
    on_progress: OnProgress = ignore_progress


@dataclass(slots=True)
class SessionProgress:
    """What is known of a session, however it ends. Each of its parts adds the facts that it knows."""

    now: SimTime = START
    agent_cpu_s: float = 0.0
    counters: dict[str, int] = field(default_factory=dict)
    facts: dict[str, Fact] = field(default_factory=dict)

    def add(self, fact: Fact) -> None:
        """Keep a fact, in place of an earlier one of its kind."""
        self.facts |= facts_of(fact)
