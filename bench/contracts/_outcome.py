"""How a session can end, and what stays of it."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, ValidationError

from bench.documents import Document, is_default
from bench.errors import (
    AgentBoxKilled,
    DetectorFault,
    FirmwareFault,
    PlacementInfeasible,
    SetupError,
    VehicleFault,
)
from bench.visible_text import visible, visible_values

# Words of agents, vehicles and files are in it: of a process that crashed, a firmware's console, a report.
Words = Annotated[str, AfterValidator(visible)]


class Blame(StrEnum):
    """Whose doing the end of a session is."""

    AGENT = "agent"
    HOST = "host"  # the computer: too slow, out of memory, a process that was killed
    BENCH = "bench"
    SITUATION = "situation"  # the SimSpec or the campaign
    NOBODY = "nobody"


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
        """Whether observables of such a run are scored: what the agent did or failed to do counts, bench
        errors do not.
        """
        return self in _SCORED_OUTCOMES

    @property
    def blame(self) -> Blame:
        """Whose doing such an end is."""
        return _BLAME[self]


# Listed and not derived: whether a run counts decides over every number, so a new outcome must be put here on
# purpose.
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

_BLAME = {
    Outcome.COMPLETED: Blame.NOBODY,
    Outcome.TIME_LIMIT: Blame.AGENT,
    Outcome.VEHICLE_CRASHED: Blame.AGENT,
    Outcome.AGENT_CRASHED: Blame.AGENT,
    Outcome.AGENT_TIMEOUT: Blame.AGENT,
    Outcome.AGENT_NEVER_CONNECTED: Blame.AGENT,
    Outcome.AGENT_PROTOCOL: Blame.AGENT,
    Outcome.AGENT_FLOODED: Blame.AGENT,
    Outcome.AGENT_BROKE_BENCH: Blame.AGENT,
    Outcome.PLACEMENT_INFEASIBLE: Blame.SITUATION,
    Outcome.SETUP_INVALID: Blame.SITUATION,
    Outcome.WALL_BUDGET: Blame.HOST,
    Outcome.BENCH_TOO_SLOW: Blame.HOST,
    Outcome.WORKER_LOST: Blame.HOST,
    Outcome.BENCH_ERROR: Blame.BENCH,
    Outcome.SETTLED: Blame.NOBODY,
}


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
    x: Annotated[float | None, Field(ge=0.0, le=1.0)] = None
    evidence: tuple[Evidence, ...] = ()
    failure: Annotated[Words, Field(exclude_if=is_default(""))] = ""


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


SUSPECT = "suspect"
"""In `SessionResult.details`: how the attempts ended that an unconfined agent may have caused, one text each."""


def suspicions_of(details: Mapping[str, object]) -> tuple[str, ...]:
    """The suspect ends in the details of a result, which may have been edited."""
    ends = details.get(SUSPECT)
    return tuple(str(end) for end in ends) if isinstance(ends, list) else ()


SAW_TRUTH = "saw_the_truth"
"""In `SessionResult.details`: the reports of honeypots, one text each."""


def truth_sightings_of(details: Mapping[str, object]) -> tuple[str, ...]:
    """The reports of honeypots in the details of a result, which may have been edited."""
    texts = details.get(SAW_TRUTH)
    return tuple(str(text) for text in texts) if isinstance(texts, list) else ()


DETECTOR = "detector"
"""In `SessionResult.details`: which detector worked on the pictures, with its version as far as it tells."""

FIRMWARE = "firmware"
"""In `SessionResult.details`: the real autopilot that flew, with version, digest and pace; absent where one is imitated."""

FIRMWARE_FAILED = "the autopilot's firmware failed"
"""How the reason of a session begins whose real autopilot failed."""

FIRMWARE_ENDS = "firmware_ended"
"""In `SessionResult.details`: how the real autopilot failed in flight in attempts at the run, one text each."""


def firmware_ends_of(details: Mapping[str, object]) -> tuple[str, ...]:
    """The failures of the firmware in the details of a result, which may have been edited."""
    ends = details.get(FIRMWARE_ENDS)
    return tuple(str(end) for end in ends) if isinstance(ends, list) else ()


AGENT_EXIT_CODE = "agent_exit_code"
"""In `SessionResult.details` of a session that its agent's process ended: the exit code, or minus the signal that killed it."""

TIMING = "timing"
"""In `SessionResult.details`: how punctual the steps of a session in real time were, a `StepTiming`."""

ARITHMETIC = "arithmetic"
"""In `SessionResult.details`: what the last bits of the recording depend on beside the versions in its head."""

WARP = "warp"
"""In `SessionResult.details`: the library by which the agent's clock was the session's, absent in the other paces."""

LEAVES_OPEN = "leaves_open"
"""In `SessionResult.details`: names of walls that the agent's rung did not hold on the host of the session."""


def open_walls_of(details: Mapping[str, object]) -> tuple[str, ...] | None:
    """The open walls in the details of a result, which may have been edited; None where they are not recorded."""
    names = details.get(LEAVES_OPEN)
    return tuple(str(name) for name in names) if isinstance(names, list) else None


class ServiceUse(Document):
    """What went over one service that the SimSpec let in. Bytes are the agent's: sent to the service, received from it.

    `failed` connections were not taken by the service, `refused` ones not by the bench: too many at once. Without
    `counted` the process that carries connections was gone before it could tell, and the numbers are 0.
    """

    name: str
    host: str
    port: int
    connections: int = 0
    failed: int = 0
    refused: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0
    counted: bool = True

    def __str__(self) -> str:
        where = f"{self.name} ({self.host}:{self.port})"
        if not self.counted:
            return f"{where}, not counted"
        lost = [
            f", {count:,} {word}"
            for count, word in ((self.failed, "failed"), (self.refused, "refused"))
            if count
        ]
        connections = f"{self.connections:,} connection{'' if self.connections == 1 else 's'}"
        return f"{where}, {connections}{''.join(lost)}, {self.bytes_sent:,} bytes sent and {self.bytes_received:,} received"


SERVICES = "services"
"""In `SessionResult.details`: what went over the services that were let in, one `ServiceUse` each."""


def services_of(details: Mapping[str, object]) -> tuple[ServiceUse, ...]:
    """The services in the details of a result, which may have been edited."""
    entries = details.get(SERVICES)
    uses = []
    for entry in entries if isinstance(entries, list) else ():
        with suppress(ValidationError):
            uses.append(ServiceUse.model_validate(entry))
    return tuple(uses)


class StepTiming(Document):
    """How punctually a session in real time began its steps. A delay is counted from the moment at which a step was due;
    percentiles of delays are its jitter. A step is late when it began more than `late_after_s`, its own length, too late:
    what the agent sent for it was then taken by another step. `late_without_input` is how many would have been late if the
    bench had had nothing to do with what the agent sends, and `late_input_share` which part of the host's time between two
    steps, of which the second was late, that work took; None where it was not counted.
    """

    steps: int
    late: int
    late_after_s: float
    delay_p50_s: float
    delay_p95_s: float
    delay_p99_s: float
    delay_max_s: float
    late_without_input: int | None = None
    late_input_share: float | None = None

    @property
    def late_share(self) -> float:
        """Late steps among all; 0 without steps."""
        return self.late / self.steps if self.steps else 0.0

    def __str__(self) -> str:
        return (
            f"{self.late:,} of {self.steps:,} steps ({self.late_share:.1%}) were late by more than "
            f"{self.late_after_s * 1e3:g} ms; delays: half up to {self.delay_p50_s * 1e3:.1f} ms, 95 % up to "
            f"{self.delay_p95_s * 1e3:.1f} ms, 99 % up to {self.delay_p99_s * 1e3:.1f} ms, largest "
            f"{self.delay_max_s * 1e3:.1f} ms"
        )


def timing_of(details: Mapping[str, object]) -> StepTiming | None:
    """The timing in the details of a result, which may have been edited; None where there is none."""
    with suppress(ValidationError):
        return StepTiming.model_validate(details.get(TIMING))
    return None


LOSSES = {
    "mavlink_dropped": "MAVLink messages that a link did not take",
    "mavlink_garbage_bytes": "bytes that are no MAVLink",
    "serial_lost_bytes": "bytes that a serial line did not take",
    "serial_lost_messages": "messages lost on serial lines, by their sequence numbers",
    "serial_resets": "serial devices that went away and came back",
    "board_late_samples": "sensor samples sent late to the board",
    "board_lost_bytes": "bytes that the line to the board did not take",
    "board_lost_messages": "messages of the board that were lost, by their sequence numbers",
    "board_garbage_bytes": "bytes from the board that are no MAVLink",
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
    details: Annotated[dict[str, Any], AfterValidator(visible_values)] = {}


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
                # The model's numbers ran away: the text says which, and the frames of our stack would say
                # nothing more.
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
        details = traceback_details(self.traceback)
        return SessionResult(
            realization=realization, outcome=self.outcome, reason=self.reason, wall_s=wall_s, details=details
        )


def traceback_details(traceback: str) -> dict[str, Any]:
    """`SessionResult.details` of a session that ended with this traceback; empty when there is none."""
    return {"traceback": traceback} if traceback else {}
