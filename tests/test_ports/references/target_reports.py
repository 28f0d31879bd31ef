"""Reports about targets, one at a time."""

from __future__ import annotations

import math

from bench.contracts import Tape, TargetReport
from bench.simspec import SimSpec

from .flown_samples import actors_at
from .looks import looks_s


def subject(tape: Tape, report: TargetReport, time_s: float, within_m: float = 40.0) -> int | None:
    nearest, nearest_m = None, math.inf
    for index, (place, member) in enumerate(zip(actors_at(tape, time_s), tape.cast, strict=True)):
        distance_m = math.dist(place, (report.east_m, report.north_m))
        if member.role == "adversary" and member.class_label == report.class_label and distance_m < nearest_m:
            nearest, nearest_m = index, distance_m
    return nearest if nearest_m <= within_m else None


def knows(spec: SimSpec, tape: Tape, report: TargetReport, time_s: float, actor: int) -> bool:
    """Looked at before; neither at a place that intelligence stated, nor nearer to one than to the actor, unless
    within 10 m of it.
    """
    assert spec.realized is not None
    place = (report.east_m, report.north_m)
    off_m = math.dist(actors_at(tape, time_s)[actor], place)
    for area in spec.realized.reports:
        told_m = math.dist((area.east_m, area.north_m), place)
        if told_m <= 1.0 or (off_m > 10.0 and told_m < off_m):
            return False
    return min(looks_s(spec, tape, actor), default=math.inf) <= time_s


def known(
    spec: SimSpec, tape: Tape, report: TargetReport, time_s: float, within_m: float = 40.0
) -> int | None:
    actor = subject(tape, report, time_s, within_m)
    return actor if actor is not None and knows(spec, tape, report, time_s, actor) else None


def credibility(spec: SimSpec, tape: Tape) -> float:
    right: set[int] = set()
    false_places: list[tuple[str, float, float]] = []
    for report in tape.reports:
        value = report.value
        about = known(spec, tape, value, report.time.s, 30.0)
        if about is not None:
            right.add(about)
        elif all(
            label != value.class_label or math.dist((east_m, north_m), (value.east_m, value.north_m)) > 10.0
            for label, east_m, north_m in false_places
        ):
            false_places.append((value.class_label, value.east_m, value.north_m))
    return min(1.0, len(right) / max(1, len(false_places)))


def targets(spec: SimSpec, tape: Tape) -> dict[int, int]:
    """The first actor of each adversary group that intelligence names, with its most urgent priority."""
    priorities: dict[int, int] = {}
    for item in spec.intelligence:
        actor = next(index for index, member in enumerate(tape.cast) if member.group == item.about)
        if tape.cast[actor].role == "adversary":
            priorities[actor] = min(priorities.get(actor, 9), item.priority)
    return priorities
