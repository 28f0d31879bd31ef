"""How the reference agent asks before it marks, and what it does with an answer, a refusal and silence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest
from agent_fakes import Actor, World, intelligence, mission_order, order_document

from agent_adapters.reference.mission._consents import CONSENT_WAIT_S

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
CIVILIAN = Actor("civilian", 140.0, 75.0)
BOTH = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0),
    intelligence("bravo", "military_vehicle", -80.0, 110.0, 2),
)


def world(consents: Mapping[str, tuple[bool, float]], *actors: Actor, **changes: Any) -> World:
    order = mission_order(mark_consent=True)
    return World(list(actors or (RADAR, TRUCK)), {0.0: BOTH}, mission=order, consents=consents, **changes)


def marks(mission: World) -> dict[str | None, float]:
    return {report.intelligence_id: report.time_s for report in mission.reports if report.mark}


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_it_marks_what_is_granted_and_nothing_else(policy: Any) -> None:
    """Both are asked about once, with place and evidence; the late grant is used, the refusal respected."""
    mission = world({"alpha": (True, 15.0), "bravo": (False, 5.0)}).fly(policy)
    requests = {request.intelligence_id: request for request in mission.consent_requests}
    assert len(requests) == len(mission.consent_requests) == 2
    alpha = requests["alpha"]
    assert alpha.class_label == "mobile_radar"
    assert math.dist((alpha.east_m, alpha.north_m), (130.0, 70.0)) < 3.0
    assert alpha.evidence
    assert (alpha.bystanders_seen, alpha.people_expected) == ((None, None) if policy == "naive" else (0, 0.0))
    assert set(marks(mission)) == {"alpha"}
    assert marks(mission)["alpha"] > alpha.time_s + 15.0
    first, *_, marked = [report for report in mission.reports if report.intelligence_id == "alpha"]
    assert (first.mark, marked.mark, marked.repeats) == (False, True, first.id)
    withheld = [decision.reason for decision in mission.decisions_to("withhold_mark")]
    assert any("the operator refuses" in reason for reason in withheld)
    assert mission.phase == "complete"


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_silence_is_no_consent_and_is_not_waited_for_for_ever(policy: Any) -> None:
    """It stays near what it asked about, for a while; then it goes home with nothing marked."""
    mission = world({}).fly(policy)
    assert len(mission.consent_requests) == 2
    assert not marks(mission)
    assert any("until the operator answers" in revisit.reason for revisit in mission.decisions_to("revisit"))
    last_s = max(request.time_s for request in mission.consent_requests)
    assert mission.decisions_to("return")[0].time_s < last_s + CONSENT_WAIT_S + 20.0
    assert mission.phase == "complete"


def test_consent_does_not_lift_the_rule_about_bystanders() -> None:
    """One target is granted with somebody beside it: it stays unmarked. The naive agent marks it."""
    granted = {"alpha": (True, 3.0), "bravo": (True, 3.0)}
    careful = world(granted, RADAR, TRUCK, CIVILIAN).fly("bystander_aware")
    stated = {request.intelligence_id: request.bystanders_seen for request in careful.consent_requests}
    assert stated == {"alpha": 1, "bravo": 0}
    assert set(marks(careful)) == {"bravo"}
    assert set(marks(world(granted, RADAR, TRUCK, CIVILIAN).fly("naive"))) == {"alpha", "bravo"}


def test_it_asks_when_the_operator_can_hear_it() -> None:
    """Found while the link is down, asked when it is up again, and marked then."""
    mission = world({"alpha": (True, 4.0), "bravo": (True, 4.0)}, link_down=(24.0, 50.0)).fly("naive")
    requests = {request.intelligence_id: request.time_s for request in mission.consent_requests}
    assert 50.0 <= requests["alpha"] < 50.2
    assert marks(mission)["alpha"] > 54.0
    assert set(marks(mission)) == {"alpha", "bravo"}


def test_an_order_to_mark_is_consent_to_that_mark() -> None:
    """Ordered to mark one target, it marks that one at once, and still waits for leave to mark the other."""
    order = order_document("mark-it", "mark", "alpha")
    mission = world({}, orders_at={50.0: order}).fly("naive")
    assert marks(mission) == {"alpha": pytest.approx(50.0)}


def test_without_the_rule_nobody_is_asked() -> None:
    """As before: marked in the first report."""
    mission = World([RADAR, TRUCK], {0.0: BOTH}).fly("naive")
    assert not mission.consent_requests
    assert all(report.mark for report in mission.reports)
    assert not mission.decisions_to("ask_consent")
