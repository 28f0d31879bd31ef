"""The pace at which simulated time passes as fast as the host's."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from bench.contracts import AgentEndpoints, SimTime

from ._host_resources import usable_cores
from ._pace import Documents, Pace
from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._step_timing import StepClock, judged
from ._stop_session import StopSession
from ._unpaced_air import UnpacedAir, open_unpaced_air


class RealTime(Pace):
    """A beat is a step of the vehicle, and begins when the host's clock says so. Nothing waits for the agent."""

    def __init__(self, parts: SessionParts, watch: SessionWatch, air: UnpacedAir) -> None:
        super().__init__(parts, watch, parts.vehicle.step_s)
        self._air = air
        self._clock = parts.plan.clock
        self._steps = StepClock(self.span_s)
        self._started_s = self._cpu_s = 0.0

    def endpoints(self, endpoints: AgentEndpoints) -> AgentEndpoints:
        """With the tick socket, if the agent has the air network there."""
        return self._air.endpoints(endpoints)

    def begin(self) -> None:
        """Time passes from now on."""
        self._air.begin(waits=True)
        self._started_s, self._cpu_s = self._clock.now(), self._watch.usage().cpu_s
        self._watch.check_agent()

    def exchange(self, now: SimTime) -> Documents:
        """Wait for the moment, and take in what has come until then."""
        self._watch.check_agent()
        # Counted from the start: rounding and late wake-ups do not add up.
        ahead_s = now.s - (self._clock.now() - self._started_s)
        if ahead_s > 0:
            self._clock.sleep(ahead_s)
        delay_s = self._clock.now() - self._started_s - now.s
        self._steps.record(delay_s, self._watch.agent_input.delay_since_mark_s())
        with self._watch.agent_input.taking():
            self._parts.vehicle.receive()
            # Before the next tick, which waits for the acknowledgement of this one.
            documents = self._air.take(now)
            self._air.send(now)
            return documents

    def judged(self, end: StopSession) -> StopSession:
        """The end by the punctuality of the steps, which becomes a fact of the session."""
        self._air.end(end)
        timing = self._steps.summary()
        self._parts.progress.add(timing)
        host_s = (self._clock.now() - self._started_s) * usable_cores()
        used_s = self._watch.usage().cpu_s - self._cpu_s + self._watch.agent_input.cpu_s
        share = used_s / host_s if host_s > 0.0 else 0.0
        return judged(end, timing, self._parts.plan.simspec.pace, share)

    def counters(self) -> dict[str, int]:
        """Those of the air network."""
        return self._air.counters()


@contextmanager
def open_real_time(parts: SessionParts, watch: SessionWatch) -> Generator[RealTime]:
    """Open the agent's side of the air network."""
    with open_unpaced_air(parts, watch) as air:
        yield RealTime(parts, watch, air)
