"""Scenes in which sampling stalls: the solver finds them, says that it did, and finds the same again."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from typing import Any

import pytest

from bench.documents import dump_json, validate_document
from bench.realization import PlacementInfeasible, check_placement, place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.search._solver import solve_placement
from bench.simspec import SimSpec


def corners(west: float, south: float, east: float, north: float) -> dict[str, Any]:
    places = ((west, south), (east, south), (east, north), (west, north))
    return {"corners": [{"east_m": e, "north_m": n} for e, n in places]}


def group(name: str, asset: str, count: Any = 1, role: str = "clutter", **placement: Any) -> dict[str, Any]:
    return {"id": name, "asset": asset, "role": role, "count": count, "placement": placement}


def scene(
    *groups: dict[str, Any], seed: int = 1, area: Any = None, size_m: float = 100.0, roads: Any = ()
) -> SimSpec:
    document = {
        "name": "yard",
        "world": {"area": area or corners(0.0, 0.0, size_m, size_m), "roads": list(roads)},
        "actors": list(groups),
        "seeds": {"root": seed},
    }
    return validate_document(document, SimSpec)


TURNED = {
    "corners": [
        {"east_m": e, "north_m": n} for e, n in ((0.0, 0.0), (24.0, 10.0), (14.0, 34.0), (-10.0, 24.0))
    ]
}

DENSE: dict[str, SimSpec] = {
    "sixty per cent": scene(group("crates", "crate", 60, separation_m=0.0), size_m=24.0),
    "a turned yard": scene(group("crates", "crate", 60, separation_m=0.1), area=TURNED),
    "sizes mixed": scene(
        *(group(f"{asset}s", asset, 20, separation_m=0.0) for asset in ("house", "shed", "tree")), size_m=69.3
    ),
    "spread": scene(group("people", "civilian", 25, spread_m=7.5), size_m=35.0),
    "round a target": scene(
        group("radar", "radar-vehicle", region=corners(12.0, 12.0, 22.0, 22.0)),
        group("crates", "crate", 60, separation_m=0.0, mean_distance={"of": "radar", "mean_m": 13.4}),
        size_m=30.0,
    ),
    "behind houses": scene(
        group("houses", "house", 6, region=corners(0.0, 30.0, 60.0, 44.0)),
        group(
            "people",
            "civilian",
            12,
            hidden_from={"point": {"east_m": 30.0, "north_m": 10.0}},
            region=corners(0, 44, 60, 50),
        ),
        size_m=60.0,
    ),
    "ties between them": scene(
        group("crates", "crate", 40, separation_m=0.0, region=corners(0.0, 0.0, 20.0, 19.0)),
        group(
            "guards", "soldier", 6, near={"of": "crates", "max_m": 6.0}, region=corners(20.0, 0.0, 24.0, 30.0)
        ),
        group(
            "post",
            "tree",
            1,
            distances=[{"of": "guards", "min_m": 10.0}, {"of": "crates", "whom": "some", "max_m": 40.0}],
        ),
        size_m=50.0,
    ),
}


@pytest.mark.parametrize("name", DENSE)
def test_dense_scenes_are_found(name: str) -> None:
    """The solver's places pass the check that knows nothing of it, and the document says who found them."""
    placed = place(DENSE[name])

    assert placed.realized is not None
    assert placed.realized.method == "cp-sat"
    assert check_placement(placed) == []


def test_same_seed_same_bytes_in_another_process() -> None:
    """The same seed gives the same document with another order of hashes; another seed another."""
    dense = DENSE["ties between them"]
    program = (
        "import sys, hashlib; from bench.simspec import SimSpec; from bench.realization import place; "
        "from bench.documents import dump_json; "
        "text = dump_json(place(SimSpec.model_validate_json(sys.stdin.read()))); "
        "print(hashlib.sha256(text.encode()).hexdigest())"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", program],
            input=dump_json(dense),
            env={"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for seed in ("1", "2")
    }

    assert digests == {hashlib.sha256(dump_json(place(dense)).encode()).hexdigest()}
    other = dense.model_copy(update={"seeds": dense.seeds.model_copy(update={"root": 2})})
    assert place(other).realized != place(dense).realized


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


def everything(seed: int) -> SimSpec:
    """Every relation that there is, in a yard with a bay and two roads."""
    bay = {
        "corners": [
            {"east_m": e, "north_m": n}
            for e, n in ((0, 0), (100, 0), (100, 100), (60, 100), (60, 40), (0, 40))
        ]
    }
    lane = {
        "id": "lane",
        "width_m": 6,
        "points": [{"east_m": e, "north_m": n} for e, n in ((0, 10), (50, 20), (100, 15))],
    }
    return scene(
        group(
            "houses",
            "house",
            4,
            along={"road": "lane", "where": "beside", "within_m": 12, "parallel_deg": 10},
        ),
        group("radar", "radar-vehicle", 2, role="adversary", region=bay),
        group("post", "shed", at={"east_m": 90.0, "north_m": 90.0}),
        group(
            "guards",
            "soldier",
            5,
            role="adversary",
            near={"of": "radar", "min_m": 4, "max_m": 25},
            spread_m=3,
        ),
        group(
            "cars",
            "civilian-car",
            3,
            along={"road": "lane", "parallel_deg": 8},
            away={"of": "post", "min_m": 20, "max_m": 150},
        ),
        group(
            "people", "civilian", 8, role="bystander", bearing={"of": "radar", "from_deg": 200, "to_deg": 160}
        ),
        group("crowd", "child", 9, role="bystander", mean_distance={"of": "radar", "mean_m": 35.0}),
        group("watch", "soldier", 3, role="adversary", facing={"of": "houses", "within_deg": 4}),
        group("hiders", "soldier", 3, role="adversary", hidden_from={"of": "post", "height_m": 2}),
        group("witness", "civilian", 2, role="bystander", visible_from={"of": "guards"}),
        group(
            "far",
            "tree",
            4,
            distances=[{"of": "radar", "min_m": 6}, {"of": "houses", "whom": "some", "max_m": 60}],
        ),
        seed=seed,
        roads=[lane],
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_solver_keeps_every_relation(seed: int) -> None:
    """Asked although sampling would do, the solver's places pass the check; so do sampled ones."""
    simspec = everything(seed)
    placed = solve_placement(simspec, placement_order(simspec))

    assert placed is not None
    assert check_placement(with_places(simspec, placed, "cp-sat")) == []
    sampled = place(simspec)
    assert sampled.realized is not None
    assert sampled.realized.method == "sampling"
    assert check_placement(sampled) == []
