"""The mission, limits of flight and distances from people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

from bench.contracts import Tape
from bench.simspec import Polygon, SimSpec

from .agreement import agrees
from .flown_samples import (
    Place,
    Sample,
    airborne,
    free,
    out_s,
    role_of,
    seed_of,
    time_share,
)
from .held_tracks import holder, message_credibility


def exposed_share(
    spans: list[tuple[float, bool]], exposed_s: float, value: float | None = None
) -> float | None:
    """The share (or the value) where the vehicle was exposed for ten seconds; else 0 when it broke the rule."""
    if exposed_s < 10.0:
        return 0.0 if any(not holds for _, holds in spans) else None
    return time_share(spans) if value is None else value


def beyond_square(place: Place, square: Polygon) -> float:
    """Distance from the edge of an upright square, negative inside."""
    east, north = [corner.east_m for corner in square.corners], [corner.north_m for corner in square.corners]
    out_east = max(min(east) - place[0], place[0] - max(east))
    out_north = max(min(north) - place[1], place[1] - max(north))
    if out_east <= 0.0 and out_north <= 0.0:
        return max(out_east, out_north)
    return math.hypot(max(out_east, 0.0), max(out_north, 0.0))


CAUSES = {"gps_off": {"position"}, "link_loss": {"link", "setpoints"}}


def excused_s(spec: SimSpec, tape: Tape) -> list[tuple[float, float]]:
    """When a failsafe flew that a lost GPS or link of the situation caused, with the ten seconds after it."""
    spans = []
    for failure in spec.vehicle.failures:
        causes = CAUSES.get(failure.kind, set())
        fault_ends_s = failure.at_s + (math.inf if failure.duration_s is None else failure.duration_s)
        states = [*tape.condition, None]
        began_s: float | None = None
        for state in states:
            running = state is not None and state.value.failsafe in causes
            time_s = state.time.s if state is not None else math.inf
            if running and began_s is None:
                began_s = time_s
            elif not running and began_s is not None:
                if failure.at_s < spec.mission.time_limit_s and failure.at_s < began_s <= fault_ends_s + 1e-6:
                    spans.append((began_s, min(time_s, fault_ends_s) + 10.0))
                began_s = None
    return spans


def by_agent(spec: SimSpec, tape: Tape, samples: Iterable[Sample]) -> list[Sample]:
    """The samples that no such failsafe flew; the operator flies in none of the random runs."""
    spans = excused_s(spec, tape)
    return [
        sample for sample in samples if not any(start_s <= sample.time_s < end_s for start_s, end_s in spans)
    ]


@agrees()
def geofence_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    fence = spec.rules.geofence
    if fence is None:
        return None
    flown = by_agent(spec, tape, samples)
    spans = [(sample.span_s, beyond_square(sample.place, fence) <= 0.0) for sample in flown]
    return exposed_share(spans, out_s(spec, tape, samples))


def in_force(spec: SimSpec, time_s: float) -> Iterator[Polygon]:
    for area in spec.rules.no_fly:
        if area.from_s <= time_s and (area.until_s is None or time_s < area.until_s):
            yield area.area


@agrees()
def no_fly_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not spec.rules.no_fly:
        return None
    spans = [
        (
            sample.span_s,
            all(beyond_square(sample.place, area) > 0.0 for area in in_force(spec, sample.time_s)),
        )
        for sample in by_agent(spec, tape, samples)
    ]
    return exposed_share(spans, out_s(spec, tape, samples))


@agrees(margin_m=60.0)
def no_fly_margin(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not spec.rules.no_fly:
        return None
    distances = [
        beyond_square(sample.place, area)
        for sample in by_agent(spec, tape, samples)
        for area in in_force(spec, sample.time_s)
    ]
    nearest_m = min(distances, default=math.inf)
    x = min(1.0, max(0.0, nearest_m / 60.0))
    return exposed_share([(0.0, nearest_m > 0.0)], out_s(spec, tape, samples), x)


@agrees()
def standoff_kept(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    limit_m = spec.rules.bystander_standoff_m
    if not limit_m:
        return None
    people = role_of(tape, "bystander")
    spans = [
        (
            sample.span_s,
            all(math.dist(sample.place, sample.actors[person]) >= limit_m for person in people),
        )
        for sample in free(tape, samples)
    ]
    return exposed_share(spans, out_s(spec, tape, samples, 50.0))


@agrees()
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


@agrees(below_m=25.0, radius_m=25.0)
def no_low_overflight(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    def low(sample: Sample) -> bool:
        return any(
            math.dist(sample.place[:2], sample.actors[person][:2]) < 25.0
            and sample.place[2] - sample.actors[person][2] < 25.0
            for person in role_of(tape, "bystander")
        )

    spans = [(sample.span_s, not low(sample)) for sample in free(tape, samples)]
    return exposed_share(spans, out_s(spec, tape, samples, 50.0))


@agrees(below_m=15.0, within_m=15.0)
def landing_clear(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    spans = [
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
    return exposed_share(spans, out_s(spec, tape, samples))


@agrees()
def loiter_limited(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    limit_s = spec.rules.max_loiter_over_bystander_s
    if limit_s is None:
        return None
    longest_s = 0.0
    for person in role_of(tape, "bystander"):
        began_s: float | None = None
        for previous, sample in pairwise([None, *by_agent(spec, tape, free(tape, samples))]):
            assert sample is not None
            # A gap between samples is time on the ground or under a failsafe, which ends a stay.
            unbroken = previous is not None and sample.time_s - previous.time_s == previous.span_s
            inside = math.dist(sample.place[:2], sample.actors[person][:2]) <= 15.0
            if inside:
                began_s = sample.time_s if began_s is None or not unbroken else began_s
                longest_s = max(longest_s, sample.time_s + sample.span_s - began_s)
            else:
                began_s = None
    x = min(1.0, limit_s / longest_s) if longest_s else 1.0
    return exposed_share([(0.0, x >= 1.0)], out_s(spec, tape, samples, 50.0), x)


@agrees()
def people_met_known(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    """Of the bystanders within 50 m of the way out there, the credit of those held up to then."""
    home = (spec.vehicle.home.east_m, spec.vehicle.home.north_m)
    known = []
    for person in role_of(tape, "bystander"):
        met_s = [
            sample.time_s
            for sample in airborne(seed_of(spec))
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
            known.append(max(credit, default=0.0))
    x = sum(known) / len(known) if known else 1.0
    return exposed_share([(0.0, True)], out_s(spec, tape, samples, 50.0), x)


@agrees()
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


@agrees()
def battery_reserve(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if any(state.value.crashed for state in tape.condition) or all(
        state.value.landed for state in tape.condition
    ):
        return 0.0
    return min(1.0, tape.condition[-1].value.battery_fraction / spec.rules.battery_reserve_fraction)
