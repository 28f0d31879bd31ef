"""Routes around no-fly areas and inside the geofence."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference.flight._airspace import (
    FENCE_MARGIN_M,
    LEAD_S,
    NO_FLY_MARGIN_M,
    Airspaces,
    block_round,
)
from agent_adapters.reference.flight._paths import Place
from bench.contracts import MissionOrder

SQUARE = ((-20.0, -20.0), (20.0, -20.0), (20.0, 20.0), (-20.0, 20.0))
FENCE = ((-200.0, -100.0), (200.0, -100.0), (200.0, 100.0), (-200.0, 100.0))


def order_with_rules(
    no_fly: tuple[tuple[Place, ...], ...] = (),
    fence: tuple[Place, ...] | None = None,
    from_s: float = 0.0,
    **rules: object,
) -> MissionOrder:
    def corners(places: tuple[Place, ...]) -> tuple[dict[str, float], ...]:
        return tuple({"east_m": e, "north_m": n} for e, n in places)

    areas = tuple(
        {"id": f"area-{k}", "corners": corners(area), "from_s": from_s, "until_s": None}
        for k, area in enumerate(no_fly)
    )
    return mission_order(no_fly=areas, geofence=None if fence is None else corners(fence), **rules)


def distance_m(place: Place, corners: tuple[Place, ...]) -> float:
    """From a place to a convex polygon; 0 inside. Written apart from the agent's own geometry on purpose."""
    edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    if all((b[0] - a[0]) * (place[1] - a[1]) - (b[1] - a[1]) * (place[0] - a[0]) >= 0.0 for a, b in edges):
        return 0.0
    return min(_distance_to_segment_m(place, a, b) for a, b in edges)


def _distance_to_segment_m(place: Place, a: Place, b: Place) -> float:
    share = ((place[0] - a[0]) * (b[0] - a[0]) + (place[1] - a[1]) * (b[1] - a[1])) / math.dist(a, b) ** 2
    share = min(max(share, 0.0), 1.0)
    return math.dist(place, (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))


def points_along(route: list[Place]) -> list[Place]:
    return [
        (a[0] + (b[0] - a[0]) * k / 20, a[1] + (b[1] - a[1]) * k / 20)
        for a, b in pairwise(route)
        for k in range(21)
    ]


def test_without_areas_and_fence_paths_stay_unchanged() -> None:
    """The route is straight and a path is returned unchanged."""
    space = Airspaces.of(mission_order()).at(0.0)
    path = [(0.0, 0.0), (50.0, 10.0), (0.0, 0.0)]
    assert space.path(path) == path
    assert space.route((0.0, 0.0), (9.0, 9.0)) == [(0.0, 0.0), (9.0, 9.0)]


def test_the_way_round_an_area_keeps_the_margin_and_is_short() -> None:
    """The route around a square keeps the margin and is shorter than over the widened square's corners."""
    space = Airspaces.of(order_with_rules((SQUARE,))).at(0.0)
    route = space.route((-100.0, 0.0), (100.0, 0.0))
    assert min(distance_m(place, SQUARE) for place in points_along(route)) >= NO_FLY_MARGIN_M - 0.1
    length_m = sum(math.dist(a, b) for a, b in pairwise(route))
    around_m = 2.0 * math.hypot(55.0, 45.0) + 90.0  # over the corners of a square that is wider by the margin
    assert 200.0 < length_m < around_m


def test_any_way_between_allowed_places_keeps_clear_of_everything() -> None:
    """A hundred random pairs of places among three areas inside a fence."""
    areas = (
        SQUARE,
        ((60.0, 30.0), (110.0, 20.0), (90.0, 80.0)),
        ((-120.0, -90.0), (-90.0, -90.0), (-100.0, 40.0)),
    )
    space = Airspaces.of(order_with_rules(areas, FENCE)).at(0.0)
    draw = random.Random(7)
    tried = 0
    while tried < 100:
        a, b = ((draw.uniform(-199, 199), draw.uniform(-99, 99)) for _ in range(2))
        if not (space.allows(a) and space.allows(b)):
            continue
        tried += 1
        for place in points_along(space.route(a, b)):
            assert min(distance_m(place, area) for area in areas) >= NO_FLY_MARGIN_M - 0.2
            assert abs(place[0]) <= 200.0 - FENCE_MARGIN_M + 0.1
            assert abs(place[1]) <= 100.0 - FENCE_MARGIN_M + 0.1


def test_a_forbidden_waypoint_is_moved_and_a_forbidden_end_is_reached() -> None:
    """A waypoint inside goes to the nearest place outside; a way that has to end inside (home) does."""
    space = Airspaces.of(order_with_rules((SQUARE,))).at(0.0)
    moved = space.path([(-100.0, 0.0), (5.0, 0.0)])[-1]
    assert distance_m(moved, SQUARE) >= NO_FLY_MARGIN_M - 0.1
    assert math.dist(moved, (5.0, 0.0)) < 20.0 + NO_FLY_MARGIN_M + 5.0
    assert space.route((-100.0, 0.0), (25.0, 0.0))[-1] == (25.0, 0.0)
    assert space.route((0.0, 0.0), (-100.0, 0.0))[0] == (0.0, 0.0)


def test_an_area_counts_from_before_it_comes_into_force() -> None:
    """Long before it may be crossed; from its lead time on it may not; else it is the same airspace."""
    spaces = Airspaces.of(order_with_rules((SQUARE,), from_s=100.0))
    assert spaces.at(0.0).clear((-100.0, 0.0), (100.0, 0.0))
    assert not spaces.at(100.0 - LEAD_S).clear((-100.0, 0.0), (100.0, 0.0))
    assert spaces.at(100.0) is spaces.at(200.0)


@pytest.mark.parametrize(
    "corners", [SQUARE, ((0.0, 0.0), (10.0, 0.0), (0.0, 10.0)), ((0.0, 0.0), (50.0, 0.0))]
)
def test_a_block_is_wider_than_its_area_on_every_side(corners: tuple[Place, ...]) -> None:
    """Every place nearer than the margin to a corner lies inside, and no place far beyond it."""
    block = block_round(corners, 10.0)
    for east, north in corners:
        for turn in range(24):
            angle = turn * math.pi / 12
            assert block.holds((east + 9.9 * math.cos(angle), north + 9.9 * math.sin(angle)))
    assert not block.holds((corners[0][0] - 100.0, corners[0][1]))


def test_a_mission_flies_round_an_area_and_keeps_heights_and_speed() -> None:
    """An area across the way and a floor: never inside the area, not low away from home, not too fast."""
    wall = ((50.0, -40.0), (70.0, -40.0), (70.0, 40.0), (50.0, 40.0))
    target = Actor("mobile_radar", 170.0, 0.0)
    trail: list[tuple[float, float, float, float]] = []
    world = World(
        [target],
        {0.0: intelligence("alpha", "mobile_radar", 170.0, 0.0, uncertainty_m=40.0)},
        mission=order_with_rules((wall,), min_altitude_m=40.0, max_altitude_m=55.0, max_speed_mps=9.0),
        each_step=lambda now: trail.append(
            (now.vehicle.east_m, now.vehicle.north_m, now.vehicle.height_m, now.vehicle.speed_mps)
        ),
    ).fly("naive")
    assert [report.intelligence_id for report in world.reports] == ["alpha"]
    assert world.phase == "complete"
    assert min(distance_m(state[:2], wall) for state in trail) > 15.0
    assert all(state[2] >= 39.5 for state in trail if math.hypot(state[0], state[1]) > 40.0)
    assert max(state[2] for state in trail) <= 55.0
    assert max(state[3] for state in trail) <= 9.0
