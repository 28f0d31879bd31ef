"""A convoy that drives past both adversaries: accompanied or left alone, warned or not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from made_run import report

from bench.contracts import Option, convoy_places_m, escort_document
from bench.simspec import SimSpec
from cases import Cases, Run, scene
from cases.mission import Stop, went

DEPART_S, HALT_S, SPEED_MPS = 60.0, 160.0, 4.0
STARTS = ((-250.0, 60.0), (-265.0, 60.0))
"""Two cars on a road 40 m south of the truck and of the radar vehicle."""

ALONG: tuple[Stop, ...] = (
    (0.0, 0.0, 0.0),
    (50.0, -250.0, 60.0),
    (60.0, -250.0, 60.0),
    (160.0, 150.0, 60.0),
    (180.0, 0.0, 0.0),
)
"""With the head of the convoy from its departure to its halt."""

TRUCK_AT, RADAR_AT = ("military_vehicle", -100.0, 100.0), ("mobile_radar", 100.0, 100.0)


def escorting(escort: Mapping[str, Any] | None = None, **changes: Any) -> SimSpec:
    """The made scene with a convoy to stay within 50 m of, and to warn 80 m before each adversary."""
    spec = scene()
    document = spec.model_dump(mode="json")
    route = [{"east_m": east, "north_m": 60.0} for east in (-240.0, 250.0)]
    motion = {"kind": "patrol", "speed_mps": SPEED_MPS, "pause_s": 0.0, "route": route}
    motion |= {"depart_s": DEPART_S, "halt_s": HALT_S}
    document["actors"].append(
        {"id": "convoy", "asset": "civilian-car", "role": "bystander", "count": 2, "motion": motion}
    )
    document["realized"]["actors"] += [
        {"id": f"convoy-{index}", "group": "convoy", "east_m": east, "north_m": north, "heading_deg": 90.0}
        for index, (east, north) in enumerate(STARTS, 1)
    ]
    document["mission"] |= {
        "escort": {"group": "convoy", "within_m": 50.0, "warn_before_m": 80.0, **(escort or {})}
    }
    document |= changes
    return SimSpec.model_validate(document)


def driven(spec: SimSpec, *stops: Stop, **streams: Any) -> Run:
    """A flight while the convoy drives; everybody else stands still."""
    plan = escort_document(spec)
    assert plan is not None
    assert spec.realized is not None
    run = went(spec, *stops, **streams)
    convoy_m = convoy_places_m(plan, run.tape.actor_time_s)
    members = [index for index, actor in enumerate(spec.realized.actors) if actor.group == "convoy"]
    run.tape.actor_position_enu_m[:, members, :2] = convoy_m
    return run


def reports_at(truck_s: float, radar_s: float) -> dict[str, Any]:
    """Both adversaries reported; the convoy is near them at 80 s and at 130 s."""
    return {"reports": (report(truck_s, *TRUCK_AT), report(radar_s, *RADAR_AT))}


def convoy_accompanied(options: Mapping[str, Option]) -> Cases:
    spec = escorting()
    aside = ((0.0, 0.0, 0.0), (100.0, -200.0, -200.0), (180.0, 0.0, 0.0))
    return Cases(driven(spec, *ALONG), driven(spec, *aside), went(scene(), *ALONG))


def convoy_warned(options: Mapping[str, Option]) -> Cases:
    spec = escorting()
    return Cases(
        driven(spec, *ALONG, **reports_at(70.0, 75.0)),
        driven(spec, *ALONG, **reports_at(90.0, 150.0)),
        went(scene(), *ALONG),
    )
