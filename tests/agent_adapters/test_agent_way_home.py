"""The time that the reference agents reckon for the way home, and what they fly."""

from __future__ import annotations

import math

import pytest
from agent_fakes import World, intelligence, mission_order

from agent_adapters.reference._settings import PolicyName
from agent_adapters.reference.flight._limits import landing_s
from agent_adapters.reference.flight._paths import Place
from agent_adapters.reference.mission._planner import Planner
from bench.contracts import Decision
from vehicle_models.controller import PX4
from vehicle_models.controller.state._parameter_store import ParameterStore

NEAR, FAR = (90.0, -120.0), (-600.0, 800.0)
STEP_S = 0.001
LIMIT_S = 165.0


def planner(*, sinks: bool, height_m: float = 70.0, safe_height_m: float = 15.0) -> Planner:
    return Planner(mission_order(), 12.0, height_m, safe_height_m, 8.0, sinks_on_the_way=lambda place: sinks)


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
        ("naive", 50.0, 270.0, 0.0),
        ("bystander_aware", 0.0, -190.0, 190.0),
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
    assert any("time left" in decision.reason for decision in returns(world))
    reserve_s = 30.0 if policy == "cautious" else 15.0
    spare_s = LIMIT_S - world.vehicle.time_s
    assert reserve_s - 4.0 < spare_s < reserve_s + 8.0


def returns(world: World) -> list[Decision]:
    return world.decisions_to("return")
