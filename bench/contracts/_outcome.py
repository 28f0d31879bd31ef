"""How a session can end, and what stays of it."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

from pydantic import AliasChoices, Field

from bench.documents import Document, is_default
from bench.errors import (
    AgentBoxKilled,
    DetectorFault,
    FirmwareFault,
    PlacementInfeasible,
    SetupError,
    VehicleFault,
)

from ._facts import AnyFact, BenchTraceback, Fact, Facts, Words, fact_of, facts_of


class Outcome(StrEnum):
    """Every way in which a session can end. None of them is an exception, and each is a row in the report."""

    COMPLETED = "completed"  # the agent declared its mission complete (or aborted) and the vehicle is down
    TIME_LIMIT = "time_limit"  # simulated time of the mission ran out
    VEHICLE_CRASHED = "vehicle_crashed"  # the vehicle hit something or turned over
    AGENT_CRASHED = "agent_crashed"  # the agent's process ended by itself before its mission did
    AGENT_TIMEOUT = "agent_timeout"  # the agent took more of its own time to answer than its budget allows
    AGENT_NEVER_CONNECTED = "agent_never_connected"  # no hello within the budget
    AGENT_PROTOCOL = "agent_protocol"  # the agent broke the tick protocol
    AGENT_FLOODED = "agent_flooded"  # the agent sent far more than is recorded of it
    AGENT_BROKE_BENCH = "agent_broke_bench"  # the bench was lost under the agent, again and again
    PLACEMENT_INFEASIBLE = "placement_infeasible"  # the constraints leave some actor no place
    SETUP_INVALID = "setup_invalid"  # the SimSpec names something that does not exist here
    WALL_BUDGET = "wall_budget"  # the session as a whole took longer than allowed by the host's clock
    BENCH_TOO_SLOW = "bench_too_slow"  # in real time, too many steps of the bench came late
    WORKER_LOST = "worker_lost"  # the worker process died under the session
    BENCH_ERROR = "bench_error"  # the bench itself failed
    SETTLED = "settled"  # not flown: the replicates before it decided the stopping rule

    @property
    def counts(self) -> bool:
        """Whether observables of such a run are scored: what the agent did counts, bench errors do not."""
        return self in _SCORED_OUTCOMES


# Listed and not derived: whether a run counts decides over every number.
_SCORED_OUTCOMES = frozenset(
    {
        Outcome.COMPLETED,
        Outcome.TIME_LIMIT,
        Outcome.VEHICLE_CRASHED,
        Outcome.AGENT_CRASHED,
        Outcome.AGENT_TIMEOUT,
        Outcome.AGENT_NEVER_CONNECTED,
        Outcome.AGENT_PROTOCOL,
        Outcome.AGENT_FLOODED,
        Outcome.AGENT_BROKE_BENCH,
    }
)


class Evidence(Document):
    """A moment in the recording that a measured value rests on."""

    time_s: float
    text: Words


class Observation(Document):
    """What one measure found in one run for one observable.

    `x` is the measured value in [0, 1], None exactly when the run is not considered: when the situation, by
    the scenario and the truth, offered nothing that could exercise the observable (docs/rulings.md 6), or when the
    measure failed. `failure` then says which measure, and where.
    """

    observable: str
    considered: bool
    x: float | None = Field(None, ge=0.0, le=1.0)
    evidence: tuple[Evidence, ...] = ()
    failure: Words = Field("", exclude_if=is_default(""))
    stages: Words = Field("", exclude_if=is_default(""))
    """Below 1, how far the agent came with the actors that it is about: in view, detected, held, reported, acted on."""


PROBES = {
    "tick_strangers": "strangers on the tick socket",
    "simulation_refused": "attempts to change the simulation",
    "air_malformed": "malformed samples",
    "air_dropped": "samples beyond the limits",
    "mavlink_garbage_bytes": "bytes that are no MAVLink",
    "mavlink_malformed": "malformed MAVLink messages",
    "mavlink_unheard": "MAVLink messages that nothing takes",
}
"""Counters of what was refused or ignored and gained nothing, with the words of the report. A careless agent has some
too.
"""


def probes_of(counters: Mapping[str, int]) -> dict[str, int]:
    """Those counters of a session that are not zero, by the words of the report."""
    return {text: counters[name] for name, text in PROBES.items() if counters.get(name, 0) > 0}


FIRMWARE_FAILED = "the autopilot's firmware failed"
"""How the reason of a session begins whose real autopilot failed."""

LOSSES = {
    "mavlink_dropped": "MAVLink messages that a link did not take",
    "mavlink_garbage_bytes": "bytes that are no MAVLink",
    "serial_lost_bytes": "bytes that a serial line did not take",
    "serial_lost_messages": "messages lost on serial lines, by their sequence numbers",
    "serial_resets": "serial devices that went away and came back",
    "firmware_late_samples": "sensor samples sent late to the autopilot",
    "firmware_lost_bytes": "bytes that the line to the autopilot did not take",
    "firmware_lost_messages": "messages of the autopilot that were lost, by their sequence numbers",
    "firmware_garbage_bytes": "bytes from the autopilot that are no MAVLink",
}
"""Counters of what was lost on the links, with the words of the report."""


def losses_of(counters: Mapping[str, int]) -> dict[str, int]:
    """Those counters of a session that are not zero, by the words of the report."""
    return {text: counters[name] for name, text in LOSSES.items() if counters.get(name, 0) > 0}


class SessionResult(Document):
    """What is left of a session beside its recording; `result.json` in a run's folder."""

    realization: str
    outcome: Outcome
    reason: Words = ""
    simulated_s: float = 0.0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    agent_cpu_s: float = 0.0
    recording_sha256: str | None = None
    counters: dict[str, int] = {}
    observations: tuple[Observation, ...] = ()
    facts: Facts = Field({}, validation_alias=AliasChoices("facts", "details"))
    """What the parts of the session tell, by key. Results of earlier versions have `details`."""

    def fact(self, kind: type[AnyFact]) -> AnyFact | None:
        """The fact of this kind; None where no part of the session told it."""
        return fact_of(self.facts, kind)

    def with_facts(self, *facts: Fact) -> Self:
        """The result with these facts too, in place of those of the same kinds."""
        return self.model_copy(update={"facts": self.facts | facts_of(*facts)})


@dataclass(frozen=True, slots=True)
class SessionFailure:
    """An exception that ended a realization, as an outcome.

    `traceback` is empty unless the bench has to be debugged.
    """

    outcome: Outcome
    reason: str
    traceback: str = ""

    @classmethod
    def of(cls, error: BaseException) -> Self:
        """The outcome that an exception stands for.

        Whatever is not expected is a bench error, with its traceback.
        """
        match error:
            case PlacementInfeasible():
                return cls(Outcome.PLACEMENT_INFEASIBLE, str(error))
            case SetupError():
                return cls(Outcome.SETUP_INVALID, str(error))
            case VehicleFault():
                # The model's numbers ran away: the text says which, and our frames would say nothing more.
                return cls(Outcome.BENCH_ERROR, f"the vehicle model failed: {error}")
            case AgentBoxKilled():
                return cls(Outcome.BENCH_ERROR, str(error))
            case FirmwareFault():
                # Its own words are in the text; our frames only say who was waiting for it.
                return cls(Outcome.BENCH_ERROR, f"{FIRMWARE_FAILED}: {error}")
            case DetectorFault():
                # A plug-in's: its own frames say where it failed.
                text = "".join(traceback.format_exception(error))
                return cls(Outcome.BENCH_ERROR, f"the detector failed: {error}", text)
            case _:
                # A fault in the bench is ours to find, so its traceback goes into result.json.
                text = "".join(traceback.format_exception(error))
                return cls(Outcome.BENCH_ERROR, f"{type(error).__name__}: {error}", text)

    def result(self, realization: str, wall_s: float = 0.0) -> SessionResult:
        """The result of a realization that ended so before it had a recording."""
        facts = facts_of(*[BenchTraceback(text=self.traceback)] if self.traceback else [])
        return SessionResult(
            realization=realization, outcome=self.outcome, reason=self.reason, wall_s=wall_s, facts=facts
        )
