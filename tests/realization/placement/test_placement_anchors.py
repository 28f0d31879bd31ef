"""Members that others need nearby: placed where they help."""

from __future__ import annotations

from typing import Any

import pytest

from bench.documents import validate_document
from bench.realization import check_placement, place
from bench.simspec import SimSpec

SIDE_M = 120.0


def pinned_radar(seed: int, trees: int, near_m: float, *, pinned_by: str) -> SimSpec:
    """A radar that can stand at one point and near one of some free trees; a second near another kind."""
    corners = ((-SIDE_M, -SIDE_M), (SIDE_M, -SIDE_M), (SIDE_M, SIDE_M), (-SIDE_M, SIDE_M))
    point = {"east_m": 20.0, "north_m": 30.0}
    tight = [
        {"east_m": 20.0 + e, "north_m": 30.0 + n}
        for e, n in ((-4.3, -4.3), (4.3, -4.3), (4.3, 4.3), (-4.3, 4.3))
    ]
    pins: dict[str, dict[str, Any]] = {
        "point": {"distances": [{"point": point, "max_m": 0.01}]},
        "region": {"region": {"corners": tight}},
    }
    return validate_document(
        {
            "name": "pinned",
            "world": {"area": {"corners": [{"east_m": east, "north_m": north} for east, north in corners]}},
            "vehicle": {"home": {"east_m": -110.0, "north_m": -110.0}},
            "actors": [
                {"id": "trees", "asset": "tree", "role": "clutter", "count": trees},
                {"id": "crates", "asset": "crate", "role": "clutter", "count": 3},
                {"id": "sheds", "asset": "shed", "role": "clutter", "count": 3},
                {"id": "radar", "asset": "radar-vehicle", "role": "adversary", "count": 1,
                 "placement": {"near": {"of": "trees", "max_m": near_m}, **pins[pinned_by]}},
                {"id": "truck", "asset": "military-truck", "role": "adversary", "count": 1,
                 "placement": {"distances": [{"of": "crates", "whom": "some", "max_m": 9.0}, {"point": {"east_m": -80.0, "north_m": 0.0}, "max_m": 0.5}]}},
            ],
            "seeds": {"root": seed},
        },
        SimSpec,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("trees", "pinned_by", "seeds"), [(1, "point", 1), (2, "point", 3), (9, "region", 3)]
)
def test_a_pinned_radar_near_a_free_tree_is_found_on_every_seed(
    trees: int, pinned_by: str, seeds: int
) -> None:
    for seed in range(seeds):
        placed = place(pinned_radar(seed, trees, 9.0, pinned_by=pinned_by))
        assert check_placement(placed) == []
