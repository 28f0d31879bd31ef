"""What befell one run: orders and how they were answered, the operator's link, silent detectors, faults of the vehicle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bench.contracts import Tape
from bench.simspec import Failure, Order, SimSpec

OUTAGES = {"operator_link": "the operator’s link is down", "detections": "the detector is silent"}


@dataclass(frozen=True, slots=True)
class Happening:
    """One thing that the situation had in store, in seconds of simulated time; `until_s` is None where it has no end of its own.

    `came` is what the recording says of it: when an order was delivered and what the agent answered, or whether the
    run lasted until then.
    """

    at_s: float
    until_s: float | None
    kind: str
    what: str
    came: str


def happenings(simspec: SimSpec, tape: Tape) -> tuple[Happening, ...]:
    """All of a run's, by their time."""
    found = [*_orders(simspec, tape), *_outages(simspec, tape), *_faults(simspec, tape)]
    return tuple(sorted(found, key=lambda one: (one.at_s, one.kind, one.what)))


def _orders(simspec: SimSpec, tape: Tape) -> Iterator[Happening]:
    for order in simspec.orders:
        about = f" {order.intelligence}" if order.intelligence else ""
        yield Happening(
            order.at_s, None, "order", f"{order.kind.replace('_', ' ')}{about}, within {order.within_s:g} s", _came(order, tape)
        )


def _came(order: Order, tape: Tape) -> str:
    given = next((one for one in tape.orders if one.value.id == order.id), None)
    if given is None:
        return "never delivered" if tape.end_s >= order.at_s else "the run had ended"
    answers = [one for one in tape.answers if one.value.order == order.id]
    said = [
        f"{'accepted' if one.value.accepted else 'refused'} at {one.time.s:.1f} s"
        + (f": {one.value.reason}" if one.value.reason else "")
        for one in answers
    ]
    return f"delivered at {given.time.s:.1f} s; {'; '.join(said) or 'not answered'}"


def _outages(simspec: SimSpec, tape: Tape) -> Iterator[Happening]:
    for outage in simspec.outages:
        came = _reached(outage.at_s, tape)
        if outage.kind == "operator_link":
            down = next((one.time.s for one in tape.operator_link if not one.value.up and one.time.s >= outage.at_s - 1e-6), None)
            came = came or ("" if down is None else f"the agent was told at {down:.1f} s")
        yield Happening(outage.at_s, outage.until_s, "outage", OUTAGES[outage.kind], came)


def _faults(simspec: SimSpec, tape: Tape) -> Iterator[Happening]:
    for failure in simspec.vehicle.failures:
        until_s = None if failure.duration_s is None else failure.at_s + failure.duration_s
        yield Happening(failure.at_s, until_s, "fault", _broken(failure), _reached(failure.at_s, tape))


def _reached(at_s: float, tape: Tape) -> str:
    return "" if tape.end_s >= at_s else "the run had ended"


def _broken(failure: Failure) -> str:
    if failure.kind == "gps_drift":
        return f"fixes drift by {failure.drift_mps:g} m/s towards {failure.towards_deg or 0.0:g}°"
    if failure.kind == "battery_drop":
        return f"the battery falls to {100 * (failure.to_fraction or 0.0):g} %"
    if failure.kind == "motor_off":
        return f"rotor {failure.instance} stops"
    if failure.kind == "link_loss":
        return f"MAVLink link {failure.link} is cut" if failure.link else "every MAVLink link is cut"
    return "no GPS fixes"
