"""Whether placed actors keep what their SimSpec asks for, judged without anything that placed them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import shapely
import shapely.affinity

from bench.errors import Fault
from bench.simspec import ASSETS, ActorGroup, Near, PlacedActor, Polygon, Realized, SimSpec

SLACK_M = 1e-6
HOME_CLEARANCE_M = 3.0


def check_placement(simspec: SimSpec) -> list[Fault]:
    """Everything in `realized` that does not keep the intent beside it; empty when all is well.

    Footprints are shapely polygons in a tree here, relations plain loops: nothing is shared with the sampler.
    """
    if simspec.realized is None:
        return [Fault("realized", "is missing", "place the SimSpec first")]
    members = _members(simspec.realized)
    return [
        *_counts(simspec, simspec.realized),
        *_collisions(simspec, simspec.realized),
        *(fault for group in simspec.actors for fault in _group(simspec, group, members)),
        *_reports(simspec, simspec.realized, members),
    ]


Members = dict[str, list[PlacedActor]]


def _members(realized: Realized) -> Members:
    members: Members = {}
    for actor in realized.actors:
        members.setdefault(actor.group, []).append(actor)
    return members


def _counts(simspec: SimSpec, realized: Realized) -> Iterator[Fault]:
    wanted = {group.id: group.members(simspec.world.area.area_m2) for group in simspec.actors}
    found = Counter(actor.group for actor in realized.actors)
    for group in wanted.keys() | found.keys():
        if wanted.get(group, 0) != found[group]:
            yield Fault(f"realized: group {group}", f"has {found[group]} members", f"{wanted.get(group, 0)} are asked for")
    for actor, times in Counter(actor.id for actor in realized.actors).items():
        if times > 1:
            yield Fault(f"realized: {actor}", f"stands {times} times", "ids must be unique")


def _outline(simspec: SimSpec, actor: PlacedActor) -> shapely.Polygon | None:
    """The actor's footprint, None where its group or asset is unknown."""
    asset = next((ASSETS.get(group.asset) for group in simspec.actors if group.id == actor.group), None)
    if asset is None:
        return None
    box = shapely.box(-asset.width_m / 2, -asset.length_m / 2, asset.width_m / 2, asset.length_m / 2)  # heading north
    turned = shapely.affinity.rotate(box, -actor.heading_deg, origin=(0.0, 0.0))
    return shapely.affinity.translate(turned, actor.east_m, actor.north_m)


def _collisions(simspec: SimSpec, realized: Realized) -> Iterator[Fault]:
    known = [(actor, outline) for actor in realized.actors if (outline := _outline(simspec, actor)) is not None]
    if not known:
        return
    separation = [simspec.group(actor.group).placement.separation_m for actor, _ in known]
    fixed = [simspec.group(actor.group).placement.at is not None for actor, _ in known]
    outlines = [outline for _, outline in known]
    tree = shapely.STRtree(outlines)
    for one, other in tree.query(outlines, predicate="dwithin", distance=max(separation) + SLACK_M).T:
        if one < other:
            # Two fixed actors stand where their author put them; they only must not overlap.
            wanted = 0.0 if fixed[one] and fixed[other] else max(separation[one], separation[other])
            gap = shapely.distance(outlines[one], outlines[other])
            if gap < wanted - SLACK_M or (gap == 0.0 and shapely.intersection(outlines[one], outlines[other]).area > SLACK_M):
                yield Fault(
                    f"realized: {known[one][0].id} and {known[other][0].id}",
                    f"are {gap:.3f} m apart",
                    f"{wanted:g} m are asked for",
                )
    home = shapely.Point(simspec.vehicle.home.east_m, simspec.vehicle.home.north_m)
    for (actor, outline), at in zip(known, fixed, strict=True):
        if not at and shapely.distance(home, outline) < HOME_CLEARANCE_M - SLACK_M:
            yield Fault(f"realized: {actor.id}", "stands on the vehicle's home", f"keep {HOME_CLEARANCE_M:g} m clear of it")


def _group(simspec: SimSpec, group: ActorGroup, members: Members) -> Iterator[Fault]:
    place = group.placement
    own = members.get(group.id, [])
    if place.at is not None:
        for actor in own:
            if math.hypot(actor.east_m - place.at.east_m, actor.north_m - place.at.north_m) > SLACK_M:
                yield Fault(f"realized: {actor.id}", "is not where placement.at fixes it", "move it there")
        return
    region = _polygon(place.region or simspec.world.area).buffer(SLACK_M)
    for actor in own:
        outline = _outline(simspec, actor)
        if outline is not None and not region.covers(outline):
            yield Fault(f"realized: {actor.id}", "stands outside its region", "keep the whole footprint inside")
        if place.near and not any(_keeps(place.near, actor, other) for other in members.get(place.near.of, [])):
            yield Fault(f"realized: {actor.id}", f"is not near {place.near.of!r}", _wanted(place.near, "some"))
        if place.away and not all(_keeps(place.away, actor, other) for other in members.get(place.away.of, [])):
            yield Fault(f"realized: {actor.id}", f"does not keep away from {place.away.of!r}", _wanted(place.away, "every"))
    mean = place.mean_distance
    if mean and own and members.get(mean.of):
        found = math.fsum(_distance_m(actor, members[mean.of][0]) for actor in own) / len(own)
        if abs(found - mean.mean_m) > mean.tolerance * mean.mean_m + SLACK_M:
            yield Fault(
                f"realized: group {group.id}",
                f"has a mean distance of {found:.2f} m to {mean.of!r}",
                f"{mean.mean_m:g} m within {mean.tolerance:.1%} are asked for",
            )


def _polygon(polygon: Polygon) -> shapely.Polygon:
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


def _distance_m(one: PlacedActor, other: PlacedActor) -> float:
    return math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)


def _keeps(relation: Near, one: PlacedActor, other: PlacedActor) -> bool:
    return relation.min_m - SLACK_M <= _distance_m(one, other) <= relation.max_m + SLACK_M


def _wanted(relation: Near, whom: str) -> str:
    return f"keep {relation.min_m:g} to {relation.max_m:g} m from {whom} member"


def _reports(simspec: SimSpec, realized: Realized, members: Members) -> Iterator[Fault]:
    placed = {report.id: report for report in realized.reports}
    for report in simspec.intelligence:
        found = placed.pop(report.id, None)
        if found is None:
            yield Fault(f"realized: report {report.id}", "is missing", "place the SimSpec again")
        elif members.get(report.about):
            truth = members[report.about][0]
            error = math.hypot(found.east_m - truth.east_m, found.north_m - truth.north_m)
            if error > report.uncertainty_m + SLACK_M:
                yield Fault(
                    f"realized: report {report.id}", f"is {error:.1f} m from the truth", f"at most {report.uncertainty_m:g} m"
                )
    for extra in placed:
        yield Fault(f"realized: report {extra}", "is about nothing in intelligence", "remove it")
