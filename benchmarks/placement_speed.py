"""How long placement takes: CPU seconds of one core, on scenes that are easy, dense, impossible or many.

python benchmarks/placement_speed.py [REALIZATIONS]

The solver's import (once in a process) is told apart. The last line designs, places and writes so many
realizations of the paper's experiment, 10000 unless told otherwise, in two processes as `rebar realize` does,
and says how long that takes.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.campaign import CampaignFolder, load_campaign, write_scenes
from bench.documents import validate_document
from bench.realization import Design, PlacementInfeasible, place, realize
from bench.simspec import SimSpec

PAPER = Path(__file__).parents[1] / "campaigns" / "paper.yaml"


def square(west: float, south: float, side: float) -> dict[str, Any]:
    """A square region as a document has it."""
    places = ((west, south), (west + side, south), (west + side, south + side), (west, south + side))
    return {"corners": [{"east_m": e, "north_m": n} for e, n in places]}


def yard(side_m: float, *groups: tuple[str, str, int, dict[str, Any]], seed: int = 1) -> SimSpec:
    """A square yard with groups in it."""
    actors = [{"id": i, "asset": a, "role": "clutter", "count": n, "placement": p} for i, a, n, p in groups]
    document = {
        "name": "yard",
        "world": {"area": square(0, 0, side_m)},
        "actors": actors,
        "seeds": {"root": seed},
    }
    return validate_document(document, SimSpec)


def outcome(simspec: SimSpec) -> str:
    """How placement ended."""
    try:
        placed = place(simspec)
    except PlacementInfeasible as refused:
        return "refused with proof" if refused.proved else "not found"
    assert placed.realized is not None
    return f"found by {placed.realized.method}"


def timed(name: str, work: Callable[[int], str], times: int) -> None:
    """Print the mean and the worst of some seeds, and how they ended."""
    spent, ends = [], set()
    for seed in range(times):
        began = time.process_time()
        ends.add(work(seed))
        spent.append(time.process_time() - began)
    print(
        f"{name:58} {1e3 * sum(spent) / times:9.1f} ms  {1e3 * max(spent):9.1f} ms  {', '.join(sorted(ends))}"
    )


def sixty(side_m: float) -> Callable[[int], str]:
    """Sixty crates in a square."""
    return lambda seed: outcome(yard(side_m, ("crates", "crate", 60, {"separation_m": 0.0}), seed=seed))


def mixed(seed: int) -> str:
    """Houses, sheds and trees over 60 % of their ground."""
    kinds = (("houses", "house"), ("sheds", "shed"), ("trees", "tree"))
    return outcome(
        yard(69.3, *((name, asset, 20, {"separation_m": 0.0}) for name, asset in kinds), seed=seed)
    )


def at_home(seed: int) -> str:
    """Half of a yard under houses, people in them near a post at its edge, and others between two of the
    houses.
    """
    return outcome(
        yard(
            66.0,
            ("houses", "house", 20, {"separation_m": 0.2}),
            ("post", "crate", 1, {"region": square(0, 0, 12)}),
            ("families", "civilian", 40, {"inside": {"of": "houses"}, "near": {"of": "post", "max_m": 30}}),
            (
                "neighbours",
                "civilian",
                4,
                {"between": {"first": "houses", "second": "houses", "within_m": 8}},
            ),
            seed=seed,
        )
    )


def north_of_the_north(seed: int) -> str:
    """People who would have to stand outside the area."""
    house = ("house", "house", 1, {"region": square(40, 80, 20)})
    sector = {
        "bearing": {"of": "house", "from_deg": 315, "to_deg": 45},
        "near": {"of": "house", "min_m": 25, "max_m": 60},
    }
    return outcome(yard(100.0, house, ("people", "civilian", 5, sector), seed=seed))


def overfull(seed: int) -> str:
    """Two groups that fit their regions each, and not both."""
    return outcome(
        yard(
            100.0,
            ("a", "house", 10, {"region": square(0, 0, 40)}),
            ("b", "house", 10, {"region": square(10, 0, 40)}),
            ("trees", "tree", 5, {"region": square(60, 60, 30)}),
            seed=seed,
        )
    )


def main(count: int) -> None:
    """Print one line for each kind of scene."""
    began = time.process_time()
    import bench.realization.placement.search._solver  # noqa: F401

    print(f"{'import of the solver, once':58} {1e3 * (time.process_time() - began):9.1f} ms")
    paper = load_campaign(PAPER)
    print(f"{'scene':58} {'mean':>12}  {'worst':>12}")
    base = paper.base
    assert base is not None
    outcome(base)
    seeds = [
        base.model_copy(update={"seeds": base.seeds.model_copy(update={"root": seed})}) for seed in range(30)
    ]
    timed("the paper's experiment, some 90 actors", lambda seed: _placed(seeds[seed]), 30)
    timed("60 crates at 60 % fill, no gap asked for", sixty(24.0), 5)
    timed("60 crates at 50 % fill", sixty(26.3), 5)
    timed("20 houses, 20 sheds, 20 trees at 60 % fill", mixed, 5)
    timed("20 houses at 50 % fill, 40 people in some, 4 between two", at_home, 5)
    timed("impossible by bearing and distance", north_of_the_north, 5)
    timed("impossible by areas that regions share", overfull, 5)
    timed(
        "1000 people in a yard of 20 by 20 m",
        lambda seed: outcome(yard(20, ("p", "civilian", 1000, {}), seed=seed)),
        5,
    )
    timed(
        "1000 people in a yard of 40 by 40 m",
        lambda seed: outcome(yard(40, ("p", "civilian", 1000, {}), seed=seed)),
        2,
    )
    _many(paper.design, base, paper.agents[:1], count)


def _placed(simspec: SimSpec) -> str:
    placed = place(simspec).realized
    assert placed is not None
    return f"found by {placed.method}"


def _many(design: Design, base: SimSpec, agents: Any, count: int) -> None:
    wall = time.perf_counter()
    levels = design.model_dump() | {"replicates": -(-count // 72), "method": {"kind": "full_factorial"}}
    digest = hashlib.sha256()
    with tempfile.TemporaryDirectory() as folder:
        plans = realize(base, validate_document(levels, Design), agents)[:count]
        refused = write_scenes(plans, CampaignFolder(Path(folder)), 2)
        host = time.perf_counter() - wall
        for plan in plans:
            digest.update(CampaignFolder(Path(folder)).simspec(plan.id).read_bytes())
    print(
        f"{len(plans)} realizations designed, placed, written by two processes: {host:.1f} s, {len(refused.infeasible)} refused"
    )
    print(f"SHA-256 of them all: {digest.hexdigest()}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
