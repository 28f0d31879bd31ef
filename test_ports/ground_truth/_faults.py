"""The faults and outages of a scenario, and whether a run lived to meet them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from bench.contracts import Outcome, Tape
from bench.simspec import SimSpec

FaultKind = Literal["any", "gps_off", "gps_drift", "battery_drop", "motor_off", "link_loss", "operator_link", "detections"]

WORDS = {
    "gps_off": "gps",
    "gps_drift": "gps",
    "battery_drop": "battery",
    "motor_off": "motor",
    "link_loss": "link",
    "operator_link": "operator_link",
    "detections": "detections",
}
"""What a decision has as its subject (or action) when it is about such a fault."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that breaks, in simulated seconds; `until_s` is infinite when it is never mended."""

    kind: str
    at_s: float
    until_s: float


def faults(simspec: SimSpec, kind: FaultKind = "any") -> list[Fault]:
    """Failures of the vehicle and outages of that kind that begin before the mission's time limit, in order of time."""
    found = [
        Fault(one.kind, one.at_s, math.inf if one.duration_s is None else one.at_s + one.duration_s)
        for one in simspec.vehicle.failures
    ]
    found += [Fault(one.kind, one.at_s, one.until_s) for one in simspec.outages]
    due = [one for one in found if one.at_s < simspec.mission.time_limit_s and kind in ("any", one.kind)]
    return sorted(due, key=lambda one: (one.at_s, one.kind))


def met(tape: Tape, simspec: SimSpec, kind: FaultKind = "any") -> list[Fault]:
    """Those that a run has to answer for: all but the ones that came after it was over as it should be.

    A run that its agent ended otherwise (crash, silence) answers for what it did not live to see.
    """
    return [one for one in faults(simspec, kind) if one.at_s <= tape.end_s or not over_well(tape)]


def over_well(tape: Tape) -> bool:
    """Whether the session ended with its mission over."""
    return any(said.value.name == "ended" and said.value.text == Outcome.COMPLETED for said in tape.events)


def ended_by_its_agent(tape: Tape) -> str | None:
    """The outcome of a session that its agent ended by crashing, falling silent or breaking the protocol; else None."""
    wrong = {Outcome.AGENT_CRASHED, Outcome.AGENT_TIMEOUT, Outcome.AGENT_NEVER_CONNECTED, Outcome.AGENT_PROTOCOL}
    return next((said.value.text for said in tape.events if said.value.name == "ended" and said.value.text in wrong), None)
