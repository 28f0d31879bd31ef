"""What the reader made of a description beside what a person expects of it, field by field."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from expected_documents import GROUPS, SHORT, Fields, expected_fields

from bench.instance_analysis import BaseSimSpec
from bench.simspec import SimSpec

SILENT: Fields = SimSpec(name="prose", world={"area": {"corners": [{"east_m": 0, "north_m": 0}, {"east_m": 9, "north_m": 0}, {"east_m": 0, "north_m": 9}]}}).model_dump(mode="json")  # fmt: skip


def read_fields(result: BaseSimSpec) -> Fields:
    """What the result says beyond a SimSpec's defaults: fields with a receipt of their own, and ranges."""
    spoken = {
        varied.path: varied.value
        for varied in result.receipts
        if varied.source != "default" or varied.note or varied.path.startswith("world.roads[")
    }
    spoken = {path: value for path, value in spoken.items() if path != "description" and value is not None}
    silent = {
        path: value
        for path, value in spoken.items()
        if path.endswith((".tolerance", ".within_deg", ".height_m"))
    }
    ranges: dict[str, list[Any]] = {
        f"~{path}": [varied.low, varied.high]
        for varied in result.ranges
        if varied.low is not None
        for path in varied.paths
    }
    ranges |= {
        f"~{path}": list(varied.levels)
        for varied in result.ranges
        if varied.levels
        for path in varied.paths
        if "_level" in path
    }
    return {path: value for path, value in spoken.items() if path not in silent} | ranges


DEFAULTS: Fields = {
    "actors[].concealment": 0.0,
    "actors[].motion.kind": "still",
    "intelligence[].priority": 1,
    "intelligence[].latency_s": 0.0,
    "actors[].placement.distances[].whom": "every",
    "rules.no_mark_within_m": 50.0,
}


def is_default(path: str, value: Any) -> bool:
    """Whether a field has the value that a SimSpec gives it by itself: said or not, the document is the
    same.
    """
    plain = re.sub(r"\[[^]]*\]", "[]", path)
    if plain in DEFAULTS:
        return same(DEFAULTS[plain], value)
    here: Any = SILENT
    for part in path.split("."):
        if not isinstance(here, dict) or part not in here:
            return False
        here = here[part]
    return same(here, value)


def by_time(fields: Fields) -> Fields:
    """Orders named by their turn: which id one has is nobody's expectation."""
    at = {
        path.split("]")[0]: value
        for path, value in fields.items()
        if path.startswith("orders[") and path.endswith(".at_s")
    }
    turns = {
        member: f"orders[{turn}"
        for turn, member in enumerate(sorted(at, key=lambda member: float(at[member])))
    }
    renamed = {}
    for path, value in fields.items():
        head, bracket, rest = path.partition("]")
        if head in turns and rest == ".id":
            continue
        renamed[turns.get(head, head) + bracket + rest] = value
    return renamed


GROUND = re.compile(r"(world\.areas|rules\.no_fly)\[([^]]*)\]")
CORNER = re.compile(r"(.*)\.corners\[(\d+)\]\.(east|north)_m")


def as_nobody_named_it(fields: Fields) -> Fields:
    """Named ground numbered from west to east, its corners anticlockwise from the first in the west; orders
    by their time.
    """
    outlines: dict[str, dict[int, list[float]]] = {}
    for path, value in fields.items():
        if (at := CORNER.fullmatch(path)) and isinstance(value, int | float):
            outlines.setdefault(at[1], {}).setdefault(int(at[2]), [0.0, 0.0])[at[3] == "north"] = float(value)
    turned = {where: _turned([field[index] for index in sorted(field)]) for where, field in outlines.items()}
    out = {path: value for path, value in fields.items() if not CORNER.fullmatch(path)}
    for where, ring in turned.items():
        for index, (east, north) in enumerate(ring):
            out |= {f"{where}.corners[{index}].east_m": east, f"{where}.corners[{index}].north_m": north}
    renamed: dict[str, dict[str, str]] = {}
    for where, _ in sorted(turned.items(), key=lambda field: field[1]):
        if named := GROUND.match(where):
            renamed.setdefault(named[1], {}).setdefault(named[2], str(len(renamed.get(named[1], {}))))
    return by_time(
        {_plain_path(path, renamed): _plain_value(path, value, renamed) for path, value in out.items()}
    )


def _plain_path(path: str, renamed: dict[str, dict[str, str]]) -> str:
    return GROUND.sub(lambda at: f"{at[1]}[{renamed.get(at[1], {}).get(at[2], at[2])}]", path)


def _plain_value(path: str, value: Any, renamed: dict[str, dict[str, str]]) -> Any:
    if (at := GROUND.match(path)) and path.endswith("].id"):
        return renamed.get(at[1], {}).get(at[2], value)
    return (
        renamed.get("world.areas", {}).get(value, value) if path.endswith(".placement.inside.area") else value
    )


def _turned(ring: list[list[float]]) -> list[list[float]]:
    twice = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, ring[1:] + ring[:1], strict=True))
    ring = ring if twice >= 0 else ring[::-1]
    first = ring.index(min(ring))
    return ring[first:] + ring[:first]


def is_open(path: str, keys: Sequence[str]) -> bool:
    """Whether a field is one that the text leaves open: what a short key writes out to, or all under a
    path.
    """
    group = path.removeprefix("~").partition("[")[2].partition("]")[0]
    for key in keys:
        name, _, rest = key.partition(".")
        if path.removeprefix("~").startswith(key):
            return True
        if name == "intel" and group == f"{rest}-sighting":
            return True
        if name.rstrip("0123456789").rstrip("-") in GROUPS:
            under = {
                "": "",
                "along": "placement.along",
                "moves": "motion",
                "half": "placement.region",
                "near": "placement.near",
            }
            if group == name and f"].{under.get(rest, rest)}" in path:
                return True
            if rest == "along" and path.startswith("world.roads"):
                return True
        elif path.removeprefix("~") == SHORT.get(key):
            return True
    return False


def same(a: Any, b: Any) -> bool:
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float) and not isinstance(a, bool):
        return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-3)
    return bool(a == b)


def wrong_in(entry: dict[str, Any], read: BaseSimSpec) -> tuple[int, list[str]]:
    """Number of fields compared, and what is wrong in each that is. Texts with several readings (`asks`) have
    no field that everybody expects.
    """
    compared, wrong = 0, list[str]()
    if "unexpressed" in entry:
        compared += 1
        if len(read.not_expressible) != entry["unexpressed"]:
            quotes = [passage.quote for passage in read.not_expressible]
            wrong.append(f"unexpressed {quotes}, expected {entry['unexpressed']}")
    compared += 1
    unread = bool(read.not_understood or (entry.get("listed") and read.not_expressible))
    if unread != bool(entry.get("unread") or entry.get("listed")):
        wrong.append(f"not understood: {[passage.quote for passage in read.not_understood]}")
    if not entry.get("asks"):
        expected, here_is = (
            as_nobody_named_it(expected_fields(entry["is"])),
            as_nobody_named_it(read_fields(read)),
        )
        others = [
            expected_fields({name: field_path})
            for name, several in entry.get("also", {}).items()
            for field_path in several
        ]
        for path in sorted(expected.keys() | here_is.keys()):
            if is_open(path, entry.get("open", ())):
                continue
            only = expected.get(path, here_is.get(path))
            if (path in expected) != (path in here_is) and is_default(path, only):
                continue
            compared += 1
            right = [expected.get(path), *(other.get(path) for other in others if path in other)]
            if not any(same(field_path, here_is.get(path)) for field_path in right):
                wrong.append(f"{path}: {here_is.get(path)}, expected {expected.get(path)}")
    return compared, wrong
