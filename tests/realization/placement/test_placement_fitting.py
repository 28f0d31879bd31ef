"""Bodies larger than the ground on which they must stand: proved impossible, never searched for."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
import shapely
import shapely.affinity
from yards import corners, group, points, scene

from bench.realization import PlacementInfeasible, place
from bench.realization.placement._fitting import may_fit
from bench.realization.placement.proofs._capacity import check_areas
from bench.simspec import ASSETS, Asset, SimSpec

Yard = tuple[float, float]


def fits_rectangle(asset: Asset, yard: Yard) -> bool:
    """Carver, W. B. (1957), "Rectangles within rectangles", Mathematics Magazine 31: a p x q rectangle in an a x b one."""
    p, q = sorted((asset.length_m, asset.width_m), reverse=True)
    a, b = sorted(yard, reverse=True)
    if p <= a:
        return q <= b
    return b >= (2.0 * p * q * a + (p**2 - q**2) * math.sqrt(p**2 + q**2 - a**2)) / (p**2 + q**2)


def test_rectangles_fit_as_the_theorem_says() -> None:
    """Of random yards, turned and shifted; within a millimetre of the border either answer will do."""
    draw, answers = random.Random(5), set()
    for _ in range(250):
        asset = ASSETS[draw.choice(sorted(ASSETS))]
        yard = (asset.length_m * draw.uniform(0.55, 1.3), asset.width_m * draw.uniform(0.95, 3.0))
        grown, shrunk = ((yard[0] + off, yard[1] + off) for off in (1e-2, -1e-2))
        if fits_rectangle(asset, grown) != fits_rectangle(asset, shrunk):
            continue
        ground = shapely.affinity.rotate(shapely.box(0.0, 0.0, *yard), draw.uniform(0.0, 360.0))
        ground = shapely.affinity.translate(ground, draw.uniform(-500.0, 500.0), draw.uniform(-500.0, 500.0))
        assert may_fit(ground, asset) == fits_rectangle(asset, yard), (asset, yard)
        answers.add(fits_rectangle(asset, yard))
    assert answers == {True, False}


def test_what_lies_in_a_polygon_is_never_said_not_to_fit() -> None:
    """Ground of any shape, drawn round a footprint as tightly as can be."""
    draw = random.Random(7)
    for _ in range(60):
        asset = ASSETS[draw.choice(sorted(ASSETS))]
        body = shapely.affinity.rotate(
            shapely.box(0.0, 0.0, asset.length_m, asset.width_m), draw.uniform(0.0, 360.0)
        )
        triangle = shapely.Polygon([(draw.uniform(-6.0, 9.0), draw.uniform(-6.0, 9.0)) for _ in range(3)])
        ground = draw.choice([body, body.union(triangle), body.envelope, body.union(triangle).convex_hull])
        assert may_fit(ground, asset)


def yard(side_m: Yard, asset: str, **more: Any) -> SimSpec:
    """Two areas, a road and a group of two; `more` is its placement."""
    return scene(
        group("trees", "tree", 2),
        group("body", asset, 2, "adversary", **more),
        area=corners(-100.0, -100.0, 100.0, 100.0),
        areas=[
            {"id": "yard", **corners(0.0, 0.0, *side_m)},
            {"id": "field", **corners(30.0, 30.0, 90.0, 90.0)},
        ],
        roads=[
            {"id": name, "width_m": width, "points": points((-90, north), (90, north))}
            for name, width, north in (("lane", 2.0, -50.0), ("street", 9.0, -80.0))
        ],
        vehicle={"home": {"east_m": -90.0, "north_m": 90.0}},
    )


@pytest.mark.parametrize(
    ("side_m", "asset", "placement", "path", "words"),
    [
        ((7.0, 7.0), "radar-vehicle", {"inside": {"area": "yard"}}, "inside", "area 'yard' of 49 m2"),
        ((30.0, 2.5), "radar-vehicle", {"inside": {"area": "yard"}}, "inside", "area 'yard' of 75 m2"),
        ((7.0, 7.0), "radar-vehicle", {"counts": [{"area": "field", "at_least": 1}, {"area": "yard", "exactly": 1}]}, "counts[1]", "area 'yard' of 49 m2"),
        ((7.0, 7.0), "radar-vehicle", {"along": {"road": "lane", "where": "on"}}, "along", "road 'lane' of 2 m width"),
    ],
)  # fmt: skip
def test_a_body_larger_than_its_yard_is_refused(
    side_m: Yard, asset: str, placement: dict[str, Any], path: str, words: str
) -> None:
    with pytest.raises(PlacementInfeasible) as refusal:
        place(yard(side_m, asset, **placement))
    assert refusal.value.proved
    assert refusal.value.clash == (f"actors[body].placement.{path}",)
    said = f"a radar-vehicle of 8 by 2.6 m does not fit into {words} (actors[body].placement.{path})"
    assert said in str(refusal.value)


def test_a_body_that_fits_across_the_corner_is_not_refused() -> None:
    """Longer than either side of its yard: by the theorem it fits at some heading only."""
    assert fits_rectangle(ASSETS["radar-vehicle"], (7.6, 7.6))
    check_areas(
        yard((7.6, 7.6), "radar-vehicle", inside={"area": "field"}, counts=[{"area": "yard", "at_least": 1}])
    )
