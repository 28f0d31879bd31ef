"""The events of one run: orders and the answers to them, outages, and failures of the vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bench.contracts import Tape
from bench.simspec import FAILURES, OUTAGES, Order, SimSpec

# An agent may answer one order as often as it likes, and the first answer is the one that counts.
ANSWERS_SHOWN = 3


@dataclass(frozen=True, slots=True)
class RunEvent:
    """One event that the situation configures, in seconds of simulated time. `until_s` is None for an event
    without an end.

    `response` is what the recording shows: when an order was delivered and what the agent answered, or that
    the run ended before the event.
    """

    at_s: float
    until_s: float | None
    kind: str
    text: str
    response: str


def run_events(simspec: SimSpec, tape: Tape) -> tuple[RunEvent, ...]:
    """Every event of a run, in the order of time."""
    events = [*_orders(simspec, tape), *_outages(simspec, tape), *_failures(simspec, tape)]
    # Kind and text break ties, so that the order does not depend on the document.
    return tuple(sorted(events, key=lambda event: (event.at_s, event.kind, event.text)))


def _orders(simspec: SimSpec, tape: Tape) -> Iterator[RunEvent]:
    for order in simspec.orders:
        about = f" {order.intelligence}" if order.intelligence else ""
        yield RunEvent(
            order.at_s,
            None,
            "order",
            f"{order.kind.replace('_', ' ')}{about}, within {order.within_s:g} s",
            _order_response(order, tape),
        )


def _order_response(order: Order, tape: Tape) -> str:
    delivered = next((answer for answer in tape.orders if answer.value.id == order.id), None)
    if delivered is None:
        # Orders wait while the operator's link is down, so a run can end before one is delivered.
        return "never delivered" if tape.end_s >= order.at_s else "the run had ended"
    answers = [answer for answer in tape.answers if answer.value.order == order.id]
    responses = [
        f"{'accepted' if answer.value.accepted else 'refused'} at {answer.time.s:.1f} s"
        + (f": {answer.value.reason}" if answer.value.reason else "")
        for answer in answers[:ANSWERS_SHOWN]
    ]
    if len(answers) > ANSWERS_SHOWN:
        responses.append(f"{len(answers) - ANSWERS_SHOWN} more answers")
    return f"delivered at {delivered.time.s:.1f} s; {'; '.join(responses) or 'not answered'}"


def _outages(simspec: SimSpec, tape: Tape) -> Iterator[RunEvent]:
    for outage in simspec.outages:
        response = _response_by_end(outage.at_s, tape)
        if outage.kind == "operator_link":
            # SimTime counts nanoseconds: the recorded moment may be rounded to just before the configured
            # one.
            down = next(
                (
                    link.time.s
                    for link in tape.operator_link
                    if not link.value.up and link.time.s >= outage.at_s - 1e-6
                ),
                None,
            )
            response = response or ("" if down is None else f"the agent was informed at {down:.1f} s")
        yield RunEvent(outage.at_s, outage.until_s, "outage", OUTAGES[outage.kind].tell(outage), response)


def _failures(simspec: SimSpec, tape: Tape) -> Iterator[RunEvent]:
    for failure in simspec.vehicle.failures:
        until_s = None if failure.duration_s is None else failure.at_s + failure.duration_s
        text = FAILURES[failure.kind].tell(failure)
        yield RunEvent(failure.at_s, until_s, "fault", text, _response_by_end(failure.at_s, tape))


def _response_by_end(at_s: float, tape: Tape) -> str:
    return "" if tape.end_s >= at_s else "the run had ended"
