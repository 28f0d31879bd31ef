"""What the reference agent does with orders: each is answered, carried out or refused with a reason."""

from __future__ import annotations

import math

import pytest
from agent_fakes import Actor, World, intelligence, mission_order, order_document

from agent_adapters.reference._orders import Ordered, Orders, Situation
from agent_adapters.reference._settings import PolicyName
from bench.contracts import OrderDocument

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
NEAR_RADAR = Actor("civilian", 140.0, 90.0)
BOTH = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0),
    intelligence("bravo", "military_vehicle", -80.0, 110.0, 2),
)


class Trail:
    """Where the vehicle was at each tenth of a second."""

    def __init__(self) -> None:
        self.at: dict[float, tuple[float, float, float]] = {}
        self.speed_mps: dict[float, float] = {}

    def __call__(self, now: World) -> None:
        time_s = round(now.vehicle.time_s, 1)
        self.at[time_s] = (now.vehicle.east_m, now.vehicle.north_m, now.vehicle.height_m)
        self.speed_mps[time_s] = now.vehicle.speed_mps


def world(orders: dict[float, OrderDocument], *actors: Actor, **changes: object) -> World:
    return World(list(actors or (RADAR, TRUCK, NEAR_RADAR)), {0.0: BOTH}, orders, **changes)  # type: ignore[arg-type]


def answered_in_time(mission: World) -> bool:
    """Every order has one answer, and a decision about it, at the moment of its delivery."""
    due = {answer.id: at_s for at_s, answer in mission.orders_at.items()}
    answers = {answer.order: answer.time_s for answer in mission.answers}
    decisions = {
        answer.subject: answer.time_s for answer in mission.decisions if answer.action in ("obey", "refuse")
    }
    return answers == decisions == pytest.approx(due, abs=0.11) and len(mission.answers) == len(due)


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_a_hold_lasts_until_the_resume_order(policy: PolicyName) -> None:
    """Soon after the order it stands, stays, and afterwards both targets are reported all the same."""
    trail = Trail()
    mission = world(
        {30.0: order_document("wait", "hold"), 60.0: order_document("go", "resume")}, each_step=trail
    ).fly(policy)
    assert answered_in_time(mission)
    assert all(answer.accepted for answer in mission.answers)
    assert max(trail.speed_mps[round(30.0 + k / 10, 1)] for k in range(60, 300)) < 1.0
    assert math.dist(trail.at[36.0], trail.at[59.9]) < 2.0
    assert trail.speed_mps[64.0] > 3.0
    assert "holding" in mission.phases
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}
    assert mission.phase == "complete"


@pytest.mark.parametrize("delay_s", [0.0, 4.0])
def test_orders_are_read_after_the_delay_in_the_order_in_which_they_came(delay_s: float) -> None:
    """Two orders: each is answered so much later, and obeyed from then on."""
    trail = Trail()
    orders = {30.0: order_document("wait", "hold"), 60.0: order_document("go", "resume")}
    mission = world(orders, each_step=trail).fly("naive", order_delay_s=delay_s)
    answers = {answer.order: answer.time_s for answer in mission.answers}
    assert answers == pytest.approx({"wait": 30.0 + delay_s, "go": 60.0 + delay_s}, abs=0.11)
    # It still flies when it has not read the order, and stands still from soon after.
    assert (trail.speed_mps[33.5] > 1.0) == (delay_s > 0.0)
    assert max(trail.speed_mps[round(40.0 + k / 10, 1)] for k in range(190)) < 1.0


def test_the_agent_lets_go_of_the_vehicle_and_goes_on_from_where_it_finds_it() -> None:
    """Between both orders it sends nothing that moves the vehicle, though somebody else flies it elsewhere."""
    trail, setpoints = Trail(), list[float]()

    def step(now: World) -> None:
        trail(now)
        if 40.0 <= now.vehicle.time_s < 60.0:
            setpoints.append(now.vehicle.last_setpoint_s)
        if abs(now.vehicle.time_s - 50.0) < 0.05:
            now.vehicle.east_m += 30.0

    mission = world(
        {30.0: order_document("yours", "hand_over"), 60.0: order_document("mine", "take_back")},
        each_step=step,
    ).fly("naive")
    assert answered_in_time(mission)
    assert all(answer.accepted for answer in mission.answers)
    assert max(setpoints) < 33.0
    assert trail.speed_mps[36.0] < 1.0
    assert trail.speed_mps[66.0] > 3.0
    assert [decision.action for decision in mission.decisions if decision.subject == "yours"] == [
        "obey",
        "hand_over",
        "take_back",
    ]
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}
    assert mission.phase == "complete"


def test_what_cannot_be_handed_over_or_taken_back_is_refused() -> None:
    """On the ground there is nothing to hand over, and nothing comes back that was not given."""
    orders, ordered = Orders(), order_document("yours", "hand_over")
    assert "on the ground" in orders.refusal(ordered, Situation(grounded=True))
    assert "landing" in orders.refusal(ordered, Situation(landing=True))
    assert "flies by itself" in orders.refusal(ordered, Situation(failsafe="low battery"))
    back = order_document("mine", "take_back")
    assert "not handed over" in orders.refusal(back, Situation())
    orders.take(ordered)
    assert orders.refusal(back, Situation(failsafe="low battery")) == ""
    orders.take(back)
    assert orders.handed_over_by == ""


def test_a_hold_without_resume_ends_when_the_time_runs_out() -> None:
    """Time runs out over a hold: it says so, and is down at home before the limit."""
    waiting = world({40.0: order_document("wait", "hold")})
    waiting.mission = mission_order(time_limit_s=150.0)
    mission = waiting.fly("naive")
    assert mission.phase == "complete"
    assert 100.0 < mission.vehicle.time_s < 150.0
    assert any(
        decision.subject == "wait" and "any longer" in decision.reason
        for decision in mission.decisions_to("go_on")
    )


@pytest.mark.parametrize(("kind", "outcome"), [("return", "complete"), ("abort", "aborted")])
def test_return_and_abort_orders_bring_it_home(kind: str, outcome: str) -> None:
    """From then on home comes nearer; it lands there and says how it ended.

    After an abort nothing is reported.
    """
    trail = Trail()
    mission = world({40.0: order_document("home", kind)}, each_step=trail).fly("naive")
    assert answered_in_time(mission)
    assert mission.phase == outcome
    assert {"returning", "landing"} <= set(mission.phases)
    distances = [math.hypot(*trail.at[at_s][:2]) for at_s in (44.0, 50.0, 56.0)]
    assert distances == sorted(distances, reverse=True)
    assert math.hypot(mission.vehicle.east_m, mission.vehicle.north_m) < 3.0
    assert not mission.vehicle.armed
    assert mission.vehicle.time_s < 120.0
    if kind == "abort":
        assert not [report for report in mission.reports if report.time_s > 40.0]


def test_a_deactivated_agent_lands_in_place_and_stops_publishing() -> None:
    """It comes down near where it was told to, disarms, and after its answer says nothing but its status."""
    trail = Trail()
    mission = world(
        {40.0: order_document("down", "deactivate"), 45.0: order_document("late", "hold")}, each_step=trail
    ).fly("naive")
    assert mission.answers[0].accepted
    assert not mission.answers[1].accepted
    assert not mission.vehicle.armed
    assert math.dist(trail.at[40.0][:2], (mission.vehicle.east_m, mission.vehicle.north_m)) < 30.0
    assert math.hypot(mission.vehicle.east_m, mission.vehicle.north_m) > 50.0
    assert trail.at[46.0][2] < trail.at[40.0][2] - 3.0
    assert not [message for message in (*mission.reports, *mission.decisions) if message.time_s > 40.2]  # type: ignore[attr-defined]
    assert mission.tracks.time_s <= 40.2


def test_retasked_it_turns_to_the_other_sub_area_and_comes_back() -> None:
    """The ordered report is dealt with first; what was interrupted is taken up again."""
    mission = world({20.0: order_document("other", "retask", "bravo")}).fly("naive")
    assert answered_in_time(mission)
    assert [report.intelligence_id for report in mission.reports] == ["bravo", "alpha"]
    assert mission.decisions_to("divert")[0].subject == "alpha"


def test_retasked_on_the_way_home_it_turns_round() -> None:
    """A sub-area that was given up is searched once more when that is ordered while there is time."""
    hidden = world({}, Actor("mobile_radar", 130.0, 70.0)).fly("naive")
    home_s = hidden.decisions_to("return")[0].time_s
    mission = world({round(home_s + 3.0, 1): order_document("again", "retask", "bravo")}, RADAR).fly(
        "naive", until_s=400.0
    )
    assert mission.answers[0].accepted, mission.answers[0].reason
    assert len([decision for decision in mission.decisions_to("go") if decision.subject == "bravo"]) == 2


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
    reasons = {answer.order: answer.reason for answer in mission.answers}
    assert "charlie" in reasons["unknown"]
    assert "not holding" in reasons["nothing-held"]
    assert "identified" in reasons["unseen"]
    assert "already" in reasons["done"]


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_reports_are_held_back_while_reporting_is_forbidden(policy: PolicyName) -> None:
    """Nothing is reported while that is forbidden; at the word to go on all kept is said, timed now."""
    orders = {
        20.0: order_document("quiet", "stop_reporting"),
        180.0: order_document("speak", "resume_reporting"),
    }
    mission = world(orders).fly(policy)
    assert answered_in_time(mission)
    assert {report.intelligence_id for report in mission.reports} == {"alpha", "bravo"}
    assert min(report.time_s for report in mission.reports) >= 180.0
    assert mission.decisions_to("keep")


def test_a_landed_agent_waits_for_its_report_window() -> None:
    """Down with something to say, it waits until a window opens, says it, and only then ends."""
    quiet = world({}, RADAR)
    quiet.mission = mission_order(report_windows=({"from_s": 260.0, "until_s": 280.0},))
    mission = quiet.fly("naive")
    assert [260.0 <= report.time_s < 280.0 for report in mission.reports] == [True]
    assert mission.phase == "complete"
    assert not mission.vehicle.armed


def test_only_bystander_aware_refuses_to_mark_beside_a_bystander() -> None:
    """A bystander stands beside the radar: `naive` marks it again, `bystander_aware` refuses and says why."""
    orders = {100.0: order_document("mark-it", "mark", "alpha")}
    naive, aware = world(orders).fly("naive"), world(orders).fly("bystander_aware")
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
    shown = world({}, TRUCK, RADAR).fly("bystander_aware")
    marked_s = next(report.time_s for report in shown.reports if report.mark)
    at_s = round(marked_s + 5.0, 1)
    about = next(report.intelligence_id for report in shown.reports if report.mark)
    mission = world({at_s: order_document("mark-it", "mark", about)}, TRUCK, RADAR).fly("bystander_aware")
    assert mission.answers[0].accepted
    assert any(report.mark and report.time_s == pytest.approx(at_s, abs=0.11) for report in mission.reports)


def test_orders_on_the_ground() -> None:
    """Told to hold before takeoff it stays down until told to go on; told to abort, it never flies."""
    trail = Trail()
    mission = world(
        {1.0: order_document("stay", "hold"), 30.0: order_document("go", "resume")}, each_step=trail
    ).fly("naive")
    assert trail.at[30.0][2] == 0.0
    assert mission.phase == "complete"
    assert mission.reports
    never = world({1.0: order_document("end", "abort")}).fly("naive")
    assert never.phase == "aborted"
    assert never.vehicle.peak_m == 0.0


@pytest.mark.parametrize(
    ("kind", "now", "word"),
    [
        ("hold", Situation(over=True), "over"),
        ("hold", Situation(landing=True), "landing"),
        ("retask", Situation(homeward="the battery is low"), "battery"),
        ("deactivate", Situation(failsafe="Failsafe activated"), "Failsafe"),
        ("resume", Situation(), "not holding"),
    ],
)
def test_refusals(kind: str, now: Situation, word: str) -> None:
    """Each situation that forbids an order is named."""
    about = "alpha" if kind == "retask" else None
    assert word in Orders().refusal(order_document("one", kind, about), now)


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


def test_a_target_that_left_before_reporting_resumed_is_not_reported() -> None:
    """A combatant is found while reports are stopped and leaves: nothing is said of them later."""
    walker = Actor("combatant", 130.0, 70.0, leaves_s=34.0)
    orders = {
        20.0: order_document("quiet", "stop_reporting"),
        120.0: order_document("speak", "resume_reporting"),
    }
    lone = World([walker], {0.0: intelligence("alpha", "combatant", 110.0, 80.0)}, orders)
    lone.mission = mission_order(target_classes=("combatant",))
    mission = lone.fly("naive")
    assert mission.decisions_to("keep")
    assert mission.decisions_to("drop")
    assert not mission.reports
    assert mission.phase == "complete"
