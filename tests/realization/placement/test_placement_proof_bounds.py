"""Bounds on numbers and headings: packings are not refused, what exceeds a bound is, with fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from yards import corners, group, points, scene

from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order
from bench.realization.placement.proofs._packing import max_aligned_rectangles, max_spaced_points
from bench.realization.placement.proofs._proof import prove_infeasible
from bench.simspec import SimSpec


def hexagonal(rows: int, columns: int, apart_m: float) -> Any:
    return [
        ((column + 0.5 * (row % 2)) * apart_m, row * math.sqrt(0.75) * apart_m)
        for row in range(rows)
        for column in range(columns)
    ]


def triangle(side: int, apart_m: float) -> Any:
    return [
        ((c + 0.5 * r) * apart_m, r * math.sqrt(0.75) * apart_m)
        for r in range(side + 1)
        for c in range(side + 1 - r)
    ]


@pytest.mark.parametrize("apart_m", [0.3, 1.0, 7.3])
@pytest.mark.parametrize("turn_deg", [0.0, 33.0])
def test_oler_never_refuses_known_packings(apart_m: float, turn_deg: float) -> None:
    """Squares of points, hexagonal lattices, triangles (at the bound), lines stand on their hulls."""
    packings = [
        *([(i * apart_m, j * apart_m) for i in range(k) for j in range(k)] for k in range(1, 12)),
        *(hexagonal(rows, columns, apart_m) for rows in range(1, 9) for columns in range(1, 9)),
        *(triangle(side, apart_m) for side in range(1, 12)),
        *([(i * apart_m, 0.0) for i in range(k)] for k in range(1, 12)),
    ]
    for packing in packings:
        hull = shapely.affinity.rotate(
            shapely.convex_hull(shapely.multipoints(packing)), turn_deg, origin=(0.0, 0.0)
        )
        assert len(packing) <= max_spaced_points(hull, apart_m)
    for side in range(1, 12):
        whole = shapely.convex_hull(shapely.multipoints(triangle(side, apart_m)))
        assert max_spaced_points(whole, apart_m) == (side + 1) * (side + 2) / 2


def test_oler_counts_parts_of_the_ground_apart() -> None:
    """Two yards far from each other hold what each holds, not what the ground between them would."""
    yards = shapely.union_all([shapely.box(0, 0, 10, 10), shapely.box(500, 0, 510, 10)])

    assert max_spaced_points(yards, 10.0) == 2 * max_spaced_points(shapely.box(0, 0, 10, 10), 10.0) < 12
    assert max_spaced_points(shapely.Polygon(), 1.0) == 0
    assert max_spaced_points(shapely.Point(3, 4), 1.0) == 1


@settings(max_examples=60, deadline=None)
@given(
    columns=st.integers(1, 5),
    rows=st.integers(1, 5),
    size=st.tuples(st.floats(0.5, 9.0), st.floats(0.3, 1.0)),
    gap_m=st.floats(0.0, 3.0),
    course_deg=st.floats(0.0, 360.0),
    within_deg=st.floats(0.0, 30.0),
    seed=st.integers(0, 1000),
)
def test_rows_of_rectangles_are_never_refused(
    columns: int,
    rows: int,
    size: tuple[float, float],
    gap_m: float,
    course_deg: float,
    within_deg: float,
    seed: int,
) -> None:
    """A grid of them, each turned as far as it may and as close as that leaves, is within the bound."""
    length_m, width_m = size[0], size[0] * size[1]
    turns = np.radians(np.random.default_rng(seed).choice([-within_deg, 0.0, within_deg], columns * rows))
    max_rad = np.radians(within_deg)
    # Pitches at which the widest turned ones keep the gap; untouched by what the bound assumes.
    along = max(length_m * math.cos(t) + width_m * math.sin(t) for t in np.linspace(0.0, max_rad, 7)) + gap_m
    across = max(width_m * math.cos(t) + length_m * math.sin(t) for t in np.linspace(0.0, max_rad, 7)) + gap_m
    if not turns.any():
        along, across = length_m + gap_m, width_m + gap_m
    centres = shapely.multipoints([(across * i, along * j) for i in range(columns) for j in range(rows)])
    ground = shapely.affinity.rotate(shapely.convex_hull(centres), -course_deg, origin=(0.0, 0.0))

    assert columns * rows <= max_aligned_rectangles(
        ground, (length_m, width_m), gap_m, course_deg, within_deg
    )


def test_aligned_rectangles_are_bounded_by_their_rows() -> None:
    """Trucks of 6.5 by 2.5 m in one lane, two abreast, and turned by up to ten degrees."""

    def lane(width_m: float, within_deg: float) -> float:
        return max_aligned_rectangles(shapely.box(0, 0, width_m, 70.0), (6.5, 2.5), 0.5, 0.0, within_deg)

    assert lane(1.0, 0.5) == 11
    assert lane(3.5, 0.5) == 22
    assert 11 <= lane(1.0, 10.0) <= 12


HOME = {"home": {"east_m": -50.0, "north_m": -50.0}}


def yard(*groups: dict[str, Any], size_m: float = 40.0, roads: Any = (), area: Any = None) -> SimSpec:
    outline = {"corners": points(*area)} if area else corners(0.0, 0.0, size_m, size_m)
    return scene(*groups, seed=0, area=outline, roads=roads, vehicle=HOME)


def road(*places: tuple[float, float], width_m: float = 7.0) -> dict[str, Any]:
    return {"id": "main", "width_m": width_m, "points": points(*places)}


def clash_of(simspec: SimSpec) -> set[str]:
    refusal = prove_infeasible(simspec, placement_order(simspec))
    return set(refusal.clash) if refusal else set()


@pytest.mark.parametrize(
    ("few", "most", "required", "field"),
    [(25, 28, {"spread_m": 9.8}, "placement.spread_m"), (49, 76, {"separation_m": 5.0}, "count")],
)
def test_what_exceeds_oler_is_refused(few: int, most: int, required: dict[str, Any], field: str) -> None:
    """What stands in rows and columns is placed, more than the bound refused, though circles fit."""
    assert check_placement(place(yard(group("people", "civilian", few, **required)))) == []
    clash = clash_of(yard(group("people", "civilian", most, **required)))
    assert clash == {"world.area", f"actors[people].{field}"}


def test_sizes_mixed_are_counted_from_the_largest() -> None:
    """People in between do not hide that trees and sheds that want ten metres round them are too many."""
    kinds = [group("trees", "tree", 6, separation_m=14.0), group("sheds", "shed", 6, separation_m=14.0)]
    clash = clash_of(yard(group("people", "civilian", 3), *kinds))

    assert clash == {"world.area", "actors[trees].count", "actors[sheds].count"}


def test_trucks_in_one_lane_are_counted() -> None:
    """A lane of 80 m holds 11 trucks; 14 have the area for it, and are refused."""
    lane = road((-10.0, 20.0), (70.0, 20.0), width_m=4.9)
    wide = ((-10, 0), (70, 0), (70, 40), (-10, 40))

    def trucks(count: int) -> SimSpec:
        along = {"road": "main", "parallel_deg": 2}
        return yard(group("trucks", "military-truck", count, along=along), roads=[lane], area=wide)

    assert check_placement(place(trucks(8))) == []
    fields = {"actors[trucks].count", "actors[trucks].placement.along.parallel_deg"}
    assert fields <= clash_of(trucks(14))


EAST = road((0.0, 20.0), (40.0, 20.0))
BENT = road((0.0, 10.0), (20.0, 10.0), (20.0, 40.0))


@pytest.mark.parametrize(
    ("lane", "facing", "region", "clashes"),
    [
        (EAST, {"heading_deg": 0.0, "within_deg": 70.0}, None, True),
        (EAST, {"heading_deg": 0.0, "within_deg": 85.0}, None, False),
        (EAST, {"heading_deg": 275.0, "within_deg": 5.0}, None, False),
        (BENT, {"heading_deg": 45.0, "within_deg": 30.0}, None, True),
        (BENT, {"heading_deg": 180.0, "within_deg": 5.0}, None, False),
        (EAST, {"point": {"east_m": 20.0, "north_m": 900.0}, "within_deg": 20.0}, None, True),
        (EAST, {"point": {"east_m": 20.0, "north_m": 30.0}, "within_deg": 20.0}, None, False),
        (
            BENT,
            {"point": {"east_m": 900.0, "north_m": 10.0}, "within_deg": 5.0},
            corners(14, 25, 26, 40),
            True,
        ),
        (BENT, {"of": "radar", "within_deg": 40.0}, None, False),
    ],
)
def test_headings_that_clash(
    lane: dict[str, Any], facing: dict[str, Any], region: Any, clashes: bool
) -> None:
    """Along a road within ten degrees and facing elsewhere: refused with both fields, or found."""
    placement = {"along": {"road": "main", "parallel_deg": 10.0}, "facing": facing}
    if region:
        placement["region"] = region
    radar = group("radar", "radar-vehicle", region=corners(24, 22, 40, 38))
    simspec = yard(group("cars", "civilian-car", 2, **placement), radar, roads=[lane])

    if not clashes:
        assert check_placement(place(simspec)) == []
        return
    with pytest.raises(PlacementInfeasible, match="impossible, and proved so") as refused:
        place(simspec)
    clash = set(refused.value.clash)
    assert {"actors[cars].placement.along.parallel_deg", "actors[cars].placement.facing"} <= clash
    assert not any("radar" in path for path in clash)


NEAR_RADAR = {"of": "radar", "max_m": 6.0}
FAR = {"of": "radar", "min_m": 10.0, "max_m": 100.0}


@pytest.mark.parametrize(
    ("required", "fields"),
    [
        ({"near": NEAR_RADAR, "away": FAR}, {"near", "away"}),
        (
            {"distances": [{**NEAR_RADAR, "whom": "some"}, {"of": "radar", "min_m": 10.0}]},
            {"distances[0]", "distances[1]"},
        ),
        ({"away": FAR, "mean_distance": {"of": "radar", "mean_m": 9.0}}, {"away", "mean_distance"}),
        ({"near": {**FAR, "of": "home"}, "distances": [{**NEAR_RADAR, "of": "home"}]}, None),
    ],
)
def test_distances_that_exclude_each_other(required: dict[str, Any], fields: set[str] | None) -> None:
    """No place is near somebody and far from everybody of the same group; both fields are named."""
    clash = clash_of(yard(group("people", "civilian", 3, **required), group("radar", "radar-vehicle", 2)))

    assert clash
    assert fields is None or clash == {f"actors[people].placement.{name}" for name in fields}


def test_distances_to_different_members_exclude_nothing() -> None:
    """Near one of two and far from some member, or from nobody: that can be kept, and is."""
    bands = {"near": NEAR_RADAR, "distances": [{"of": "radar", "whom": "some", "min_m": 10.0}]}
    apart = group("radar", "radar-vehicle", 2, spread_m=20.0)
    assert check_placement(place(yard(group("people", "civilian", 3, **bands), apart))) == []
