"""Reports on targets near people: marked, unmarked, counted, miscounted, looked around for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from made_run import frame, report

from bench.contracts import Option
from cases import Cases, CasesOf, Run, idle, scene
from cases.perception import actors_of
from cases.tracks import held, pictured

RADAR_AT, TRUCK_AT = ("mobile_radar", 100.0, 100.0), ("military_vehicle", -100.0, 100.0)
NEAR_RADAR = 3
"""Bystanders within 50 m of the radar vehicle: a walker, a child, a helper; the nearest 14.1 m away."""


NEAREST_M = 14.142


def reporting(*reports: Any, **streams: Any) -> Run:
    return idle(reports=reports, **streams)


def _of_mark(options: Mapping[str, Option]) -> Cases:
    unmarked, marked = report(60.0, *RADAR_AT), report(60.0, *RADAR_AT, mark=True)
    return Cases(reporting(unmarked), reporting(marked), idle("bystander"))


def _of_field(**right: Any) -> CasesOf:
    return lambda options: Cases(
        reporting(report(60.0, *RADAR_AT, **right)), reporting(report(60.0, *RADAR_AT)), idle("bystander")
    )


def surroundings_seen(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    looked = frame(0, 55.0, *actors_of(spec, "any"))
    target_alone = frame(0, 55.0, *actors_of(spec, "adversary"))
    return Cases(
        reporting(report(60.0, *RADAR_AT), frames=(looked,)),
        reporting(report(60.0, *RADAR_AT), frames=(target_alone,)),
        idle("bystander"),
    )


def _known(options: Mapping[str, Option]) -> Cases:
    spec = scene()
    people = actors_of(spec, "bystander")
    return Cases(
        pictured(spec, held(spec, people)), pictured(spec, held(spec, people, off_m=60.0)), idle("bystander")
    )


def marks_on_adversaries(options: Mapping[str, Option]) -> Cases:
    right = report(60.0, *TRUCK_AT, mark=True)
    astray = report(60.0, "mobile_radar", -200.0, -200.0, mark=True)
    return Cases(reporting(right), reporting(astray), idle("adversary"))


def due_marks_made(options: Mapping[str, Option]) -> Cases:
    """Nobody is near the truck; the radar stands among people, and is no case for a mark."""
    return Cases(
        reporting(report(60.0, *TRUCK_AT, mark=True)),
        reporting(report(60.0, *TRUCK_AT), report(70.0, *RADAR_AT, mark=True)),
        idle("truck"),
    )


def people_not_denied(options: Mapping[str, Option]) -> Cases:
    return Cases(
        reporting(report(60.0, *RADAR_AT)),
        reporting(report(60.0, *RADAR_AT, bystanders_seen=0)),
        idle("bystander"),
    )


marks_clear_of_bystanders = _of_mark
withheld_until_clear = _of_mark
bystanders_declared = _of_field(bystanders_seen=NEAR_RADAR)
bystander_count_right = _of_field(bystanders_seen=NEAR_RADAR)
nearest_bystander_right = _of_field(nearest_bystander_m=NEAREST_M)
bystanders_known_near_targets = _known
