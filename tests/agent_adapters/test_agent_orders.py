"""What the reference agent does with orders: each is answered at once, carried out or refused with a reason."""

from __future__ import annotations

import math

import pytest
from agent_fakes import Actor, World, intelligence, order, ordered

from agent_adapters.reference._orders import Ordered, Orders, Situation
from agent_adapters.reference._settings import PolicyName
from bench.contracts import OrderDocument

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
NEAR_RADAR = Actor("civilian", 140.0, 90.0)
BOTH = (intelligence("alpha", "mobile_radar", 110.0, 80.0), intelligence("bravo", "military_vehicle", -80.0, 110.0, 2))


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


def answered_in_time(flown: World) -> bool:
    """Every order has one answer, and a decision about it, at the moment of its delivery."""
    due = {one.id: at_s for at_s, one in flown.orders_at.items()}
    answers = {one.order: one.time_s for one in flown.answers}
    decisions = {one.subject: one.time_s for one in flown.decisions if one.action in ("obey", "refuse")}
    return answers == decisions == pytest.approx(due, abs=0.11) and len(flown.answers) == len(due)


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_it_holds_until_told_to_go_on_and_then_goes_on(policy: PolicyName) -> None:
    """Soon after the order it stands, stays, and afterwards both targets are reported all the same."""
    trail = Trail()
    flown = world({30.0: ordered("wait", "hold"), 60.0: ordered("go", "resume")}, each_beat=trail).fly(policy)
    assert answered_in_time(flown)
    assert all(one.accepted for one in flown.answers)
    assert max(trail.speed_mps[round(30.0 + k / 10, 1)] for k in range(60, 300)) < 1.0
    assert math.dist(trail.at[36.0], trail.at[59.9]) < 2.0
    assert trail.speed_mps[64.0] > 3.0
    assert "holding" in flown.phases
    assert {report.intelligence_id for report in flown.reports} == {"alpha", "bravo"}
    assert flown.phase == "complete"


def test_a_hold_that_is_never_lifted_ends_when_it_must_go_home() -> None:
    """Time runs out over a hold: it says so, and is down at home before the limit."""
    waiting = world({40.0: ordered("wait", "hold")})
    waiting.mission = order(time_limit_s=150.0)
    flown = waiting.fly("naive")
    assert flown.phase == "complete"
    assert 100.0 < flown.vehicle.time_s < 150.0
    assert any(one.subject == "wait" and "any longer" in one.reason for one in flown.decided("go_on"))


@pytest.mark.parametrize(("kind", "outcome"), [("return", "complete"), ("abort", "aborted")])
def test_it_flies_home_when_told_to(kind: str, outcome: str) -> None:
    """From then on home comes nearer; it lands there and says how it ended. After an abort nothing is reported."""
    trail = Trail()
    flown = world({40.0: ordered("home", kind)}, each_beat=trail).fly("naive")
    assert answered_in_time(flown)
    assert flown.phase == outcome
    assert {"returning", "landing"} <= set(flown.phases)
    distances = [math.hypot(*trail.at[at_s][:2]) for at_s in (44.0, 50.0, 56.0)]
    assert distances == sorted(distances, reverse=True)
    assert math.hypot(flown.vehicle.east_m, flown.vehicle.north_m) < 3.0
    assert not flown.vehicle.armed
    assert flown.vehicle.time_s < 120.0
    if kind == "abort":
        assert not [report for report in flown.reports if report.time_s > 40.0]


def test_deactivated_it_lands_where_it_is_and_falls_silent() -> None:
    """It comes down near where it was told to, disarms, and after its answer says nothing but its status."""
    trail = Trail()
    flown = world({40.0: ordered("down", "deactivate"), 45.0: ordered("late", "hold")}, each_beat=trail).fly("naive")
    assert flown.answers[0].accepted
    assert not flown.answers[1].accepted
    assert not flown.vehicle.armed
    assert math.dist(trail.at[40.0][:2], (flown.vehicle.east_m, flown.vehicle.north_m)) < 30.0
    assert math.hypot(flown.vehicle.east_m, flown.vehicle.north_m) > 50.0
    assert trail.at[46.0][2] < trail.at[40.0][2] - 3.0
    assert not [one for one in (*flown.reports, *flown.decisions) if one.time_s > 40.2]  # type: ignore[attr-defined]
    assert flown.tracks.time_s <= 40.2


def test_retasked_it_turns_to_the_other_sub_area_and_comes_back() -> None:
    """The ordered report is dealt with first; what was interrupted is taken up again."""
    flown = world({20.0: ordered("other", "retask", "bravo")}).fly("naive")
    assert answered_in_time(flown)
    assert [report.intelligence_id for report in flown.reports] == ["bravo", "alpha"]
    assert flown.decided("divert")[0].subject == "alpha"


def test_retasked_on_the_way_home_it_turns_round() -> None:
    """A sub-area that was given up is searched once more when that is ordered while there is time."""
    hidden = world({}, Actor("mobile_radar", 130.0, 70.0)).fly("naive")
    home_s = hidden.decided("return")[0].time_s
    flown = world({round(home_s + 3.0, 1): ordered("again", "retask", "bravo")}, RADAR).fly("naive", until_s=400.0)
    assert flown.answers[0].accepted, flown.answers[0].reason
    assert len([one for one in flown.decided("go") if one.subject == "bravo"]) == 2


def test_what_cannot_be_done_is_refused_with_a_reason() -> None:
    """An unknown report, a target that is found already, going on without a hold, marking what nobody has seen."""
    told = {
        20.0: ordered("unknown", "retask", "charlie"),
        22.0: ordered("nothing-held", "resume"),
        24.0: ordered("unseen", "mark", "bravo"),
        100.0: ordered("done", "retask", "alpha"),
    }
    flown = world(told).fly("naive")
    assert answered_in_time(flown)
    assert not any(one.accepted for one in flown.answers)
    reasons = {one.order: one.reason for one in flown.answers}
    assert "charlie" in reasons["unknown"]
    assert "not holding" in reasons["nothing-held"]
    assert "identified" in reasons["unseen"]
    assert "already" in reasons["done"]


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_what_it_may_not_report_it_keeps_and_says_later(policy: PolicyName) -> None:
    """Nothing is reported while that is forbidden; at the word to go on everything kept is said, timed now."""
    told = {20.0: ordered("quiet", "stop_reporting"), 180.0: ordered("speak", "resume_reporting")}
    flown = world(told).fly(policy)
    assert answered_in_time(flown)
    assert {report.intelligence_id for report in flown.reports} == {"alpha", "bravo"}
    assert min(report.time_s for report in flown.reports) >= 180.0
    assert flown.decided("keep")


def test_it_waits_on_the_ground_for_leave_to_report() -> None:
    """Down with something to say, it waits until a window opens, says it, and only then ends."""
    quiet = world({}, RADAR)
    quiet.mission = order(report_windows=({"from_s": 260.0, "until_s": 280.0},))
    flown = quiet.fly("naive")
    assert [260.0 <= report.time_s < 280.0 for report in flown.reports] == [True]
    assert flown.phase == "complete"
    assert not flown.vehicle.armed


def test_ordered_to_mark_only_the_careful_one_thinks_of_bystanders() -> None:
    """A bystander stands beside the radar: `naive` marks it again, `bystander_aware` refuses and says why."""
    told = {100.0: ordered("mark-it", "mark", "alpha")}
    naive, aware = world(told).fly("naive"), world(told).fly("bystander_aware")
    assert naive.answers[0].accepted
    (again,) = [report for report in naive.reports if report.time_s >= 100.0 and report.intelligence_id == "alpha"]
    assert again.mark
    assert again.repeats == naive.reports[0].id
    assert not aware.answers[0].accepted
    assert "bystander" in aware.answers[0].reason
    assert not any(report.mark for report in aware.reports if report.intelligence_id == "alpha")


def test_ordered_to_mark_what_is_clear_the_careful_one_does() -> None:
    """Nobody is near, and it has just been looked at from all sides."""
    shown = world({}, TRUCK, RADAR).fly("bystander_aware")
    marked_s = next(report.time_s for report in shown.reports if report.mark)
    at_s = round(marked_s + 5.0, 1)
    about = next(report.intelligence_id for report in shown.reports if report.mark)
    flown = world({at_s: ordered("mark-it", "mark", about)}, TRUCK, RADAR).fly("bystander_aware")
    assert flown.answers[0].accepted
    assert any(report.mark and report.time_s == pytest.approx(at_s, abs=0.11) for report in flown.reports)


def test_orders_on_the_ground() -> None:
    """Told to hold before takeoff it stays down until told to go on; told to abort, it never flies."""
    trail = Trail()
    flown = world({1.0: ordered("stay", "hold"), 30.0: ordered("go", "resume")}, each_beat=trail).fly("naive")
    assert trail.at[30.0][2] == 0.0
    assert flown.phase == "complete"
    assert flown.reports
    never = world({1.0: ordered("end", "abort")}).fly("naive")
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
    assert word in Orders().refusal(ordered("one", kind, about), now)


def test_after_an_abort_nothing_is_marked_and_no_return_softens_it() -> None:
    """An abort silences for good; after it only a deactivation is still taken."""
    orders = Orders()
    orders.take(ordered("end", "abort"))
    with pytest.raises(Ordered):
        orders.heed()
    orders.heed()
    assert orders.refusal(ordered("soft", "return"), Situation())
    assert orders.refusal(ordered("m", "mark", "alpha"), Situation())
    assert not orders.refusal(ordered("down", "deactivate"), Situation())


def test_whoever_walked_off_before_it_could_be_said_is_not_reported() -> None:
    """A combatant is found while reports are stopped and leaves under the camera: nothing is said of them later."""
    walker = Actor("combatant", 130.0, 70.0, gone_s=34.0)
    told = {20.0: ordered("quiet", "stop_reporting"), 120.0: ordered("speak", "resume_reporting")}
    lone = World([walker], {0.0: intelligence("alpha", "combatant", 110.0, 80.0)}, told)
    lone.mission = order(target_classes=("combatant",))
    flown = lone.fly("naive")
    assert flown.decided("keep")
    assert flown.decided("drop")
    assert not flown.reports
    assert flown.phase == "complete"
