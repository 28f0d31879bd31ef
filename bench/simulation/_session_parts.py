"""What a session is asked for, what is known of it while it flies, and its parts beside the agent, opened in order."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import (
    START,
    AgentManifest,
    BootsFirmware,
    Detector,
    Fact,
    FirmwareBuild,
    LinkSpec,
    MavlinkNeed,
    OnProgress,
    OpenAgent,
    OpenPixelDetector,
    OpenRenderer,
    OpenScene,
    OpenVehicle,
    PixelDetectorBuild,
    Scene,
    SimTime,
    Tap,
    Vehicle,
    VehiclePlan,
    facts_of,
    ignore_progress,
    load_plugin,
)
from bench.errors import SetupError
from bench.perception import PictureDetector, open_detectors
from bench.simspec import SimSpec

from ._air_network import AirNetwork, open_air_network
from ._host_clock import HOST_CLOCK, HostClock
from ._host_resources import count_memory_kills
from ._operator_pilot import OperatorPilot, open_operator_pilot, operator_links
from ._outside_links import outside_links, recorded_links
from ._ports import reserved_udp_port
from ._session_cameras import scene_faults
from ._session_faults import firmware_faults, tick_faults, topic_faults
from ._truth import TruthRecorder


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


@dataclass(frozen=True, slots=True)
class SessionParts:
    """The open parts of a session. `detectors` has one for each camera that perceives, the main one's first."""

    plan: SessionPlan
    progress: SessionProgress
    vehicle: Vehicle
    scene: Scene
    detectors: Sequence[Detector]
    air: AirNetwork
    truth: TruthRecorder
    operator: OperatorPilot | None = None


@contextmanager
def open_parts(plan: SessionPlan, progress: SessionProgress) -> Generator[SessionParts]:
    """Open all parts. Raises SetupError for what cannot be flown together."""
    spec, manifest = plan.simspec, plan.manifest
    open_vehicle: OpenVehicle = load_plugin("rebar.vehicles", spec.vehicle.model)
    open_scene: OpenScene = load_plugin("rebar.scenes", spec.world.scene)
    truth = TruthRecorder(spec.vehicle.name, plan.tap)
    with ExitStack() as stack:
        links = (
            *(_link(need, stack) for need in manifest.mavlink),
            *operator_links(spec),
            *outside_links(spec),
        )
        scene = open_scene(spec)
        if faults := scene_faults(spec, scene):
            raise SetupError(faults)
        detectors = open_detectors(spec, scene.cast, plan.open_on_pixels)
        if isinstance(detectors[0], PictureDetector):
            progress.add(PixelDetectorBuild(description=detectors[0].description))
        has_topics = manifest.px4_msgs is not None or manifest.ap_dds is not None
        vehicle_plan = VehiclePlan(spec, links, artefacts=plan.artefacts, companion_topics=has_topics)
        vehicle = stack.enter_context(open_vehicle(vehicle_plan, recorded_links(spec, truth)))
        if faults := [
            *tick_faults(spec, vehicle),
            *firmware_faults(spec, vehicle),
            *topic_faults(spec, manifest, vehicle),
        ]:
            raise SetupError(faults)
        if isinstance(vehicle, BootsFirmware):
            # Before the agent starts and its budgets begin: a real autopilot takes a minute until it can be armed.
            progress.add(FirmwareBuild(description=vehicle.boot()))
        air = stack.enter_context(
            open_air_network(
                spec,
                plan.tap,
                zenoh=manifest.on_zenoh,
                in_ticks=manifest.air == "tick",
                px4_msgs=manifest.px4_msgs,
                ap_dds=manifest.ap_dds,
                clock=plan.clock,
                on_drop=lambda time, topic: truth.write_event(time, "dropping", topic),
            )
        )
        operator = stack.enter_context(open_operator_pilot(spec, vehicle))
        yield SessionParts(plan, progress, vehicle, scene, detectors, air, truth, operator)


def _link(need: MavlinkNeed, stack: ExitStack) -> LinkSpec:
    """The vehicle's side: it listens where the system chooses, or sends to a port kept for the agent."""
    port = stack.enter_context(reserved_udp_port()) if need.kind == "udp_out" else 0
    return LinkSpec(name=need.name, kind=need.kind, port=port, streams=need.streams)
