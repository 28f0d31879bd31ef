"""Intelligence that comes in flight goes before second looks."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from agent_fakes import Actor, World, intelligence, mission_order, order_document

RADAR = Actor("mobile_radar", 120.0, 10.0)
TRUCK = Actor("military_vehicle", -120.0, 120.0)
PEOPLE = [Actor("civilian", 130.0, 25.0), Actor("civilian", 110.0, 0.0)]
LATE = intelligence("late", "military_vehicle", -115.0, 115.0, priority=2, uncertainty_m=40.0)


def flight(actors: list[Actor], late_s: float | None) -> World:
    radar = intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=40.0)
    world = World(actors, {0.0: radar}, mission=mission_order(time_limit_s=400.0))
    if late_s is not None:
        world.reports_at[late_s] = LATE
    return world.fly("bystander_aware", until_s=420.0)


def moment(world: World, action: str, subject: str) -> float:
    return next(
        round(decision.time_s, 1) for decision in world.decisions_to(action) if decision.subject == subject
    )


def test_a_revisit_is_left_for_late_intelligence_and_made_up_for() -> None:
    """Two people stand by the target: the mark is withheld, and looked at again after the late report is served."""
    revisit_s = moment(flight([RADAR, *PEOPLE], None), "revisit", "alpha")
    late_s = round(revisit_s + 6.0, 1)
    world = flight([RADAR, TRUCK, *PEOPLE], late_s)
    assert moment(world, "move_on", "alpha") - late_s < 1.0
    assert moment(world, "go", "late") - late_s < 1.0
    assert {report.intelligence_id for report in world.reports} == {"alpha", "late"}
    assert len(world.decisions_to("revisit")) == 2
    assert world.phase == "complete"


@pytest.mark.parametrize("after_s", [5.0, 12.0])
def test_a_second_pass_is_left_for_late_intelligence(after_s: float) -> None:
    """Nothing stands where the first report says: the second pass gives way."""
    quiet = flight([TRUCK], None)
    second_s = round(quiet.decisions_to("search")[1].time_s, 1)
    late_s = round(second_s + after_s, 1)
    world = flight([TRUCK], late_s)
    assert moment(world, "give_up", "alpha") - late_s < 1.0
    assert moment(world, "go", "late") - late_s < 1.0
    assert [report.intelligence_id for report in world.reports] == ["late"]
    assert math.hypot(world.vehicle.east_m, world.vehicle.north_m) < 3.0


@pytest.mark.parametrize("deadline_s", [None, 400.0])
def test_what_was_seen_during_the_flight_is_served_while_it_is_fresh(deadline_s: float | None) -> None:
    """Two targets wait after the first: the one seen lately ends the rest of the first search, the other does not."""

    def left_s(observed_s: float) -> float:
        """When it turns to the second target."""
        radar = intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=90.0)
        order = mission_order(time_limit_s=600.0, report_deadline_s=deadline_s)
        late = replace(LATE, observed_s=observed_s)
        world = World([RADAR, TRUCK], {0.0: radar, 5.0: late}, mission=order).fly("naive", until_s=260.0)
        return moment(world, "go", "late") - moment(world, "report", "alpha")

    fresh_s, old_s = left_s(4.0), left_s(-30.0)
    assert fresh_s < old_s - 10.0
    # It is there before 120 s have passed since it was told: 258 m at 8 m/s, and a search of 15 s.
    assert fresh_s + 258.0 / 8.0 + 15.0 < 5.0 + 120.0


@pytest.mark.parametrize("people", [PEOPLE, []])
def test_what_a_broken_off_search_finds_is_reported_unless_it_would_be_marked(people: list[Actor]) -> None:
    """Ordered away just before the target is identified, it goes on seeing it for a moment."""
    both = (
        intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=60.0),
        replace(LATE, id="bravo"),
    )
    actors = [RADAR, TRUCK, *people]
    found_s = moment(World(actors, {0.0: both}).fly("bystander_aware", until_s=60.0), "report", "alpha")
    orders = {round(found_s - 0.4, 1): order_document("other", "retask", "bravo")}

    world = World(actors, {0.0: both}, orders).fly("bystander_aware")

    visits = [decision.subject for decision in world.decisions_to("go")]
    reported_s = moment(world, "report", "alpha")
    if people:
        assert visits == ["alpha", "bravo"]
        assert found_s <= reported_s < moment(world, "report", "bravo")
        assert [report.mark for report in world.reports if report.intelligence_id == "alpha"] == [False]
    else:
        assert visits == ["alpha", "bravo", "alpha"]
        assert reported_s > moment(world, "report", "bravo")
    assert {report.intelligence_id for report in world.reports} == {"alpha", "bravo"}
