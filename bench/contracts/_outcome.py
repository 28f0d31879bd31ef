"""How a session can end, and what is said of it."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

from pydantic import Field

from bench.documents import Document


class Outcome(StrEnum):
    """Every way in which a session can end. None of them is an exception, and each is a row in the report."""

    COMPLETED = "completed"  # the agent declared its mission complete (or aborted) and the vehicle is down
    TIME_LIMIT = "time_limit"  # simulated time of the mission ran out
    VEHICLE_CRASHED = "vehicle_crashed"  # the vehicle hit something or turned over
    AGENT_CRASHED = "agent_crashed"  # the agent's process ended by itself before its mission did
    AGENT_TIMEOUT = "agent_timeout"  # the agent did not answer a tick within its budget
    AGENT_NEVER_CONNECTED = "agent_never_connected"  # no hello within the budget
    AGENT_PROTOCOL = "agent_protocol"  # the agent broke the tick protocol
    PLACEMENT_INFEASIBLE = "placement_infeasible"  # the constraints leave no place for somebody
    SETUP_INVALID = "setup_invalid"  # the SimSpec names something that does not exist here
    WALL_BUDGET = "wall_budget"  # the session as a whole took longer than allowed by the host's clock
    WORKER_LOST = "worker_lost"  # the worker process died under the session
    BENCH_ERROR = "bench_error"  # a fault of the bench's own
    SETTLED = "settled"  # not flown: the replicates before it had settled the question

    @property
    def counts(self) -> bool:
        """Whether observables of such a run are scored: what the agent did or failed to do counts, the bench's faults do not."""
        return self in _AGENT_ANSWERS_FOR


_AGENT_ANSWERS_FOR = frozenset(
    {
        Outcome.COMPLETED,
        Outcome.TIME_LIMIT,
        Outcome.VEHICLE_CRASHED,
        Outcome.AGENT_CRASHED,
        Outcome.AGENT_TIMEOUT,
        Outcome.AGENT_NEVER_CONNECTED,
        Outcome.AGENT_PROTOCOL,
    }
)


class Evidence(Document):
    """A moment in the recording that a measured value rests on."""

    time_s: float
    text: str


class Observation(Document):
    """What one measure found in one run for one observable.

    `x` is the measured value in [0, 1], None exactly when the run is not considered: when the situation, by the
    scenario and the truth, offered nothing that could exercise the observable (docs/rulings.md 6).
    """

    observable: str
    considered: bool
    x: Annotated[float | None, Field(ge=0.0, le=1.0)] = None
    evidence: tuple[Evidence, ...] = ()


class SessionResult(Document):
    """What is left of a session beside its recording; `result.json` in a run's folder."""

    realization: str
    outcome: Outcome
    reason: str = ""
    simulated_s: float = 0.0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    agent_cpu_s: float = 0.0
    recording_sha256: str | None = None
    counters: dict[str, int] = {}
    observations: tuple[Observation, ...] = ()
    details: dict[str, Any] = {}
