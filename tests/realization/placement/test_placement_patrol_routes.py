"""Patrols get to their routes and round them, by sampling, solver and check alike."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
import yards
from yards import corners, group, points

from bench.contracts import SimTime
from bench.errors import SetupError
from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.proofs._proof import prove_infeasible
from bench.realization.placement.search._solver import solve_placement
from bench.simspec import SimSpec
from bench.simulation import open_plain_scene

ROUTE = [(70.0, 20.0), (90.0, 20.0), (90.0, 60.0), (70.0, 60.0)]


def fixed(name: str, asset: str, east_m: float, north_m: float, heading_deg: float = 0.0) -> dict[str, Any]:
    return group(name, asset, at={"east_m": east_m, "north_m": north_m, "heading_deg": heading_deg})


def patrol(count: int = 1, route: Any = ROUTE, **placement: Any) -> dict[str, Any]:
    motion = {"kind": "patrol", "route": points(*route), "pause_s": 0.0, "speed_mps": 20.0}
    return group("guards", "soldier", count, **placement) | {"motion": motion, "role": "adversary"}


scene = partial(yards.scene, vehicle={"home": {"east_m": 3.0, "north_m": 97.0}})


def fence(*gaps: int) -> list[dict[str, Any]]:
    """Houses from south to north at 40 m east, end to end, but for those left out."""
    return [fixed(f"wall-{k}", "house", 40.0, 6.0 + 12.2 * k) for k in range(8) if k not in gaps]


def walked(placed: SimSpec, group: str = "guards", steps: int = 400) -> list[set[int]]:
    """Which points of the route each member of the group comes to, as the simulation moves it."""
    assert placed.realized is not None
    flown = open_plain_scene(placed)
    mine = [index for index, actor in enumerate(placed.realized.actors) if actor.group == group]
    route = np.array([(point.east_m, point.north_m) for point in placed.group(group).motion.route])
    met: list[set[int]] = [set() for _ in mine]
    for step in range(steps):
        flown.advance(SimTime(step * 100_000_000))
        places = flown.positions()[mine, :2]
        nearest = np.linalg.norm(places[:, None, :] - route[None], axis=-1) < 2.0
        for walker, point in zip(*np.nonzero(nearest), strict=True):
            met[walker].add(int(point))
    return met


CROWDED = [group("houses", "house", 8), group("trees", "tree", 12), patrol(4), group("sheds", "shed", 8)]
TILED = [
    group("houses", "house", 5, separation_m=0.1, region=corners(40, 0, 56, 100)),
    patrol(3, region=corners(1, 1, 30, 60)),
]


@pytest.mark.parametrize(
    ("groups", "seed"),
    # Houses before and after the walkers; houses that tile the way with little room to spare.
    [*((CROWDED, seed) for seed in range(4)), (TILED, 1)],
)
def test_every_walker_gets_round_its_route(groups: list[dict[str, Any]], seed: int) -> None:
    """Among what is placed before, with and after them all walk the whole route, sampled or solved."""
    simspec = scene(*groups, seed=seed)
    by_solver = solve_placement(simspec, placement_order(simspec))

    assert by_solver is not None
    for placed in (place(simspec), with_places(simspec, by_solver, "cp-sat")):
        assert check_placement(placed) == []
        assert {*map(frozenset, walked(placed))} == {frozenset(range(len(ROUTE)))}


def test_walkers_stand_where_a_way_is_open() -> None:
    """Behind a fence with one gap they stand where the gap lets them see a point of the route."""
    placed = place(scene(*fence(3), patrol(3, region=corners(1, 1, 30, 95))))

    assert walked(placed) == [{0, 1, 2, 3}] * 3


def test_no_way_at_all_is_proved_and_named() -> None:
    """A closed fence is a proof: the region, the route, and only such walls as are needed."""
    simspec = scene(*fence(), patrol(2, region=corners(1, 1, 30, 60)), group("people", "civilian", 5))

    with pytest.raises(PlacementInfeasible, match="straight from its place to some point of its") as refused:
        place(simspec)

    assert refused.value.proved
    assert {"actors[guards].motion.route", "actors[guards].placement.region"} <= set(refused.value.clash)
    assert "actors[wall-0].placement.at" in refused.value.clash
    assert not any("people" in path for path in refused.value.clash)


def test_a_gap_is_never_called_closed() -> None:
    """The proof says nothing where the fence has a gap, wherever that is."""
    for gap in range(8):
        simspec = scene(*fence(gap), patrol(2, region=corners(1, 1, 30, 95)))
        assert prove_infeasible(simspec, placement_order(simspec)) is None


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        (
            [fixed("house", "house", 80.0, 20.0), patrol()],
            "'house' is fixed .* on the patrol route of 'guards'",
        ),
        (
            [
                fixed("house", "house", 45.0, 40.0),
                patrol(route=[(70.0, 39.0), (70.0, 41.0)], at={"east_m": 20.0, "north_m": 40.0}),
            ],
            "'guards' is fixed .* no straight way leads to any point of its patrol route",
        ),
    ],
)
def test_what_is_fixed_in_the_way_is_refused_at_once(groups: list[dict[str, Any]], message: str) -> None:
    """A house that its author put on the route, or before a walker who is fixed too."""
    with pytest.raises(PlacementInfeasible, match=message) as refused:
        place(scene(*groups))

    assert refused.value.proved
    assert "actors[house].placement.at" in refused.value.clash
    assert "actors[guards].motion.route" in refused.value.clash


BAY = {"corners": points((0, 0), (100, 0), (100, 100), (60, 100), (60, 40), (40, 40), (40, 100), (0, 100))}


def test_a_route_across_a_bay_is_a_fault_of_the_document() -> None:
    """Nobody inside the area walks out of it: the fault names the leg; one round the bay is walked."""
    with pytest.raises(SetupError, match=r"motion.route: .* from point 1 to point 2 leaves world.area"):
        place(scene(patrol(route=[(20.0, 80.0), (80.0, 80.0), (80.0, 20.0), (20.0, 20.0)]), area=BAY))

    round_it = [(20.0, 80.0), (30.0, 20.0), (70.0, 20.0), (80.0, 80.0), (70.0, 20.0), (30.0, 20.0)]
    placed = place(scene(patrol(3, route=round_it), group("trees", "tree", 10), area=BAY))
    assert check_placement(placed) == []
    assert [len(points) for points in walked(placed)] == [6, 6, 6]


def test_points_beyond_the_border_are_walked_inside_it() -> None:
    """A point outside is taken half a metre inside; what stands there closes the route."""
    beyond = [(20.0, 50.0), (130.0, 50.0)]
    placed = place(scene(patrol(2, route=beyond), group("trees", "tree", 6)))
    assert check_placement(placed) == []
    with pytest.raises(PlacementInfeasible, match="on the patrol route"):
        place(scene(patrol(2, route=beyond), fixed("tree", "tree", 98.0, 52.0)))


def test_corners_count_as_the_simulation_counts_them() -> None:
    """Footprints are grown along and across: what the simulation closes at a corner is closed here."""
    # A diagonal leg passes the house's corner at 0.33 m; a soldier needs 0.35 m to either side of an axis.
    corner = np.array([46.0, 44.5])
    off = 0.40 / np.sqrt(2.0)
    ends = [tuple(float(v) for v in corner + off + s * np.array([1.0, -1.0])) for s in (-20.0, 20.0)]
    house = fixed("house", "house", 41.5, 38.5)
    with pytest.raises(PlacementInfeasible, match="on the patrol route"):
        place(scene(house, patrol(route=ends)))


def test_wanderers_need_no_way() -> None:
    """Whoever wanders in a closed yard is placed."""
    walls = [
        fixed(f"{name}-{k}", "house", east + step_east * k, north + step_north * k, heading)
        for name, east, north, step_east, step_north, heading in (
            ("north", 34.5, 60.0, 12.1, 0.0, 90.0),
            ("south", 34.5, 30.0, 12.1, 0.0, 90.0),
            ("west", 23.9, 33.0, 0.0, 12.1, 0.0),
            ("east", 69.3, 33.0, 0.0, 12.1, 0.0),
        )
        for k in range(3)
    ]
    people = group("people", "civilian", 3, region=corners(40, 40, 55, 50))
    people["motion"] = {"kind": "wander", "speed_mps": 3.0}

    assert check_placement(place(scene(*walls, people))) == []
