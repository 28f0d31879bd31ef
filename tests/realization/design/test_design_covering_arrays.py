"""Covering arrays: every combination of so many factors, and nothing that is forbidden."""

from __future__ import annotations

import itertools

import pytest
from design_plans import FORBID, TANGLED, design, levels, refused

from bench.realization import DesignPoint


def occurring(points: list[DesignPoint], names: tuple[str, ...]) -> set[tuple[object, ...]]:
    return {tuple(point.levels[name] for name in names) for point in points}


@pytest.mark.parametrize(
    ("sizes", "strength", "max_runs"),
    [
        ([3] * 4, 2, 11),
        ([2] * 10, 2, 10),
        ([3] * 13, 2, 23),
        ([5, 4, 3, 2, 2], 2, 22),
        ([3] * 6, 3, 52),
        ([2] * 8, 4, 40),
        ([4, 3], 4, 12),
        ([4, 3, 2], 1, 4),
    ],
)
def test_covering_arrays_cover_everything(sizes: list[int], strength: int, max_runs: int) -> None:
    """Every combination of levels of any t factors, in a number of points near to what is known."""
    factors = [levels(f"f{place}", *range(size)) for place, size in enumerate(sizes)]
    points = design(factors, method={"kind": "covering_array", "strength": strength}).points()

    t = min(strength, len(sizes))
    for chosen in itertools.combinations(range(len(sizes)), t):
        combinations = set(itertools.product(*(range(sizes[at]) for at in chosen)))
        assert occurring(points, tuple(f"f{at}" for at in chosen)) == combinations
    assert len(points) <= max_runs


@pytest.mark.parametrize("strength", [2, 3])
def test_covering_arrays_keep_what_is_forbidden_out(strength: int) -> None:
    """With conditional factors, formulas, prohibitions: all that can be, by every point there is."""
    full = design(TANGLED, forbid=FORBID).points()
    points = design(TANGLED, forbid=FORBID, method={"kind": "covering_array", "strength": strength}).points()

    names = ("gps", "noise", "approach", "fog", "night")
    for chosen in itertools.combinations(names, strength):
        assert occurring(points, chosen) == occurring(full, chosen)
    assert len(points) < len(full)


def test_covering_array_that_cannot_be() -> None:
    """Everything forbidden, and too much to cover, are message."""
    method = {"kind": "covering_array"}
    assert "everything is forbidden" in refused([levels("a", 1, 2)], forbid=["a < 5"], method=method)
    factors = [levels(f"f{place}", *range(30)) for place in range(6)]
    assert "lower strength" in refused(factors, method={"kind": "covering_array", "strength": 4})
