"""The time that the reference agents reckon for the way home, what they fly, and how they come down among people."""

from __future__ import annotations

import math

import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference._settings import PolicyName
from agent_adapters.reference.flight._landing import CLEAR_M, clearest, room_m
from agent_adapters.reference.flight._limits import landing_s
from agent_adapters.reference.flight._paths import Place
from agent_adapters.reference.mission._planner import Planner
from vehicle_models.controller import PX4
from vehicle_models.controller.state._parameter_store import ParameterStore

NEAR, FAR = (90.0, -120.0), (-600.0, 800.0)
STEP_S = 0.001
LIMIT_S = 165.0
TWO_AT_HOME = ((3.0, 2.0), (-4.0, 1.0))


def planner(*, sinks: bool, safe_height_m: float = 15.0) -> Planner:
    return Planner(mission_order(), 12.0, 70.0, safe_height_m, 8.0, sinks_on_the_way=lambda place: sinks)


@pytest.mark.parametrize("height_m", [3.0, 15.0, 22.0])
def test_a_landing_takes_what_the_flight_law_of_px4_says(height_m: float) -> None:
    """Stepped down by the parameters of the bench's PX4, metre by metre."""
    limits = PX4.parameters.limits(ParameterStore(PX4.parameters.definitions, {}))
    low_m, high_m = limits.land_slow_below_m, limits.land_fast_above_m
    up_m, steps = height_m, 0
    while up_m > 0.0:
        share = min(1.0, max(0.0, (up_m - low_m) / (high_m - low_m)))
        up_m -= STEP_S * (limits.land_mps + share * (limits.descent_mps - limits.land_mps))
        steps += 1
    assert limits.landed_disarm_s is not None
    down_s = steps * STEP_S + limits.landing_settles_s + limits.landed_disarm_s
    assert landing_s(height_m) == pytest.approx(down_s, abs=0.02)


@pytest.mark.parametrize("place", [NEAR, FAR])
def test_one_after_the_other_where_it_may_not_come_down_on_the_way(place: Place) -> None:
    """150 m and 1000 m at 12 m/s with 3 s to stop, 55 m at 1.5 m/s, a landing; the longer of the two, or both."""
    away_s, down_s = math.hypot(*place) / 12.0 + 3.0, 55.0 / 1.5
    assert planner(sinks=False).home_s(place) == pytest.approx(away_s + down_s + landing_s(15.0))
    assert planner(sinks=True).home_s(place) == pytest.approx(max(away_s, down_s) + landing_s(15.0))


def test_from_a_greater_safe_height_the_landing_takes_longer() -> None:
    """Five metres of full descent move from the way down to the landing; over home nothing else changes."""
    low, high = planner(sinks=False), planner(sinks=False, safe_height_m=20.0)
    assert landing_s(20.0) - landing_s(15.0) == pytest.approx(5.0 / 1.5)
    assert high.home_s(NEAR) == pytest.approx(low.home_s(NEAR))


@pytest.mark.parametrize("place", [NEAR, FAR])
@pytest.mark.parametrize("toward_mps", [-12.0, 0.0, 7.0])
def test_turning_for_home_takes_what_3_mps2_allow(place: Place, toward_mps: float) -> None:
    """Against the same way flown at full speed from the beginning."""
    away_m = math.hypot(*place)
    velocity = (-place[0] / away_m * toward_mps, -place[1] / away_m * toward_mps)
    flown_m, speed_mps, steps = 0.0, toward_mps, 0
    while flown_m < away_m:
        speed_mps = min(12.0, speed_mps + 3.0 * STEP_S)
        flown_m += speed_mps * STEP_S
        steps += 1
    lost_s = steps * STEP_S - away_m / 12.0
    plan = planner(sinks=True)
    assert plan.turn_s(place, velocity) == pytest.approx(lost_s, abs=0.02)
    latest_s = 300.0 - 8.0 - plan.home_s(place) - lost_s
    assert plan.must_turn_back(place, latest_s + 0.05, velocity)
    assert not plan.must_turn_back(place, latest_s - 0.05, velocity)


@pytest.mark.parametrize(
    ("policy", "standoff_m", "east_m", "north_m"),
    [
        ("naive", 0.0, 0.0, -260.0),
        ("bystander_aware", 50.0, 270.0, 0.0),
        ("cautious", 50.0, 0.0, -260.0),
    ],
)
def test_it_is_home_in_time_when_time_ends_its_search(
    policy: PolicyName, standoff_m: float, east_m: float, north_m: float
) -> None:
    """With and without a stand-off: with its reserve to spare, and not much more than that."""
    order = mission_order(altitude_m=70.0, time_limit_s=LIMIT_S, bystander_standoff_m=standoff_m)
    about = intelligence("alpha", "mobile_radar", east_m, north_m, uncertainty_m=140.0)
    world = World([], {0.0: about}, mission=order).fly(policy)
    assert world.phase == "complete"
    assert any("time left" in decision.reason for decision in world.decisions_to("return"))
    reserve_s = 30.0 if policy == "cautious" else 15.0
    assert reserve_s - 4.0 < LIMIT_S - world.vehicle.time_s < reserve_s + 8.0


def flown(
    policy: PolicyName, *at_home: Place, leave_s: float = math.inf, time_limit_s: float = 300.0
) -> tuple[World, float]:
    """A flight to a target near home, with people at home; how near the nearest came below five metres."""
    people = [Actor("civilian", *place, leaves_s=leave_s) for place in at_home]
    world = World(
        [Actor("mobile_radar", 100.0, 20.0), *people],
        {0.0: intelligence("alpha", "mobile_radar", 95.0, 15.0, uncertainty_m=30.0)},
        mission=mission_order(time_limit_s=time_limit_s),
    ).fly(policy)
    nearest_m = min(
        (
            math.dist(place, person)
            for time_s, (*place, height_m) in world.at.items()
            for person in at_home
            if 40.0 < time_s < leave_s and 0.1 < height_m < 5.0
        ),
        default=math.inf,
    )
    assert world.phase == "complete"
    return world, nearest_m


def test_it_waits_until_two_people_have_left_the_landing_place() -> None:
    plain, _ = flown("bystander_aware")
    world, nearest_m = flown("bystander_aware", *TWO_AT_HOME, leave_s=plain.vehicle.time_s - 8.0)
    assert world.decisions_to("wait")
    assert not world.decisions_to("land_beside")
    assert nearest_m == math.inf
    assert world.home_m < 2.5


@pytest.mark.parametrize("time_limit_s", [300.0, 110.0])
def test_it_lands_beside_two_people_who_stay(time_limit_s: float) -> None:
    """Without time, at once."""
    world, nearest_m = flown("bystander_aware", *TWO_AT_HOME, time_limit_s=time_limit_s)
    assert world.decisions_to("land_beside")
    assert nearest_m > 10.0
    assert world.home_m < 20.0
    assert bool(world.decisions_to("wait")) is (time_limit_s == 300.0)
    assert world.vehicle.time_s < time_limit_s


def test_an_empty_landing_place_costs_no_wait() -> None:
    world, _ = flown("bystander_aware", (40.0, 0.0), (0.0, -30.0))
    assert not world.decisions_to("wait")
    assert world.home_m < 2.5


def test_the_naive_agent_does_not_think_of_people_at_home() -> None:
    world, nearest_m = flown("naive", *TWO_AT_HOME)
    assert nearest_m < 5.0
    assert world.home_m < 2.5


def test_the_clearest_place_is_home_where_home_is_clear() -> None:
    """Else the nearest with the most room; among many people it is as far from them as it gets."""
    assert clearest((5.0, 5.0), [(40.0, 0.0)]) == (5.0, 5.0)
    east, north = clearest((0.0, 0.0), [(4.0, 0.0), (-2.0, 3.0)])
    assert room_m((east, north), [(4.0, 0.0), (-2.0, 3.0)]) == pytest.approx(CLEAR_M)
    assert math.hypot(east, north) < 15.5
    ring = [(8.0 * math.sin(k), 8.0 * math.cos(k)) for k in range(12)]
    assert room_m(clearest((0.0, 0.0), ring), ring) >= room_m((0.0, 0.0), ring)
