"""Ways round no-fly areas and inside the geofence, of the reference agent and of its surrogate."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise, permutations

import networkx as nx
import numpy as np
import pytest
from agent_fakes import Actor, World, intelligence, mission_order
from shapely import LineString, MultiPoint, Polygon
from shapely.geometry import Point

from agent_adapters.reference.flight._airspace import (
    FENCE_MARGIN_M,
    LEAD_S,
    NO_FLY_MARGIN_M,
    Airspace,
    Airspaces,
    block_round,
)
from agent_adapters.reference.flight._paths import Place
from agent_adapters.reference.flight._routes import shortest_route
from agent_adapters.reference.surrogate.batch._airspace import SurrogateAirspace
from bench.contracts import MissionOrder

Corners = Sequence[Place]


def square(east_m: float, north_m: float, half_m: float) -> Corners:
    return [(east_m + e * half_m, north_m + n * half_m) for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


SQUARE = square(0.0, 0.0, 20.0)
FENCE = [(-200.0, -100.0), (200.0, -100.0), (200.0, 100.0), (-200.0, 100.0)]


def order_with_rules(
    no_fly: Iterable[Corners] = (), fence: Corners | None = None, **rules: object
) -> MissionOrder:
    def corners(places: Corners) -> list[dict[str, float]]:
        return [{"east_m": e, "north_m": n} for e, n in places]

    areas = [
        {"id": f"area-{k}", "corners": corners(area), "from_s": 0.0, "until_s": None}
        for k, area in enumerate(no_fly)
    ]
    return mission_order(no_fly=areas, geofence=None if fence is None else corners(fence), **rules)


def points_along(route: list[Place]) -> list[Point]:
    line = LineString(route)
    return [line.interpolate(k / 100, normalized=True) for k in range(101)]


def test_without_areas_and_fence_paths_stay_unchanged() -> None:
    space = Airspaces.of(mission_order()).at(0.0)
    path = [(0.0, 0.0), (50.0, 10.0), (0.0, 0.0)]
    assert space.path(path) == path
    assert space.route((0.0, 0.0), (9.0, 9.0)) == [(0.0, 0.0), (9.0, 9.0)]


def test_any_way_between_allowed_places_keeps_clear_of_everything() -> None:
    """A hundred random pairs of places among three areas inside a fence."""
    areas = (
        SQUARE,
        ((60.0, 30.0), (110.0, 20.0), (90.0, 80.0)),
        ((-120.0, -90.0), (-90.0, -90.0), (-100.0, 40.0)),
    )
    polygons = [Polygon(area) for area in areas]
    space = Airspaces.of(order_with_rules(areas, FENCE)).at(0.0)
    draw = random.Random(7)
    tried = 0
    while tried < 100:
        a, b = ((draw.uniform(-199, 199), draw.uniform(-99, 99)) for _ in range(2))
        if not (space.allows(a) and space.allows(b)):
            continue
        tried += 1
        for place in points_along(space.route(a, b)):
            assert min(polygon.distance(place) for polygon in polygons) >= NO_FLY_MARGIN_M - 0.2
            assert abs(place.x) <= 200.0 - FENCE_MARGIN_M + 0.1
            assert abs(place.y) <= 100.0 - FENCE_MARGIN_M + 0.1


def test_a_forbidden_waypoint_is_moved_and_a_forbidden_end_is_reached() -> None:
    """A waypoint inside goes to the nearest place outside; a way that has to end inside (home) does."""
    space = Airspaces.of(order_with_rules([SQUARE])).at(0.0)
    moved = space.path([(-100.0, 0.0), (5.0, 0.0)])[-1]
    assert Polygon(SQUARE).distance(Point(moved)) >= NO_FLY_MARGIN_M - 0.1
    assert math.dist(moved, (5.0, 0.0)) < 20.0 + NO_FLY_MARGIN_M + 5.0
    assert space.route((-100.0, 0.0), (25.0, 0.0))[-1] == (25.0, 0.0)
    assert space.route((0.0, 0.0), (-100.0, 0.0))[0] == (0.0, 0.0)


def test_an_area_is_kept_free_from_a_little_before_it_is_closed_until_it_is_open() -> None:
    spaces = Airspaces([(100.0, 150.0, SQUARE)], None)
    moments_s = (0.0, 100.0 - LEAD_S - 0.1, 100.0 - LEAD_S, 149.0, 150.0)
    assert [len(spaces.at(now_s).blocks) for now_s in moments_s] == [0, 0, 1, 1, 0]
    assert [spaces.at(now_s).clear((-100.0, 0.0), (100.0, 0.0)) for now_s in (0.0, 149.0)] == [True, False]
    assert spaces.at(100.0) is spaces.at(149.0)


@pytest.mark.parametrize(
    "corners", [SQUARE, ((0.0, 0.0), (10.0, 0.0), (0.0, 10.0)), ((0.0, 0.0), (50.0, 0.0))]
)
def test_a_block_is_wider_than_its_area_on_every_side(corners: Corners) -> None:
    """Every place nearer than the margin to a corner lies inside, and no place far beyond it."""
    block = block_round(tuple(corners), 10.0)
    for east, north in corners:
        for turn in range(24):
            angle = turn * math.pi / 12
            assert block.holds((east + 9.9 * math.cos(angle), north + 9.9 * math.sin(angle)))
    assert not block.holds((corners[0][0] - 100.0, corners[0][1]))


def test_a_mission_flies_round_an_area_and_keeps_heights_and_speed() -> None:
    """An area across the way and a floor: never inside the area, not low away from home, not too fast."""
    wall = ((50.0, -40.0), (70.0, -40.0), (70.0, 40.0), (50.0, 40.0))
    world = World(
        [Actor("mobile_radar", 170.0, 0.0)],
        {0.0: intelligence("alpha", "mobile_radar", 170.0, 0.0, uncertainty_m=40.0)},
        mission=order_with_rules([wall], min_altitude_m=40.0, max_altitude_m=55.0, max_speed_mps=9.0),
    ).fly("naive")
    assert world.reported == ["alpha"]
    assert world.phase == "complete"
    assert min(Polygon(wall).distance(Point(e, n)) for e, n, _ in world.at.values()) > 15.0
    assert all(up >= 39.5 for e, n, up in world.at.values() if math.hypot(e, n) > 40.0)
    assert world.vehicle.peak_m <= 55.0
    assert max(world.speed_mps.values()) <= 9.0


def shortest_m(areas: list[Polygon], begin: Place, end: Place) -> float:
    """The shortest path round areas, by the visibility graph over their corners. Written apart from the agent's geometry."""
    inner = [area.buffer(-1e-5) for area in areas]
    nodes = [begin, end, *(corner for area in areas for corner in area.exterior.coords[:-1])]
    nodes = [node for node in nodes if not any(area.contains(Point(node)) for area in inner)]
    graph: nx.Graph[tuple[float, float]] = nx.Graph()
    graph.add_nodes_from(nodes)
    for a, b in combinations(nodes, 2):
        if a != b and not any(LineString([a, b]).intersects(area) for area in inner):
            graph.add_edge(a, b, length_m=math.dist(a, b))
    return float(nx.shortest_path_length(graph, begin, end, weight="length_m"))


@pytest.mark.parametrize("seed", range(40))
def test_the_way_round_two_areas_is_the_shortest(seed: int) -> None:
    """Areas as hulls of random places: the agent's route and the surrogate's are as long as the reference says."""
    rng = random.Random(seed)
    corners: list[list[Place]] = []
    for _ in range(2):
        east_m, north_m = rng.uniform(-120.0, 120.0), rng.uniform(-80.0, 80.0)
        places = [(east_m + rng.uniform(-45, 45), north_m + rng.uniform(-45, 45)) for _ in range(6)]
        corners.append(list(MultiPoint(places).convex_hull.exterior.coords)[:-1])
    blocks = tuple(block_round(tuple(area), NO_FLY_MARGIN_M) for area in corners)
    polygons = [Polygon(block.corners) for block in blocks]
    begin, end = (-320.0, rng.uniform(-120.0, 120.0)), (320.0, rng.uniform(-120.0, 120.0))
    expected_m = pytest.approx(shortest_m(polygons, begin, end), abs=1e-2)

    assert Airspace(blocks).length_m(begin, end) == expected_m
    assert SurrogateAirspace(Airspace(blocks)).length_m(np.array([begin]), np.array([end]))[0] == expected_m
    for area, polygon in zip(corners, polygons, strict=True):  # and a block keeps its margin
        assert Polygon(area).exterior.distance(polygon.exterior) >= NO_FLY_MARGIN_M - 1e-6


@pytest.mark.parametrize("seed", [1, 2])
def test_the_agent_and_its_surrogate_find_the_same_ways(seed: int) -> None:
    """Which ways are cut is written twice, for one place and for many; three areas and a fence, forty ways."""
    rng = np.random.Generator(np.random.PCG64(seed))
    squares = [
        square(*at) for at in rng.uniform((-150.0, -150.0, 10.0), (150.0, 150.0, 40.0), (3, 3)).tolist()
    ]
    agent = Airspaces.of(order_with_rules(squares, square(0.0, 0.0, 300.0))).at(0.0)
    surrogate = SurrogateAirspace(agent)

    bent = 0
    for begin, end in rng.uniform(-310.0, 310.0, (40, 2, 2)).tolist():
        path = agent.path([tuple(begin), tuple(end)])
        bent += len(path) > 2
        (surrogate_path,) = surrogate.paths(np.array([[begin, end]]))
        assert len(path) == len(surrogate_path)
        assert np.allclose(path, surrogate_path, atol=1e-6)
        route = agent.route(tuple(begin), tuple(end))
        length_m = sum(math.dist(leg_begin, leg_end) for leg_begin, leg_end in pairwise(route))
        assert math.isclose(surrogate.length_m(np.array([begin]), np.array([end]))[0], length_m, rel_tol=1e-9)
    assert bent >= 10


@pytest.mark.parametrize("seed", range(5))
def test_no_way_over_corners_is_shorter_than_the_one_that_is_found(seed: int) -> None:
    """Against every order of every choice of five corners, with half of the legs closed by chance."""
    rng = np.random.Generator(np.random.PCG64(seed))
    places = [(float(east_m), float(north_m)) for east_m, north_m in rng.uniform(0.0, 100.0, (7, 2))]
    open_legs = {frozenset(pair) for pair in combinations(range(7), 2) if rng.random() < 0.5}

    def length_m(way: Sequence[int]) -> float:
        legs = list(pairwise(way))
        if any(frozenset(leg) not in open_legs for leg in legs):
            return math.inf
        return sum(math.dist(places[a], places[b]) for a, b in legs)

    ways = [(0, *over, 1) for count in range(6) for over in permutations(range(2, 7), count)]
    best = min(ways, key=length_m)
    route = shortest_route(places[0], places[1], places[2:], lambda a, b: frozenset((a, b)) in open_legs)
    straight_on = math.isinf(length_m(best))
    assert route == ([places[0], places[1]] if straight_on else [places[index] for index in best])
