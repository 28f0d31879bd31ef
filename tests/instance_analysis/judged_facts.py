"""Whether a document holds a fact of a judged text: fields by their paths, with members chosen by asset, role or kind."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from operator import attrgetter
from typing import Any

from bench.instance_analysis import BaseSimSpec
from bench.simspec import SimSpec

_STEP = re.compile(r"([a-z_0-9]+)((?:\[[^\]]*\])*)")
_KINDS = {
    "static": ("still",),
    "still": ("still",),
    "moving": ("wander", "patrol"),
    "wander": ("wander", "patrol"),
    "patrol": ("patrol",),
}
_MEMBER_OF = {"of": "actors", "about": "actors", "group": "actors", "intelligence": "intelligence"}
TOLERANCE = 0.02
"""Facts are rounded: 45.7 m are 150 ft."""


_PLACEMENT = ("near", "along", "bearing", "facing", "inside", "mean_distance", "spread_m", "extent_m", "between", "separation_m")  # fmt: skip


def facts_of(entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The facts of a compact entry for which a field exists: `van.near` is a path of the actors whose asset is a van."""
    return [
        {"words": " ".join(fact[0].split()), "path": _whole_path(fact[1]), "value": fact[2]}
        for fact in entry["facts"]
        if len(fact) == 3
    ]


def _whole_path(written: str) -> str:
    paths: list[str] = []
    for path in written.split("|"):
        who, _, rest = path.partition(".")
        if who.split("[")[0] not in SimSpec.model_fields:
            inner = f"placement.{rest}" if re.split(r"[.\[]", rest)[0] in _PLACEMENT else rest
            path = f"actors[asset={who}].{inner}"
        paths.append(path)
        if path.endswith("placement.near"):
            paths.append(f"{path.removesuffix('near')}distances")
    return "|".join(paths)


def can_be_judged(fact: Mapping[str, Any]) -> bool:
    """Whether a fact has a value that a program can compare."""
    value = fact["value"]
    if isinstance(value, dict):
        return bool(value) and set(value) <= {"low", "high", "of", "min_m", "max_m", "east_extent_m", "north_extent_m", "width_m",
                            "height_m", "at_s", "duration_s", "to_fraction", "drift_mps", "towards_deg", "from_s", "until_s",
                            "speed_mps", "from_deg", "mean_m", "priority", "latency_s", "where", "lost_share"} and not isinstance(value.get("where"), str) | (fact["path"].startswith(("actors", "rules")) and "where" in value)  # fmt: skip
    if isinstance(value, str):
        words = ("on", "granted", "refused", "never", "hold", "return", "continue", "ardupilot", "motor_off")
        return value in _KINDS or value in words
    return value is not None and not isinstance(value, list)


def holds(result: BaseSimSpec, fact: Mapping[str, Any]) -> bool:
    """Whether the document holds a fact on one of its paths."""
    document = result.simspec.model_dump(mode="json")
    ranges = {
        path: (item.low, item.high) if item.low is not None else item.levels
        for item in result.ranges
        for path in item.paths
    }
    first = fact["path"].split("|")[0].strip()
    counts = [value for path, value in _found(document, first) if path.endswith(".count")]
    if len(counts) > 1 and all(isinstance(count, int) for count in counts) and sum(counts) == fact["value"]:
        # A group that is divided.
        return True
    if not fact["value"] and "[" not in fact["path"] and not list(_found(document, fact["path"])):
        # A field that came later is left out of the document at its default.
        return bool(attrgetter(fact["path"])(result.simspec) == fact["value"])
    return any(
        _same(value, fact["value"], path, document, ranges)
        for written in fact["path"].split("|")
        for path, value in _found(document, written.strip())
    )


def _found(document: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every value on a path, with its path as receipts name it."""
    places = [("", document)]
    path = re.sub(r"placement\.(away|separation_m)", lambda match: {"away": "placement.distances", "separation_m": "placement.spread_m"}[match[1]], path)  # fmt: skip
    for match in _STEP.finditer(path):
        name, choices = match[1], re.findall(r"\[([^\]]*)\]", match[2])
        places = [
            (f"{where}.{name}".lstrip("."), value[name])
            for where, value in places
            if isinstance(value, dict) and name in value
        ]
        places = [place for where, value in places for place in _members(where, value, choices, document)]
    return iter([(where, value) for where, value in places if value is not None])


def _members(where: str, value: Any, choices: list[str], document: Any) -> list[tuple[str, Any]]:
    if not isinstance(value, list | tuple):
        return [(where, value)]
    members = [
        (f"{where}[{member.get('id', at)}]" if isinstance(member, dict) else where, member)
        for at, member in enumerate(value)
    ]
    for choice in choices:
        for condition in filter(None, choice.split(",")):
            name, _, wanted = condition.partition("=")
            members = [
                (at, member)
                for at, member in members
                if not wanted or _is(member, name.strip(), wanted.strip(), document)
            ]
    return members


def _is(member: Any, name: str, wanted: str, document: Any) -> bool:
    value = member.get(name)
    if name == "asset" and wanted in ("armed-person", "soldier"):
        # Both are combatants: a gunman may be either.
        return value in ("armed-person", "soldier")
    if isinstance(value, int | float):
        return f"{value:g}" == wanted
    return value == wanted or wanted in _names_of(value, document)


def _names_of(member: Any, document: Any) -> set[str]:
    """The id, asset and noun of the group that a value names."""
    groups = {group["id"]: group["asset"] for group in document["actors"]}
    reports = {report["id"]: report["about"] for report in document["intelligence"]}
    member = reports.get(member, member)
    return {str(member), groups.get(member, ""), str(member).split("-")[0]} - {""}


def _same(value: Any, wanted: Any, path: str, document: Any, ranges: Mapping[str, tuple[Any, ...]]) -> bool:
    if isinstance(wanted, dict):
        return _same_dict(value, wanted, path, document, ranges)
    if isinstance(wanted, bool):
        return value is wanted
    if isinstance(wanted, int | float):
        return path not in ranges and isinstance(value, int | float) and _close(value, wanted)
    if isinstance(wanted, str) and wanted in _KINDS:
        return value in _KINDS[wanted]
    return value == wanted or (isinstance(wanted, str) and wanted in _names_of(value, document))


def _same_dict(
    value: Any, wanted: Mapping[str, Any], path: str, document: Any, ranges: Mapping[str, tuple[Any, ...]]
) -> bool:
    if "values" in wanted:
        return ranges.get(path) == tuple(wanted["values"])
    if "contains_deg" in wanted:
        width = (value["to_deg"] - value["from_deg"]) % 360
        return bool((wanted["contains_deg"] - value["from_deg"]) % 360 <= width)
    if {"low", "high"} <= set(wanted):
        low, *_, high = ranges.get(path, (value, value))
        if path.startswith("environment") and wanted["low"] <= value <= wanted["high"]:
            return True
        return _close(low, wanted["low"]) and _close(high, wanted["high"])
    if isinstance(value, dict) and "corners" in value:
        east, north = ([corner[axis] for corner in value["corners"]] for axis in ("east_m", "north_m"))
        value = {"east_extent_m": max(east) - min(east), "north_extent_m": max(north) - min(north)}
        value |= {"width_m": value["east_extent_m"], "height_m": value["north_extent_m"]}
    if not isinstance(value, dict):
        return False
    return all(
        _same(value.get(name), part, f"{path}.{name}", document, ranges) if name in _MEMBER_OF or isinstance(part, str)
        else _close(value.get(name), part)
        for name, part in wanted.items()
    )  # fmt: skip


def _close(value: Any, wanted: Any) -> bool:
    return isinstance(value, int | float) and abs(float(value) - float(wanted)) <= TOLERANCE * max(
        1.0, abs(float(wanted))
    )


def is_understood(result: BaseSimSpec, words: str) -> bool:
    """Whether the clauses with the words of a fact claim to be read, and tell of no default."""
    words = words.split("...")[0].strip()
    begin = result.prose.find(words)
    end = begin + len(words)
    statuses = {clause.status for clause in result.clauses if clause.start < end and begin < clause.end}
    return begin >= 0 and statuses == {"understood"}
