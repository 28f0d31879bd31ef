"""Members admitted in runs are those that would be admitted one at a time; grounds that scenes share stay as they are."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import shapely

from bench.realization.placement._footprint import Footprints, footprints
from bench.realization.placement._geometry import polygon_ground, prepared_ground
from bench.realization.placement.search._selection import ChosenMembers
from bench.simspec import ASSETS, Placement, Point, Polygon


def _admitted_alone(
    crowd: ChosenMembers, pool: Footprints, order: list[int], until: int
) -> tuple[list[int], Footprints]:
    admitted = []
    for index in order:
        candidate = pool[np.array([index])]
        if crowd.count < until and crowd.fits(candidate):
            crowd.put(crowd.count, candidate)
            crowd.count += 1
            admitted.append(index)
    return admitted if crowd.count == until else [], crowd.members()


@pytest.mark.parametrize("asset", ["civilian", "house"])
@pytest.mark.parametrize("side_m", [12.0, 60.0, 600.0], ids=["jammed", "crowded", "open"])
@pytest.mark.parametrize(
    "wishes",
    [{}, {"separation_m": 4.0}, {"spread_m": 9.0}, {"extent_m": 40.0}, {"spread_m": 2.0, "extent_m": 25.0}],
    ids=str,
)
def test_members_admitted_in_runs_are_those_admitted_alone(
    asset: str, side_m: float, wishes: dict[str, Any]
) -> None:
    """In two pools after another, in orders of their own, as sampling and the choice by mean distance admit them."""
    rng = np.random.default_rng(round(side_m))
    placement = Placement(**wishes)
    runs, alone = ChosenMembers.of(40, placement), ChosenMembers.of(40, placement)
    for until in (15, 40):
        places_m = np.round(rng.uniform(0.0, side_m, (90, 2)), 3)
        pool = footprints(ASSETS[asset], places_m, rng.uniform(0.0, 360.0, 90), placement.separation_m)
        order = rng.permutation(90)
        admitted = runs.admit(pool, order, until)
        assert (admitted, runs.members().centre_m.tolist()) == (
            (expected := _admitted_alone(alone, pool, order.tolist(), until))[0],
            expected[1].centre_m.tolist(),
        )
        assert runs.members().heading_rad.tolist() == alone.members().heading_rad.tolist()
        assert runs.count == alone.count


def test_grounds_that_scenes_share_are_prepared_for_one_thread_alone() -> None:
    """Equal polygons share a ground that nobody prepares; each thread has a prepared one of its own."""
    corners = ((0.0, 0.0), (30.0, 0.0), (30.0, 20.0))
    first, second = (
        Polygon(corners=tuple(Point(east_m=east_m, north_m=north_m) for east_m, north_m in corners))
        for _ in range(2)
    )
    prepared = prepared_ground(first)
    with ThreadPoolExecutor(1) as other:
        elsewhere = other.submit(prepared_ground, first).result()

    assert polygon_ground(first) is polygon_ground(second)
    assert not shapely.is_prepared(polygon_ground(first))
    assert prepared is prepared_ground(second)
    assert shapely.is_prepared(prepared)
    assert shapely.is_prepared(elsewhere)
    assert elsewhere is not prepared
    assert elsewhere.equals(prepared)
