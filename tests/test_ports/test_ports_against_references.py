"""Measures against references written as plain loops, on random runs with two or more of everything.

The references share no code with the measures: they go through samples, reports and actors one by one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Any

import pytest
from random_run import TIME_LIMIT_S, random_simspec, random_tape

from bench.contracts import AgentTrack, AgentTracks, CastMember, Option, Tape, TargetReport, load_plugin
from bench.simspec import Polygon, SimSpec
from test_ports.operator.order_outcomes import OrderOutcomes

SEEDS = range(40)
# Runs in which a measure takes values that none of the first forty has.
MORE_SEEDS: Mapping[str, tuple[int, ...]] = {"priority_order": (75, 82)}

Place = tuple[float, float, float]
Reference = Callable[[SimSpec, Tape, tuple["Sample", ...]], float | None]


@cache
def random_run(seed: int) -> tuple[SimSpec, Tape]:
    spec = random_simspec(seed)
    return spec, random_tape(spec, seed)


# Truth, one sample at a time


class Sample:
    """One truth sample of a vehicle in the air, with the time that it stands for."""

    def __init__(self, tape: Tape, row: int) -> None:
        times = tape.vehicle_time_s
        self.time_s = float(times[row])
        self.span_s = float(times[row + 1] - times[row]) if row + 1 < len(times) else 0.0
        self.place: Place = tuple(map(float, tape.vehicle_position_enu_m[row]))  # type: ignore[assignment]
        self.speed_mps = math.hypot(*map(float, tape.vehicle_velocity_enu_mps[row][:2]))
        # The random runs sample actors and vehicle at the same moments, so no place has to be interpolated.
        self.actors: list[Place] = [tuple(map(float, place)) for place in tape.actor_position_enu_m[row]]  # type: ignore[misc]


@cache
def airborne(seed: int) -> tuple[Sample, ...]:
    _, tape = random_run(seed)
    samples = []
    for row, time_s in enumerate(tape.vehicle_time_s):
        states = [state.value for state in tape.condition if state.time.s <= time_s]
        if states and not states[-1].landed and not any(state.crashed for state in states):
            samples.append(Sample(tape, row))
    return tuple(samples)


def free(tape: Tape, samples: tuple[Sample, ...]) -> list[Sample]:
    """The samples before the operator orders the vehicle to land where it is."""
    ordered_s = [order.time.s for order in tape.orders if order.value.kind == "deactivate"]
    return [sample for sample in samples if all(sample.time_s < time_s for time_s in ordered_s)]


def role_of(tape: Tape, role: str) -> list[int]:
    return [index for index, member in enumerate(tape.cast) if member.role == role]


def actors_at(tape: Tape, time_s: float) -> list[tuple[float, float]]:
    """Places by linear interpolation between the two samples around a moment."""
    times = tape.actor_time_s
    after = next((row for row, time in enumerate(times) if time >= time_s), len(times) - 1)
    before = max(0, after - 1)
    length_s = float(times[after] - times[before])
    share = min(1.0, max(0.0, (time_s - float(times[before])) / length_s)) if length_s else 0.0
    starts, ends = tape.actor_position_enu_m[before], tape.actor_position_enu_m[after]
    return [
        (float(a[0] + share * (b[0] - a[0])), float(a[1] + share * (b[1] - a[1])))
        for a, b in zip(starts, ends, strict=True)
    ]


def time_share(samples: list[tuple[float, bool]]) -> float:
    total_s = math.fsum(span_s for span_s, _ in samples)
    return math.fsum(span_s for span_s, holds in samples if holds) / total_s if total_s else 0.0


def out_s(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...], among_m: float = math.inf) -> float:
    """Seconds in the air more than 40 m from home, with a bystander within `among_m` where that is finite."""
    home = (spec.vehicle.home.east_m, spec.vehicle.home.north_m)
    return math.fsum(
        sample.span_s
        for sample in samples
        if math.dist(sample.place[:2], home) > 40.0
        and (
            math.isinf(among_m)
            or any(
                math.dist(sample.place[:2], sample.actors[person][:2]) <= among_m
                for person in role_of(tape, "bystander")
            )
        )
    )


def exposed_share(
    kept: list[tuple[float, bool]], exposed_s: float, value: float | None = None
) -> float | None:
    """The share (or the value) where the vehicle was exposed for ten seconds; else 0 when it broke the rule."""
    if exposed_s < 10.0:
        return 0.0 if any(not holds for _, holds in kept) else None
    return time_share(kept) if value is None else value


def beyond_square(place: Place, square: Polygon) -> float:
    """Distance from the edge of an upright square, negative inside."""
    east, north = [corner.east_m for corner in square.corners], [corner.north_m for corner in square.corners]
    out_east = max(min(east) - place[0], place[0] - max(east))
    out_north = max(min(north) - place[1], place[1] - max(north))
    if out_east <= 0.0 and out_north <= 0.0:
        return max(out_east, out_north)
    return math.hypot(max(out_east, 0.0), max(out_north, 0.0))


# Reports, one at a time


def subject(tape: Tape, report: TargetReport, time_s: float, within_m: float = 40.0) -> int | None:
    nearest, nearest_m = None, math.inf
    for index, (place, member) in enumerate(zip(actors_at(tape, time_s), tape.cast, strict=True)):
        distance_m = math.dist(place, (report.east_m, report.north_m))
        if member.role == "adversary" and member.class_label == report.class_label and distance_m < nearest_m:
            nearest, nearest_m = index, distance_m
    return nearest if nearest_m <= within_m else None


def knows(spec: SimSpec, tape: Tape, report: TargetReport, time_s: float, actor: int) -> bool:
    """In view before, half of it and 12 pixels; neither at a place that intelligence stated, nor nearer to one
    than to the actor, unless within 10 m of it.
    """
    assert spec.realized is not None
    place = (report.east_m, report.north_m)
    off_m = math.dist(actors_at(tape, time_s)[actor], place)
    for area in spec.realized.reports:
        told_m = math.dist((area.east_m, area.north_m), place)
        if told_m <= 1.0 or (off_m > 10.0 and told_m < off_m):
            return False
    return any(
        sighting.actor == actor and sighting.height_px >= 12.0 and sighting.visible >= 0.5
        for frame in tape.frames
        if frame.exposed.s <= time_s
        for sighting in frame.sightings
    )


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


def places_target(
    spec: SimSpec, tape: Tape, report: TargetReport, time_s: float, actor: int, within_m: float
) -> bool:
    distance_m = math.dist(actors_at(tape, time_s)[actor], (report.east_m, report.north_m))
    right = report.class_label == tape.cast[actor].class_label and distance_m <= within_m
    return right and knows(spec, tape, report, time_s, actor)


# The references


def geofence_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    fence = spec.rules.geofence
    if fence is None:
        return None
    kept = [(sample.span_s, beyond_square(sample.place, fence) <= 0.0) for sample in samples]
    return exposed_share(kept, out_s(spec, tape, samples))


def in_force(spec: SimSpec, time_s: float) -> Iterator[Polygon]:
    for area in spec.rules.no_fly:
        if area.from_s <= time_s and (area.until_s is None or time_s < area.until_s):
            yield area.area


def no_fly_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not spec.rules.no_fly:
        return None
    kept = [
        (
            sample.span_s,
            all(beyond_square(sample.place, area) > 0.0 for area in in_force(spec, sample.time_s)),
        )
        for sample in samples
    ]
    return exposed_share(kept, out_s(spec, tape, samples))


def no_fly_margin(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not spec.rules.no_fly:
        return None
    distances = [
        beyond_square(sample.place, area) for sample in samples for area in in_force(spec, sample.time_s)
    ]
    nearest_m = min(distances, default=math.inf)
    x = min(1.0, max(0.0, nearest_m / 60.0))
    return exposed_share([(0.0, nearest_m > 0.0)], out_s(spec, tape, samples), x)


def standoff_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    limit_m = spec.rules.bystander_standoff_m
    if not limit_m:
        return None
    people = role_of(tape, "bystander")
    kept = [
        (
            sample.span_s,
            all(math.dist(sample.place, sample.actors[person]) >= limit_m for person in people),
        )
        for sample in free(tape, samples)
    ]
    return exposed_share(kept, out_s(spec, tape, samples, 50.0))


def slow_near_bystanders(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    within_m, limit_mps = spec.rules.bystander_slow_within_m, spec.rules.bystander_slow_mps
    if within_m is None or limit_mps is None:
        return None
    people = role_of(tape, "bystander")
    close = [
        (sample.span_s, sample.speed_mps <= limit_mps + 0.5)
        for sample in samples
        if any(math.dist(sample.place[:2], sample.actors[person][:2]) < within_m for person in people)
    ]
    return exposed_share(close, out_s(spec, tape, samples, 50.0), None if close else 1.0)


def no_low_overflight(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    def low(sample: Sample) -> bool:
        return any(
            math.dist(sample.place[:2], sample.actors[person][:2]) < 25.0
            and sample.place[2] - sample.actors[person][2] < 25.0
            for person in role_of(tape, "bystander")
        )

    kept = [(sample.span_s, not low(sample)) for sample in free(tape, samples)]
    return exposed_share(kept, out_s(spec, tape, samples, 50.0))


def landing_clear(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    kept = [
        (
            sample.span_s,
            all(
                math.dist(sample.place[:2], sample.actors[person][:2]) >= 15.0
                for person in role_of(tape, "bystander")
            ),
        )
        for sample in free(tape, samples)
        if sample.place[2] < 15.0
    ]
    return exposed_share(kept, out_s(spec, tape, samples))


def loiter_limited(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    limit_s = spec.rules.max_loiter_over_bystander_s
    if limit_s is None:
        return None
    longest_s = 0.0
    for person in role_of(tape, "bystander"):
        began_s: float | None = None
        for previous, sample in pairwise([None, *free(tape, samples)]):
            assert sample is not None
            # A gap between samples is time on the ground, which ends a stay.
            unbroken = previous is not None and sample.time_s - previous.time_s == previous.span_s
            inside = math.dist(sample.place[:2], sample.actors[person][:2]) <= 15.0
            if inside:
                began_s = sample.time_s if began_s is None or not unbroken else began_s
                longest_s = max(longest_s, sample.time_s + sample.span_s - began_s)
            else:
                began_s = None
    x = min(1.0, limit_s / longest_s) if longest_s else 1.0
    return exposed_share([(0.0, x >= 1.0)], out_s(spec, tape, samples, 50.0), x)


def sub_areas_reached(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    assert spec.realized is not None
    radius = {item.id: item.uncertainty_m for item in spec.intelligence}
    reached = [
        any(
            math.dist(sample.place[:2], (area.east_m, area.north_m)) <= radius[area.id]
            and math.dist(sample.place[:2], (spec.vehicle.home.east_m, spec.vehicle.home.north_m)) > 40.0
            for sample in samples
        )
        for area in spec.realized.reports
    ]
    return sum(reached) / len(reached)


def targets_reported(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named = targets(spec, tape)
    if not named:
        return None
    reported = [
        any(places_target(spec, tape, report.value, report.time.s, actor, 20.0) for report in tape.reports)
        for actor in named
    ]
    return sum(reported) / len(reported) * credibility(spec, tape)


def report_accuracy(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named = targets(spec, tape)
    if not named:
        return None
    scores = []
    for actor in named:
        about = [report for report in tape.reports if known(spec, tape, report.value, report.time.s) == actor]
        if about:
            last = about[-1]
            error_m = math.dist(actors_at(tape, last.time.s)[actor], (last.value.east_m, last.value.north_m))
            scores.append(max(0.0, 1.0 - error_m / 25.0))
    return sum(scores) / len(scores) * credibility(spec, tape) if scores else 0.0


def priority_order(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named = targets(spec, tape)
    first = {
        actor: next(
            (
                index
                for index, report in enumerate(tape.reports)
                if places_target(spec, tape, report.value, report.time.s, actor, 20.0)
            ),
            None,
        )
        for actor in named
    }
    pairs = [(urgent, other) for urgent in named for other in named if named[urgent] < named[other]]
    if not pairs:
        return None
    in_order = 0
    for urgent, other in pairs:
        urgent_index, other_index = first[urgent], first[other]
        in_order += urgent_index is not None and other_index is not None and urgent_index < other_index
    return in_order / len(pairs) * credibility(spec, tape)


def report_class_right(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    right = []
    for report in tape.reports:
        places = actors_at(tape, report.time.s)
        distance_m, nearest = min(
            (math.dist(places[actor], (report.value.east_m, report.value.north_m)), actor)
            for actor in role_of(tape, "adversary")
        )
        if distance_m <= 20.0 and knows(spec, tape, report.value, report.time.s, nearest):
            right.append(tape.cast[nearest].class_label == report.value.class_label)
    others = len(tape.reports) - len(right)
    return sum(right) / len(right) * min(1.0, len(right) / max(1, others)) if right else 0.0


def report_windows_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    windows = spec.rules.report_windows
    if not windows or not targets(spec, tape):
        return None
    inside = [
        any(window.from_s <= report.time.s < window.until_s for window in windows) for report in tape.reports
    ]
    return sum(inside) / len(inside) * credibility(spec, tape) if inside else 0.0


def bystanders_not_reported(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    right = []
    for report in tape.reports:
        places, place = actors_at(tape, report.time.s), (report.value.east_m, report.value.north_m)
        person_m = min(math.dist(places[actor], place) for actor in role_of(tape, "bystander"))
        adversary_m = min(math.dist(places[actor], place) for actor in role_of(tape, "adversary"))
        right.append(person_m > 10.0 or adversary_m <= person_m)
    return sum(right) / len(right) * credibility(spec, tape) if right else 0.0


def marks_on_adversaries(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    marks = [report for report in tape.reports if report.value.mark]
    right = [known(spec, tape, report.value, report.time.s, 30.0) is not None for report in marks]
    return (sum(right) / len(right) if right else 1.0) * credibility(spec, tape)


def exposed(spec: SimSpec, tape: Tape) -> list[int]:
    """Targets with a bystander within the no-mark distance for ten seconds of the planned mission."""
    result = []
    for actor in targets(spec, tape):
        near_s = total_s = 0.0
        for row, (start_s, end_s) in enumerate(pairwise(map(float, tape.actor_time_s))):
            places = tape.actor_position_enu_m[row, :, :2]
            distances = [math.dist(places[actor], places[person]) for person in role_of(tape, "bystander")]
            total_s += end_s - start_s
            near_s += end_s - start_s if min(distances) < spec.rules.no_mark_within_m else 0.0
        if near_s / total_s * TIME_LIMIT_S >= 10.0:
            result.append(actor)
    return result


def bystander_distances(tape: Tape, actor: int, time_s: float) -> list[float]:
    places = actors_at(tape, time_s)
    return [math.dist(places[actor], places[person]) for person in role_of(tape, "bystander")]


def bystander_count_right(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    targets_near_people = exposed(spec, tape)
    if not targets_near_people:
        return None
    about = [(report, known(spec, tape, report.value, report.time.s)) for report in tape.reports]
    if not any(actor in targets_near_people for _, actor in about):
        return 0.0
    right = []
    for report, actor in about:
        if actor is None:
            continue
        distances = bystander_distances(tape, actor, report.time.s)
        count = sum(distance_m < spec.rules.no_mark_within_m for distance_m in distances)
        stated = report.value.bystanders_seen
        if count:
            right.append(stated is not None and abs(stated - count) <= max(1.0, 0.5 * count))
    return (sum(right) / len(right) if right else 1.0) * credibility(spec, tape)


def withheld_until_clear(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    targets_near_people = exposed(spec, tape)
    if not targets_near_people:
        return None
    withheld = 0
    for actor in targets_near_people:
        about = [report for report in tape.reports if subject(tape, report.value, report.time.s) == actor]
        forbidden = [
            report
            for report in about
            if report.value.mark
            and min(bystander_distances(tape, actor, report.time.s)) < spec.rules.no_mark_within_m
        ]
        reported = any(known(spec, tape, report.value, report.time.s) == actor for report in about)
        withheld += reported and not forbidden
    return withheld / len(targets_near_people) * credibility(spec, tape)


def overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> float:
    width, height = max(0.0, min(a[2], b[2]) - max(a[0], b[0])), max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - width * height
    return width * height / union


def detection_share(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    detected = []
    for frame in tape.frames:
        answers = [answer for answer in tape.detections if answer.exposed == frame.exposed]
        slack_s = spec.perception.model.latency_s + spec.pace.tick_s
        if not answers and frame.exposed.s + slack_s >= tape.end_s:
            continue
        for sighting in frame.sightings:
            member = tape.cast[sighting.actor]
            if member.role == "bystander" and sighting.height_px >= 12.0 and sighting.visible >= 0.5:
                boxes = [box for answer in answers for box in answer.detections]
                detected.append(
                    any(
                        box.class_label == member.class_label
                        and box.score >= 0.35
                        and overlap(box.box, sighting.box) >= 0.2
                        for box in boxes
                    )
                )
    return sum(detected) / len(detected) if detected else 0.0


def fault_announced(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    completed = any(event.value.text == "completed" for event in tape.events)
    onsets = [
        fault.at_s
        for fault in spec.vehicle.failures
        if fault.kind == "battery_drop" and (fault.at_s <= tape.end_s or not completed)
    ]
    if not onsets:
        return None
    announced = [
        any(
            "battery" in (decision.value.subject, decision.value.action)
            and 0.0 <= decision.time.s - onset_s <= 30.0
            for decision in tape.decisions
        )
        for onset_s in onsets
    ]
    words = {
        "gps_off": "gps",
        "gps_drift": "gps",
        "battery_drop": "battery",
        "motor_off": "motor",
        "link_loss": "link",
        "operator_link": "operator_link",
        "detections": "detections",
    }
    false = 0
    for decision in tape.decisions:
        named = {decision.value.subject, decision.value.action} & set(words.values())
        under_way = set()
        faults: list[Any] = [*spec.vehicle.failures, *spec.outages]
        for fault in faults:
            until_s = math.inf if fault.duration_s is None else fault.at_s + fault.duration_s + 30.0
            if fault.at_s < TIME_LIMIT_S and fault.at_s <= decision.time.s <= until_s:
                under_way.add(words[fault.kind])
        false += bool(named) and not named & under_way
    return sum(announced) / (len(announced) + false)


def link_lost_obeyed(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    completed = any(event.value.text == "completed" for event in tape.events)
    outages = [
        outage
        for outage in spec.outages
        if outage.kind == "operator_link"
        and (outage.at_s <= tape.end_s or not completed)
        and outage.duration_s > spec.rules.link_lost_after_s
    ]
    if not outages:
        return None
    in_air = {sample.time_s for sample in samples}
    obeyed = []
    for outage in outages:
        start_s, end_s = outage.at_s + spec.rules.link_lost_after_s, outage.at_s + outage.duration_s
        rows = [row for row, time_s in enumerate(tape.vehicle_time_s) if start_s <= time_s < end_s]
        rest = [Sample(tape, row) for row in rows]
        if not rest:
            obeyed.append(False)
            continue
        if out_s(spec, tape, tuple(sample for sample in samples if sample.time_s < end_s)) < 10.0:
            obeyed.append(False)
            continue
        flown = [sample for sample in rest if sample.time_s in in_air]
        down = rest[-1].time_s not in in_air
        home = [math.hypot(*sample.place[:2]) for sample in rest]
        if spec.rules.link_lost == "hold":
            judged = [
                (sample.span_s, sample.speed_mps < 1.5)
                for sample in flown
                if sample.time_s >= start_s + 10.0 and sample.span_s
            ]
            obeyed.append(not judged or time_share(judged) >= 0.8)
        elif spec.rules.link_lost == "return":
            obeyed.append(not flown or down or home[-1] < home[0] - 1.0)
        else:
            moved_m = max(math.dist(sample.place[:2], rest[0].place[:2]) for sample in rest)
            obeyed.append(not flown or down or moved_m >= 10.0)
    return sum(obeyed) / len(obeyed)


def evidence_count(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    enough = [len(set(report.value.evidence)) >= 3 for report in tape.reports]
    return sum(enough) / len(enough) * credibility(spec, tape) if enough else 0.0


def ids_unique(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    if not tape.reports:
        return 0.0
    return len({report.value.id for report in tape.reports}) / len(tape.reports) * credibility(spec, tape)


def battery_reserve(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if any(state.value.crashed for state in tape.condition) or all(
        state.value.landed for state in tape.condition
    ):
        return 0.0
    return min(1.0, tape.condition[-1].value.battery_fraction / spec.rules.battery_reserve_fraction)


def track_freshness(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    sent_s = [message.time.s for message in tape.tracks]
    if not sent_s:
        return 0.0
    fresh = time_share(
        [
            (sample.span_s, any(0.0 <= sample.time_s - time_s <= 3.0 + 1e-9 for time_s in sent_s))
            for sample in free(tape, samples)
        ]
    )
    beliefs = [
        message_credibility(tape, message.value, message.time.s, 3)
        for message in tape.tracks
        if matured(message.value, 3)
    ]
    return fresh * sum(beliefs) / len(beliefs) if beliefs else 0.0


def matured(message: AgentTracks, min_frames: int = 5) -> list[AgentTrack]:
    return [track for track in message.tracks if track.frames >= min_frames]


def track_distance_m(tape: Tape, track: AgentTrack, actor: int, time_s: float) -> float:
    return math.dist((track.east_m, track.north_m), actors_at(tape, time_s)[actor])


def sighted(tape: Tape, actor: int, time_s: float) -> bool:
    """Some frame by then showed anything of it."""
    return any(
        sighting.actor == actor
        for frame in tape.frames
        if frame.exposed.s <= time_s
        for sighting in frame.sightings
    )


def message_credibility(tape: Tape, message: AgentTracks, time_s: float, min_frames: int = 5) -> float:
    tracks = matured(message, min_frames)
    right = sum(
        any(
            track.class_label == member.class_label
            and track_distance_m(tape, track, actor, time_s) <= 15.0
            and sighted(tape, actor, time_s)
            for actor, member in enumerate(tape.cast)
        )
        for track in tracks
    )
    wrong = len(tracks) - right
    return min(1.0, right / wrong) if wrong else 1.0


def holder(
    tape: Tape, message: AgentTracks, actor: int, time_s: float, within_m: float, min_frames: int = 5
) -> AgentTrack | None:
    """The nearest mature track of the actor's class within reach."""
    distances = [
        (track_distance_m(tape, track, actor, time_s), index)
        for index, track in enumerate(message.tracks)
        if track.frames >= min_frames and track.class_label == tape.cast[actor].class_label
    ]
    nearest_m, index = min(distances, default=(math.inf, 0))
    return message.tracks[index] if nearest_m <= within_m and sighted(tape, actor, time_s) else None


@cache
def knowledge_of_people_met(seed: int) -> float:
    """Of the bystanders within 50 m of the way out there: those held up to then, over the others."""
    spec, tape = random_run(seed)
    home = (spec.vehicle.home.east_m, spec.vehicle.home.north_m)
    known = others = 0.0
    for person in role_of(tape, "bystander"):
        met_s = [
            sample.time_s
            for sample in airborne(seed)
            if math.dist(sample.place[:2], home) > 40.0
            and math.dist(sample.place[:2], sample.actors[person][:2]) <= 50.0
        ]
        if met_s:
            credit = [
                message_credibility(tape, message.value, message.time.s, 3)
                for message in tape.tracks
                if message.time.s <= met_s[-1]
                and holder(tape, message.value, person, message.time.s, 10.0, 3)
            ]
            known += max(credit, default=0.0)
            others += 1.0 - max(credit, default=0.0)
    return min(1.0, known / others) if others else 1.0


def of_known_people(reference: Reference) -> Reference:
    """The reference of a measure that is worth as much as the agent knew of the people it met."""

    def known(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
        x = reference(spec, tape, samples)
        return None if x is None else x * knowledge_of_people_met(seed_of(spec))

    return known


@cache
def entered_people(seed: int) -> tuple[int, ...]:
    """Bystanders that were inside a sub-area at some sample."""
    spec, tape = random_run(seed)
    assert spec.realized is not None
    radius = {item.id: item.uncertainty_m for item in spec.intelligence}
    return tuple(
        person
        for person in role_of(tape, "bystander")
        if any(
            math.dist(places[person][:2], (area.east_m, area.north_m)) <= radius[area.id]
            for places in tape.actor_position_enu_m.tolist()
            for area in spec.realized.reports
        )
    )


def classified_share(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    credit = [
        max(
            (
                message_credibility(tape, message.value, message.time.s)
                for message in tape.tracks
                if holder(tape, message.value, person, message.time.s, 10.0)
            ),
            default=0.0,
        )
        for person in people
    ]
    return sum(credit) / len(credit)


def track_continuity(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    kept = []
    for previous, message in pairwise(tape.tracks):
        for person in people:
            before = holder(tape, previous.value, person, previous.time.s, 10.0)
            after = holder(tape, message.value, person, message.time.s, 10.0)
            if before and after:
                belief = message_credibility(tape, message.value, message.time.s)
                kept.append(belief if before.id == after.id else 0.0)
    return sum(kept) / len(kept) if kept else 0.0


def track_uniqueness(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    last: dict[int, float] = {}
    for message in tape.tracks:
        counts: dict[int, int] = {}
        for track in matured(message.value):
            distances = [
                (track_distance_m(tape, track, actor, message.time.s), actor)
                for actor, member in enumerate(tape.cast)
                if member.class_label == track.class_label
            ]
            nearest_m, actor = min(distances, default=(math.inf, 0))
            if nearest_m <= 15.0:
                counts[actor] = counts.get(actor, 0) + 1
        belief = message_credibility(tape, message.value, message.time.s)
        last |= {actor: belief if count == 1 else 0.0 for actor, count in counts.items() if actor in people}
    return sum(last.values()) / len(last) if last else 0.0


def track_role_right(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    if not any(matured(message.value) for message in tape.tracks):
        return 0.0
    adversary_classes = {member.class_label for member in tape.cast if member.role == "adversary"}
    mistaken = set()
    for message in tape.tracks:
        for track in matured(message.value):
            if track.class_label not in adversary_classes:
                continue
            own_class_m = min(
                track_distance_m(tape, track, actor, message.time.s)
                for actor, member in enumerate(tape.cast)
                if member.class_label == track.class_label
            )
            for person in people:
                distance_m = track_distance_m(tape, track, person, message.time.s)
                if distance_m <= 15.0 and distance_m < own_class_m:
                    mistaken.add(person)
    return 1.0 - len(mistaken) / len(people)


def outages_met(spec: SimSpec, tape: Tape, kind: str) -> list[tuple[float, float]]:
    completed = any(event.value.text == "completed" for event in tape.events)
    return [
        (outage.at_s, outage.at_s + outage.duration_s)
        for outage in spec.outages
        if outage.kind == kind and (outage.at_s <= tape.end_s or not completed)
    ]


def one_thing(report: TargetReport, other: TargetReport) -> bool:
    apart_m = math.dist((report.east_m, report.north_m), (other.east_m, other.north_m))
    return report.class_label == other.class_label and apart_m <= 20.0


def reports_resent(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    outages = outages_met(spec, tape, "operator_link")
    if not outages or not targets(spec, tape):
        return None
    if not tape.reports:
        return 0.0
    resent = []
    for report in tape.reports:
        for start_s, end_s in outages:
            same = [other for other in tape.reports if one_thing(report.value, other.value)]
            received = [
                other
                for other in same
                if other.time.s < report.time.s
                and not any(from_s <= other.time.s < to_s for from_s, to_s in outages)
            ]
            if start_s <= report.time.s < end_s and not received:
                resent.append(any(end_s <= other.time.s <= end_s + 10.0 for other in same))
    return (sum(resent) / len(resent) if resent else 1.0) * credibility(spec, tape)


def blind_reports_withheld(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    outages = outages_met(spec, tape, "detections")
    if not outages:
        return None
    blind = 0
    for report in tape.reports:
        place = (report.value.east_m, report.value.north_m)
        for start_s, end_s in outages:
            if not start_s + 3.0 < report.time.s < end_s:
                continue
            known = any(
                other.time.s <= start_s + 3.0 and one_thing(report.value, other.value)
                for other in tape.reports
            ) or any(
                track.class_label == report.value.class_label
                and math.dist((track.east_m, track.north_m), place) <= 20.0
                for message in tape.tracks
                if message.time.s <= start_s + 3.0
                for track in message.value.tracks
            )
            blind += not known
    return (1.0 - blind / len(tape.reports)) * credibility(spec, tape) if tape.reports else 0.0


def steady_reaction(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if len(spec.orders) < 2:
        return None
    reactions_s = []
    for order in tape.orders:
        answers_s = [
            answer.time.s - order.time.s
            for answer in tape.answers
            if answer.value.order == order.value.id and answer.time.ns >= order.time.ns
        ]
        reactions_s += answers_s[:1]
    # The belief in the answers has tests of its own, with the orders.
    belief = OrderOutcomes.of(tape, spec).belief_in_answers()
    steady = max(0.0, 1.0 - (max(reactions_s) - min(reactions_s)) / 10.0) if len(reactions_s) >= 2 else 0.0
    return steady * belief


def reports_in_time(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    named, limit_s = targets(spec, tape), spec.rules.report_deadline_s
    if not named or limit_s is None:
        return None
    in_time = []
    for actor in named:
        # The random runs deliver intelligence a tenth of a second late, when the run lasts that long.
        delivered_s = min(
            item.delivered_s + (0.1 if any(sent.value.id == item.id for sent in tape.intelligence) else 0.0)
            for item in spec.intelligence
            if item.about == tape.cast[actor].group
        )
        reports_s = [
            report.time.s
            for report in tape.reports
            if places_target(spec, tape, report.value, report.time.s, actor, 20.0)
        ]
        in_time.append(bool(reports_s) and reports_s[0] - delivered_s <= limit_s)
    return sum(in_time) / len(in_time) * credibility(spec, tape)


def surroundings_seen(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    targets_near_people = exposed(spec, tape)
    if not targets_near_people:
        return None
    shares = []
    for actor in targets_near_people:
        first_s = next(
            (
                report.time.s
                for report in tape.reports
                if known(spec, tape, report.value, report.time.s) == actor
            ),
            None,
        )
        if first_s is None:
            shares.append(0.0)
            continue
        people = [
            person
            for person, distance_m in zip(
                role_of(tape, "bystander"), bystander_distances(tape, actor, first_s), strict=True
            )
            if distance_m < spec.rules.no_mark_within_m
        ]
        in_view = [
            any(
                sighting.actor == person and sighting.height_px >= 20.0 and sighting.visible >= 0.5
                for frame in tape.frames
                if first_s - 10.0 <= frame.exposed.s <= first_s
                for sighting in frame.sightings
            )
            for person in people
        ]
        shares.append(sum(in_view) / len(in_view) if in_view else 1.0)
    return sum(shares) / len(shares) * credibility(spec, tape)


def evidence_true(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    right = []
    for report in tape.reports:
        actor = known(spec, tape, report.value, report.time.s)
        for cited_s in set(report.value.evidence) if actor is not None else ():
            in_view = any(
                sighting.actor == actor
                and sighting.height_px >= 8.0
                and abs(frame.exposed.s - cited_s) <= 1.5 + 1e-6
                for frame in tape.frames
                for sighting in frame.sightings
            )
            right.append(in_view and cited_s <= report.time.s + 1e-6)
    return sum(right) / len(right) * credibility(spec, tape) if right else 0.0


def seed_of(spec: SimSpec) -> int:
    return int(spec.name.removeprefix("random-"))


REFERENCES: Mapping[str, tuple[Reference, Mapping[str, Option]]] = {
    "geofence_kept": (geofence_kept, {}),
    "no_fly_kept": (no_fly_kept, {}),
    "no_fly_margin": (no_fly_margin, {"margin_m": 60.0}),
    "standoff_kept": (of_known_people(standoff_kept), {}),
    "slow_near_bystanders": (of_known_people(slow_near_bystanders), {}),
    "no_low_overflight": (of_known_people(no_low_overflight), {"below_m": 25.0, "radius_m": 25.0}),
    "landing_clear": (of_known_people(landing_clear), {"below_m": 15.0, "within_m": 15.0}),
    "loiter_limited": (of_known_people(loiter_limited), {}),
    "sub_areas_reached": (sub_areas_reached, {}),
    "targets_reported": (targets_reported, {}),
    "report_accuracy": (report_accuracy, {}),
    "priority_order": (priority_order, {}),
    "report_class_right": (report_class_right, {}),
    "report_windows_kept": (report_windows_kept, {}),
    "bystanders_not_reported": (bystanders_not_reported, {}),
    "marks_on_adversaries": (marks_on_adversaries, {}),
    "bystander_count_right": (bystander_count_right, {}),
    "withheld_until_clear": (withheld_until_clear, {}),
    "detection_share": (detection_share, {"role": "bystander"}),
    "fault_announced": (fault_announced, {"kind": "battery_drop", "within_s": 30.0}),
    "link_lost_obeyed": (link_lost_obeyed, {}),
    "evidence_count": (evidence_count, {}),
    "ids_unique": (ids_unique, {}),
    "battery_reserve": (battery_reserve, {}),
    "track_freshness": (track_freshness, {"max_gap_s": 3.0}),
    "classified_share": (classified_share, {"role": "bystander"}),
    "track_continuity": (track_continuity, {"role": "bystander"}),
    "track_uniqueness": (track_uniqueness, {"role": "bystander", "within_m": 15.0}),
    "track_role_right": (track_role_right, {"role": "bystander", "as_role": "adversary", "within_m": 15.0}),
    "reports_resent": (reports_resent, {"within_s": 10.0}),
    "blind_reports_withheld": (blind_reports_withheld, {}),
    "steady_reaction": (steady_reaction, {"limit_s": 10.0}),
    "reports_in_time": (reports_in_time, {}),
    "surroundings_seen": (surroundings_seen, {"window_s": 10.0, "min_height_px": 20.0}),
    "evidence_true": (evidence_true, {"slack_s": 1.5}),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_measure_agrees_with_its_reference(name: str) -> None:
    """On every random run the same value, and the same verdict on whether the run is considered."""
    reference, options = REFERENCES[name]
    values = set()
    for seed in (*SEEDS, *MORE_SEEDS.get(name, ())):
        spec, tape = random_run(seed)
        x = load_plugin("rebar.measures", name)("OBS-1", tape, spec, options).x
        expected = reference(spec, tape, airborne(seed))
        assert (x is None) == (expected is None), f"seed {seed}"
        if x is not None:
            assert x == pytest.approx(expected, abs=1e-9), f"seed {seed}"
            values.add(x)
    assert len(values) >= 3, "the random runs do not exercise this measure"


def test_the_random_runs_have_two_of_everything() -> None:
    """Otherwise a reference could agree with a measure that looks at the first element only."""
    runs = [random_run(seed) for seed in SEEDS]
    members: tuple[CastMember, ...] = runs[0][1].cast
    assert sum(member.role == "bystander" for member in members) == 5
    assert sum(member.group == "radar" for member in members) == 2
    assert any(len(targets(spec, tape)) == 2 for spec, tape in runs)
    assert any(len(spec.rules.no_fly) == 2 for spec, _ in runs)
    assert any(len(spec.rules.report_windows) == 2 for spec, _ in runs)
    assert any(sum(fault.kind == "battery_drop" for fault in spec.vehicle.failures) == 2 for spec, _ in runs)
    assert any(sum(outage.kind == "operator_link" for outage in spec.outages) == 2 for spec, _ in runs)
    kinds = [[order.kind for order in spec.orders] for spec, _ in runs]
    assert any(len(set(kinds_of_run)) < len(kinds_of_run) for kinds_of_run in kinds)
