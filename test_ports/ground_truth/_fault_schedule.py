"""The faults and outages of a scenario, and which of them a run has to answer for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench.contracts import Outcome, Tape
from bench.simspec import FailureKind, OutageKind, SimSpec

FaultKind = Literal["any", FailureKind, OutageKind]

EXACT_S = 1e-6
"""Slack of a comparison of seconds, which are made of whole nanoseconds."""


def in_span(time_s: float, since_s: float, until_s: float) -> bool:
    """Whether a moment lies in a span, its bounds included."""
    return since_s - EXACT_S <= time_s <= until_s + EXACT_S


@dataclass(frozen=True, slots=True)
class FaultSpan:
    """A fault or an outage in simulated seconds; `until_s` is infinite when it lasts to the end."""

    kind: str
    at_s: float
    until_s: float


def scheduled_faults(simspec: SimSpec, kind: FaultKind = "any") -> list[FaultSpan]:
    """Failures and outages of that kind that begin before the mission's time limit, in order of time."""
    failures = [
        FaultSpan(failure.kind, failure.at_s, failure.until_s) for failure in simspec.vehicle.failures
    ]
    # A failure is of the vehicle and may last to the end; an outage is around it and always ends.
    # An agent with a perception of its own meets no outage of the bench's detector.
    outages = [
        FaultSpan(outage.kind, outage.at_s, outage.until_s)
        for outage in simspec.outages
        if outage.kind == "operator_link" or simspec.perception.by_bench
    ]
    due = [
        fault
        for fault in [*failures, *outages]
        if fault.at_s < simspec.mission.time_limit_s and kind in ("any", fault.kind)
    ]
    # The kind breaks ties, so that the order does not depend on where in the SimSpec a fault stands.
    return sorted(due, key=lambda fault: (fault.at_s, fault.kind))


def faults_met(tape: Tape, simspec: SimSpec, kind: FaultKind = "any") -> list[FaultSpan]:
    """The faults that a run has to answer for: all but those scheduled after a mission that was properly
    over.

    A run that its agent ended otherwise, by a crash or by silence, also answers for the faults that it did
    not live to meet.
    """
    return [
        fault for fault in scheduled_faults(simspec, kind) if fault.at_s <= tape.end_s or not _completed(tape)
    ]


def _completed(tape: Tape) -> bool:
    """Whether the session ended with its mission over."""
    return any(event.value.name == "ended" and event.value.text == Outcome.COMPLETED for event in tape.events)


def outcome_by_agent_fault(tape: Tape) -> str | None:
    """The outcome of a session ended by its agent's crash, silence or breach of the protocol; else None."""
    agent_faults = {
        Outcome.AGENT_CRASHED,
        Outcome.AGENT_TIMEOUT,
        Outcome.AGENT_NEVER_CONNECTED,
        Outcome.AGENT_PROTOCOL,
        Outcome.AGENT_FLOODED,
        Outcome.AGENT_BROKE_BENCH,
    }
    ends = (event.value.text for event in tape.events if event.value.name == "ended")
    return next((outcome for outcome in ends if outcome in agent_faults), None)
