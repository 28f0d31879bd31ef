"""Coming down among people: wait until they have gone, or land a little beside them."""

from __future__ import annotations

import math

import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference.flight._landing import CLEAR_M, clearest, room_m

TWO_AT_HOME = ((3.0, 2.0), (-4.0, 1.0))


def landing_world(
    leave_s: float = math.inf, time_limit_s: float = 300.0, *, at_home: tuple[tuple[float, float], ...]
) -> World:
    """A target near home, and people at home; notes how near the nearest is below five metres."""
    people = [Actor("civilian", *place, leaves_s=leave_s) for place in at_home]
    world = World(
        [Actor("mobile_radar", 100.0, 20.0), *people],
        {0.0: intelligence("alpha", "mobile_radar", 95.0, 15.0, uncertainty_m=30.0)},
        mission=mission_order(time_limit_s=time_limit_s),
    )
    nearest_m.clear()

    def note(now: World) -> None:
        vehicle = now.vehicle
        if vehicle.armed and vehicle.time_s > 40.0 and 0.1 < vehicle.height_m < 5.0:
            here = (vehicle.east_m, vehicle.north_m)
            nearest_m.extend(
                math.dist(here, (p.east_m, p.north_m)) for p in people if vehicle.time_s < p.leaves_s
            )

    world.each_step = note
    return world


nearest_m: list[float] = []


def home_m(world: World) -> float:
    return math.hypot(world.vehicle.east_m, world.vehicle.north_m)


def test_it_waits_until_two_people_have_left_the_landing_place() -> None:
    plain = landing_world(at_home=()).fly("bystander_aware")
    leave_s = plain.vehicle.time_s - 8.0
    world = landing_world(leave_s, at_home=TWO_AT_HOME).fly("bystander_aware")
    assert world.decisions_to("wait")
    assert not world.decisions_to("land_beside")
    assert nearest_m == []
    assert home_m(world) < 2.5
    assert world.phase == "complete"


def test_it_lands_beside_two_people_who_stay() -> None:
    world = landing_world(at_home=TWO_AT_HOME).fly("bystander_aware")
    assert world.decisions_to("land_beside")
    assert min(nearest_m) > 10.0
    assert home_m(world) < 20.0
    assert world.phase == "complete"


def test_without_time_it_lands_beside_them_at_once() -> None:
    world = landing_world(at_home=TWO_AT_HOME, time_limit_s=110.0).fly("bystander_aware")
    assert not world.decisions_to("wait")
    assert min(nearest_m) > 10.0
    assert world.phase == "complete"
    assert world.vehicle.time_s < 110.0


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_an_empty_landing_place_costs_no_wait(policy: str) -> None:
    world = landing_world(at_home=((40.0, 0.0), (0.0, -30.0))).fly(policy)  # type: ignore[arg-type]
    assert not world.decisions_to("wait")
    assert home_m(world) < 2.5


def test_the_naive_agent_does_not_think_of_people_at_home() -> None:
    world = landing_world(at_home=TWO_AT_HOME).fly("naive")
    assert min(nearest_m) < 5.0
    assert home_m(world) < 2.5


def test_the_clearest_place_is_home_where_home_is_clear() -> None:
    """Else the nearest with the most room; among many people it is as far from them as it gets."""
    assert clearest((5.0, 5.0), [(40.0, 0.0)]) == (5.0, 5.0)
    east, north = clearest((0.0, 0.0), [(4.0, 0.0), (-2.0, 3.0)])
    assert room_m((east, north), [(4.0, 0.0), (-2.0, 3.0)]) == pytest.approx(CLEAR_M)
    assert math.hypot(east, north) < 15.5
    ring = [(8.0 * math.sin(k), 8.0 * math.cos(k)) for k in range(12)]
    assert room_m(clearest((0.0, 0.0), ring), ring) >= room_m((0.0, 0.0), ring)
