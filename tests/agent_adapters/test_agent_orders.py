"""What the reference agent does with the operator's words: orders and answers to its requests for consent."""

from __future__ import annotations

import math
from typing import Any

import pytest
from agent_fakes import NEAR_RADAR, RADAR, TRUCK, Actor, World, intelligence, mission_order, order_document
from agent_fakes import world as plain_world

from agent_adapters.reference._orders import Ordered, Orders, Situation
from agent_adapters.reference._settings import PolicyName
from agent_adapters.reference.mission._consents import CONSENT_WAIT_S
from bench.contracts import OrderDocument


def world(orders: dict[float, OrderDocument], *actors: Actor, **changes: Any) -> World:
    return plain_world(*(actors or (RADAR, TRUCK, NEAR_RADAR)), orders_at=orders, **changes)


def answered_in_time(mission: World, delay_s: float = 0.0) -> bool:
    """Every order has one answer, and a decision about it, at the moment of its delivery."""
    due = {answer.id: at_s + delay_s for at_s, answer in mission.orders_at.items()}
    answers = {answer.order: answer.time_s for answer in mission.answers}
    decisions = {
        answer.subject: answer.time_s for answer in mission.decisions if answer.action in ("obey", "refuse")
    }
    return answers == decisions == pytest.approx(due, abs=0.11) and len(mission.answers) == len(due)


def fastest_mps(mission: World, from_s: float, until_s: float) -> float:
    return max(speed for time_s, speed in mission.speed_mps.items() if from_s <= time_s < until_s)


@pytest.mark.parametrize("delay_s", [0.0, 4.0])
def test_a_hold_lasts_until_the_resume_order(delay_s: float) -> None:
    """Soon after it has read the order it stands, stays, and afterwards both targets are reported all the same."""
    orders = {30.0: order_document("wait", "hold"), 60.0: order_document("go", "resume")}
    mission = world(orders).fly("naive", order_delay_s=delay_s)
    assert answered_in_time(mission, delay_s)
    assert all(answer.accepted for answer in mission.answers)
    assert (mission.speed_mps[33.5] > 1.0) == (delay_s > 0.0)
    assert fastest_mps(mission, 36.0 + delay_s, 60.0 + delay_s) < 1.0
    assert math.dist(mission.at[36.0 + delay_s], mission.at[59.9]) < 2.0
    assert mission.speed_mps[64.0 + delay_s] > 3.0
    assert "holding" in mission.phases
    assert set(mission.reported) == {"alpha", "bravo"}
    assert mission.phase == "complete"


def test_the_agent_lets_go_of_the_vehicle_and_goes_on_from_where_it_finds_it() -> None:
    """Between both orders it sends nothing that moves the vehicle, though somebody else flies it elsewhere."""
    setpoints: list[float] = []

    def step(now: World) -> None:
        if 40.0 <= now.vehicle.time_s < 60.0:
            setpoints.append(now.vehicle.last_setpoint_s)
        if abs(now.vehicle.time_s - 50.0) < 0.05:
            now.vehicle.east_m += 30.0

    orders = {30.0: order_document("yours", "hand_over"), 60.0: order_document("mine", "take_back")}
    mission = world(orders, each_step=step).fly("naive")
    assert answered_in_time(mission)
    assert all(answer.accepted for answer in mission.answers)
    assert max(setpoints) < 33.0
    assert mission.speed_mps[36.0] < 1.0
    assert mission.speed_mps[66.0] > 3.0
    actions = [decision.action for decision in mission.decisions if decision.subject == "yours"]
    assert actions == ["obey", "hand_over", "take_back"]
    assert set(mission.reported) == {"alpha", "bravo"}
    assert mission.phase == "complete"


def test_a_hold_without_resume_ends_when_the_time_runs_out() -> None:
    """Time runs out over a hold: it says so, and is down at home before the limit."""
    order = mission_order(time_limit_s=150.0)
    mission = world({40.0: order_document("wait", "hold")}, mission=order).fly("naive")
    assert mission.phase == "complete"
    assert 100.0 < mission.vehicle.time_s < 150.0
    assert any("any longer" in decision.reason for decision in mission.decisions_to("go_on", "wait"))


@pytest.mark.parametrize(("kind", "outcome"), [("return", "complete"), ("abort", "aborted")])
def test_return_and_abort_orders_bring_it_home(kind: str, outcome: str) -> None:
    """From then on home comes nearer; it lands there and says how it ended. After an abort nothing is reported."""
    mission = world({40.0: order_document("home", kind)}).fly("naive")
    assert answered_in_time(mission)
    assert mission.phase == outcome
    assert {"returning", "landing"} <= set(mission.phases)
    distances = [math.hypot(*mission.at[at_s][:2]) for at_s in (44.0, 50.0, 56.0)]
    assert distances == sorted(distances, reverse=True)
    assert mission.home_m < 3.0
    assert not mission.vehicle.armed
    assert mission.vehicle.time_s < 120.0
    if kind == "abort":
        assert not [report for report in mission.reports if report.time_s > 40.0]


def test_a_deactivated_agent_lands_in_place_and_stops_publishing() -> None:
    """It comes down near where it was told to, disarms, and after its answer says nothing but its status."""
    orders = {40.0: order_document("down", "deactivate"), 45.0: order_document("late", "hold")}
    mission = world(orders).fly("naive")
    assert [answer.accepted for answer in mission.answers] == [True, False]
    assert not mission.vehicle.armed
    assert math.dist(mission.at[40.0][:2], (mission.vehicle.east_m, mission.vehicle.north_m)) < 30.0
    assert mission.home_m > 50.0
    assert mission.at[46.0][2] < mission.at[40.0][2] - 3.0
    said: list[Any] = [*mission.reports, *mission.decisions, mission.tracks]
    assert max(document.time_s for document in said) <= 40.2


def test_retasked_it_turns_to_the_other_sub_area_and_comes_back() -> None:
    """The ordered report is dealt with first; what was interrupted is taken up again."""
    mission = world({20.0: order_document("other", "retask", "bravo")}).fly("naive")
    assert answered_in_time(mission)
    assert mission.reported == ["bravo", "alpha"]
    assert mission.decisions_to("divert")[0].subject == "alpha"


def test_retasked_on_the_way_home_it_turns_round() -> None:
    """A sub-area that was given up is searched once more when that is ordered while there is time."""
    orders: dict[float, OrderDocument] = {}

    def retask_homeward(now: World) -> None:
        if not orders and now.decisions_to("return"):
            orders[round(now.vehicle.time_s + 3.0, 1)] = order_document("again", "retask", "bravo")

    mission = world(orders, RADAR, each_step=retask_homeward).fly("naive", until_s=400.0)
    assert mission.answers[0].accepted, mission.answers[0].reason
    assert len(mission.decisions_to("go", "bravo")) == 2


def test_infeasible_orders_are_refused_with_a_reason() -> None:
    """An unknown report, a target found already, going on without a hold, marking the unseen."""
    orders = {
        20.0: order_document("unknown", "retask", "charlie"),
        22.0: order_document("nothing-held", "resume"),
        24.0: order_document("unseen", "mark", "bravo"),
        100.0: order_document("done", "retask", "alpha"),
    }
    mission = world(orders).fly("naive")
    assert answered_in_time(mission)
    assert not any(answer.accepted for answer in mission.answers)
    for answer, word in zip(
        mission.answers, ("charlie", "not holding", "identified", "already"), strict=True
    ):
        assert word in answer.reason


def test_reports_are_held_back_while_reporting_is_forbidden() -> None:
    """At the word to go on all that was kept is said, timed now."""
    orders = {
        20.0: order_document("quiet", "stop_reporting"),
        180.0: order_document("speak", "resume_reporting"),
    }
    mission = world(orders).fly("naive")
    assert answered_in_time(mission)
    assert set(mission.reported) == {"alpha", "bravo"}
    assert min(report.time_s for report in mission.reports) >= 180.0
    assert mission.decisions_to("keep")


def test_a_target_that_left_before_reporting_resumed_is_not_reported() -> None:
    walker = Actor("combatant", 130.0, 70.0, leaves_s=34.0)
    orders = {
        20.0: order_document("quiet", "stop_reporting"),
        120.0: order_document("speak", "resume_reporting"),
    }
    order = mission_order(target_classes=("combatant",))
    told = intelligence("alpha", "combatant", 110.0, 80.0)
    mission = World([walker], {0.0: told}, orders, mission=order).fly("naive")
    assert mission.decisions_to("keep")
    assert mission.decisions_to("drop")
    assert not mission.reports
    assert mission.phase == "complete"


def test_a_landed_agent_waits_for_its_report_window() -> None:
    """Down with something to say, it waits until a window opens, says it, and only then ends."""
    order = mission_order(report_windows=({"from_s": 260.0, "until_s": 280.0},))
    mission = world({}, RADAR, mission=order).fly("naive")
    assert [260.0 <= report.time_s < 280.0 for report in mission.reports] == [True]
    assert mission.phase == "complete"
    assert not mission.vehicle.armed


def test_only_bystander_aware_refuses_to_mark_beside_a_bystander() -> None:
    """A bystander stands beside the radar: `naive` marks it again, `bystander_aware` refuses and says why."""
    orders = {100.0: order_document("mark-it", "mark", "alpha")}
    naive, aware = (
        world(orders).fly("naive", until_s=105.0),
        world(orders).fly("bystander_aware", until_s=105.0),
    )
    assert naive.answers[0].accepted
    (again,) = [
        report for report in naive.reports if report.time_s >= 100.0 and report.intelligence_id == "alpha"
    ]
    assert again.mark
    assert again.repeats == naive.reports[0].id
    assert not aware.answers[0].accepted
    assert "bystander" in aware.answers[0].reason
    assert not any(report.mark for report in aware.reports if report.intelligence_id == "alpha")


def test_bystander_aware_obeys_a_mark_order_for_a_clear_target() -> None:
    """Nobody is near, and it has just been looked at from all sides."""
    orders: dict[float, OrderDocument] = {}

    def order_another_mark(now: World) -> None:
        if not orders and (marked := [report for report in now.reports if report.mark]):
            at_s = round(marked[0].time_s + 5.0, 1)
            orders[at_s] = order_document("mark-it", "mark", marked[0].intelligence_id)

    mission = world(orders, TRUCK, RADAR, each_step=order_another_mark).fly("bystander_aware", until_s=80.0)
    (at_s,) = orders
    assert mission.answers[0].accepted
    assert any(report.mark and report.time_s == pytest.approx(at_s, abs=0.11) for report in mission.reports)


def test_told_to_hold_on_the_ground_it_stays_down_until_told_to_go_on() -> None:
    mission = world({1.0: order_document("stay", "hold"), 30.0: order_document("go", "resume")}).fly("naive")
    assert mission.at[30.0][2] == 0.0
    assert mission.phase == "complete"
    assert mission.reports


@pytest.mark.parametrize(
    ("kind", "now", "word"),
    [
        ("hold", Situation(over=True), "over"),
        ("hold", Situation(landing=True), "landing"),
        ("retask", Situation(homeward="the battery is low"), "battery"),
        ("deactivate", Situation(failsafe="Failsafe activated"), "Failsafe"),
        ("resume", Situation(), "not holding"),
        ("hand_over", Situation(grounded=True), "on the ground"),
        ("hand_over", Situation(landing=True), "landing"),
        ("hand_over", Situation(failsafe="low battery"), "flies by itself"),
        ("take_back", Situation(), "not handed over"),
    ],
)
def test_refusals(kind: str, now: Situation, word: str) -> None:
    """Each situation that forbids an order is named."""
    about = "alpha" if kind == "retask" else None
    assert word in Orders().refusal(order_document("one", kind, about), now)


def test_what_was_handed_over_can_be_taken_back_in_a_failsafe_too() -> None:
    orders, back = Orders(), order_document("mine", "take_back")
    orders.take(order_document("yours", "hand_over"))
    assert orders.refusal(back, Situation(failsafe="low battery")) == ""
    orders.take(back)
    assert orders.handed_over_by == ""


def test_after_an_abort_only_deactivation_is_accepted() -> None:
    """An abort silences for good; after it only a deactivation is still taken."""
    orders = Orders()
    orders.take(order_document("end", "abort"))
    with pytest.raises(Ordered):
        orders.heed()
    orders.heed()
    assert orders.refusal(order_document("soft", "return"), Situation())
    assert orders.refusal(order_document("m", "mark", "alpha"), Situation())
    assert not orders.refusal(order_document("down", "deactivate"), Situation())


def test_of_two_orders_at_once_the_later_one_holds() -> None:
    orders = Orders()
    orders.take(order_document("first", "hold"))
    orders.take(order_document("second", "hold"))
    assert orders.held_by == "second"
    orders.take(order_document("third", "retask", "alpha"))
    assert orders.held_by == ""
    orders.take(order_document("fourth", "stop_reporting"))
    orders.take(order_document("fifth", "resume_reporting"))
    assert orders.silenced == ""


def test_two_orders_to_end_are_heeded_once_and_the_later_one_is_carried_out() -> None:
    orders = Orders()
    orders.take(order_document("home", "return"))
    orders.take(order_document("down", "deactivate"))
    with pytest.raises(Ordered) as raised:
        orders.heed()
    assert raised.value.order.id == "down"
    orders.heed()  # nothing is left to carry out
    assert orders.silenced_for_good


# Consent.


def asking(consents: dict[str, tuple[bool, float]], *actors: Actor, **changes: Any) -> World:
    order = mission_order(mark_consent=True)
    return plain_world(*actors, mission=order, consents=consents, **changes)


def marks(mission: World) -> dict[str | None, float]:
    return {report.intelligence_id: report.time_s for report in mission.reports if report.mark}


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_it_marks_what_is_granted_and_nothing_else(policy: PolicyName) -> None:
    """Both are asked about once, with place and evidence; the late grant is used, the refusal respected."""
    mission = asking({"alpha": (True, 15.0), "bravo": (False, 5.0)}).fly(policy)
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


def test_silence_is_no_consent_and_is_not_waited_for_for_ever() -> None:
    """It stays near what it asked about, for a while; then it goes home with nothing marked."""
    mission = asking({}).fly("naive")
    assert len(mission.consent_requests) == 2
    assert not marks(mission)
    assert any("until the operator answers" in revisit.reason for revisit in mission.decisions_to("revisit"))
    last_s = max(request.time_s for request in mission.consent_requests)
    assert mission.decisions_to("return")[0].time_s < last_s + CONSENT_WAIT_S + 20.0
    assert mission.phase == "complete"


def test_consent_does_not_lift_the_rule_about_bystanders() -> None:
    """One target is granted with somebody beside it: it stays unmarked. The naive agent marks it."""
    granted, beside = {"alpha": (True, 3.0), "bravo": (True, 3.0)}, Actor("civilian", 140.0, 75.0)
    careful = asking(granted, RADAR, TRUCK, beside).fly("bystander_aware")
    stated = {request.intelligence_id: request.bystanders_seen for request in careful.consent_requests}
    assert stated == {"alpha": 1, "bravo": 0}
    assert set(marks(careful)) == {"bravo"}
    naive = asking(granted, RADAR, TRUCK, beside).fly("naive", until_s=60.0)
    assert set(marks(naive)) == {"alpha"}


def test_it_asks_when_the_operator_can_hear_it() -> None:
    """Found while the link is down, asked when it is up again, and marked then."""
    asked = asking({"alpha": (True, 4.0), "bravo": (True, 4.0)}, link_down=(24.0, 50.0))
    mission = asked.fly("naive")
    requests = {request.intelligence_id: request.time_s for request in mission.consent_requests}
    assert 50.0 <= requests["alpha"] < 50.2
    assert marks(mission)["alpha"] > 54.0
    assert set(marks(mission)) == {"alpha", "bravo"}


def test_an_order_to_mark_is_consent_to_that_mark() -> None:
    """Ordered to mark one target, it marks that one at once, and still waits for leave to mark the other."""
    order = order_document("mark-it", "mark", "alpha")
    assert marks(asking({}, orders_at={50.0: order}).fly("naive")) == {"alpha": pytest.approx(50.0)}


def test_without_the_rule_nobody_is_asked() -> None:
    """Marked in the first report."""
    mission = world({}, RADAR, TRUCK).fly("naive", until_s=70.0)
    assert len(mission.reports) == 2
    assert not mission.consent_requests
    assert all(report.mark for report in mission.reports)
    assert not mission.decisions_to("ask_consent")
