"""The corpus's short form of an expected document, written out to fields of a SimSpec and ranges."""

from __future__ import annotations

from typing import Any

GROUPS = {
    "radar": ("radar-vehicle", "adversary"),
    "truck": ("military-truck", "adversary"),
    "soldier": ("soldier", "adversary"),
    "civilian": ("civilian", "bystander"),
    "child": ("child", "bystander"),
    "aid-worker": ("aid-worker", "bystander"),
    "car": ("civilian-car", "clutter"),
    "house": ("house", "clutter"),
    "shed": ("shed", "clutter"),
    "tree": ("tree", "clutter"),
    "crate": ("crate", "clutter"),
    "sheep": ("sheep", "clutter"),
    "dog": ("dog", "clutter"),
}
SHORT = {
    "alt": "mission.altitude_m",
    "speed": "mission.speed_mps",
    "limit": "mission.time_limit_s",
    "rain": "environment.rain_level",
    "fog": "environment.fog_level",
    "wind": "environment.wind.speed_mps",
    "from": "environment.wind.from_deg",
    "gust": "environment.wind.turbulence_mps",
    "start": "environment.start_utc",
    "nomark": "rules.no_mark_within_m",
    "standoff": "rules.bystander_standoff_m",
    "ceiling": "rules.max_altitude_m",
    "floor": "rules.min_altitude_m",
    "maxspeed": "rules.max_speed_mps",
    "conf": "rules.min_report_confidence",
    "reserve": "rules.battery_reserve_fraction",
    "deadline": "rules.report_deadline_s",
    "gps": "vehicle.gps.wander_m",
    "tilt": "vehicle.camera.tilt_deg",
}
AREA = (600.0, 250.0)
Fields = dict[str, Any]


def expected_fields(short: Fields) -> Fields:
    """Every field that is not a SimSpec's default, and `~path` for each range, from the short form."""
    area = tuple(float(entry) for entry in str(short.get("area", "600 250")).split())
    out: Fields = {}
    for key, value in short.items():
        name, _, rest = key.partition(".")
        base = name.rstrip("0123456789").rstrip("-")
        if key == "area":
            out |= _corners("world.area", -area[0] / 2, -area[1] / 2, area[0] / 2, area[1] / 2)
        elif name == "intel":
            out |= {
                f"intelligence[{rest}-sighting].id": f"{rest}-sighting",
                f"intelligence[{rest}-sighting].about": rest,
            }
            out |= {f"intelligence[{rest}-sighting].{field}": entry for field, entry in value.items()}
        elif name == "order":
            kind = rest.rstrip("0123456789").rstrip("-").replace("-", "_")
            out |= {f"orders[{rest}].id": rest, f"orders[{rest}].kind": kind, f"orders[{rest}].at_s": value}
        elif name in ("failure", "outage"):
            where = f"vehicle.failures[{rest}]" if name == "failure" else f"outages[{rest}]"
            kind, at, lasting = value.split()
            out |= {f"{where}.kind": kind, f"{where}.at_s": float(at), f"{where}.duration_s": float(lasting)}
        elif base in GROUPS:
            out |= _of_group(name, base, rest, value, area)
        else:
            out |= _number(SHORT.get(key, key), value)
    return out


def _number(path: str, value: Any) -> Fields:
    if isinstance(value, list):
        return {path: value[0], f"~{path}": value}
    return {path: value}


def _of_group(group: str, base: str, rest: str, value: Any, area: tuple[float, ...]) -> Fields:
    where = f"actors[{group}]"
    placed = f"{where}.placement"
    words = str(value).split()
    match rest:
        case "":
            asset, role = GROUPS[base]
            return {f"{where}.id": group, f"{where}.asset": asset, f"{where}.role": role} | _count(
                where, str(value)
            )
        case "near":
            of, low, high = words
            fields: Fields = {f"{placed}.near.of": of, f"{placed}.near.max_m": float(high)}
            return fields | ({f"{placed}.near.min_m": float(low)} if float(low) else {})
        case "away":
            row = f"{placed}.distances[0]"
            return {f"{row}.of": words[0], f"{row}.whom": "every", f"{row}.min_m": float(words[1])}
        case "mean":
            low, _, high = words[1].partition("..")
            span = [float(low), float(high)] if high else float(low)
            return {f"{placed}.mean_distance.of": words[0]} | _number(f"{placed}.mean_distance.mean_m", span)
        case "bearing":
            row = f"{placed}.bearing"
            return {
                f"{row}.of": words[0],
                f"{row}.from_deg": float(words[1]),
                f"{row}.to_deg": float(words[2]),
            }
        case "half":
            east, north = area[0] / 2, area[1] / 2
            degrees = float(value)
            low_e, high_e = (0.0 if 0 < degrees < 180 else -east), (0.0 if degrees > 180 else east)
            low_n, high_n = (
                (0.0 if degrees < 90 or degrees > 270 else -north),
                (0.0 if 90 < degrees < 270 else north),
            )
            return _corners(f"{placed}.region", low_e, low_n, high_e, high_n)
        case "middle":
            third = (round(area[0] / 6, 3), round(area[1] / 6, 3))
            return _corners(f"{placed}.region", -third[0], -third[1], *third)
        case "along":
            road = {"world.roads[road].id": "road", "world.roads[road].width_m": 6.0}
            for index, east in enumerate((-area[0] / 2, area[0] / 2)):
                road |= {
                    f"world.roads[road].points[{index}].east_m": east,
                    f"world.roads[road].points[{index}].north_m": 0.0,
                }
            return road | {f"{placed}.along.road": "road", f"{placed}.along.where": value}
        case "facing" | "hidden_from" | "visible_from":
            return {f"{placed}.{rest}.of": value}
        case "spread_m":
            return {f"{placed}.spread_m": value}
        case "moves":
            if value == "still":
                return {f"{where}.motion.kind": "still"}
            return {f"{where}.motion.kind": "wander"} | _number(f"{where}.motion.speed_mps", value)
    return _number(f"{where}.{rest}", value)


def _count(where: str, text: str) -> Fields:
    text = (
        "2..10" if text == "some" else text
    )  # how many is not said: the vocabulary's `some`, shown as a default
    number, _, per = text.partition("/")
    low, _, high = number.partition("..")
    path = f"{where}.density_per_km2" if per else f"{where}.count"
    return _number(path, [float(low), float(high)] if high else float(low))


def _corners(where: str, west: float, south: float, east: float, north: float) -> Fields:
    out: Fields = {}
    for index, (e, n) in enumerate(((west, south), (east, south), (east, north), (west, north))):
        out |= {f"{where}.corners[{index}].east_m": e, f"{where}.corners[{index}].north_m": n}
    return out
