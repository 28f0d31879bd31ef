"""Ways round closed areas and inside a fence: allowed, no longer than need be, and as stated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations, pairwise, permutations

import numpy as np
import pytest

from agent_adapters.reference.flight._airspace import (
    NO_FLY_MARGIN_M,
    Airspaces,
    places_of,
)
from agent_adapters.reference.flight._routes import shortest_route
from agent_adapters.reference.surrogate.batch._airspace import SurrogateAirspace
from bench.simspec import NoFlyArea, Point, Polygon


def square(east_m: float, north_m: float, half_m: float) -> Polygon:
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return Polygon(corners=tuple(Point(east_m=east_m + e, north_m=north_m + n) for e, n in corners))


def closed(*areas: NoFlyArea, fence: Polygon | None = None) -> Airspaces:
    timed = [(area.from_s, area.until_s, places_of(area.area.corners)) for area in areas]
    return Airspaces(timed, None if fence is None else places_of(fence.corners))


def test_a_way_goes_round_a_closed_area_by_the_shorter_side() -> None:
    space = SurrogateAirspace(closed(NoFlyArea(id="clinic", area=square(0.0, 10.0, 20.0))).at(0.0))
    begin, end = np.array([[-100.0, 0.0]]), np.array([[100.0, 0.0]])

    (path,) = space.paths(np.stack((begin, end), axis=1))

    assert (
        path[:, 1].min() <= -10.0 - NO_FLY_MARGIN_M + 1e-6
    )  # south of it, though the area reaches farther north
    assert path[:, 1].max() == 0.0
    length_m = sum(math.dist(a, b) for a, b in pairwise(path))
    assert 200.0 < length_m < 225.0
    assert space.length_m(begin, end)[0] == length_m


def test_lengths_are_those_of_the_ways_from_and_to_anywhere() -> None:
    areas = [NoFlyArea(id=f"area-{k}", area=square(80.0 * k - 80.0, 20.0 * k, 15.0)) for k in range(3)]
    space = SurrogateAirspace(closed(*areas, fence=square(0.0, 0.0, 200.0)).at(0.0))
    rng = np.random.Generator(np.random.PCG64(5))
    begin, end = rng.uniform(-230.0, 230.0, (2, 60, 2))

    lengths_m = space.length_m(begin, end)

    assert (lengths_m >= np.hypot(*(end - begin).T) - 1e-9).all()
    for a, b, length_m in zip(begin, end, lengths_m, strict=True):
        route = space.airspace.route((float(a[0]), float(a[1])), (float(b[0]), float(b[1])))
        assert math.isclose(
            sum(math.dist(start, stop) for start, stop in pairwise(route)), length_m, rel_tol=1e-9
        )


@pytest.mark.parametrize("seed", [1, 2])
def test_the_agent_and_its_surrogate_find_the_same_ways(seed: int) -> None:
    """Which ways are cut is written twice, for one place and for many; three areas and a fence, forty ways."""
    rng = np.random.Generator(np.random.PCG64(seed))
    squares = [
        square(float(east_m), float(north_m), float(half_m))
        for east_m, north_m, half_m in rng.uniform((-150.0, -150.0, 10.0), (150.0, 150.0, 40.0), (3, 3))
    ]
    fence = square(0.0, 0.0, 300.0)
    areas = [NoFlyArea(id=f"area-{number}", area=area) for number, area in enumerate(squares)]
    agent = closed(*areas, fence=fence).at(0.0)
    surrogate = SurrogateAirspace(agent)

    bent = 0
    for a, b in rng.uniform(-310.0, 310.0, (40, 2, 2)):
        begin, end = (float(a[0]), float(a[1])), (float(b[0]), float(b[1]))
        path = agent.path([begin, end])
        bent += len(path) > 2
        (surrogate_path,) = surrogate.paths(np.array([[begin, end]]))
        assert len(path) == len(surrogate_path)
        assert np.allclose(path, surrogate_path, atol=1e-6)
        route = agent.route(begin, end)
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


def test_an_area_is_kept_free_from_a_little_before_it_is_closed() -> None:
    spaces = closed(NoFlyArea(id="helicopter", area=square(0.0, 0.0, 20.0), from_s=100.0, until_s=150.0))

    assert [len(spaces.at(now_s).blocks) for now_s in (0.0, 60.0, 149.0, 150.0)] == [0, 1, 1, 0]
