"""Whether placed actors keep what their SimSpec asks for, judged without anything that placed them."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator

import shapely

from bench.errors import Fault
from bench.simspec import (
    ASSETS,
    HOME,
    ActorGroup,
    Along,
    CountRange,
    Distance,
    Near,
    PlacedActor,
    PlaceReference,
    Polygon,
    Realized,
    Sight,
    SimSpec,
)

SLACK_M = 1e-6


SLACK_DEG = 1e-5


HOME_CLEARANCE_M = 3.0


def check_placement(simspec: SimSpec) -> list[Fault]:
    """Everything in `realized` that does not keep the intent beside it; empty when all is well.

    Footprints are shapely polygons in a tree here, relations plain loops: nothing is shared with the sampler.
    """
    if simspec.realized is None:
        return [Fault("realized", "is missing", "place the SimSpec first")]
    members, outlines = _members(simspec, simspec.realized), _outlines(simspec, simspec.realized)
    return [
        *_counts(simspec, simspec.realized),
        *_collisions(simspec, simspec.realized, outlines),
        *(fault for group in simspec.actors for fault in _inside(simspec, group, members, outlines)),
        *(fault for group in simspec.actors for fault in _between(group, members)),
        *(fault for group in simspec.actors for fault in _group(simspec, group, members, outlines)),
        *(fault for group in simspec.actors for fault in _more(simspec, group, members, outlines)),
        *_routes(simspec, simspec.realized, outlines),
        *_reports(simspec, simspec.realized, members),
    ]


Members = dict[str, list[PlacedActor]]


def _members(simspec: SimSpec, realized: Realized) -> Members:
    members: Members = {}
    if all(group.id != HOME for group in simspec.actors):
        members[HOME] = [PlacedActor(id=HOME, group=HOME, **simspec.vehicle.home.model_dump())]
    for actor in realized.actors:
        members.setdefault(actor.group, []).append(actor)
    return members


def _counts(simspec: SimSpec, realized: Realized) -> Iterator[Fault]:
    wanted = {group.id: _wanted_count(simspec, group) for group in simspec.actors}
    found = Counter(actor.group for actor in realized.actors)
    for group in sorted(wanted.keys() | found.keys()):
        low, high = wanted.get(group, (0, 0))
        if not low <= found[group] <= high:
            asked = f"{low} are" if low == high else f"{low} to {high} are"
            yield Fault(f"realized: group {group}", f"has {found[group]} members", f"{asked} asked for")
    for actor, times in Counter(actor.id for actor in realized.actors).items():
        if times > 1:
            yield Fault(f"realized: {actor}", f"stands {times} times", "ids must be unique")


def _wanted_count(simspec: SimSpec, group: ActorGroup) -> tuple[int, int]:
    if isinstance(group.count, CountRange):
        return group.count.low, group.count.high
    return (group.member_count(simspec.world.area.area_m2),) * 2


Outlines = dict[str, shapely.Polygon]
"""Footprints by the actor's id; of an unknown group or asset there is none."""


def _outlines(simspec: SimSpec, realized: Realized) -> Outlines:
    assets = {group.id: ASSETS.get(group.asset) for group in simspec.actors}
    known = [(actor, asset) for actor in realized.actors if (asset := assets.get(actor.group)) is not None]
    # All at once and by hand: shapely's own turning of a box takes far longer, and every scene is judged.
    rings = []
    for actor, asset in known:
        heading = math.radians(actor.heading_deg)
        ahead, aside = asset.length_m / 2, asset.width_m / 2
        east, north = ahead * math.sin(heading), ahead * math.cos(heading)
        right_east, right_north = aside * math.cos(heading), -aside * math.sin(heading)
        rings.append(
            [
                (actor.east_m + fore * east + side * right_east, actor.north_m + fore * north + side * right_north)
                for fore, side in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
        )
    outlines = shapely.polygons(rings) if rings else []
    return {actor.id: outline for (actor, _), outline in zip(known, outlines, strict=True)}


def _collisions(simspec: SimSpec, realized: Realized, footprints: Outlines) -> Iterator[Fault]:
    known = [(actor, footprints[actor.id]) for actor in realized.actors if actor.id in footprints]
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
            if _stands_in(simspec, known[one], known[other]) or _stands_in(simspec, known[other], known[one]):
                continue
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


Outlined = tuple[PlacedActor, shapely.Polygon]


def _stands_in(simspec: SimSpec, guest: Outlined, host: Outlined) -> bool:
    """Whether the one is to stand inside the other's group, or inside what is inside that, and stands wholly inside this member."""
    inside = simspec.group(guest[0].group).placement.inside
    seen = {guest[0].group}
    while inside is not None and inside.of is not None and inside.of not in seen:
        if inside.of == host[0].group:
            return bool(host[1].buffer(SLACK_M).covers(guest[1]))
        seen.add(inside.of)
        inside = simspec.group(inside.of).placement.inside
    return False


def _inside(simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines) -> Iterator[Fault]:
    inside = group.placement.inside
    if inside is None:
        return
    if inside.area is not None:
        rooms = [_polygon(one) for one in simspec.world.areas if one.id == inside.area]
    else:
        rooms = [outlines[other.id] for other in members.get(inside.of or "", []) if other.id in outlines]
    rooms = [room.buffer(SLACK_M) for room in rooms]
    what = f"area {inside.area!r}" if inside.area is not None else f"any member of {inside.of!r}"
    for actor in members.get(group.id, []):
        outline = outlines.get(actor.id)
        if outline is not None and not any(room.covers(outline) for room in rooms):
            yield Fault(f"realized: {actor.id}", f"is not inside {what}", "keep the whole footprint inside")


def _between(group: ActorGroup, members: Members) -> Iterator[Fault]:
    between = group.placement.between
    if between is None:
        return
    own = members.get(group.id, [])
    firsts, seconds = members.get(between.first, []), members.get(between.second, [])
    last = 1 if between.first == between.second else 0
    if own and (not firsts or len(seconds) <= last):
        yield Fault(f"realized: group {group.id}", f"has nobody to stand between in {between.first!r} and {between.second!r}")
        return
    for actor in own:
        start, end = firsts[0], seconds[last]
        way = shapely.LineString([(start.east_m, start.north_m), (end.east_m, end.north_m)])
        spot = shapely.Point(actor.east_m, actor.north_m)
        # Law of cosines: neither end sees the other and the actor at more than a right angle.
        ends = (_distance_m(start, end) ** 2, _distance_m(actor, start) ** 2, _distance_m(actor, end) ** 2)
        acute = ends[0] + ends[1] - ends[2] > -SLACK_M and ends[0] + ends[2] - ends[1] > -SLACK_M
        if not acute or way.length == 0.0 or way.distance(spot) > between.within_m + SLACK_M:
            yield Fault(
                f"realized: {actor.id}",
                f"is not between {between.first!r} and {between.second!r}",
                f"stand within {between.within_m:g} m of the way from one to the other",
            )


def _group(simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines) -> Iterator[Fault]:
    place = group.placement
    own = members.get(group.id, [])
    if place.at is not None:
        for actor in own:
            if math.hypot(actor.east_m - place.at.east_m, actor.north_m - place.at.north_m) > SLACK_M:
                yield Fault(f"realized: {actor.id}", "is not where placement.at fixes it", "move it there")
            if _turn_deg(actor.heading_deg, place.at.heading_deg) > SLACK_DEG:
                yield Fault(f"realized: {actor.id}", "does not head as placement.at fixes it", "turn it")
        return
    region = _polygon(place.region or simspec.world.area).buffer(SLACK_M)
    for actor in own:
        outline = outlines.get(actor.id)
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


def _more(simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines) -> Iterator[Fault]:
    place = group.placement
    own = members.get(group.id, [])
    for actor in own:
        where = f"realized: {actor.id}"
        for distance in place.distances:
            keeps = [_in_band(distance, one) for one in _found_m(simspec, group, distance, actor, members)]
            if not (any(keeps) if distance.whom == "some" else all(keeps)):
                whom = f"{distance.whom} member of {distance.of!r}" if distance.of else "a point"
                yield Fault(where, f"does not keep its distance from {whom}", "see distances")
        if place.along:
            yield from _along(simspec, actor, place.along, outlines)
        if place.bearing and (seen := _seen(place.bearing, members)):
            angle = _bearing_deg(seen[0], (actor.east_m, actor.north_m))
            span = (place.bearing.to_deg - place.bearing.from_deg) % 360.0
            if not -SLACK_DEG <= (angle - place.bearing.from_deg + SLACK_DEG) % 360.0 - SLACK_DEG <= span + SLACK_DEG:
                yield Fault(
                    where, f"stands at {angle:.2f} degrees", f"{place.bearing.from_deg:g} to {place.bearing.to_deg:g} asked for"
                )
        if place.facing and place.facing.heading_deg is not None:
            off = _turn_deg(actor.heading_deg, place.facing.heading_deg)
            if off > place.facing.within_deg + SLACK_DEG:
                yield Fault(where, f"heads {actor.heading_deg:.2f} degrees", f"{place.facing.heading_deg:g} asked for")
        elif place.facing and (seen := _seen(place.facing, members)):
            off = _turn_deg(actor.heading_deg, _bearing_deg((actor.east_m, actor.north_m), seen[0]))
            if off > place.facing.within_deg + SLACK_DEG:
                yield Fault(where, f"heads {off:.2f} degrees off whom it is to face", f"at most {place.facing.within_deg:g}")
        if place.hidden_from and any(
            _sees(simspec, actor, eye, place.hidden_from, outlines) for eye in _seen(place.hidden_from, members)
        ):
            yield Fault(where, "can be seen from where it is to be hidden", "put something solid between them")
        if place.visible_from and not any(
            _sees(simspec, actor, eye, place.visible_from, outlines) for eye in _seen(place.visible_from, members)
        ):
            yield Fault(where, "cannot be seen from where it is to be visible", "clear the line of sight")
    if place.spread_m:
        for one, other in itertools.combinations(own, 2):
            if _distance_m(one, other) < place.spread_m - SLACK_M:
                yield Fault(f"realized: {one.id} and {other.id}", "are less spread than asked for", f"{place.spread_m:g} m")


def _found_m(simspec: SimSpec, group: ActorGroup, distance: Distance, actor: PlacedActor, members: Members) -> Iterator[float]:
    """How far the actor is from whomever a distance is about."""
    if distance.point is not None:
        yield math.hypot(actor.east_m - distance.point.east_m, actor.north_m - distance.point.north_m)
        return
    assert distance.of is not None
    named = distance.of in {HOME, *(one.id for one in simspec.actors)}
    for name in [distance.of] if named else _of_role(simspec, group, distance.of):
        yield from (_distance_m(actor, other) for other in members.get(name, []))


def _of_role(simspec: SimSpec, group: ActorGroup, role: str) -> list[str]:
    return [one.id for one in simspec.actors if one.role == role and one.id != group.id]


def _in_band(distance: Distance, found_m: float) -> bool:
    most_m = math.inf if distance.max_m is None else distance.max_m
    return distance.min_m - SLACK_M <= found_m <= most_m + SLACK_M


Spot = tuple[float, float]


def _seen(seen: PlaceReference, members: Members) -> list[Spot]:
    """The point, or all members, the first one first."""
    if seen.point is not None:
        return [(seen.point.east_m, seen.point.north_m)]
    return [(one.east_m, one.north_m) for one in members.get(seen.of or "", [])]


def _bearing_deg(start: Spot, end: Spot) -> float:
    return math.degrees(math.atan2(end[0] - start[0], end[1] - start[1])) % 360.0


def _turn_deg(one_deg: float, other_deg: float) -> float:
    return abs((one_deg - other_deg + 180.0) % 360.0 - 180.0)


def _along(simspec: SimSpec, actor: PlacedActor, along: Along, outlines: Outlines) -> Iterator[Fault]:
    road = next(one for one in simspec.world.roads if one.id == along.road)
    line = shapely.LineString([(point.east_m, point.north_m) for point in road.points])
    covered = line.buffer(road.width_m / 2.0, cap_style="flat", join_style="mitre", mitre_limit=2.0)
    outline = outlines.get(actor.id)
    if outline is None:
        return
    where = f"realized: {actor.id}"
    gap = covered.distance(outline)
    if along.where == "on" and not covered.buffer(SLACK_M).covers(outline):
        yield Fault(where, f"does not stand on road {road.id!r}", "keep the whole footprint on it")
    if along.where == "beside" and not (gap > 0.0 and along.at_least_m - SLACK_M <= gap <= along.within_m + SLACK_M):
        yield Fault(where, f"is {gap:.3f} m from road {road.id!r}", f"stand off it, {along.gap_text}")
    if along.parallel_deg is not None:
        spot = shapely.Point(actor.east_m, actor.north_m)
        pieces = [shapely.LineString(pair) for pair in itertools.pairwise(line.coords)]
        near = min(pieces, key=spot.distance)
        # Where two stretches are equally near, either will do.
        level = [piece for piece in pieces if piece.distance(spot) <= near.distance(spot) + SLACK_M]
        off = min(_slant_deg(actor.heading_deg, _bearing_deg(*piece.coords)) for piece in level)
        if off > along.parallel_deg + SLACK_DEG:
            yield Fault(where, f"heads {off:.2f} degrees off road {road.id!r}", f"at most {along.parallel_deg:g}")


def _slant_deg(one_deg: float, other_deg: float) -> float:
    return min(_turn_deg(one_deg, other_deg), _turn_deg(one_deg + 180.0, other_deg))


def _sees(simspec: SimSpec, actor: PlacedActor, eye: Spot, sight: Sight, outlines: Outlines) -> bool:
    """Whether the middle of the actor's top is in sight: each solid outline cuts the line on the ground, and the line's height
    over the cut tells whether it passes above."""
    assert simspec.realized is not None
    top_m = ASSETS[simspec.group(actor.group).asset].height_m
    spot = (actor.east_m, actor.north_m)
    line = shapely.LineString([eye, spot])
    for other in simspec.realized.actors:
        group = next((one for one in simspec.actors if one.id == other.group), None)
        asset = ASSETS.get(group.asset) if group else None
        if asset is None or not asset.solid or other.group == actor.group:
            continue
        outline = outlines.get(other.id)
        if outline is None or outline.covers(shapely.Point(eye)):
            continue
        cut = line.intersection(outline)
        if cut.length > SLACK_M:
            shares = [line.project(shapely.Point(corner)) / line.length for corner in cut.coords]
            if min(sight.height_m + share * (top_m - sight.height_m) for share in shares) < asset.height_m - SLACK_M:
                return False
    return True


def _routes(simspec: SimSpec, realized: Realized, outlines: Outlines) -> Iterator[Fault]:
    """Patrols must be able to walk straight to some point of their route and round it: nothing solid that stands still may
    reach in, nor the area's border for whoever starts inside it."""
    groups = {group.id: group for group in simspec.actors if group.asset in ASSETS}
    walkers = [one for one in realized.actors if one.group in groups and groups[one.group].motion.kind == "patrol"]
    if not walkers:
        return
    walls = [
        (actor, outline)
        for actor in realized.actors
        if actor.group in groups and groups[actor.group].motion.kind == "still" and ASSETS[groups[actor.group].asset].solid
        if (outline := outlines.get(actor.id)) is not None
    ]
    area = _polygon(simspec.world.area)
    told: set[tuple[str, str]] = set()
    for walker in walkers:
        group, spot = groups[walker.group], shapely.Point(walker.east_m, walker.north_m)
        held = bool(area.contains(spot))
        points = [_walked(area, shapely.Point(one.east_m, one.north_m), held) for one in group.motion.route]
        room_m = ASSETS[group.asset].width_m / 2.0 - SLACK_M
        closed = [(wall, outline, outline.buffer(room_m, join_style="mitre")) for wall, outline in walls]
        legs = [shapely.LineString(pair) for pair in itertools.pairwise([*points, points[0]])]
        for wall, _, grown in closed:
            if (wall.id, group.id) not in told and any(grown.intersects(leg) for leg in legs):
                told.add((wall.id, group.id))
                yield Fault(f"realized: {wall.id}", f"closes the patrol route of {group.id!r}", "move one of them")
        if held and ("area", group.id) not in told and not all(area.buffer(SLACK_M).covers(leg) for leg in legs):
            told.add(("area", group.id))
            yield Fault(f"realized: {walker.id}", "is to walk a route that leaves the area", "add points that lead round")
        ways = [shapely.LineString([spot, point]) for point in points]
        held_ways = [way for way in ways if not held or area.buffer(SLACK_M).covers(way)]
        if not any(_open(way, spot, [(outline, grown) for _, outline, grown in closed]) for way in held_ways):
            yield Fault(
                f"realized: {walker.id}", "has no straight way to any point of its patrol route", "move it, or what closes it"
            )


def _walked(area: shapely.Polygon, point: shapely.Point, held: bool) -> shapely.Point:
    """A point of a route as it is walked: half a metre inside the border where it lies beyond it."""
    if not held or area.contains(point):
        return point
    near = area.exterior.interpolate(area.exterior.project(point))
    share = 1.0 + 0.5 / max(near.distance(point), 1e-9)
    return shapely.Point(point.x + share * (near.x - point.x), point.y + share * (near.y - point.y))


def _open(way: shapely.LineString, spot: shapely.Point, walls: list[tuple[shapely.Polygon, shapely.Polygon]]) -> bool:
    """Whether nothing closes a way: what the walker needs to its sides, but where it stands closer than that already."""
    return not any((outline if grown.covers(spot) else grown).intersects(way) for outline, grown in walls)


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
