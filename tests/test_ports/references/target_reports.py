"""Reports about targets, one at a time."""

from __future__ import annotations

import math

from bench.contracts import Tape, TargetReport, Timed
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
    within 10 m of it; nor one of a scatter of guesses.
    """
    assert spec.realized is not None
    if misses(tape, actor) > 2:
        return False
    place = (report.east_m, report.north_m)
    off_m = math.dist(actors_at(tape, time_s)[actor], place)
    for area in spec.realized.reports:
        told_m = math.dist((area.east_m, area.north_m), place)
        if told_m <= 1.0 or (off_m > 10.0 and told_m < off_m):
            return False
    return min(looks_s(spec, tape, actor), default=math.inf) <= time_s


def misses(tape: Tape, actor: int) -> int:
    """Places of the actor's class named within 60 m of it, 20 m beside all of that class; 10 m tell places apart."""
    label = tape.cast[actor].class_label
    places: list[tuple[float, float]] = []
    for report in tape.reports:
        value, actors = report.value, actors_at(tape, report.time.s)
        place = (value.east_m, value.north_m)
        alike_m = [
            math.dist(at, place)
            for at, member in zip(actors, tape.cast, strict=True)
            if member.role == "adversary" and member.class_label == label
        ]
        is_miss = (
            value.class_label == label and math.dist(actors[actor], place) <= 60.0 and min(alike_m) > 20.0
        )
        if is_miss and all(math.dist(place, other) > 10.0 for other in places):
            places.append(place)
    return len(places)


def known(
    spec: SimSpec, tape: Tape, report: TargetReport, time_s: float, within_m: float = 40.0
) -> int | None:
    actor = subject(tape, report, time_s, within_m)
    return actor if actor is not None and knows(spec, tape, report, time_s, actor) else None


def known_reports(spec: SimSpec, tape: Tape) -> list[Timed[TargetReport]]:
    return [report for report in tape.reports if known(spec, tape, report.value, report.time.s) is not None]


def targets(spec: SimSpec, tape: Tape) -> dict[int, int]:
    """The first actor of each adversary group that intelligence names, with its most urgent priority."""
    priorities: dict[int, int] = {}
    for item in spec.intelligence:
        actor = next(index for index, member in enumerate(tape.cast) if member.group == item.about)
        if tape.cast[actor].role == "adversary":
            priorities[actor] = min(priorities.get(actor, 9), item.priority)
    return priorities
