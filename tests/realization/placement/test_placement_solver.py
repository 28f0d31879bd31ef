"""Scenes in which sampling stalls: the solver finds them, says that it did, and finds the same again."""

from __future__ import annotations

import time

import pytest
from yards import YARDS, dense, group, scene, written

from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.search._solver import solve_placement


@pytest.mark.parametrize("name", YARDS["dense"])
def test_dense_scenes_are_found(name: str) -> None:
    """The solver's places pass the check that knows nothing of it, and the document says who found them."""
    placed = place(dense(name))

    assert placed.realized is not None
    assert placed.realized.method == "cp-sat"
    assert check_placement(placed) == []


@pytest.mark.parametrize("name", YARDS["anchored"])
def test_who_can_stand_at_one_place_only_is_found_on_every_seed(name: str) -> None:
    """Those whom others need nearby are placed where they help."""
    for seed in range(2):
        placed = place(scene(*written(YARDS["anchored"][name]), seed=seed, size_m=240.0))
        assert check_placement(placed) == []


def test_not_found_is_not_called_impossible() -> None:
    """Twelve houses tile the yard, home stands in one of the places: nobody knows, and it says so."""
    began = time.process_time()
    with pytest.raises(
        PlacementInfeasible,
        match=r"no places were found.*: .* of 11 members found a place.* crowd each other",
    ) as refused:
        place(scene(group("houses", "house", 11, separation_m=0.0), size_m=36.0))

    assert not refused.value.proved
    assert refused.value.clash == ()
    assert time.process_time() - began < 10.0


@pytest.mark.parametrize("seed", range(2))
def test_the_solver_keeps_every_relation(seed: int) -> None:
    """Asked although sampling would do, the solver's places pass the check; so do sampled ones."""
    simspec = scene(*written(YARDS["everything"]), seed=seed)
    placed = solve_placement(simspec, placement_order(simspec))

    assert placed is not None
    assert check_placement(with_places(simspec, placed, "cp-sat")) == []
    sampled = place(simspec)
    assert sampled.realized is not None
    assert sampled.realized.method == "sampling"
    assert check_placement(sampled) == []
