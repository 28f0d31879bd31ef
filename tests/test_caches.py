"""Every cache answers as the work it saves: each input that changes the value changes the key."""

from __future__ import annotations

import ast
import importlib
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely

from agent_adapters.reference.flight._airspace import Airspace, block_round
from bench.contracts import Lens
from bench.scoring._arrays import _DocumentKey
from bench.simspec import ASSETS, Polygon, load_simspec
from decompositions import Decomposition, decomposition_of, load_decomposition

ROOT = Path(__file__).parents[1]
ROOMS = ("bench", "vehicle_models", "test_ports", "agent_adapters", "decompositions")
WORDS = "bench/instance_analysis"


def square(side_m: float) -> Polygon:
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (side_m, 0), (side_m, side_m), (0, side_m))]
    return Polygon.model_validate({"corners": corners})


def stricter(decomposition: Decomposition) -> Decomposition:
    """The same nodes with another threshold of one observable."""
    document = decomposition.document.model_dump(mode="json")
    document["observables"][0]["threshold"] = 0.123
    return decomposition_of(type(decomposition.document).model_validate(document))


def changed_counts(points: int, others: int) -> tuple[tuple[int, int, int], ...]:
    """Points, factors and a seed; then another number of each."""
    return (points, 3, 1), (others, 3, 1), (points, 4, 1), (points, 3, 2)


DECOMPOSITION = load_decomposition("search-and-report")
CORNERS = tuple((corner.east_m, corner.north_m) for corner in square(9.0).corners)
LENS = Lens("test", 320, 240, 300.0, 303.0, 163.5, 117.75, (-0.05, 0.01, 0.0, 0.0, 0.0))
# Calls that differ in one argument from the first: by function, with its module.
CALLS: dict[str, tuple[tuple[Any, ...], ...]] = {
    "bench.camera._looks._geometry": (
        ("man", "", "standing", 1.0, 0),
        ("woman", "", "standing", 1.0, 0),
        ("man", ASSETS["crate"].model_dump_json(), "box", 1.0, 0),
        ("man", ASSETS["house"].model_dump_json(), "box", 1.0, 0),
        ("man", "", "walking", 1.0, 0),
        ("man", "", "standing", 1.1, 0),
        ("man", "", "standing", 1.0, 3),
    ),
    "bench.contracts._rendering._view_radius": (
        (LENS,),
        *((replace(LENS, **{name: getattr(LENS, name) * 1.25}),) for name in ("fx", "fy", "cx", "cy")),
        (replace(LENS, width_px=500),),
        (replace(LENS, height_px=400),),
        (replace(LENS, distortion=(-0.1, 0.0, 0.0, 0.0, 0.0)),),
    ),
    "bench.realization.design._fractional_factorial._search": ((9, 4, 3), (8, 4, 3), (9, 5, 3), (9, 4, 4)),
    "bench.realization.design._orthogonal_hypercubes._maximin_columns": changed_counts(17, 33),
    "bench.realization.design._orthogonal_hypercubes.nearly_orthogonal_latin_hypercube": changed_counts(
        12, 13
    ),
    "bench.realization.design._space_filling._latin": changed_counts(12, 13),
    "bench.realization.placement._check_geometry.grown_polygon": ((square(9.0),), (square(8.0),)),
    "bench.realization.placement._fitting.may_fit": (
        (shapely.box(0.0, 0.0, 3.0, 3.0), ASSETS["civilian-car"]),
        (shapely.box(0.0, 0.0, 9.0, 9.0), ASSETS["civilian-car"]),
        (shapely.box(0.0, 0.0, 3.0, 3.0), ASSETS["civilian"]),
    ),
    "bench.realization.placement._geometry._ground": ((CORNERS,), (CORNERS[:3],)),
    "bench.realization.placement._geometry._prepared_ground": ((CORNERS, 1), (CORNERS[:3], 1)),
    "bench.realization.placement._geometry.is_convex": (
        (shapely.box(0, 0, 1, 1),),
        (shapely.Polygon([(0, 0), (4, 0), (1, 1), (0, 4)]),),
    ),
    "bench.realization.placement.proofs._capacity._offered_m2": tuple(
        (square(side_m), space_m) for side_m, space_m in ((9.0, 1.0), (8.0, 1.0), (9.0, 2.0))
    ),
    "bench.reporting.statistics._design_quality._placed_features": tuple(
        (load_simspec(ROOT / "campaigns" / "standard" / name).model_dump_json(),)
        for name in ("search-1.yaml", "search-2.yaml")
    ),
    "bench.scoring._arrays._arrays": tuple(
        (_DocumentKey(tree),) for tree in (DECOMPOSITION, stricter(DECOMPOSITION))
    ),
    "bench.simspec._seeds._derived_seed": ((1, "gusts"), (2, "gusts"), (1, "sensors")),
    "bench.streams._cdr._string": (("a", 0), ("b", 0), ("a", 1)),
    "vehicle_models.controller.links._frames._target_place": ((76,), (11,)),
    "vehicle_models.controller.links._frames.v1_length": ((30,), (24,)),
    "agent_adapters.reference.flight._routes._everything_joined": ((3,), (4,)),
    "agent_adapters.reference.surrogate.batch._airspace.in_arrays": tuple(
        (space,)
        for space in (Airspace(), Airspace(fence=CORNERS), Airspace(blocks=(block_round(CORNERS, 5.0),)))
    ),
}
OF_PROCESS = {
    "of the host, which stays the same under a process": (
        "bench.agents.confinement._ladder.rungs",
        "bench.agents.confinement._landlock.namespaces_fault",
        "bench.campaign._versions.arithmetic",
        "bench.campaign._versions.versions",
        "bench.cli._machine._own_network_fault",
        "bench.process_threads.unseen_reason",
        "bench.simulation.warp._library.warp_fault",
        "bench.simulation.warp._pages._system_call",
    ),
    "of the installed package": (
        "bench.agents._manifest.installed_agents",
        "bench.camera._looks.look_tables",
        "bench.cli._app._commands",
        "bench.plugins.plugins",
        "bench.simspec._assets.packaged_assets",
        "bench.lazy.declared_names",
        "bench.reporting._page._environment",
        "vehicle_models.tables.constant_subscripts",
    ),
    "of a class or of its layout on the wire: test_streams_cdr and test_documents_faults compare each class": (
        "bench.documents._document._hasty_validator",
        "agent_adapters.client.documents._reader",
        "bench.contracts._documents._adapter",
        *(f"bench.streams._cdr.{name}" for name in ("_builder", "_many", "_phased", "_reader", "_writers")),
        "bench.streams._ap_dds.ap_message",
        "bench.streams._px4.px4_message",
        *(f"bench.streams._schemas.{name}" for name in ("fields_of", "_hash_of", "_schema_of")),
    ),
    "of contact sheets, which are looked at": ("bench.camera.sheet._ground",),
}


def cached_functions() -> set[str]:
    """Every function of the product that functools caches, by decorator or by call."""
    names = set()
    for path in (path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        if module.startswith(WORDS.replace("/", ".")):
            continue
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "cache" in text else ():
            if isinstance(node, ast.FunctionDef) and any(
                ast.unparse(decorator).split("(")[0] in ("cache", "lru_cache")
                for decorator in node.decorator_list
            ):
                names.add(f"{module}.{node.name}")
            if isinstance(node, ast.Call) and ast.unparse(node.func).startswith("lru_cache("):
                names.add(f"{module}.{ast.unparse(node.args[0])}")
    return names


def test_every_cached_function_is_here() -> None:
    assert cached_functions() == {*CALLS, *(name for names in OF_PROCESS.values() for name in names)}


@pytest.mark.parametrize("name", CALLS)
def test_a_cached_function_tells_its_arguments_apart(name: str) -> None:
    module, _, function = name.rpartition(".")
    cached = getattr(importlib.import_module(module), function)
    cached = {"_string": importlib.import_module("bench.streams._cdr")._frequent_string}.get(function, cached)
    first, *others = CALLS[name]
    # Twice, so that every value also comes out of the cache.
    held = [pickle.dumps(cached(*call)) for call in (first, *others) * 2]
    assert held == [pickle.dumps(cached.__wrapped__(*call)) for call in (first, *others) * 2]
    idle = [call for call, value in zip(others, held[1:], strict=False) if value == held[0]]
    assert idle == [], "arguments that change nothing"
