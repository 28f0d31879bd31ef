"""Requests for consent to a mark in one run, and the operator's answers to them."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Literal

from bench.contracts import ConsentAnswer, ConsentRequest, SimTime, Tape, Timed

from ._sample import chosen_rows, row_ends

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


@dataclass(frozen=True, slots=True)
class MapConsents:
    """The requests that are drawn, in the order of the recording, and how many there are and were granted in all."""

    drawn: tuple[MapConsent, ...] = ()
    count: int = 0
    granted: int = 0


def map_consents(tape: Tape) -> MapConsents:
    """The requests of a run. At most MAX_DRAWN are drawn: the first and last of each state about each intelligence
    report, then the others evenly over the run.
    """
    requests = all_consents(tape)
    rows = chosen_rows(len(requests), [row_ends((request.about, request.state) for request in requests)])
    return MapConsents(
        drawn=tuple(requests[row] for row in rows),
        count=len(requests),
        granted=sum(request.state == "granted" for request in requests),
    )


def all_consents(tape: Tape) -> tuple[MapConsent, ...]:
    """Every request of a run with its answer, in the order of the recording."""
    # By id and by time, because an agent may ask thousands of times, and each request would look through all answers.
    moments: dict[str, list[int]] = {}
    for request in tape.consent_requests:
        moments.setdefault(request.value.id, []).append(request.time.ns)
    answers: dict[str, list[Timed[ConsentAnswer]]] = {}
    for answer in tape.consents:
        answers.setdefault(answer.value.request, []).append(answer)
    return tuple(
        _consent(request, _answer(request.time, moments[request.value.id], answers.get(request.value.id, [])))
        for request in tape.consent_requests
    )


def _answer(
    moment: SimTime, moments: list[int], answers: list[Timed[ConsentAnswer]]
) -> Timed[ConsentAnswer] | None:
    """The first answer from `moment` on; `moments` (ns) are those of all requests with that id, in order.

    An agent may use an id again: an answer belongs to the last request with that id before it.
    """
    place = bisect_left(answers, moment.ns, key=lambda answer: answer.time.ns)
    if place == len(answers):
        return None
    later = bisect_right(moments, moment.ns)
    is_for_later = later < len(moments) and answers[place].time.ns >= moments[later]
    return None if is_for_later else answers[place]


def _consent(request: Timed[ConsentRequest], answer: Timed[ConsentAnswer] | None) -> MapConsent:
    document = request.value
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
