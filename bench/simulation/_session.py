"""One session: a realized SimSpec, flown.

`run_session` opens everything that the session needs, runs it to one of its named ends, closes everything
again and returns how it ended. Every message goes to the tap as a record.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bench.contracts import (
    DETECTOR_OPENED,
    FIRMWARE_BOOTED,
    OPERATOR_LINK,
    START,
    AgentEndpoints,
    AgentExit,
    AgentManifest,
    AgentPlan,
    AgentProcess,
    AgentStatus,
    AgentUsage,
    BootsFirmware,
    CarriesCamera,
    ConsentRequest,
    Detector,
    Fact,
    FirmwareBuild,
    HasProcessRoot,
    LinkSpec,
    MavlinkNeed,
    OnProgress,
    OpenAgent,
    OpenPixelDetector,
    OpenRenderer,
    OpenScene,
    OpenVehicle,
    Outcome,
    PixelDetectorBuild,
    Scene,
    SessionFailure,
    SessionResult,
    SimTime,
    Tap,
    Tick,
    Vehicle,
    VehiclePlan,
    VehicleTopics,
    WarpLibrary,
    fact_of,
    facts_of,
    ignore_progress,
    load_plugin,
    parse_document,
    realized_of,
)
from bench.errors import Fault, SetupError
from bench.perception import PictureDetector, open_detectors
from bench.simspec import SimSpec

from ._agent_input import AgentInput
from ._agent_time import AgentTime
from ._air_network import AirNetwork, open_air_network
from ._further_cameras import FurtherCameras, scene_faults
from ._host_clock import HOST_CLOCK, HostClock
from ._host_cores import usable_cores
from ._host_memory import count_memory_kills
from ._mission_information import MissionInformation
from ._operator_pilot import OperatorPilot, open_operator_pilot, operator_links
from ._outside_links import outside_links, recorded_links
from ._pictures import camera_pictures
from ._ports import reserved_udp_port
from ._progress_updates import ProgressUpdates
from ._service_relays import open_services
from ._session_faults import camera_faults, firmware_faults, link_faults, pace_faults, tick_faults
from ._step_timing import StepClock, judged
from ._stop_session import StopSession
from ._tick_server import TickServer, open_tick_server
from ._truth import TruthRecorder, truth_of
from .warp import Warp, open_warp

# Host time for samples that the agent says it has sent: they are on loopback already, so this is generous.
# Chosen, not measured.
COUNT_BUDGET_S = 5.0
# Between two looks for MAVLink messages that are under way on loopback; a lockstep tick is to lose no more
# than this.
RECEIVE_POLL_S = 0.0005


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


def run_session(plan: SessionPlan) -> SessionResult:
    """Fly one session to its end. Times by the host are for budgets and tables, never for the recording.

    Never raises for anything that happens inside; KeyboardInterrupt travels on.
    """
    started_s, started_cpu_s = plan.clock.now(), time.process_time()
    progress = SessionProgress()
    try:
        with open_session(plan, progress) as session:
            session.run()
        raise AssertionError("Session.run returned; it always ends by raising StopSession")
    except StopSession as end:
        failure = SessionFailure(end.outcome, end.reason)
    except Exception as error:  # the one broad except: a bench error costs this session and no more
        failure = SessionFailure.of(error)
    result = failure.result(plan.simspec.name, round(plan.clock.now() - started_s, 3))
    return result.with_facts(*progress.facts.values()).model_copy(
        update={
            "simulated_s": progress.now.s,
            "cpu_s": round(time.process_time() - started_cpu_s, 3),
            "agent_cpu_s": round(progress.agent_cpu_s, 3),
            "counters": progress.counters,
        }
    )


@dataclass(slots=True)
class SessionProgress:
    """What is known of a session, however it ends."""

    now: SimTime = START
    agent_cpu_s: float = 0.0
    counters: dict[str, int] = field(default_factory=dict)
    facts: dict[str, Fact] = field(default_factory=dict)

    def add(self, fact: Fact) -> None:
        """A part of the session tells something."""
        self.facts |= facts_of(fact)


class Session:
    """The parts of a running session and the order in which they act. `open_session` builds it.

    Each round publishes what the agent may know, waits for it to act, records what it did and advances the
    world by one tick.
    """

    def __init__(
        self,
        plan: SessionPlan,
        vehicle: Vehicle,
        scene: Scene,
        detector: Detector,
        air: AirNetwork,
        truth: TruthRecorder,
        progress: SessionProgress,
        operator: OperatorPilot | None = None,
        further_detectors: Mapping[str, Detector] | None = None,
    ) -> None:
        self._spec = plan.simspec
        self._plan = plan
        self._agent_links = {need.name for need in plan.manifest.mavlink}
        self._vehicle = vehicle
        self._scene = scene
        self._detector = detector
        self._air = air
        self._truth = truth
        self._progress = progress
        self._operator = operator
        self._topics = VehicleTopics(plan.simspec.vehicle.name)
        self._information = MissionInformation(plan.simspec, air, scene)
        self._pictures, *further = camera_pictures(plan.simspec, air, truth, plan.open_renderer)
        self._further_cameras = FurtherCameras(
            plan.simspec, air, tuple(further), further_detectors or {}, truth
        )
        self._agent: AgentProcess | None = None
        self._ticks: TickServer | None = None
        self._warp: Warp | None = None
        self._carries_camera = vehicle if isinstance(vehicle, CarriesCamera) else None
        self._complete = False
        self._frame = 0
        self._frame_period_ns = round(1e9 / plan.simspec.vehicle.camera.rate_hz)
        self._next_frame_ns = 0
        self._clock = plan.clock
        self._agent_time = AgentTime(plan.clock, self._usage)
        self._agent_input = AgentInput(plan.clock)
        started_s = plan.clock.now()
        self._wall_deadline_s = started_s + plan.simspec.budgets.wall_s
        self._updates = ProgressUpdates(plan.on_progress, plan.simspec.mission.time_limit_s, started_s)
        self._memory_kills = plan.memory_kills()

    def attach(self, agent: AgentProcess, ticks: TickServer | None, warp: Warp | None = None) -> None:
        """The started agent, and the tick socket in lockstep or the agent's clock in warp."""
        self._agent, self._ticks, self._warp = agent, ticks, warp
        if ticks is not None:
            ticks.watch(self._check_waiting, self._agent_time)
        if warp is not None:
            if not isinstance(agent, HasProcessRoot):
                fault = "cannot follow an agent whose processes are not known"
                raise SetupError(Fault("pace.mode", fault, "fly it with --pace realtime"))
            with_bench = self._air.access is not None
            # Imports are no part of the mission.
            warp.start_budget_s = self._spec.budgets.connect_s
            warp.watch(agent.root(), self._check_waiting, self._agent_time, with_bench=with_bench)

    def run(self) -> None:
        """Run rounds until something ends the session. Always raises StopSession or an error."""
        self._truth.write_event(self._progress.now, "started", self._spec.name)
        if detector := fact_of(self._progress.facts, PixelDetectorBuild):
            self._truth.write_event(self._progress.now, DETECTOR_OPENED, detector.description)
        if firmware := fact_of(self._progress.facts, FirmwareBuild):
            self._truth.write_event(self._progress.now, FIRMWARE_BOOTED, firmware.description)
        if self._plan.manifest.truth:
            self._truth.write_event(self._progress.now, "truth given", self._plan.manifest.name)
        self._truth.write_cast(self._progress.now, self._scene)
        self._truth.write_due(self._progress.now, self._vehicle, self._scene)
        try:
            if self._ticks is not None:
                self._run_lockstep(self._ticks)
            elif self._warp is not None:
                self._run_warp(self._warp)
            else:
                self._run_realtime()
        except StopSession as end:
            self._truth.write_due(self._progress.now, self._vehicle, self._scene)
            self._truth.write_event(self._progress.now, "ended", f"{end.outcome}")
            if self._ticks is not None and end.outcome is Outcome.AGENT_PROTOCOL:
                # Whoever wrote the agent reads there what it did wrong.
                self._ticks.end(end.reason)
            raise
        finally:
            strangers = {"tick_strangers": self._ticks.strangers} if self._ticks is not None else {}
            unrecorded = {"mavlink_unrecorded_bytes": self._truth.unrecorded_bytes}
            paced = self._warp.counts.counters() if self._warp is not None else {}
            counters = (self._vehicle.counters(), self._air.counters(), unrecorded, strangers, paced)
            self._progress.counters = {name: count for part in counters for name, count in part.items()}

    def _run_lockstep(self, ticks: TickServer) -> None:
        budgets = self._spec.budgets
        with self._agent_time.waiting():
            hello = ticks.hello(budgets.connect_s)
        self._truth.write_event(self._progress.now, "agent connected", hello.agent)
        self._air.open_for(hello.subscribes)
        number = 0
        while True:
            now = self._progress.now
            self._information.publish(now, self._vehicle, self._detector)
            self._pictures.publish(now)
            self._further_cameras.publish(now)
            self._fly_handed_over(now)
            tick = Tick(number=number, time_ns=now.ns, topics=self._air.sent(), links=self._sent_to_agent())
            with self._agent_time.waiting():
                ack = ticks.exchange(tick, budgets.reply_s)
                self._receive_exactly(ack.links)
                # Inside, because it may state samples long before it sends them.
                documents = self._air.receive(now, ack.topics, COUNT_BUDGET_S)
            self._receive_from_operator()
            self._process_documents(documents)
            self._advance(self._spec.pace.tick_s)
            number += 1

    def _run_realtime(self) -> None:
        self._air.open_for_all()
        started_s, cpu_s = self._clock.now(), self._usage().cpu_s
        steps = StepClock(self._vehicle.step_s)
        try:
            self._run_steps(steps, started_s)
        except StopSession as end:
            self._progress.add(timing := steps.summary())
            host_s = (self._clock.now() - started_s) * usable_cores()
            used_s = self._usage().cpu_s - cpu_s + self._agent_input.cpu_s
            share = used_s / host_s if host_s > 0.0 else 0.0
            raise judged(end, timing, self._spec.pace, share) from None

    def _run_steps(self, steps: StepClock, started_s: float) -> None:
        while True:
            now = self._progress.now
            self._check_agent()
            self._information.publish(now, self._vehicle, self._detector)
            self._pictures.publish(now)
            self._further_cameras.publish(now)
            self._fly_handed_over(now)
            # Counted from the start: rounding and late wake-ups do not add up.
            ahead_s = now.s - (self._clock.now() - started_s)
            if ahead_s > 0:
                self._clock.sleep(ahead_s)
            steps.record(self._clock.now() - started_s - now.s, self._agent_input.delay_since_mark_s())
            with self._agent_input.taking():
                self._vehicle.receive()
                self._process_documents(self._air.receive(now, None, 0.0))
            self._advance(self._vehicle.step_s)

    def _run_warp(self, warp: Warp) -> None:
        self._air.open_for_all()
        # It starts before it is told anything: a program that cannot fly in warp shows here, when its end says nothing
        # of how the situation goes.
        warp.settle()
        warp.agent_is_informed = True
        while True:
            now = self._progress.now
            self._information.publish(now, self._vehicle, self._detector)
            self._pictures.publish(now)
            self._further_cameras.publish(now)
            self._fly_handed_over(now)
            # What the vehicle and the streams say of this moment is with the agent: it acts on it.
            warp.settle()
            # Only now: before it has settled its end would be seen by this moment or by the next, as the host likes.
            self._check_agent()
            # Then it lives until the next step, and acts at the moments for which it waits.
            warp.run_until(now.after(self._vehicle.step_s))
            with self._agent_input.taking():
                received = self._vehicle.receive()
                documents = self._air.receive(now, None, 0.0)
            self._receive_from_operator()
            warp.agent_has_spoken = (
                warp.agent_has_spoken or bool(documents) or any(received[name] for name in self._agent_links)
            )
            self._process_documents(documents)
            self._advance(self._vehicle.step_s)

    def _fly_handed_over(self, now: SimTime) -> None:
        """Let the operator do what is due, and write it into the session's log."""
        if self._operator is None:
            return
        actions = [self._operator.receive(order, now) for order in self._information.take_delivered()]
        for action in (*actions, self._operator.act(now, self._vehicle)):
            if action is not None:
                self._truth.write_event(now, action.name, action.text)

    def _sent_to_agent(self) -> dict[str, int]:
        return {link: count for link, count in self._vehicle.sent().items() if link in self._agent_links}

    def _receive_from_operator(self) -> None:
        """Wait for what the operator has sent, so that the step which takes it does not depend on the host."""
        if self._operator is None:
            return
        deadline_s = self._clock.now() + COUNT_BUDGET_S
        while self._vehicle.receive().get(OPERATOR_LINK, 0) < self._operator.sent:
            if self._clock.now() > deadline_s:
                raise StopSession(Outcome.BENCH_ERROR, "the operator's MAVLink messages did not arrive")
            self._clock.sleep(RECEIVE_POLL_S)

    def _advance(self, span_s: float) -> None:
        """Advance the world by `span_s`, and end the session if an end is reached."""
        until = self._progress.now.after(span_s)
        while self._progress.now < until:
            previous = self._progress.now
            self._vehicle.step()
            self._progress.now = now = self._vehicle.time
            self._truth.write_mavlink(previous, now)
            if (link := self._truth.flooded_link(now)) is not None:
                raise StopSession(
                    Outcome.AGENT_FLOODED,
                    f"the agent floods link {link!r}: more than is recorded of a link (docs/streams.md)",
                )
            if now.ns >= self._next_frame_ns:
                self._capture_frame(now)
            if self._further_cameras.due(now):
                self._scene.advance(now)
                self._further_cameras.capture(self._vehicle, self._scene, now)
            self._truth.write_due(now, self._vehicle, self._scene)
        self._check_end()

    def _capture_frame(self, now: SimTime) -> None:
        # One frame a step at most: a camera that is faster than the controller has the controller's rate.
        self._next_frame_ns += self._frame_period_ns
        self._scene.advance(now)
        frame = self._scene.observe(self._vehicle.truth(), self._frame)
        self._frame += 1
        self._truth.write_frame(frame)
        picture = None
        if self._pictures.wanted:
            picture = self._pictures.capture_with_pose(self._vehicle, self._scene, frame.number, now)
        if self._carries_camera is not None:
            self._carries_camera.record_exposure(frame.number, now)
        self._information.record_exposure(now)
        self._detector.process(frame, picture)

    def _check_end(self) -> None:
        condition = self._vehicle.condition()
        if condition.crashed:
            raise StopSession(
                Outcome.VEHICLE_CRASHED, f"the vehicle crashed after {self._progress.now.s:.1f} s"
            )
        if self._complete and condition.landed and not condition.armed:
            raise StopSession(
                Outcome.COMPLETED, "the agent declared its mission over and the vehicle is down"
            )
        if self._information.deactivated and condition.landed and not condition.armed:
            raise StopSession(
                Outcome.COMPLETED, "the agent was ordered to deactivate and the vehicle is down"
            )
        if self._progress.now.s >= self._spec.mission.time_limit_s:
            raise StopSession(
                Outcome.TIME_LIMIT, f"the time limit of {self._spec.mission.time_limit_s:g} s is reached"
            )
        self._check_wall_time()

    def _check_wall_time(self) -> None:
        host_s = self._clock.now()
        self._updates.publish_due(self._progress.now, host_s)
        if host_s > self._wall_deadline_s:
            raise self._out_of_wall_time()

    def _out_of_wall_time(self) -> StopSession:
        """The end of a session that used up its wall budget: the agent's fault if its own time to answer was
        more than half of it.

        Runs that end by WALL_BUDGET are not scored, so an agent could drop a run that goes badly by dawdling.
        """
        wall_s = self._spec.budgets.wall_s
        own_s, waited_s = self._agent_time.own_s(), self._agent_time.waited_s
        own_s, waited_s = own_s + self._agent_input.taken_s, waited_s + self._agent_input.taken_s
        if own_s > wall_s / 2:
            reason = (
                f"the agent took {own_s:.0f} s of the session's {wall_s:g} s of the host's time to answer"
            )
            return StopSession(Outcome.AGENT_TIMEOUT, reason)
        reason = f"the session took longer than {wall_s:g} s of the host's time, {own_s:.0f} s of it the agent's own"
        if waited_s - own_s >= 1.0:
            reason += f"; for {waited_s - own_s:.0f} s the host was too busy to let the agent answer"
        return StopSession(Outcome.WALL_BUDGET, reason)

    def _usage(self) -> AgentUsage:
        return self._agent.usage() if self._agent is not None else AgentUsage()

    def _process_documents(self, documents: dict[str, list[str | bytes]]) -> None:
        for text in documents.get(self._topics.status, ()):
            status = parse_document(AgentStatus, text)
            if status is None:
                continue
            self._updates.phase = status.phase
            if status.phase in ("complete", "aborted"):
                self._complete = True
        for text in documents.get(self._topics.consent_requests, ()):
            request = parse_document(ConsentRequest, text)
            if request is not None:
                self._information.hear(self._progress.now, request)

    def _receive_exactly(self, stated: dict[str, int]) -> None:
        deadline_s = self._clock.now() + COUNT_BUDGET_S
        while True:
            received = self._vehicle.receive()
            missing = {link: count for link, count in stated.items() if received.get(link, 0) < count}
            if not missing:
                return
            if self._clock.now() > deadline_s:
                raise StopSession(Outcome.AGENT_PROTOCOL, _miscount(missing, received))
            self._clock.sleep(RECEIVE_POLL_S)

    def _check_waiting(self) -> None:
        """End the session while it waits, if the agent has ended or the wall budget is used up."""
        self._check_agent()
        self._check_wall_time()

    def _check_agent(self) -> None:
        assert self._agent is not None
        code = self._agent.exit_code()
        if code is None:
            return
        condition = self._vehicle.condition()
        if code == 0 and condition.landed and not condition.armed and self._progress.now > START:
            raise StopSession(Outcome.COMPLETED, "the agent ended by itself and the vehicle is down")
        if limit := self._agent.exceeded_limit():
            raise StopSession(
                Outcome.AGENT_CRASHED, f"the agent used more than its limit of {limit} and was killed for it"
            )
        # Which process used up the memory is not known, so the agent is not blamed; the run is flown again.
        if code == -signal.SIGKILL and self._plan.memory_kills() > self._memory_kills:
            raise StopSession(
                Outcome.BENCH_ERROR, "the host ran out of memory, and the kernel killed the agent's process"
            )
        self._progress.add(AgentExit(code=code))
        cause = f"exit code {code}" if code >= 0 else f"signal {-code}"
        raise StopSession(
            Outcome.AGENT_CRASHED,
            f"the agent's process ended with {cause} before its mission did: {self._agent.output_tail()}",
        )


@contextmanager
def open_session(plan: SessionPlan, progress: SessionProgress | None = None) -> Generator[Session]:
    """Open everything that a session needs. Leaving the block closes all of it, the agent first."""
    spec, manifest = plan.simspec, plan.manifest
    progress = progress or SessionProgress()
    realized_of(spec)  # before anything is opened: a session without places has nothing to fly over
    if faults := [*link_faults(spec, manifest), *pace_faults(spec, manifest), *camera_faults(spec)]:
        raise SetupError(faults)
    open_vehicle: OpenVehicle = load_plugin("rebar.vehicles", spec.vehicle.model)
    open_scene: OpenScene = load_plugin("rebar.scenes", spec.world.scene)
    truth = TruthRecorder(spec.vehicle.name, plan.tap)
    with ExitStack() as stack:
        # Before anything else takes a port of the session.
        services = stack.enter_context(open_services(spec.agent.services, progress.add))
        links = (
            *(_link(need, stack) for need in manifest.mavlink),
            *operator_links(spec),
            *outside_links(spec),
        )
        scene = open_scene(spec)
        if faults := scene_faults(spec, scene):
            raise SetupError(faults)
        detector, *further = open_detectors(spec, scene.cast, plan.open_on_pixels)
        further_names = [camera.name for camera in spec.perceiving_cameras[1:]]
        further_detectors = dict(zip(further_names, further, strict=True))
        if isinstance(detector, PictureDetector):
            progress.add(PixelDetectorBuild(description=detector.description))
        vehicle_plan = VehiclePlan(spec, links, artefacts=plan.artefacts)
        vehicle = stack.enter_context(open_vehicle(vehicle_plan, recorded_links(spec, truth)))
        if faults := [*tick_faults(spec, vehicle), *firmware_faults(spec, vehicle)]:
            raise SetupError(faults)
        if isinstance(vehicle, BootsFirmware):
            # Before the agent starts and its budgets begin: a real autopilot takes a minute until it can be armed.
            progress.add(FirmwareBuild(description=vehicle.boot()))
        air = stack.enter_context(
            open_air_network(
                spec,
                plan.tap,
                zenoh=manifest.zenoh,
                clock=plan.clock,
                on_drop=lambda time, topic: truth.write_event(time, "dropping", topic),
            )
        )
        ticks = stack.enter_context(open_tick_server(plan.clock)) if spec.pace.mode == "lockstep" else None
        warp = None
        if spec.pace.mode == "warp":
            utc_ns = round(spec.environment.start_utc.timestamp() * 1e9)
            warp = stack.enter_context(open_warp(plan.scratch, utc_ns, plan.clock))
            progress.add(WarpLibrary(description=warp.description))
        operator = stack.enter_context(open_operator_pilot(spec, vehicle))
        session = Session(plan, vehicle, scene, detector, air, truth, progress, operator, further_detectors)
        # A router may be there for a companion computer alone.
        access = air.access if manifest.zenoh else None
        endpoints = AgentEndpoints(
            mavlink={need.variable: vehicle.endpoints()[need.name] for need in manifest.mavlink},
            zenoh_locator=access.locator if access else None,
            zenoh_user=access.user if access else "",
            zenoh_password=access.password if access else "",
            domain=access.domain if access else 0,
            tick=ticks.address if ticks else None,
            tick_secret=ticks.secret if ticks else "",
            services=services.endpoints,
            hosts=services.hosts,
            warp=warp.access if warp else None,
        )
        # From a scene of its own: this one must not be advanced before the session.
        truth_document = truth_of(spec, open_scene(spec)) if manifest.truth else None
        agent_plan = AgentPlan(
            manifest, plan.manifest_folder, spec, endpoints, plan.scratch, truth_document, plan.hidden
        )
        agent = stack.enter_context(_measured(plan.open_agent(agent_plan), progress))
        if ticks is not None:
            stack.callback(ticks.end, "the session is over")
        session.attach(agent, ticks, warp)
        if warp is not None:
            stack.callback(warp.release)
        yield session


@contextmanager
def _measured(
    opening: AbstractContextManager[AgentProcess], progress: SessionProgress
) -> Generator[AgentProcess]:
    """The agent of `opening`; its CPU time is kept in `progress`, however the session ends.

    It is read twice. Before the agent is ended, because a container cannot be asked afterwards; and afterwards, because
    a process that ends while its tree is read can be missed there.
    """
    with ExitStack() as stack:
        agent = stack.enter_context(opening)
        try:
            yield agent
        finally:
            progress.agent_cpu_s = agent.usage().cpu_s
            stack.close()
            progress.agent_cpu_s = agent.usage().cpu_s


def _link(need: MavlinkNeed, stack: ExitStack) -> LinkSpec:
    """The vehicle's side of a link: it listens where the system chooses, or sends to a port that is kept for
    the agent.
    """
    port = stack.enter_context(reserved_udp_port()) if need.kind == "udp_out" else 0
    return LinkSpec(name=need.name, kind=need.kind, port=port, streams=need.streams)


def _miscount(stated: Mapping[str, int], received: Mapping[str, int]) -> str:
    """Why the agent's statement about the MAVLink messages that it sent cannot be true."""
    parts = [
        f"{count} on link {link!r}, of which {received[link]} came"
        if link in received
        else f"{count} on link {link!r}, which does not exist (links: {', '.join(sorted(received)) or 'none'})"
        for link, count in sorted(stated.items())
    ]
    return (
        f"the agent states that it sent these MAVLink messages since the start: {'; '.join(parts)}. Count each whole frame "
        "that went out on the link once (docs/time.md)"
    )
