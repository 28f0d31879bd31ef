"""What an agent under test declares of itself, and what starts and stops it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, Protocol, Self, runtime_checkable

from pydantic import BeforeValidator, Field, model_validator

from bench.documents import Document, added_field, is_default
from bench.simspec import Identifier, Isolation, PaceMode, SimSpec

from ._truth_documents import TruthDocument


class MavlinkNeed(Document):
    """One MAVLink link that the agent wants.

    The connection string is handed over in the variable named `variable`.
    """

    name: Identifier = "onboard"
    kind: Literal["udp_out", "udp_in", "tcp_in"] = "udp_out"
    streams: str = Field("onboard", description="Default stream set of the link: onboard, gcs or none.")
    variable: str = "REBAR_MAVLINK"


class AgentLimits(Document):
    """What one agent may use of the host, with everything that it starts.

    The defaults leave the shipped agents, MAVSDK and Node much room; docs/agents-confinement.md has what these were measured
    to use. Which limits hold depends on the rung.
    """

    memory_mb: int = Field(2048, ge=64, description="Memory of all processes together.")
    processes: int = Field(
        512, ge=8, description="Processes and threads together: libraries start one per processor."
    )
    cpus: float = Field(4.0, gt=0, description="Processors' worth of CPU time.")
    open_files: int = Field(1024, ge=64, description="Open files of one process.")
    file_mb: int = Field(256, ge=1, description="The largest file that it may write.")
    scratch_mb: int = Field(256, ge=1, description="Each of the scratch folder, /tmp and /dev/shm.")


class CacheNeed(Document):
    """A folder that is filled once, and that every session of the agent reads: compiled code, weights."""

    prepare: tuple[str, ...] = Field(
        min_length=1, description="Command that fills the folder, with the placeholders of the agent's."
    )
    variable: str = Field(
        "REBAR_CACHE", description="The variable in which command and sessions find the folder."
    )
    budget_s: float = Field(600.0, gt=0.0, description="Limit on the command, in host time.")
    size_mb: int = Field(2048, ge=1, description="Limit on what it may write there.")


AgentRole = Literal["tested", "floor", "ceiling"]


def _release_text(value: object) -> object:
    """A release that YAML reads as a number because nobody quoted it."""
    return f"{value:.2f}" if isinstance(value, float) else value


Px4Release = Annotated[Literal["1.16", "1.17", "1.18"], BeforeValidator(_release_text)]

ApRelease = Literal["2025-12"]


class AgentManifest(Document):
    """How an agent is started, connected and paced: a YAML file, or a plug-in of `rebar.agents`.

    In `command`, `environment` and `read`, `{python}` stands for the bench's interpreter, `{folder}` for the
    manifest's folder, and `{option:NAME}` for an option of SimSpec.agent. What is handed over in the
    environment is listed in docs/agents-protocol.md.
    """

    format: Literal["rebar.agent/1"] = "rebar.agent/1"
    name: Identifier = Field(
        description="For people who read the file. Results name the agent by its entry point, or by its file without the suffix."
    )
    description: str = ""
    command: tuple[str, ...] = Field(min_length=1)
    environment: dict[str, str] = {}
    pace: tuple[PaceMode, ...] = Field(
        ("realtime",), min_length=1, description="Paces that the agent can follow."
    )
    mavlink: tuple[MavlinkNeed, ...] = (MavlinkNeed(),)
    zenoh: bool = True
    air: Literal["zenoh", "tick"] = added_field(
        "zenoh",
        "How the agent has the air network: as ROS 2 messages over Zenoh, or as JSON in the lines of the tick socket, which needs "
        "no library.",
    )
    px4_msgs: Px4Release | None = added_field(
        None,
        "The release of px4_msgs that the agent is built with: it also has the topics of a PX4 (/fmu/in/..., /fmu/out/...).",
    )
    ap_dds: ApRelease | None = added_field(
        None,
        "The month of the ArduPilot whose ardupilot_msgs the agent is built with: it also has the topics and services of an "
        "ArduPilot (/ap/...).",
    )
    truth: bool = Field(
        False,
        description="The agent is given the truth: an oracle, which shows what can be reached, and never a result.",
    )
    role: AgentRole = Field(
        "tested",
        description="What its results stand for: an agent under test, what needs no merit (floor), or what can be reached (ceiling).",
        exclude_if=is_default("tested"),
    )
    isolation: Isolation = Field(
        "auto", description="How the agent is confined; auto is the strongest that works here."
    )
    image: str = Field("", description="The image for isolation container, in which `command` is looked up.")
    limits: AgentLimits = AgentLimits()
    read: tuple[str, ...] = Field(
        (), description="Absolute paths that the agent may read besides its program and the system's."
    )
    tcp_ports: tuple[Annotated[int, Field(ge=1, le=65535)], ...] = Field(
        (),
        description="TCP ports on which the agent's own processes reach each other, where landlock has no network of its own.",
    )
    gpu: bool = Field(False, description="The agent is given the host's GPU devices.")
    cache: CacheNeed | None = added_field(
        None, "A folder that a command fills once for all sessions, confined as they are."
    )

    @property
    def on_zenoh(self) -> bool:
        """Whether it is given the session's router."""
        return self.zenoh and self.air == "zenoh"

    @model_validator(mode="after")
    def _has_zenoh_for_topics(self) -> Self:
        for switch, whose in (("px4_msgs", "PX4"), ("ap_dds", "ArduPilot")):
            if getattr(self, switch) and not self.on_zenoh:
                raise ValueError(
                    f"{switch}: {whose}'s topics come over Zenoh alone; leave out zenoh: false and air: tick"
                )
        return self


@dataclass(frozen=True, slots=True)
class WarpAccess:
    """The files by which the clock of an agent is the session's: the library that is preloaded into it, the clock that this
    reads (REBAR_WARP_CLOCK) and the page in which it writes who waits until when (REBAR_WARP_WAITERS).

    All three lie in the agent's scratch folder on the host. `link` leads to the library where that folder's name has a space
    or a colon, at which LD_PRELOAD is split; None where it has neither.
    """

    library: Path
    clock: Path
    waiters: Path
    link: Path | None = None


@dataclass(frozen=True, slots=True)
class AgentEndpoints:
    """Where the agent finds the air network; becomes environment variables.

    REBAR_MAVLINK (or the manifest's name for each link), REBAR_ZENOH (a locator such as tcp/127.0.0.1:7447),
    REBAR_ZENOH_USER, REBAR_ZENOH_PASSWORD, ROS_DOMAIN_ID, REBAR_VEHICLE, REBAR_TICK (host:port of the tick
    socket) and REBAR_TICK_SECRET (both in lockstep, or with `air: tick`), REBAR_OPTIONS (JSON object), REBAR_SEED (integer).

    `warp`: the clock of the warp pace, absent in the others. `services` holds host:port by variable for what the SimSpec lets in; `hosts` the addresses that their host names have
    in the session, for agents with files of their own.
    """

    mavlink: Mapping[str, str]
    zenoh_locator: str | None
    zenoh_user: str
    zenoh_password: str
    domain: int
    tick: str | None
    tick_secret: str = field(default="", repr=False)
    services: Mapping[str, str] = field(default_factory=dict)
    hosts: Mapping[str, str] = field(default_factory=dict)
    warp: WarpAccess | None = None


@dataclass(frozen=True, slots=True)
class AgentPlan:
    """All that is needed to start one agent for one session."""

    manifest: AgentManifest
    folder: Path
    simspec: SimSpec
    endpoints: AgentEndpoints
    scratch: Path
    truth: TruthDocument | None = None
    """For an agent whose manifest asks for the truth, and for no other."""
    hidden: tuple[Path, ...] = ()
    """Folders that the agent must not read though they may lie in one that it may: the campaign's."""
    cache: Path | None = None
    """The folder of its manifest's `cache`; `fills_cache`: the program is the one that fills it."""
    fills_cache: bool = False


@dataclass(frozen=True, slots=True)
class AgentUsage:
    """Host time of an agent and of every process that it started, also of those that have ended.

    `cpu_s` was spent running. `starved_s` was spent ready to run while other work had the cores, summed over
    threads; it is 0 where the system does not tell.
    """

    cpu_s: float = 0.0
    starved_s: float = 0.0


class AgentProcess(Protocol):
    """A started agent, seen from outside."""

    @property
    def pid(self) -> int: ...

    def exit_code(self) -> int | None:
        """Exit code, or None while it runs. A negative code is the signal that ended it.

        Raises SetupError if the agent's program could not be started at all.
        """

    def usage(self) -> AgentUsage:
        """What the agent has used of the host so far. It never shrinks, and can be asked after the end too."""

    def exceeded_limit(self) -> str:
        """The limit of its manifest for which the kernel killed it, in words; empty if there is none."""

    def output_tail(self) -> str:
        """The end of what it wrote to stdout and stderr, for the report."""


@dataclass(frozen=True, slots=True)
class ProcessRoot:
    """The process below which all of an agent runs; `is_box`: it is not the agent's own, but part of its confinement."""

    pid: int
    is_box: bool


@runtime_checkable
class HasProcessRoot(Protocol):
    """What a started agent promises beside `AgentProcess` where its threads can be watched from outside."""

    def root(self) -> ProcessRoot: ...


class OpenAgent(Protocol):
    """Starts an agent; leaving the block ends it and everything that it started, by force if need be."""

    def __call__(self, plan: AgentPlan) -> AbstractContextManager[AgentProcess]: ...
