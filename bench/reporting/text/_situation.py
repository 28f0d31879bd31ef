"""One situation in words: its groups, its rules and its events."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from bench.simspec import (
    ActorGroup,
    Along,
    Between,
    Consent,
    CountRange,
    Facing,
    Motion,
    Placement,
    PlaceReference,
    Point,
    Rules,
    SimSpec,
)


def group_text(group: ActorGroup, area_m2: float) -> str:
    """A group in words: how many members, of what kind, where, and how they move."""
    density = "" if group.density_per_km2 is None else f" ({group.density_per_km2:g} per km²)"
    count = str(group.member_count(area_m2))
    if isinstance(group.count, CountRange):
        count = f"{group.count.low} to {group.count.high}"
    parts = [
        f"{count} {group.asset}{density}",
        group.role.value,
        *_distances(group.placement),
        *_places(group.placement),
    ]
    parts += [group.color] if group.color else []
    parts += [f"concealment {group.concealment:g}"] if group.concealment else []
    return ", ".join([*parts, *_motion(group.motion)])


def _distances(place: Placement) -> Iterator[str]:
    if place.mean_distance:
        yield f"{place.mean_distance.mean_m:g} m from {place.mean_distance.of} on average"
    if place.near:
        yield f"{place.near.min_m:g} to {place.near.max_m:g} m from {place.near.of}"
    if place.away:
        yield f"{place.away.min_m:g} to {place.away.max_m:g} m from every {place.away.of}"
    for distance in place.distances:
        target = (
            _point_text(distance.point)
            if distance.of is None
            else f"{'every' if distance.whom == 'every' else 'some'} {distance.of}"
        )
        span = (
            f"{distance.min_m:g} m or more"
            if distance.max_m is None
            else f"{distance.min_m:g} to {distance.max_m:g} m"
        )
        yield f"{span} from {target}"


def _along_text(along: Along) -> str:
    return f"on {along.road}" if along.where == "on" else f"beside {along.road}, {along.gap_text} off it"


def _between_text(between: Between) -> str:
    same = between.first == between.second
    return f"between two of {between.first}" if same else f"between {between.first} and {between.second}"


def _facing_text(facing: Facing) -> str:
    if facing.heading_deg is not None:
        return f"heading {facing.heading_deg:g}°"
    return f"facing {_reference_text(facing)}"


# By the field of a placement that is told, in this order.
_PLACES: dict[str, Callable[[Any], str]] = {
    "at": lambda at: f"at {at.east_m:g}, {at.north_m:g} m",
    "region": lambda region: f"in a region of {region.area_m2:.0f} m²",
    "inside": lambda inside: f"inside {inside.area or inside.of}",
    "along": _along_text,
    "between": _between_text,
    "bearing": lambda ray: f"{ray.from_deg:g} to {ray.to_deg:g}° from {_reference_text(ray)}",
    "facing": _facing_text,
    "hidden_from": lambda observer: f"hidden from {_reference_text(observer)}",
    "visible_from": lambda observer: f"visible from {_reference_text(observer)}",
}


def _places(place: Placement) -> Iterator[str]:
    for field, text in _PLACES.items():
        if value := getattr(place, field):
            yield text(value)
    for avoid in place.avoid:
        gap = f"{avoid.at_least_m:g} m or more clear of" if avoid.at_least_m else "outside"
        yield f"{gap} {avoid.area or f'every {avoid.of}'}"
    yield from (f"{count.text} of them inside {count.area}" for count in place.counts)
    if place.spread_m:
        yield f"{place.spread_m:g} m apart or more"
    if place.extent_m:
        yield f"at most {place.extent_m:g} m from one to another"


def _reference_text(reference: PlaceReference) -> str:
    return reference.of if reference.of is not None else _point_text(reference.point)


def _point_text(point: Point | None) -> str:
    return "nowhere" if point is None else f"{point.east_m:g}, {point.north_m:g} m"


def _motion(motion: Motion) -> Iterator[str]:
    if motion.kind == "wander":
        yield f"wandering within {motion.radius_m:g} m at {motion.speed_mps:g} m/s"
    elif motion.kind == "patrol":
        yield f"patrolling {len(motion.route)} points at {motion.speed_mps:g} m/s"
    if motion.kind != "still" and motion.depart_s:
        yield f"from {motion.depart_s:g} s on"
    if motion.kind != "still" and motion.halt_s is not None:
        yield f"until {motion.halt_s:g} s"


def rules_text(rules: Rules) -> str:
    """Every rule that is set, the no-mark distance first."""
    return "; ".join(_rules(rules))


def _rules(rules: Rules) -> Iterator[str]:
    yield f"no mark within {rules.no_mark_within_m:g} m of bystanders"
    yield f"reports from confidence {rules.min_report_confidence:g} on"
    low = "" if rules.min_altitude_m is None else f"from {rules.min_altitude_m:g} m on and "
    yield f"height {low}up to {rules.max_altitude_m:g} m"
    yield f"{rules.battery_reserve_fraction:.0%} of charge kept"
    if rules.max_speed_mps is not None:
        yield f"no faster than {rules.max_speed_mps:g} m/s"
    if rules.bystander_standoff_m:
        yield f"{rules.bystander_standoff_m:g} m from bystanders"
    if rules.bystander_slow_mps is not None:
        yield f"{rules.bystander_slow_mps:g} m/s within {rules.bystander_slow_within_m:g} m of bystanders"
    if rules.max_loiter_over_bystander_s is not None:
        yield f"no longer than {rules.max_loiter_over_bystander_s:g} s over one bystander"
    if rules.geofence is not None:
        yield "a geofence"
    if rules.no_fly:
        yield f"no flight over {', '.join(window.id for window in rules.no_fly)}"
    if rules.report_deadline_s is not None:
        yield f"reports within {rules.report_deadline_s:g} s of intelligence"
    if rules.report_windows:
        yield f"reports only from {', '.join(f'{window.from_s:g} to {window.until_s:g} s' for window in rules.report_windows)}"
    if rules.link_lost != "continue":
        yield f"{rules.link_lost} after {rules.link_lost_after_s:g} s without the operator"
    if rules.mark_consent:
        yield "marks only with the operator's consent"


def events_text(simspec: SimSpec) -> str:
    """Orders, outages and failures in words; `none` when there are none."""
    events = [(order.at_s, f"order {order.kind}") for order in simspec.orders]
    events += [
        (outage.at_s, f"{outage.kind.replace('_', ' ')} away for {outage.duration_s:g} s")
        for outage in simspec.outages
    ]
    events += [
        (
            failure.at_s,
            f"{failure.kind.replace('_', ' ')}{'' if failure.duration_s is None else f' for {failure.duration_s:g} s'}",
        )
        for failure in simspec.vehicle.failures
    ]
    texts = [f"{at_s:g} s {text}" for at_s, text in sorted(events)]
    return "; ".join([*texts, *map(_consent_text, simspec.consents)]) or "none"


def _consent_text(consent: Consent) -> str:
    after = "" if consent.answer == "never" else f" after {consent.after_s:g} s"
    return f"consent to mark {consent.intelligence}: {consent.answer}{after}"


def intelligence_text(simspec: SimSpec) -> str:
    """The intelligence reports in words; `none` when there are none."""
    reports = [
        f"{report.id}: priority {report.priority}, within {report.uncertainty_m:g} m"
        + (f" of ({report.at.east_m:g}, {report.at.north_m:g})" if report.at else "")
        + (f", {report.latency_s:g} s old" if report.latency_s else "")
        + (f", delivered at {report.delivered_s:g} s" if report.delivered_s else "")
        for report in simspec.intelligence
    ]
    return "; ".join(reports) or "none"
