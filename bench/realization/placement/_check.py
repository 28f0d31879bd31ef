"""The judge of placements: checks places against their SimSpec and shares no code with the search."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache

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

# Slacks absorb rounding alone: places are millimetres, headings microdegrees, so real faults are far larger.
SLACK_M = 1e-6


SLACK_DEG = 1e-5


# Repeated here on purpose: the judge imports nothing from the modules that it judges.
HOME_CLEARANCE_M = 3.0


def check_placement(simspec: SimSpec) -> list[Fault]:
    """Every fault of `realized` against the relations of the same SimSpec; empty when all hold.

    Footprints are shapely polygons in a tree here, relations plain loops: nothing is shared with the sampler.
    """
    if simspec.realized is None:
        return [Fault("realized", "is missing", "place the SimSpec first")]
    members, outlines = _members(simspec, simspec.realized), _outlines(simspec, simspec.realized)
    return [
        *_count_faults(simspec, simspec.realized),
        *_collision_faults(simspec, simspec.realized, outlines),
        *(fault for group in simspec.actors for fault in _inside_faults(simspec, group, members, outlines)),
        *(fault for group in simspec.actors for fault in _between_faults(group, members)),
        *(fault for group in simspec.actors for fault in _group_faults(simspec, group, members, outlines)),
        *(fault for group in simspec.actors for fault in _actor_faults(simspec, group, members, outlines)),
        *_route_faults(simspec, simspec.realized, outlines),
        *_report_faults(simspec, simspec.realized, members),
    ]


Members = dict[str, list[PlacedActor]]


def _members(simspec: SimSpec, realized: Realized) -> Members:
    members: Members = {}
    if all(group.id != HOME for group in simspec.actors):
        members[HOME] = [PlacedActor(id=HOME, group=HOME, **simspec.vehicle.home.model_dump())]
    for actor in realized.actors:
        members.setdefault(actor.group, []).append(actor)
    return members


def _count_faults(simspec: SimSpec, realized: Realized) -> Iterator[Fault]:
    wanted = {group.id: _count_bounds(simspec, group) for group in simspec.actors}
    counts = Counter(actor.group for actor in realized.actors)
    for group in sorted(wanted.keys() | counts.keys()):
        low, high = wanted.get(group, (0, 0))
        if not low <= counts[group] <= high:
            expected = f"{low} are" if low == high else f"{low} to {high} are"
            yield Fault(f"realized: group {group}", f"has {counts[group]} members", f"{expected} required")
    for actor, times in Counter(actor.id for actor in realized.actors).items():
        if times > 1:
            yield Fault(f"realized: {actor}", f"is placed {times} times", "ids must be unique")


def _count_bounds(simspec: SimSpec, group: ActorGroup) -> tuple[int, int]:
    if isinstance(group.count, CountRange):
        return group.count.low, group.count.high
    return (group.member_count(simspec.world.area.area_m2),) * 2


Outlines = dict[str, shapely.Polygon]
"""Footprints by the actor's id. An actor of an unknown group or asset has none."""


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
                (
                    actor.east_m + fore * east + side * right_east,
                    actor.north_m + fore * north + side * right_north,
                )
                for fore, side in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
        )
    outlines = shapely.polygons(rings) if rings else []
    return {actor.id: outline for (actor, _), outline in zip(known, outlines, strict=True)}


def _collision_faults(simspec: SimSpec, realized: Realized, footprints: Outlines) -> Iterator[Fault]:
    known = [(actor, footprints[actor.id]) for actor in realized.actors if actor.id in footprints]
    if not known:
        return
    separation = [simspec.group(actor.group).placement.separation_m for actor, _ in known]
    fixed = [simspec.group(actor.group).placement.at is not None for actor, _ in known]
    outlines = [outline for _, outline in known]
    tree = shapely.STRtree(outlines)
    for first, second in tree.query(outlines, predicate="dwithin", distance=max(separation) + SLACK_M).T:
        if first < second:
            # The author decides how close two fixed actors stand; they only must not overlap.
            wanted = 0.0 if fixed[first] and fixed[second] else max(separation[first], separation[second])
            if _is_inside_host(simspec, known[first], known[second]) or _is_inside_host(
                simspec, known[second], known[first]
            ):
                continue
            gap = shapely.distance(outlines[first], outlines[second])
            if gap < wanted - SLACK_M or (
                gap == 0.0 and shapely.intersection(outlines[first], outlines[second]).area > SLACK_M
            ):
                yield Fault(
                    f"realized: {known[first][0].id} and {known[second][0].id}",
                    f"are {gap:.3f} m apart",
                    f"{wanted:g} m are required",
                )
    home = shapely.Point(simspec.vehicle.home.east_m, simspec.vehicle.home.north_m)
    for (actor, _), at, distance_m in zip(known, fixed, shapely.distance(home, outlines), strict=True):
        if not at and distance_m < HOME_CLEARANCE_M - SLACK_M:
            yield Fault(
                f"realized: {actor.id}",
                "is too close to the vehicle's home",
                f"keep {HOME_CLEARANCE_M:g} m clear of it",
            )


Outlined = tuple[PlacedActor, shapely.Polygon]


def _is_inside_host(simspec: SimSpec, guest: Outlined, host: Outlined) -> bool:
    """Whether the guest's group belongs inside the host's, directly or through other hosts, and the guest
    lies wholly in this host.
    """
    inside = simspec.group(guest[0].group).placement.inside
    visited = {guest[0].group}
    while inside is not None and inside.of is not None and inside.of not in visited:
        if inside.of == host[0].group:
            return bool(host[1].buffer(SLACK_M).covers(guest[1]))
        visited.add(inside.of)
        inside = simspec.group(inside.of).placement.inside
    return False


def _inside_faults(
    simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines
) -> Iterator[Fault]:
    inside = group.placement.inside
    if inside is None:
        return
    if inside.area is not None:
        rooms = [_polygon(area) for area in simspec.world.areas if area.id == inside.area]
    else:
        rooms = [outlines[other.id] for other in members.get(inside.of or "", []) if other.id in outlines]
    rooms = [room.buffer(SLACK_M) for room in rooms]
    what = f"area {inside.area!r}" if inside.area is not None else f"any member of {inside.of!r}"
    for actor in members.get(group.id, []):
        outline = outlines.get(actor.id)
        if outline is not None and not any(room.covers(outline) for room in rooms):
            yield Fault(f"realized: {actor.id}", f"is not inside {what}", "keep the whole footprint inside")


def _between_faults(group: ActorGroup, members: Members) -> Iterator[Fault]:
    between = group.placement.between
    if between is None:
        return
    actors = members.get(group.id, [])
    firsts, seconds = members.get(between.first, []), members.get(between.second, [])
    last = 1 if between.first == between.second else 0
    if actors and (not firsts or len(seconds) <= last):
        yield Fault(
            f"realized: group {group.id}",
            f"has no members of {between.first!r} and {between.second!r} to stand between",
        )
        return
    for actor in actors:
        start, end = firsts[0], seconds[last]
        way = shapely.LineString([(start.east_m, start.north_m), (end.east_m, end.north_m)])
        spot = shapely.Point(actor.east_m, actor.north_m)
        # Law of cosines: the actor lies strictly between the ends when the angles at both ends are acute.
        ends = (_distance_m(start, end) ** 2, _distance_m(actor, start) ** 2, _distance_m(actor, end) ** 2)
        acute = ends[0] + ends[1] - ends[2] > -SLACK_M and ends[0] + ends[2] - ends[1] > -SLACK_M
        if not acute or way.length == 0.0 or way.distance(spot) > between.within_m + SLACK_M:
            yield Fault(
                f"realized: {actor.id}",
                f"is not between {between.first!r} and {between.second!r}",
                f"stand within {between.within_m:g} m of the straight line between them",
            )


def _group_faults(
    simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines
) -> Iterator[Fault]:
    place = group.placement
    actors = members.get(group.id, [])
    if place.at is not None:
        for actor in actors:
            if math.hypot(actor.east_m - place.at.east_m, actor.north_m - place.at.north_m) > SLACK_M:
                yield Fault(f"realized: {actor.id}", "is not at the place of placement.at", "move it there")
            if _turn_deg(actor.heading_deg, place.at.heading_deg) > SLACK_DEG:
                yield Fault(f"realized: {actor.id}", "has another heading than placement.at", "turn it")
        return
    outlined = [actor.id for actor in actors if actor.id in outlines]
    covered = shapely.covers(
        _grown_polygon(place.region or simspec.world.area), [outlines[name] for name in outlined]
    )
    outside = {name for name, is_covered in zip(outlined, covered, strict=True) if not is_covered}
    for actor in actors:
        if actor.id in outside:
            yield Fault(
                f"realized: {actor.id}", "stands outside its region", "keep the whole footprint inside"
            )
        if place.near and not any(
            _is_in_near_band(place.near, actor, other) for other in members.get(place.near.of, [])
        ):
            yield Fault(
                f"realized: {actor.id}", f"is not near {place.near.of!r}", _near_remedy(place.near, "some")
            )
        if place.away and not all(
            _is_in_near_band(place.away, actor, other) for other in members.get(place.away.of, [])
        ):
            yield Fault(
                f"realized: {actor.id}",
                f"does not keep away from {place.away.of!r}",
                _near_remedy(place.away, "every"),
            )
    mean = place.mean_distance
    if mean and actors and members.get(mean.of):
        mean_m = math.fsum(_distance_m(actor, members[mean.of][0]) for actor in actors) / len(actors)
        if abs(mean_m - mean.mean_m) > mean.tolerance * mean.mean_m + SLACK_M:
            yield Fault(
                f"realized: group {group.id}",
                f"has a mean distance of {mean_m:.2f} m to {mean.of!r}",
                f"{mean.mean_m:g} m within {mean.tolerance:.1%} are required",
            )


def _actor_faults(
    simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines
) -> Iterator[Fault]:
    place = group.placement
    actors = members.get(group.id, [])
    for actor in actors:
        yield from _distance_faults(simspec, group, actor, members)
        if place.along:
            yield from _road_faults(simspec, actor, place.along, outlines)
        yield from _bearing_faults(group, actor, members)
        yield from _heading_faults(group, actor, members)
        yield from _sight_faults(simspec, group, actor, members, outlines)
    yield from _avoid_faults(simspec, group, members, outlines)
    yield from _area_count_faults(simspec, group, members, outlines)
    if place.extent_m:
        for first, second in itertools.combinations(actors, 2):
            if _distance_m(first, second) > place.extent_m + SLACK_M:
                yield Fault(
                    f"realized: {first.id} and {second.id}",
                    "stand farther apart than extent_m",
                    f"at most {place.extent_m:g} m between centres are allowed",
                )
    if place.spread_m:
        for first, second in itertools.combinations(actors, 2):
            if _distance_m(first, second) < place.spread_m - SLACK_M:
                yield Fault(
                    f"realized: {first.id} and {second.id}",
                    "stand closer than spread_m",
                    f"keep {place.spread_m:g} m between centres",
                )


def _distance_faults(
    simspec: SimSpec, group: ActorGroup, actor: PlacedActor, members: Members
) -> Iterator[Fault]:
    for number, distance in enumerate(group.placement.distances):
        in_band = [
            _is_in_band(distance, distance_m)
            for distance_m in _distances_m(simspec, group, distance, actor, members)
        ]
        if not (any(in_band) if distance.whom == "some" else all(in_band)):
            target = f"{distance.whom} member of {distance.of!r}" if distance.of else "a point"
            yield Fault(
                f"realized: {actor.id}",
                f"does not keep its distance from {target}",
                f"see distances[{number}]",
            )


def _avoid_faults(
    simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines
) -> Iterator[Fault]:
    outlined = [(actor, outlines[actor.id]) for actor in members.get(group.id, []) if actor.id in outlines]
    for number, avoid in enumerate(group.placement.avoid):
        if avoid.of is None:
            others = [_polygon(area) for area in simspec.world.areas if area.id == avoid.area]
        elif avoid.of in {HOME, *(other_group.id for other_group in simspec.actors)}:
            others = [_outline_or_point(actor, outlines) for actor in members.get(avoid.of, [])]
        else:
            names = _groups_of_role(simspec, group, avoid.of)
            others = [_outline_or_point(actor, outlines) for name in names for actor in members.get(name, [])]
        for (actor, outline), other in itertools.product(outlined, others):
            gap_m = outline.distance(other)
            # Touching is no overlap. Only what touches is shrunk: a crowd has many thousand pairs.
            overlap = gap_m == 0.0 and outline.buffer(-SLACK_M).intersects(other)
            if gap_m < avoid.at_least_m - SLACK_M or overlap:
                yield Fault(
                    f"realized: {actor.id}",
                    f"does not keep out of {avoid.area or avoid.of!r}",
                    f"see avoid[{number}]",
                )


def _outline_or_point(actor: PlacedActor, outlines: Outlines) -> shapely.Geometry:
    return outlines.get(actor.id, shapely.Point(actor.east_m, actor.north_m))


def _area_count_faults(
    simspec: SimSpec, group: ActorGroup, members: Members, outlines: Outlines
) -> Iterator[Fault]:
    actors = [actor for actor in members.get(group.id, []) if actor.id in outlines]
    for number, count in enumerate(group.placement.counts):
        area = next(_polygon(area) for area in simspec.world.areas if area.id == count.area)
        room = area.buffer(SLACK_M)
        inside = [room.covers(outlines[actor.id]) for actor in actors]
        for actor, is_inside in zip(actors, inside, strict=True):
            if not is_inside and outlines[actor.id].buffer(-SLACK_M).intersects(area):
                yield Fault(
                    f"realized: {actor.id}",
                    f"stands across the border of area {count.area!r}",
                    f"see counts[{number}]",
                )
        if not count.low <= sum(inside) <= count.high(len(actors)):
            yield Fault(
                f"realized: group {group.id}",
                f"has {sum(inside)} members inside area {count.area!r}",
                f"{count.text} are required",
            )


def _bearing_faults(group: ActorGroup, actor: PlacedActor, members: Members) -> Iterator[Fault]:
    bearing = group.placement.bearing
    if bearing and (spots := _spots_of(bearing, members)):
        angle = _bearing_deg(spots[0], (actor.east_m, actor.north_m))
        span = (bearing.to_deg - bearing.from_deg) % 360.0
        # The slack on both sides of the modulo, so that a place a hair before `from_deg` is not 360 degrees
        # past it.
        if not -SLACK_DEG <= (angle - bearing.from_deg + SLACK_DEG) % 360.0 - SLACK_DEG <= span + SLACK_DEG:
            sector = f"{bearing.from_deg:g} to {bearing.to_deg:g}"
            yield Fault(
                f"realized: {actor.id}", f"stands at {angle:.2f} degrees", f"the sector is {sector} degrees"
            )


def _heading_faults(group: ActorGroup, actor: PlacedActor, members: Members) -> Iterator[Fault]:
    facing = group.placement.facing
    where = f"realized: {actor.id}"
    if facing and facing.heading_deg is not None:
        off = _turn_deg(actor.heading_deg, facing.heading_deg)
        if off > facing.within_deg + SLACK_DEG:
            required = f"{facing.heading_deg:g} degrees within {facing.within_deg:g} are required"
            yield Fault(where, f"heads {actor.heading_deg:.2f} degrees", required)
    elif facing and (spots := _spots_of(facing, members)):
        off = _turn_deg(actor.heading_deg, _bearing_deg((actor.east_m, actor.north_m), spots[0]))
        if off > facing.within_deg + SLACK_DEG:
            yield Fault(
                where,
                f"heads {off:.2f} degrees off what it faces",
                f"at most {facing.within_deg:g} degrees are allowed",
            )


def _sight_faults(
    simspec: SimSpec, group: ActorGroup, actor: PlacedActor, members: Members, outlines: Outlines
) -> Iterator[Fault]:
    """Faults of sight: `hidden_from` must hold for every member of the other group, `visible_from` for one of
    them.
    """
    hidden, visible = group.placement.hidden_from, group.placement.visible_from
    where = f"realized: {actor.id}"
    if hidden and any(
        _is_visible(simspec, actor, eye, hidden, outlines) for eye in _spots_of(hidden, members)
    ):
        yield Fault(where, "is visible from where it must be hidden", "put something solid in between")
    if visible and not any(
        _is_visible(simspec, actor, eye, visible, outlines) for eye in _spots_of(visible, members)
    ):
        yield Fault(where, "is hidden from where it must be visible", "clear the line of sight")


def _distances_m(
    simspec: SimSpec, group: ActorGroup, distance: Distance, actor: PlacedActor, members: Members
) -> Iterator[float]:
    """The actor's distances to every target of the relation: the point, or each member of the groups."""
    if distance.point is not None:
        yield math.hypot(actor.east_m - distance.point.east_m, actor.north_m - distance.point.north_m)
        return
    assert distance.of is not None
    named = distance.of in {HOME, *(other_group.id for other_group in simspec.actors)}
    for name in [distance.of] if named else _groups_of_role(simspec, group, distance.of):
        yield from (_distance_m(actor, other) for other in members.get(name, []))


def _groups_of_role(simspec: SimSpec, group: ActorGroup, role: str) -> list[str]:
    return [other.id for other in simspec.actors if other.role == role and other.id != group.id]


def _is_in_band(distance: Distance, found_m: float) -> bool:
    most_m = math.inf if distance.max_m is None else distance.max_m
    return distance.min_m - SLACK_M <= found_m <= most_m + SLACK_M


Spot = tuple[float, float]


def _spots_of(reference: PlaceReference, members: Members) -> list[Spot]:
    """The point, or all members, the first one first."""
    if reference.point is not None:
        return [(reference.point.east_m, reference.point.north_m)]
    return [(actor.east_m, actor.north_m) for actor in members.get(reference.of or "", [])]


def _bearing_deg(start: Spot, end: Spot) -> float:
    return math.degrees(math.atan2(end[0] - start[0], end[1] - start[1])) % 360.0


def _turn_deg(one_deg: float, other_deg: float) -> float:
    return abs((one_deg - other_deg + 180.0) % 360.0 - 180.0)


def _road_faults(simspec: SimSpec, actor: PlacedActor, along: Along, outlines: Outlines) -> Iterator[Fault]:
    road = next(candidate for candidate in simspec.world.roads if candidate.id == along.road)
    line = shapely.LineString([(point.east_m, point.north_m) for point in road.points])
    covered = line.buffer(road.width_m / 2.0, cap_style="flat", join_style="mitre", mitre_limit=2.0)
    outline = outlines.get(actor.id)
    if outline is None:
        return
    where = f"realized: {actor.id}"
    gap = covered.distance(outline)
    if along.where == "on" and not covered.buffer(SLACK_M).covers(outline):
        yield Fault(where, f"does not stand on road {road.id!r}", "keep the whole footprint on it")
    if along.where == "beside" and not (
        gap > 0.0 and along.at_least_m - SLACK_M <= gap <= along.within_m + SLACK_M
    ):
        yield Fault(where, f"is {gap:.3f} m from road {road.id!r}", f"stand off it, {along.gap_text}")
    if along.parallel_deg is not None:
        spot = shapely.Point(actor.east_m, actor.north_m)
        pieces = [shapely.LineString(pair) for pair in itertools.pairwise(line.coords)]
        nearest = min(pieces, key=spot.distance)
        # At a bend both stretches are equally near, and rounding would choose: either heading is accepted.
        equally_near = [piece for piece in pieces if piece.distance(spot) <= nearest.distance(spot) + SLACK_M]
        off = min(_slant_deg(actor.heading_deg, _bearing_deg(*piece.coords)) for piece in equally_near)
        if off > along.parallel_deg + SLACK_DEG:
            yield Fault(
                where, f"heads {off:.2f} degrees off road {road.id!r}", f"at most {along.parallel_deg:g}"
            )


def _slant_deg(one_deg: float, other_deg: float) -> float:
    return min(_turn_deg(one_deg, other_deg), _turn_deg(one_deg + 180.0, other_deg))


def _is_visible(simspec: SimSpec, actor: PlacedActor, eye: Spot, sight: Sight, outlines: Outlines) -> bool:
    """Whether the middle of the actor's top is visible from the eye.

    Each solid outline cuts the ground line; the height of the line of sight over the cut decides whether it
    passes above.
    """
    assert simspec.realized is not None
    top_m = ASSETS[simspec.group(actor.group).asset].height_m
    spot = (actor.east_m, actor.north_m)
    line = shapely.LineString([eye, spot])
    for other in simspec.realized.actors:
        group = next((candidate for candidate in simspec.actors if candidate.id == other.group), None)
        asset = ASSETS.get(group.asset) if group else None
        if asset is None or not asset.solid or other.group == actor.group:
            continue
        outline = outlines.get(other.id)
        if outline is None or outline.covers(shapely.Point(eye)):
            continue
        cut = line.intersection(outline)
        if cut.length > SLACK_M:
            shares = [line.project(shapely.Point(corner)) / line.length for corner in cut.coords]
            if (
                min(sight.height_m + share * (top_m - sight.height_m) for share in shares)
                < asset.height_m - SLACK_M
            ):
                return False
    return True


def _route_faults(simspec: SimSpec, realized: Realized, outlines: Outlines) -> Iterator[Fault]:
    """Patrols that cannot walk straight to some point of their route and round it.

    Solid actors that stand still block the way, and so does the area's border for walkers that start inside
    it.
    """
    groups = {group.id: group for group in simspec.actors if group.asset in ASSETS}
    walkers = [
        actor
        for actor in realized.actors
        if actor.group in groups and groups[actor.group].motion.kind == "patrol"
    ]
    if not walkers:
        return
    walls = [
        (actor, outline)
        for actor in realized.actors
        if actor.group in groups
        and groups[actor.group].motion.kind == "still"
        and ASSETS[groups[actor.group].asset].solid
        if (outline := outlines.get(actor.id)) is not None
    ]
    area = _polygon(simspec.world.area)
    reported: set[tuple[str, str]] = set()
    for walker in walkers:
        group, spot = groups[walker.group], shapely.Point(walker.east_m, walker.north_m)
        starts_inside = bool(area.contains(spot))
        points = [
            _walked_point(area, shapely.Point(point.east_m, point.north_m), starts_inside)
            for point in group.motion.route
        ]
        room_m = ASSETS[group.asset].width_m / 2.0 - SLACK_M
        closed = [(wall, outline, outline.buffer(room_m, join_style="mitre")) for wall, outline in walls]
        legs = [shapely.LineString(pair) for pair in itertools.pairwise([*points, points[0]])]
        for wall, _, grown in closed:
            if (wall.id, group.id) not in reported and any(grown.intersects(leg) for leg in legs):
                reported.add((wall.id, group.id))
                yield Fault(
                    f"realized: {wall.id}", f"blocks the patrol route of {group.id!r}", "move one of them"
                )
        if (
            starts_inside
            and ("area", group.id) not in reported
            and not all(area.buffer(SLACK_M).covers(leg) for leg in legs)
        ):
            reported.add(("area", group.id))
            yield Fault(
                f"realized: {walker.id}",
                "has a patrol route that leaves the area",
                "add points that lead round",
            )
        ways = [shapely.LineString([spot, point]) for point in points]
        reachable = [way for way in ways if not starts_inside or area.buffer(SLACK_M).covers(way)]
        if not any(
            _is_open(way, spot, [(outline, grown) for _, outline, grown in closed]) for way in reachable
        ):
            yield Fault(
                f"realized: {walker.id}",
                "has no straight way to any point of its patrol route",
                "move it, or what blocks it",
            )


def _walked_point(area: shapely.Polygon, point: shapely.Point, held: bool) -> shapely.Point:
    """A route point as the simulation walks it: moved half a metre inside the border when it lies beyond."""
    if not held or area.contains(point):
        return point
    nearest = area.exterior.interpolate(area.exterior.project(point))
    share = 1.0 + 0.5 / max(nearest.distance(point), 1e-9)
    return shapely.Point(point.x + share * (nearest.x - point.x), point.y + share * (nearest.y - point.y))


def _is_open(
    way: shapely.LineString, spot: shapely.Point, walls: list[tuple[shapely.Polygon, shapely.Polygon]]
) -> bool:
    """Whether no wall blocks the way.

    A wall counts with the walker's half width, unless the walker already stands closer.
    """
    return not any((outline if grown.covers(spot) else grown).intersects(way) for outline, grown in walls)


def _polygon(polygon: Polygon) -> shapely.Polygon:
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


@lru_cache(64)
def _grown_polygon(polygon: Polygon) -> shapely.Polygon:
    return _polygon(polygon).buffer(SLACK_M)


def _distance_m(first: PlacedActor, second: PlacedActor) -> float:
    return math.hypot(first.east_m - second.east_m, first.north_m - second.north_m)


def _is_in_near_band(relation: Near, first: PlacedActor, second: PlacedActor) -> bool:
    return relation.min_m - SLACK_M <= _distance_m(first, second) <= relation.max_m + SLACK_M


def _near_remedy(relation: Near, quantifier: str) -> str:
    return f"keep {relation.min_m:g} to {relation.max_m:g} m from {quantifier} member"


def _report_faults(simspec: SimSpec, realized: Realized, members: Members) -> Iterator[Fault]:
    placed = {report.id: report for report in realized.reports}
    for report in simspec.intelligence:
        placed_report = placed.pop(report.id, None)
        if placed_report is None:
            yield Fault(f"realized: report {report.id}", "is missing", "place the SimSpec again")
        elif members.get(report.about):
            truth = members[report.about][0]
            error = math.hypot(placed_report.east_m - truth.east_m, placed_report.north_m - truth.north_m)
            if error > report.uncertainty_m + SLACK_M:
                yield Fault(
                    f"realized: report {report.id}",
                    f"is {error:.1f} m from the truth",
                    f"at most {report.uncertainty_m:g} m",
                )
    for extra in placed:
        yield Fault(f"realized: report {extra}", "has no entry in intelligence", "remove it")
