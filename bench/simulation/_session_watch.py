"""What ends a session from the host's side: the agent's process, and the wall budget."""

from __future__ import annotations

import signal

from bench.contracts import START, AgentExit, AgentProcess, AgentUsage, Outcome

from ._agent_input import AgentInput
from ._agent_time import AgentTime
from ._progress_updates import ProgressUpdates
from ._session_parts import SessionParts
from ._stop_session import StopSession


class SessionWatch:
    """Looks at the agent's process and at the host's time, from before the agent starts. Its checks raise StopSession."""

    def __init__(self, parts: SessionParts) -> None:
        self._plan = plan = parts.plan
        self._vehicle, self._progress = parts.vehicle, parts.progress
        self._agent: AgentProcess | None = None
        self.agent_time = AgentTime(plan.clock, self.usage)
        self.agent_input = AgentInput(plan.clock)
        started_s = plan.clock.now()
        self._wall_deadline_s = started_s + plan.simspec.budgets.wall_s
        self.updates = ProgressUpdates(plan.on_progress, plan.simspec.mission.time_limit_s, started_s)
        self._memory_kills = plan.memory_kills()

    def follow(self, agent: AgentProcess) -> None:
        """Look at this agent, which has started."""
        self._agent = agent

    def usage(self) -> AgentUsage:
        """What the agent has used of the host so far."""
        return self._agent.usage() if self._agent is not None else AgentUsage()

    def check(self) -> None:
        """Both checks, while the session waits."""
        self.check_agent()
        self.check_wall_time()

    def check_wall_time(self) -> None:
        """End the session if its wall budget is used up."""
        host_s = self._plan.clock.now()
        self.updates.publish_due(self._progress.now, host_s)
        if host_s > self._wall_deadline_s:
            raise self._out_of_wall_time()

    def _out_of_wall_time(self) -> StopSession:
        """The end for a used-up wall budget: the agent's fault if more than half of it was its own time.

        Runs that end by WALL_BUDGET are not scored, so an agent could drop a run that goes badly by dawdling.
        """
        wall_s, taken_s = self._plan.simspec.budgets.wall_s, self.agent_input.taken_s
        own_s, waited_s = self.agent_time.own_s() + taken_s, self.agent_time.waited_s + taken_s
        if own_s > wall_s / 2:
            reason = (
                f"the agent took {own_s:.0f} s of the session's {wall_s:g} s of the host's time to answer"
            )
            return StopSession(Outcome.AGENT_TIMEOUT, reason)
        reason = f"the session took longer than {wall_s:g} s of the host's time, {own_s:.0f} s of it the agent's own"
        if waited_s - own_s >= 1.0:
            reason += f"; for {waited_s - own_s:.0f} s the host was too busy to let the agent answer"
        return StopSession(Outcome.WALL_BUDGET, reason)

    def check_agent(self) -> None:
        """End the session if the agent's process has ended."""
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
