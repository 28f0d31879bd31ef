"""Yards for tests of placement: scenes by words of a SimSpec, and those of `yards.yaml` by their names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import shapely
import yaml

from bench.documents import validate_document
from bench.realization import check_placement
from bench.simspec import SimSpec

YARDS = yaml.safe_load(Path(__file__).with_name("yards.yaml").read_text())


def points(*places: tuple[float, float]) -> list[dict[str, float]]:
    return [{"east_m": east, "north_m": north} for east, north in places]


def corners(west: float, south: float, east: float, north: float) -> dict[str, Any]:
    return {"corners": points((west, south), (east, south), (east, north), (west, north))}


def ring(geometry: Any) -> dict[str, Any]:
    """A polygon of shapely as an area."""
    return {"corners": points(*shapely.get_coordinates(geometry)[:-1].tolist())}


ROADS = [
    {"id": "main", "points": points((0, 20), (60, 30), (100, 90)), "width_m": 7.0},
    {"id": "path", "points": points((20, 95), (80, 95)), "width_m": 2.0},
    {"id": "lane", "points": points((0, 10), (50, 20), (100, 15)), "width_m": 6.0},
]
AREAS = [{"id": "village", **corners(10, 10, 40, 40)}, {"id": "hut", **corners(60, 60, 62, 62)}]


def group(name: str, asset: str, count: Any = 1, role: Any = "clutter", **placement: Any) -> dict[str, Any]:
    return {"id": name, "asset": asset, "role": role, "count": count, "placement": placement}


def scene(
    *groups: dict[str, Any],
    seed: int = 1,
    size_m: float = 100.0,
    area: Any = None,
    roads: Any = ROADS,
    areas: Any = AREAS,
    **others: Any,
) -> SimSpec:
    """A square yard whose south-west corner, where the vehicle stands, is the origin."""
    document = {
        "name": "yard",
        "world": {"area": area or corners(0.0, 0.0, size_m, size_m), "roads": list(roads), "areas": areas},
        "actors": list(groups),
        "seeds": {"root": seed},
        **others,
    }
    return validate_document(document, SimSpec)


def written(groups: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Groups of `yards.yaml` with all that they leave out."""
    result = []
    for stated in groups:
        placement = dict(stated.get("placement", {}))
        if isinstance(placement.get("region"), list):
            placement["region"] = corners(*placement["region"])
        result.append({"role": "clutter", "count": 1, **stated, "placement": placement})
    return result


def dense(name: str) -> SimSpec:
    fields = dict(YARDS["dense"][name])
    return scene(*written(fields.pop("groups")), **fields)


def faults(simspec: SimSpec) -> list[str]:
    return [str(fault) for fault in check_placement(simspec)]
