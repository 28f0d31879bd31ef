"""What is possible is never refused with proof: scenes that fit exactly, to rounding."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import pytest
import shapely
import shapely.affinity
from yards import group, ring, scene

from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._geometry import grown_at_most, shrunk_at_most
from bench.realization.placement._placement import placement_order
from bench.realization.placement.proofs._capacity import check_areas
from bench.realization.placement.proofs._proof import prove_infeasible
from bench.realization.placement.relations._patrol_routes import check_fixed_routes
from bench.realization.placement.search._sampling import fixed_places
from bench.simspec import PlacedActor, Realized, SimSpec

yard = partial(scene, roads=(), vehicle={"home": {"east_m": -500.0, "north_m": -500.0}})


def refusal(simspec: SimSpec) -> PlacementInfeasible | None:
    """What is said before anything is tried, or when trying stalls; None where nothing is proved."""
    order = placement_order(simspec)
    try:
        check_fixed_routes(simspec, fixed_places(order))
        check_areas(simspec)
    except PlacementInfeasible as refused:
        return refused
    return prove_infeasible(simspec, order)


def is_kept(simspec: SimSpec, *places: tuple[str, float, float, float]) -> bool:
    """Whether the judge accepts these places: group, east, north, heading."""
    actors = tuple(
        PlacedActor(id=f"{name}-{number}", group=name, east_m=east, north_m=north, heading_deg=heading)
        for number, (name, east, north, heading) in enumerate(places, start=1)
    )
    return check_placement(simspec.model_copy(update={"realized": Realized(actors=actors)})) == []


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 90.0])
@pytest.mark.parametrize("separation_m", [0.0, 0.7, 25.0])
@pytest.mark.parametrize("where", ["region", "inside"])
def test_ground_of_the_size_of_a_footprint_holds_it(turn_deg: float, separation_m: float, where: str) -> None:
    """One house on ground of exactly its own size, however that lies and whatever its gap."""
    lot = shapely.affinity.rotate(shapely.box(44.0, 45.5, 56.0, 54.5), -turn_deg)
    placement = {"region": ring(lot)} if where == "region" else {"inside": {"area": "lot"}}
    simspec = yard(
        group("h", "house", separation_m=separation_m, **placement), areas=[{"id": "lot", **ring(lot)}]
    )

    assert is_kept(simspec, ("h", 50.0, 50.0, (90.0 + turn_deg) % 360.0))
    assert refusal(simspec) is None


def test_rounded_ground_is_not_cut_short() -> None:
    """Shrunk ground holds every centre whose footprint fits, grown ground none beyond reach."""
    turns = [step * math.pi / 22 for step in range(44)]
    disc = shapely.Polygon([(9.5 * math.cos(turn), 9.5 * math.sin(turn)) for turn in turns])
    for corner in shapely.get_coordinates(disc):
        deepest = shapely.Point(*(corner * (1.0 - 4.5 / (9.5 * math.cos(math.pi / 44)))))
        assert shapely.distance(disc.exterior, deepest) >= 4.5 - 1e-9
        assert shapely.distance(shrunk_at_most(disc, 4.5), deepest) < 1e-9
    pond = shapely.box(-20.0, -20.0, 20.0, 20.0).difference(disc)
    away = shapely.distance(grown_at_most(pond, 4.5), shapely.Point(0.0, 0.0))
    assert away >= 9.5 * math.cos(math.pi / 44) - 4.5


def test_a_crowded_region_names_the_crowd_alone() -> None:
    """Of those who share a region only those are named whose areas exceed it, with the region."""
    refused = refusal(yard(group("few", "crate", 2), group("many", "house", 99)))

    assert refused is not None
    assert set(refused.clash) == {"actors[many].count", "world.area"}


def test_a_wall_across_one_way_round_leaves_the_other() -> None:
    """Guards past the border walk a route out there; a house on that holds only those."""
    walk = {"kind": "patrol", "route": [{"east_m": e, "north_m": 50.0} for e in (50.0, 140.0)]}
    guards = group("guards", "soldier", 3, region=ring(shapely.box(80.0, 30.0, 110.0, 70.0))) | {
        "motion": walk
    }
    beyond = group("house", "house", at={"east_m": 130.0, "north_m": 50.0, "heading_deg": 0.0})
    within = group("shed", "shed", at={"east_m": 70.0, "north_m": 50.0, "heading_deg": 0.0})

    placed = place(yard(guards, beyond))
    assert placed.realized is not None
    assert all(one.east_m < 100.0 for one in placed.realized.actors if one.group == "guards")
    refused = refusal(yard(guards, beyond, within))
    assert refused is not None
    assert set(refused.clash) == {"actors[shed].placement.at", "actors[guards].motion.route"}


def test_who_is_fixed_is_told_who_walls_him_in() -> None:
    """A guard behind a house that stands before his route: that house is named, another is not."""
    walk = {"kind": "patrol", "route": [{"east_m": 80.0, "north_m": n} for n in (48.0, 52.0)]}
    guard = group("guard", "soldier", at={"east_m": 20.0, "north_m": 50.0}) | {"motion": walk}
    house = group("house", "house", at={"east_m": 30.0, "north_m": 50.0, "heading_deg": 0.0})
    aside = group("aside", "house", at={"east_m": 30.0, "north_m": 90.0, "heading_deg": 0.0})

    refused = refusal(yard(guard, aside, house))
    assert refused is not None
    fixed = {"actors[guard].placement.at", "actors[house].placement.at"}
    assert set(refused.clash) == fixed | {"actors[guard].motion.route"}


@pytest.mark.parametrize(
    ("other", "one"),
    [
        # A radar is drawn from a wide yard, one guard far off is to be at just some distance from it.
        (
            group("other", "radar-vehicle"),
            {
                "region": ring(shapely.box(0.0, 0.0, 6.0, 6.0)),
                "mean_distance": {"of": "other", "mean_m": 124.0},
            },
        ),
        # The mean of one is its own distance: in a wide yard it is found at 42 m, to 4 cm.
        (group("other", "civilian"), {"mean_distance": {"of": "other", "mean_m": 42.0, "tolerance": 0.001}}),
    ],
)
def test_a_lone_member_is_drawn_where_its_mean_distance_is(
    other: dict[str, Any], one: dict[str, Any]
) -> None:
    for seed in range(4):
        assert place(yard(other, group("one", "crate", **one), seed=seed)).realized is not None
