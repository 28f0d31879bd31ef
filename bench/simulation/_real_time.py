"""The pace at which simulated time passes as fast as the host's."""

from __future__ import annotations

from bench.contracts import SimTime

from ._host_resources import usable_cores
from ._pace import Documents, Pace
from ._session_parts import SessionParts
from ._session_watch import SessionWatch
from ._step_timing import StepClock, judged
from ._stop_session import StopSession


class RealTime(Pace):
    """A beat is a step of the vehicle, and begins when the host's clock says so. Nothing waits for the agent."""

    def __init__(self, parts: SessionParts, watch: SessionWatch) -> None:
        super().__init__(parts, watch, parts.vehicle.step_s)
        self._clock = parts.plan.clock
        self._steps = StepClock(self.span_s)
        self._started_s = self._cpu_s = 0.0

    def begin(self) -> None:
        """Time passes from now on."""
        self._parts.air.open_for_all()
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
            return self._parts.air.receive(now, None, 0.0)

    def judged(self, end: StopSession) -> StopSession:
        """The end by the punctuality of the steps, which becomes a fact of the session."""
        timing = self._steps.summary()
        self._parts.progress.add(timing)
        host_s = (self._clock.now() - self._started_s) * usable_cores()
        used_s = self._watch.usage().cpu_s - self._cpu_s + self._watch.agent_input.cpu_s
        share = used_s / host_s if host_s > 0.0 else 0.0
        return judged(end, timing, self._parts.plan.simspec.pace, share)
