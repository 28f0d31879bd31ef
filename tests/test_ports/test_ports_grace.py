"""A deed counts just inside its time and not just outside: before the order, at it, at the end of the time and after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from cases import Run, scene
from cases.bystanders import RADAR_AT
from cases.mission import OVER_BOTH, went
from cases.orders import GOES_ON, NAME, decided, flew, phases, state
from made_run import answer, order, report

from bench.contracts import load_plugin

# 60.3 + 5.1 and 60.3 + 3.3 are less than 65.4 and 63.6 as floats: a deed exactly at the end of its time counts.
ORDERED_S, TICK_S = 60.3, 0.1
SEEN_BEFORE = report(40.0, *RADAR_AT)


def ordered(kind: str, *absent: str, within_s: float = 10.0, **streams: Any) -> Run:
    """A flight that goes on after an order at ORDERED_S."""
    about = {"mark": "first"}.get(kind)
    listed = {"id": NAME, "at_s": ORDERED_S, "kind": kind, "within_s": within_s}
    spec = scene(*absent, orders=[listed | ({"intelligence": about} if about else {})])
    delivered = order(ORDERED_S, kind, id=NAME, intelligence_id=about, within_s=within_s)
    return flew(spec, *GOES_ON, orders=(delivered,), **streams)


def silent_between(at_s: float) -> Run:
    """Reporting is forbidden from ORDERED_S to 20 s later."""
    orders = [(ORDERED_S, "stop_reporting"), (ORDERED_S + 20.0, "resume_reporting")]
    spec = scene(orders=[{"id": kind.replace("_", "-"), "at_s": at, "kind": kind} for at, kind in orders])
    delivered = tuple(order(at, kind) for at, kind in orders)
    return flew(spec, *GOES_ON, orders=delivered, reports=(SEEN_BEFORE, report(at_s, *RADAR_AT)))


def marked_after_refusal(at_s: float) -> Run:
    refused = answer(ORDERED_S + 1.0, NAME, accepted=False, reason="people near it")
    return ordered("mark", answers=(refused,), reports=(SEEN_BEFORE, report(at_s, *RADAR_AT, mark=True)))


def in_failsafe(at_s: float) -> Run:
    """A failsafe from ORDERED_S on, and a change of phase."""
    condition = (
        state(0.0, landed=True),
        state(5.0),
        state(ORDERED_S, failsafe="link"),
        state(180.0, landed=True),
    )
    said = phases((1.0, "starting"), (5.0, "searching"), (at_s, "holding"), (180.0, "landing"))
    return flew(scene(), *GOES_ON, condition=condition, status=said)


def failing(at_s: float) -> Run:
    failure = {"kind": "battery_drop", "at_s": ORDERED_S, "to_fraction": 0.5}
    return went(
        scene(vehicle={"failures": [failure]}), *OVER_BOTH, decisions=(decided(at_s, "notice", "battery"),)
    )


def degraded(at_s: float) -> Run:
    outage = {"kind": "detections", "at_s": ORDERED_S, "duration_s": 40.0}
    return went(scene(outages=[outage]), *OVER_BOTH, decisions=(decided(at_s, "degraded", "detections"),))


def reported(at_s: float) -> Run:
    """A report at ORDERED_S, and a decision about it."""
    return flew(
        scene(),
        *GOES_ON,
        reports=(report(ORDERED_S, *RADAR_AT, id="r"),),
        decisions=(decided(at_s, "withhold_mark", "r"),),
    )


@dataclass(frozen=True)
class Grace:
    """A measure whose value is better (or worse, for what is forbidden) for a deed within a span, bounds included."""

    measure: str
    run: Callable[[float], Run]
    since_s: float
    until_s: float
    is_good: bool = True
    bounds: tuple[bool, bool] = (True, True)
    options: tuple[tuple[str, Any], ...] = ()

    def value(self, at_s: float) -> float:
        run = self.run(at_s)
        observation = load_plugin("rebar.measures", self.measure)(
            "o", run.tape, run.simspec, dict(self.options)
        )
        assert observation.considered
        return float(observation.x)


GRACES = (
    Grace(
        "order_answered",
        lambda at: ordered("resume", answers=(answer(at, NAME),)),
        60.3,
        65.4,
        options=(("within_s", 5.1),),
    ),
    Grace(
        "decisions_for_orders",
        lambda at: ordered("resume", decisions=(decided(at, "resume", NAME),)),
        60.3,
        65.4,
        options=(("within_s", 5.1),),
    ),
    Grace(
        "phase_announced",
        lambda at: ordered("resume", status=phases((at, "searching"))),
        0.0,
        65.4,
        options=(("kind", "resume"), ("within_s", 5.1)),
    ),
    Grace(
        "silence_kept",
        silent_between,
        63.6,
        80.3,
        is_good=False,
        bounds=(False, False),
        options=(("kind", "stop_reporting"), ("grace_s", 3.3)),
    ),
    Grace("unlawful_refused", marked_after_refusal, 60.3, 90.3, is_good=False),
    Grace(
        "order_obeyed",
        lambda at: ordered("mark", "bystander", within_s=5.1, reports=(report(at, *RADAR_AT, mark=True),)),
        60.3,
        65.4,
        options=(("kind", "mark"),),
    ),
    Grace(
        "order_obeyed",
        lambda at: ordered("stop_reporting", reports=(SEEN_BEFORE, report(at, *RADAR_AT))),
        62.3,
        175.0,
        is_good=False,
        bounds=(False, True),
        options=(("kind", "stop_reporting"),),
    ),
    Grace("state_changes_announced", in_failsafe, 60.3, 65.4, options=(("within_s", 5.1),)),
    Grace("fault_announced", failing, 60.3, 65.4, options=(("within_s", 5.1),)),
    Grace("degradation_announced", degraded, 60.3, 65.4, options=(("within_s", 5.1),)),
    Grace("decision_for_reports", reported, 55.2, 65.4, options=(("within_s", 5.1),)),
    Grace("marks_decided", reported, 55.2, 65.4, options=(("within_s", 5.1),)),
)


@pytest.mark.parametrize("grace", GRACES, ids=lambda grace: grace.measure)
def test_a_deed_counts_within_its_time_and_not_beside_it(grace: Grace) -> None:
    at_first, at_last = grace.bounds
    deeds = {
        round(grace.since_s - TICK_S, 3): False,
        grace.since_s: at_first,
        round(grace.since_s + TICK_S, 3): True,
        round(grace.until_s - TICK_S, 3): True,
        grace.until_s: at_last,
        round(grace.until_s + TICK_S, 3): False,
    }
    values = {at_s: grace.value(at_s) for at_s in deeds if 0.0 < at_s < 174.0}
    best, worst = max(values.values()), min(values.values())
    assert best > worst
    assert {at_s: value == best for at_s, value in values.items()} == {
        at_s: deeds[at_s] is grace.is_good for at_s in values
    }
