"""One session: a realized SimSpec, flown.

`run_session` opens everything that the session needs, runs it to one of its named ends, closes everything
again and returns how it ended. Every message goes to the tap as a record.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager

from bench.contracts import (
    START,
    AgentEndpoints,
    AgentPlan,
    AgentProcess,
    AgentStatus,
    ConsentRequest,
    HasCompanionTopics,
    OpenScene,
    Outcome,
    SessionFailure,
    SessionResult,
    UnmatchedTopics,
    UnreadTopics,
    VehicleTopics,
    load_plugin,
    parse_document,
    realized_of,
)
from bench.errors import SetupError

from ._companion_topics import Companion
from ._lockstep import open_lockstep
from ._pace import Documents, Pace
from ._real_time import open_real_time
from ._service_relays import Services, open_services
from ._session_faults import camera_faults, link_faults, pace_faults
from ._session_parts import SessionParts, SessionPlan, SessionProgress, open_parts
from ._session_watch import SessionWatch
from ._stop_session import StopSession
from ._truth import truth_of
from ._warp_pace import open_in_warp
from ._world import World

_OPEN_PACE: Mapping[str, Callable[[SessionParts, SessionWatch], AbstractContextManager[Pace]]] = {
    "lockstep": open_lockstep,
    "realtime": open_real_time,
    "warp": open_in_warp,
}


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


class Session:
    """A running session: the beat that all paces share.

    Each beat publishes what the agent may know, lets it act at its pace, records what it did and advances the world.
    """

    def __init__(self, parts: SessionParts, watch: SessionWatch, pace: Pace) -> None:
        self._parts, self._watch, self._pace = parts, watch, pace
        self._spec, self._progress = parts.plan.simspec, parts.progress
        self._world = World(parts)
        self._topics = VehicleTopics(self._spec.vehicle.name)
        self._companion = None
        if parts.air.companion and isinstance(parts.vehicle, HasCompanionTopics):
            self._companion = Companion(parts.vehicle, parts.air.companion)
        self._complete = False

    def run(self) -> None:
        """Run beats until something ends the session. Always raises StopSession or an error."""
        self._world.begin()
        try:
            self._pace.begin()
            while True:
                self._beat()
        except StopSession as stop:
            end = self._pace.judged(stop)
            self._world.end(end.outcome)
            raise end from None
        finally:
            if unmatched := self._parts.air.unmatched:
                self._progress.add(UnmatchedTopics(sentences=unmatched))
            # An agent that never flew was told nothing.
            if (unread := self._parts.air.unread) and self._progress.now > START:
                self._progress.add(UnreadTopics(topics=unread))
            self._progress.counters = {
                **self._parts.vehicle.counters(),
                **self._parts.air.counters(),
                "mavlink_unrecorded_bytes": self._parts.truth.unrecorded_bytes,
                **self._pace.counters(),
            }

    def _beat(self) -> None:
        now = self._progress.now
        self._world.publish(now)
        if self._companion:
            self._companion.publish(now)
        self._process(self._pace.exchange(now))
        self._world.advance(self._pace.span_s)
        self._check_end()
        self._watch.check_wall_time()

    def _process(self, documents: Documents) -> None:
        if self._companion:
            self._companion.hand_over(documents)
        for text in documents.get(self._topics.status, ()):
            status = parse_document(AgentStatus, text)
            if status is None:
                continue
            self._watch.updates.phase = status.phase
            if status.phase in ("complete", "aborted"):
                self._complete = True
        for text in documents.get(self._topics.consent_requests, ()):
            request = parse_document(ConsentRequest, text)
            if request is not None:
                self._world.information.hear(self._progress.now, request)

    def _check_end(self) -> None:
        now, limit_s = self._progress.now, self._spec.mission.time_limit_s
        condition = self._parts.vehicle.condition()
        down = condition.landed and not condition.armed
        if condition.crashed:
            raise StopSession(Outcome.VEHICLE_CRASHED, f"the vehicle crashed after {now.s:.1f} s")
        if self._complete and down:
            raise StopSession(
                Outcome.COMPLETED, "the agent declared its mission over and the vehicle is down"
            )
        if self._world.information.deactivated and down:
            raise StopSession(
                Outcome.COMPLETED, "the agent was ordered to deactivate and the vehicle is down"
            )
        if now.s >= limit_s:
            raise StopSession(Outcome.TIME_LIMIT, f"the time limit of {limit_s:g} s is reached")


@contextmanager
def open_session(plan: SessionPlan, progress: SessionProgress | None = None) -> Generator[Session]:
    """Open everything that a session needs. Leaving the block closes all of it, the agent first."""
    spec, manifest = plan.simspec, plan.manifest
    progress = progress or SessionProgress()
    realized_of(spec)  # before anything is opened: a session without places has nothing to fly over
    if faults := [*link_faults(spec, manifest), *pace_faults(spec, manifest), *camera_faults(spec)]:
        raise SetupError(faults)
    with ExitStack() as stack:
        # Before anything else takes a port of the session.
        services = stack.enter_context(open_services(spec.agent.services, progress.add))
        parts = stack.enter_context(open_parts(plan, progress))
        watch = SessionWatch(parts)
        pace = stack.enter_context(_OPEN_PACE[spec.pace.mode](parts, watch))
        session = Session(parts, watch, pace)
        agent_plan = _agent_plan(plan, pace.endpoints(_endpoints(parts, services)))
        agent = stack.enter_context(_measured(plan.open_agent(agent_plan), progress))
        pace.follow(agent)
        stack.callback(pace.release)
        yield session


def _endpoints(parts: SessionParts, services: Services) -> AgentEndpoints:
    manifest, addresses = parts.plan.manifest, parts.vehicle.endpoints()
    # A router may be there for a companion computer alone.
    access = parts.air.access if manifest.on_zenoh else None
    return AgentEndpoints(
        tick=None,
        mavlink={need.variable: addresses[need.name] for need in manifest.mavlink},
        zenoh_locator=access.locator if access else None,
        zenoh_user=access.user if access else "",
        zenoh_password=access.password if access else "",
        domain=access.domain if access else 0,
        services=services.endpoints,
        hosts=services.hosts,
    )


def _agent_plan(plan: SessionPlan, endpoints: AgentEndpoints) -> AgentPlan:
    spec, manifest = plan.simspec, plan.manifest
    truth = None
    if manifest.truth:
        # From a scene of its own: the session's must not be advanced before it.
        open_scene: OpenScene = load_plugin("rebar.scenes", spec.world.scene)
        truth = truth_of(spec, open_scene(spec))
    return AgentPlan(manifest, plan.manifest_folder, spec, endpoints, plan.scratch, truth, plan.hidden)


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
