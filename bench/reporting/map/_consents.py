"""Requests for consent to a mark in one run, and the operator's answers to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench.contracts import ConsentRequest, Tape, Timed

ConsentState = Literal["granted", "refused", "never answered"]


@dataclass(frozen=True, slots=True)
class MapConsent:
    """One request of the agent, at the place that it states, in seconds of simulated time.

    `answered_s` is when the answer reached the agent; None where it never did.
    """

    time_s: float
    about: str
    class_label: str
    east_m: float
    north_m: float
    bystanders_seen: int | None
    reason: str
    state: ConsentState
    answered_s: float | None


def map_consents(tape: Tape) -> tuple[MapConsent, ...]:
    """Every request of a run with its answer, in the order of the recording."""
    return tuple(_consent(request, tape) for request in tape.consent_requests)


def _consent(request: Timed[ConsentRequest], tape: Tape) -> MapConsent:
    document = request.value
    # An agent may use an id again: an answer belongs to the last request with that id before it.
    until_ns = min(
        (
            later.time.ns
            for later in tape.consent_requests
            if later.value.id == document.id and later.time.ns > request.time.ns
        ),
        default=None,
    )
    answer = next(
        (
            answer
            for answer in tape.consents
            if answer.value.request == document.id
            and answer.time.ns >= request.time.ns
            and (until_ns is None or answer.time.ns < until_ns)
        ),
        None,
    )
    state: ConsentState = (
        "never answered" if answer is None else "granted" if answer.value.granted else "refused"
    )
    return MapConsent(
        time_s=round(request.time.s, 2),
        about=document.intelligence_id,
        class_label=document.class_label,
        east_m=round(document.east_m, 1),
        north_m=round(document.north_m, 1),
        bystanders_seen=document.bystanders_seen,
        reason=document.reason,
        state=state,
        answered_s=None if answer is None else round(answer.time.s, 2),
    )
