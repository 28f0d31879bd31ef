"""The reference agents with a convoy to escort: the order of their search, and where they stay after it."""

from __future__ import annotations

import math

import pytest
from agent_fakes import Actor, World, intelligence, mission_order
from air_documents import valid

from agent_adapters.reference._settings import PolicyName
from agent_adapters.reference.mission._convoy import Convoy
from agent_adapters.reference.mission._planner import Planner
from bench.contracts import EscortDocument

RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
REPORTS = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0, 1, uncertainty_m=30.0),
    intelligence("bravo", "military_vehicle", -60.0, 110.0, 2, uncertainty_m=30.0),
)


def convoy(**changes: object) -> EscortDocument:
    """Two cars that drive eastwards on north 60, past bravo and then past alpha."""
    document = {
        "class_label": "civilian_vehicle",
        "starts": [{"east_m": -265.0, "north_m": 60.0}, {"east_m": -250.0, "north_m": 60.0}],
        "route": [{"east_m": -240.0, "north_m": 60.0}, {"east_m": 250.0, "north_m": 60.0}],
        "speed_mps": 4.0,
        "depart_s": 90.0,
        "halt_s": 190.0,
        "within_m": 80.0,
        "warn_before_m": 100.0,
    }
    return valid(EscortDocument, document | changes)


def test_places_are_searched_in_the_order_in_which_the_convoy_comes_by() -> None:
    """Against their priorities; the same reports without an escort keep these."""
    orders = []
    for escort in (convoy(), None):
        plan = Planner(mission_order(escort=escort), 12.0, 60.0, 15.0, 8.0)
        for report in REPORTS:
            plan.add(report)
        orders.append([task.id for task in plan.waiting((0.0, 0.0))])
    assert orders == [["bravo", "alpha"], ["alpha", "bravo"]]


def test_when_the_convoy_comes_by() -> None:
    """Its head has 103.4 m to go to 100 m from bravo; a place that it has left behind, or never passes, is not due."""
    plan = Convoy(convoy(), 300.0)
    to_go_m = 250.0 - 60.0 - math.sqrt(100.0**2 - 50.0**2)
    assert plan.near_s((-60.0, 110.0), 0.0) == pytest.approx(90.0 + to_go_m / 4.0, abs=1.0)
    assert plan.near_s((-60.0, 110.0), 185.0) == math.inf
    assert plan.near_s((200.0, -250.0), 0.0) == math.inf
    assert plan.moves_until(189.0)
    assert not plan.moves_until(190.0)
    assert not Convoy(convoy(halt_s=None), 300.0).moves_until(300.0)


def test_the_station_is_ahead_of_the_head() -> None:
    """Half of 80 m ahead of the second car, which drives first; before the departure where it will come by."""
    plan = Convoy(convoy(), 300.0)
    assert plan.station(0.0) == pytest.approx((-210.0, 60.0))
    assert plan.station(140.0) == pytest.approx((-10.0, 60.0))
    assert plan.station(189.0) == pytest.approx((150.0, 60.0))


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_it_searches_ahead_of_the_convoy_and_stays_with_it(policy: PolicyName) -> None:
    """Both places are reported before the convoy is there; then it is within 80 m of it until it stops, and home."""
    places: dict[float, tuple[float, float]] = {}

    def note(world: World) -> None:
        places[round(world.vehicle.time_s, 1)] = (world.vehicle.east_m, world.vehicle.north_m)

    world = World(
        [RADAR, TRUCK],
        {0.0: REPORTS},
        mission=mission_order(escort=convoy(), time_limit_s=320.0),
        each_step=note,
    )
    world.fly(policy)
    assert [report.intelligence_id for report in world.reports[:2]] == ["bravo", "alpha"]
    (accompany, *_) = world.decisions_to("accompany")
    for second in range(max(math.ceil(accompany.time_s) + 25, 90), 190, 5):
        head = (-250.0 + 4.0 * (second - 90.0), 60.0)
        near_m = min(math.dist(places[float(second)], car) for car in (head, (head[0] - 15.0, 60.0)))
        assert near_m <= 80.0, (second, near_m)
    assert world.phase == "complete"
    assert world.vehicle.time_s > 190.0
