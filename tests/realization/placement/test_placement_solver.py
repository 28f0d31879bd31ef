"""Scenes in which sampling stalls: the solver finds them, says that it did, and finds the same again."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time

import pytest
from yards import YARDS, group, scene, written

from bench.documents import dump_json
from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.search._solver import solve_placement
from bench.simspec import SimSpec


def dense(name: str) -> SimSpec:
    fields = dict(YARDS["dense"][name])
    return scene(*written(fields.pop("groups")), **fields)


@pytest.mark.parametrize("name", YARDS["dense"])
def test_dense_scenes_are_found(name: str) -> None:
    """The solver's places pass the check that knows nothing of it, and the document says who found them."""
    placed = place(dense(name))

    assert placed.realized is not None
    assert placed.realized.method == "cp-sat"
    assert check_placement(placed) == []


def test_same_seed_same_bytes_in_another_process() -> None:
    """The same seed gives the same document with another order of hashes; another seed another."""
    simspec = dense("ties between them")
    program = (
        "import sys, hashlib; from bench.simspec import SimSpec; from bench.realization import place; "
        "from bench.documents import dump_json; "
        "text = dump_json(place(SimSpec.model_validate_json(sys.stdin.read()))); "
        "print(hashlib.sha256(text.encode()).hexdigest())"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", program],
            input=dump_json(simspec),
            env={"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for seed in ("1", "2")
    }

    assert digests == {hashlib.sha256(dump_json(place(simspec)).encode()).hexdigest()}
    other = simspec.model_copy(update={"seeds": simspec.seeds.model_copy(update={"root": 2})})
    assert place(other).realized != place(simspec).realized


def test_what_is_sampled_says_so() -> None:
    """An easy scene never sees the solver."""
    realized = place(scene(group("people", "civilian", 10))).realized

    assert realized is not None
    assert realized.method == "sampling"


def test_not_found_is_not_called_impossible() -> None:
    """Twelve houses tile the yard, home stands in one of the places: nobody knows, and it says so."""
    began = time.process_time()
    with pytest.raises(PlacementInfeasible, match=r"no places were found.*: .* crowd each other") as refused:
        place(scene(group("houses", "house", 11, separation_m=0.0), size_m=36.0))

    assert not refused.value.proved
    assert refused.value.clash == ()
    assert time.process_time() - began < 10.0


@pytest.mark.parametrize("seed", range(3))
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
