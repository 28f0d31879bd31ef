"""Ways round closed areas and inside a fence: allowed, no longer than need be, and as long as they are said
to be.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from agent_adapters.reference.flight._airspace import NO_FLY_MARGIN_M
from agent_adapters.reference.surrogate.batch._airspace import SurrogateAirspaces
from bench.simspec import NoFlyArea, Point, Polygon, Rules


def square(east_m: float, north_m: float, half_m: float) -> Polygon:
    corners = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    return Polygon(corners=tuple(Point(east_m=east_m + e, north_m=north_m + n) for e, n in corners))


def closed(*areas: NoFlyArea, fence: Polygon | None = None) -> SurrogateAirspaces:
    return SurrogateAirspaces(Rules(no_fly=areas, geofence=fence))


def test_a_way_goes_round_a_closed_area_by_the_shorter_side() -> None:
    space = closed(NoFlyArea(id="clinic", area=square(0.0, 10.0, 20.0))).of(1)
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
    space = closed(*areas, fence=square(0.0, 0.0, 200.0)).of(0b111)
    rng = np.random.Generator(np.random.PCG64(5))
    begin, end = rng.uniform(-230.0, 230.0, (2, 60, 2))

    lengths_m = space.length_m(begin, end)

    assert (lengths_m >= np.hypot(*(end - begin).T) - 1e-9).all()
    for a, b, length_m in zip(begin, end, lengths_m, strict=True):
        route = space._route((float(a[0]), float(a[1])), (float(b[0]), float(b[1])))
        assert math.isclose(
            sum(math.dist(start, stop) for start, stop in pairwise(route)), length_m, rel_tol=1e-9
        )


def test_an_area_is_kept_free_from_a_little_before_it_is_closed() -> None:
    spaces = closed(NoFlyArea(id="helicopter", area=square(0.0, 0.0, 20.0), from_s=100.0, until_s=150.0))

    assert spaces.states(np.array([0.0, 60.0, 149.0, 150.0])).tolist() == [0, 1, 1, 0]
