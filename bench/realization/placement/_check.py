"""The judge of placements: checks places against their SimSpec and shares no code with the search."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence

import shapely

from bench.errors import Fault
from bench.simspec import HOME, ActorGroup, CountRange, PlacedActor, PlaceReference, Realized, SimSpec

from ._check_geometry import (
    SLACK_M,
    Spot,
    apart_m,
    bearing_deg,
    footprint_outlines,
    ground_of,
    grown_polygon,
    is_in_band,
    point_of,
    slant_deg,
    turn_deg,
    walked_point,
)

SLACK_DEG = 1e-5

# Repeated here on purpose: the judge imports nothing from the modules that it judges.
HOME_CLEARANCE_M = 3.0


def check_placement(simspec: SimSpec) -> list[Fault]:
    """Every fault of `realized` against the relations of the same SimSpec; empty when all hold.

    Footprints are shapely polygons in a tree here, relations plain loops: nothing is shared with the sampler.
    """
    if simspec.realized is None:
        return [Fault("realized", "is missing", "place the SimSpec first")]
    judge = _Judge(simspec, simspec.realized)
    checks = (judge.inside, judge.between, judge.place, judge.relations)
    return [
        *judge.numbers(),
        *judge.collisions(),
        *judge.clearances(),
        *(
            fault
            for check in checks
            for group in simspec.actors
            for fault in check(group, judge.members.get(group.id, []))
        ),
        *judge.routes(),
        *judge.reports(),
    ]


def _fault(actors: Sequence[PlacedActor], what: str, remedy: str) -> Fault:
    return Fault(f"realized: {' and '.join(actor.id for actor in actors)}", what, remedy)


def _group_fault(name: str, what: str, remedy: str = "") -> Fault:
    return Fault(f"realized: group {name}", what, remedy)


class _Judge:
    """A SimSpec with its placed members by group, the vehicle's home among them, and their footprints by id.

    An actor of an unknown group or asset has no footprint.
    """

    def __init__(self, simspec: SimSpec, realized: Realized) -> None:
        self.simspec, self.realized = simspec, realized
        self.members: dict[str, list[PlacedActor]] = {}
        if all(group.id != HOME for group in simspec.actors):
            self.members[HOME] = [PlacedActor(id=HOME, group=HOME, **simspec.vehicle.home.model_dump())]
        for actor in realized.actors:
            self.members.setdefault(actor.group, []).append(actor)
        self.outlines = footprint_outlines(simspec, realized)

    def numbers(self) -> Iterator[Fault]:
        area_m2 = self.simspec.world.area.area_m2
        wanted = {
            group.id: (group.count.low, group.count.high)
            if isinstance(group.count, CountRange)
            else (group.member_count(area_m2),) * 2
            for group in self.simspec.actors
        }
        counts = Counter(actor.group for actor in self.realized.actors)
        for group in sorted(wanted.keys() | counts.keys()):
            low, high = wanted.get(group, (0, 0))
            if not low <= counts[group] <= high:
                expected = f"{low} are" if low == high else f"{low} to {high} are"
                yield _group_fault(group, f"has {counts[group]} members", f"{expected} required")
        for actor, times in Counter(actor.id for actor in self.realized.actors).items():
            if times > 1:
                yield Fault(f"realized: {actor}", f"is placed {times} times", "ids must be unique")

    def collisions(self) -> Iterator[Fault]:
        known = [actor for actor in self.realized.actors if actor.id in self.outlines]
        if not known:  # a tree of nothing cannot be asked
            return
        places = [self.simspec.group(actor.group).placement for actor in known]
        outlines = [self.outlines[actor.id] for actor in known]
        widest_m = max((place.separation_m for place in places), default=0.0)
        pairs = shapely.STRtree(outlines).query(outlines, predicate="dwithin", distance=widest_m + SLACK_M)
        for first, second in pairs.T:
            if first >= second or self._is_hosted(known[first], known[second]):
                continue
            # The author decides how close two fixed actors stand; they only must not overlap.
            pair = (places[first], places[second])
            wanted = 0.0 if all(place.at for place in pair) else max(place.separation_m for place in pair)
            gap = shapely.distance(outlines[first], outlines[second])
            overlap = gap == 0.0 and shapely.intersection(outlines[first], outlines[second]).area > SLACK_M
            if overlap or gap < wanted - SLACK_M:
                actors = (known[first], known[second])
                yield _fault(actors, f"are {gap:.3f} m apart", f"{wanted:g} m are required")

    def clearances(self) -> Iterator[Fault]:
        home = point_of(self.simspec.vehicle.home)
        for actor in self.realized.actors:
            outline = self.outlines.get(actor.id)
            if outline is None or self.simspec.group(actor.group).placement.at:
                continue
            if outline.distance(home) < HOME_CLEARANCE_M - SLACK_M:
                remedy = f"keep {HOME_CLEARANCE_M:g} m clear of it"
                yield _fault([actor], "is too close to the vehicle's home", remedy)

    def _is_hosted(self, first: PlacedActor, second: PlacedActor) -> bool:
        """Whether one of them lies in the other, and its group belongs inside the other's or its hosts'."""
        return any(
            host.group in self._hosts(guest.group)
            and self.outlines[host.id].buffer(SLACK_M).covers(self.outlines[guest.id])
            for guest, host in ((first, second), (second, first))
        )

    def _hosts(self, name: str) -> list[str]:
        """The group that a group stands inside, the group that this one stands inside, and so on."""
        hosts: list[str] = []
        inside = self.simspec.group(name).placement.inside
        while inside and inside.of and inside.of not in (name, *hosts):
            hosts.append(inside.of)
            inside = self.simspec.group(inside.of).placement.inside
        return hosts

    def inside(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        inside = group.placement.inside
        if inside is None:
            return
        what = f"area {inside.area!r}" if inside.area else f"any member of {inside.of!r}"
        hosts = [self.outlines.get(host.id) for host in self.members.get(inside.of or "", [])]
        rooms = [
            room.buffer(SLACK_M) for room in ([self._area(inside.area)] if inside.area else hosts) if room
        ]
        for actor in actors:
            outline = self.outlines.get(actor.id)
            if outline is not None and not any(room.covers(outline) for room in rooms):
                yield _fault([actor], f"is not inside {what}", "keep the whole footprint inside")

    def between(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        between = group.placement.between
        if between is None:
            return
        firsts, seconds = self.members.get(between.first, []), self.members.get(between.second, [])
        last, ends_text = int(between.first == between.second), f"{between.first!r} and {between.second!r}"
        if actors and (not firsts or len(seconds) <= last):
            yield _group_fault(group.id, f"has no members of {ends_text} to stand between")
            return
        for actor in actors:
            start, end = firsts[0], seconds[last]
            way = shapely.LineString([point_of(start), point_of(end)])
            # Law of cosines: the actor lies strictly between the ends when the angles at both ends are acute.
            sides = ((start, end), (actor, start), (actor, end))
            whole, first, second = (apart_m(*side) ** 2 for side in sides)
            acute = whole + first - second > -SLACK_M and whole + second - first > -SLACK_M
            if not acute or way.length == 0.0 or way.distance(point_of(actor)) > between.within_m + SLACK_M:
                remedy = f"stand within {between.within_m:g} m of the straight line between them"
                yield _fault([actor], f"is not between {ends_text}", remedy)

    def place(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        at = group.placement.at
        if at is None:
            yield from self._bands(group, actors)
            yield from self._mean(group, actors)
            return
        for actor in actors:
            if apart_m(actor, at) > SLACK_M:
                yield _fault([actor], "is not at the place of placement.at", "move it there")
            if turn_deg(actor.heading_deg, at.heading_deg) > SLACK_DEG:
                yield _fault([actor], "has another heading than placement.at", "turn it")

    def _bands(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        place = group.placement
        outlined = [actor.id for actor in actors if actor.id in self.outlines]
        region = grown_polygon(place.region or self.simspec.world.area)
        covered = shapely.covers(region, [self.outlines[name] for name in outlined])
        outside = {name for name, is_covered in zip(outlined, covered, strict=True) if not is_covered}
        bands = (
            (place.near, any, "some", "is not near"),
            (place.away, all, "every", "does not keep away from"),
        )
        for actor in actors:
            if actor.id in outside:
                yield _fault([actor], "stands outside its region", "keep the whole footprint inside")
            for band, quantified, quantifier, what in bands:
                if band and not quantified(
                    is_in_band(band, apart_m(actor, other)) for other in self.members.get(band.of, [])
                ):
                    remedy = f"keep {band.min_m:g} to {band.max_m:g} m from {quantifier} member"
                    yield _fault([actor], f"{what} {band.of!r}", remedy)

    def _mean(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        mean = group.placement.mean_distance
        if mean and actors and self.members.get(mean.of):
            target = self.members[mean.of][0]
            mean_m = math.fsum(apart_m(actor, target) for actor in actors) / len(actors)
            if abs(mean_m - mean.mean_m) > mean.tolerance * mean.mean_m + SLACK_M:
                remedy = f"{mean.mean_m:g} m within {mean.tolerance:.1%} are required"
                yield _group_fault(group.id, f"has a mean distance of {mean_m:.2f} m to {mean.of!r}", remedy)

    def relations(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        """Faults of each member's other relations, and of the members together."""
        for actor in actors:
            for check in (self._distances, self._road, self._bearing, self._facing, self._sight):
                yield from check(group, actor)
        outlined = [actor for actor in actors if actor.id in self.outlines]
        yield from self._avoided(group, outlined)
        yield from self._area_counts(group, outlined)
        extent_m, spread_m = group.placement.extent_m or math.inf, group.placement.spread_m or 0.0
        for pair in itertools.combinations(actors, 2) if extent_m < math.inf else ():
            if apart_m(*pair) > extent_m + SLACK_M:
                remedy = f"at most {extent_m:g} m between centres are allowed"
                yield _fault(pair, "stand farther apart than extent_m", remedy)
        for pair in itertools.combinations(actors, 2) if spread_m else ():
            if apart_m(*pair) < spread_m - SLACK_M:
                yield _fault(pair, "stand closer than spread_m", f"keep {spread_m:g} m between centres")

    def _distances(self, group: ActorGroup, actor: PlacedActor) -> Iterator[Fault]:
        for number, distance in enumerate(group.placement.distances):
            targets = [distance.point] if distance.point else self._named(group, distance.of)
            quantified = any if distance.whom == "some" else all
            if not quantified(is_in_band(distance, apart_m(actor, target)) for target in targets):
                target_text = f"{distance.whom} member of {distance.of!r}" if distance.of else "a point"
                what = f"does not keep its distance from {target_text}"
                yield _fault([actor], what, f"see distances[{number}]")

    def _named(self, group: ActorGroup, name: str | None) -> list[PlacedActor]:
        """The members of the group of that name, or of all other groups of that role; or the vehicle's home."""
        others = [other for other in self.simspec.actors if other.role == name and other.id != group.id]
        is_group = name in {HOME, *(other.id for other in self.simspec.actors)}
        names = [name or ""] if is_group else [other.id for other in others]
        return [actor for name in names for actor in self.members.get(name, [])]

    def _avoided(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        for number, avoid in enumerate(group.placement.avoid):
            others = (
                [self._area(avoid.area)]
                if avoid.area
                else [self.outlines.get(other.id, point_of(other)) for other in self._named(group, avoid.of)]
            )
            for actor, other in itertools.product(actors, others):
                outline = self.outlines[actor.id]
                gap_m = outline.distance(other)
                # Touching is no overlap. Only what touches is shrunk: a crowd has many thousand pairs.
                overlap = gap_m == 0.0 and outline.buffer(-SLACK_M).intersects(other)
                if gap_m < avoid.at_least_m - SLACK_M or overlap:
                    what = f"does not keep out of {avoid.area or avoid.of!r}"
                    yield _fault([actor], what, f"see avoid[{number}]")

    def _area(self, name: str) -> shapely.Polygon:
        return next(ground_of(area) for area in self.simspec.world.areas if area.id == name)

    def _area_counts(self, group: ActorGroup, actors: Sequence[PlacedActor]) -> Iterator[Fault]:
        for number, count in enumerate(group.placement.counts):
            area = self._area(count.area)
            room = area.buffer(SLACK_M)
            inside = [room.covers(self.outlines[actor.id]) for actor in actors]
            for actor, is_inside in zip(actors, inside, strict=True):
                if not is_inside and self.outlines[actor.id].buffer(-SLACK_M).intersects(area):
                    what = f"stands across the border of area {count.area!r}"
                    yield _fault([actor], what, f"see counts[{number}]")
            if not count.low <= sum(inside) <= count.high(len(actors)):
                what = f"has {sum(inside)} members inside area {count.area!r}"
                yield _group_fault(group.id, what, f"{count.text} are required")

    def _spots(self, reference: PlaceReference) -> Sequence[Spot]:
        """The point, or all members, the first one first."""
        return [reference.point] if reference.point else self.members.get(reference.of or "", [])

    def _bearing(self, group: ActorGroup, actor: PlacedActor) -> Iterator[Fault]:
        bearing = group.placement.bearing
        if bearing and (spots := self._spots(bearing)):
            angle = bearing_deg(spots[0], actor)
            span = (bearing.to_deg - bearing.from_deg) % 360.0
            # Slack on both sides: a place a hair before `from_deg` is not 360 degrees past it.
            past_deg = (angle - bearing.from_deg + SLACK_DEG) % 360.0 - SLACK_DEG
            if not -SLACK_DEG <= past_deg <= span + SLACK_DEG:
                sector = f"{bearing.from_deg:g} to {bearing.to_deg:g}"
                yield _fault([actor], f"stands at {angle:.2f} degrees", f"the sector is {sector} degrees")

    def _facing(self, group: ActorGroup, actor: PlacedActor) -> Iterator[Fault]:
        facing = group.placement.facing
        if facing and facing.heading_deg is not None:
            if turn_deg(actor.heading_deg, facing.heading_deg) > facing.within_deg + SLACK_DEG:
                required = f"{facing.heading_deg:g} degrees within {facing.within_deg:g} are required"
                yield _fault([actor], f"heads {actor.heading_deg:.2f} degrees", required)
        elif facing and (spots := self._spots(facing)):
            off = turn_deg(actor.heading_deg, bearing_deg(actor, spots[0]))
            if off > facing.within_deg + SLACK_DEG:
                remedy = f"at most {facing.within_deg:g} degrees are allowed"
                yield _fault([actor], f"heads {off:.2f} degrees off what it faces", remedy)

    def _sight(self, group: ActorGroup, actor: PlacedActor) -> Iterator[Fault]:
        """`hidden_from` must hold for every member of the other group, `visible_from` for one of them."""
        hidden, visible = group.placement.hidden_from, group.placement.visible_from
        if hidden and any(self._is_visible(actor, eye, hidden.height_m) for eye in self._spots(hidden)):
            what = "is visible from where it must be hidden"
            yield _fault([actor], what, "put something solid in between")
        if visible and not any(
            self._is_visible(actor, eye, visible.height_m) for eye in self._spots(visible)
        ):
            yield _fault([actor], "is hidden from where it must be visible", "clear the line of sight")

    def _road(self, group: ActorGroup, actor: PlacedActor) -> Iterator[Fault]:
        along, outline = group.placement.along, self.outlines.get(actor.id)
        if along is None or outline is None:
            return
        road = self.simspec.world.road(along.road)
        line = shapely.LineString([(point.east_m, point.north_m) for point in road.points])
        covered = line.buffer(road.width_m / 2.0, cap_style="flat", join_style="mitre", mitre_limit=2.0)
        gap = covered.distance(outline)
        if along.where == "on" and not covered.buffer(SLACK_M).covers(outline):
            yield _fault([actor], f"does not stand on road {road.id!r}", "keep the whole footprint on it")
        is_beside = gap > 0.0 and along.at_least_m - SLACK_M <= gap <= along.within_m + SLACK_M
        if along.where == "beside" and not is_beside:
            what = f"is {gap:.3f} m from road {road.id!r}"
            yield _fault([actor], what, f"stand off it, {along.gap_text}")
        if along.parallel_deg is not None:
            stretches = [
                (shapely.LineString([point_of(start), point_of(end)]), bearing_deg(start, end))
                for start, end in itertools.pairwise(road.points)
            ]
            # At a bend both stretches are equally near, and rounding would choose: either heading is accepted.
            far_m = [stretch.distance(point_of(actor)) for stretch, _ in stretches]
            off = min(
                slant_deg(actor.heading_deg, course_deg)
                for (_, course_deg), distance_m in zip(stretches, far_m, strict=True)
                if distance_m <= min(far_m) + SLACK_M
            )
            if off > along.parallel_deg + SLACK_DEG:
                what = f"heads {off:.2f} degrees off road {road.id!r}"
                yield _fault([actor], what, f"at most {along.parallel_deg:g}")

    def _is_visible(self, actor: PlacedActor, eye: Spot, eye_m: float) -> bool:
        """Whether the middle of the actor's top is visible from an eye so high over the ground.

        Each solid outline cuts the ground line; the height of the line of sight over the cut decides whether
        it passes above.
        """
        top_m = self.simspec.group(actor.group).definition.height_m
        line = shapely.LineString([point_of(eye), point_of(actor)])
        for other, outline in self._solids():
            if other.group == actor.group or outline.covers(point_of(eye)):
                continue
            cut = line.intersection(outline)
            if cut.length > SLACK_M:
                shares = [line.project(shapely.Point(corner)) / line.length for corner in cut.coords]
                lowest_m = min(eye_m + share * (top_m - eye_m) for share in shares)
                if lowest_m < self.simspec.group(other.group).definition.height_m - SLACK_M:
                    return False
        return True

    def _solids(self) -> Iterator[tuple[PlacedActor, shapely.Polygon]]:
        """The placed actors that are solid, with their footprints."""
        for actor in self.realized.actors:
            if actor.id in self.outlines and self.simspec.group(actor.group).definition.solid:
                yield actor, self.outlines[actor.id]

    def routes(self) -> Iterator[Fault]:
        """Patrols that cannot walk straight to some point of their route and round it.

        Solid actors that stand still block the way, and so does the area's border for walkers that start
        inside it.
        """
        groups = {group.id: group for group in self.simspec.actors if group.is_known}
        known = [(groups[actor.group], actor) for actor in self.realized.actors if actor.group in groups]
        walkers = [(group, actor) for group, actor in known if group.motion.kind == "patrol"]
        if not walkers:
            return
        walls = [
            (actor, outline)
            for actor, outline in self._solids()
            if self.simspec.group(actor.group).motion.kind == "still"
        ]
        reported: set[tuple[str, str]] = set()
        for group, walker in walkers:
            for obstacle, fault in self._route_faults(group, walker, walls):
                # Walkers of a group share its route: each obstacle on it is reported once.
                if obstacle is None or (obstacle, group.id) not in reported:
                    yield fault
                    reported |= {(obstacle, group.id)} if obstacle else set()

    def _route_faults(
        self, group: ActorGroup, walker: PlacedActor, walls: Sequence[tuple[PlacedActor, shapely.Polygon]]
    ) -> Iterator[tuple[str | None, Fault]]:
        """A walker's faults, each with the obstacle on the route, if it is one."""
        area, spot = ground_of(self.simspec.world.area), point_of(walker)
        starts_inside = bool(area.contains(spot))
        points = [walked_point(area, point_of(point), starts_inside) for point in group.motion.route]
        room_m = group.definition.width_m / 2.0 - SLACK_M
        closed = [(wall, outline, outline.buffer(room_m, join_style="mitre")) for wall, outline in walls]
        legs = [shapely.LineString(pair) for pair in itertools.pairwise([*points, points[0]])]

        def is_held(way: shapely.LineString) -> bool:
            return not starts_inside or bool(area.buffer(SLACK_M).covers(way))

        way_round = shapely.MultiLineString(legs)
        for wall, _, grown in closed:
            if grown.intersects(way_round):
                what = f"blocks the patrol route of {group.id!r}"
                yield wall.id, _fault([wall], what, "move one of them")
        if not all(map(is_held, legs)):
            what = "has a patrol route that leaves the area"
            yield "area", _fault([walker], what, "add points that lead round")
        # A wall counts with the walker's half width, unless the walker already stands closer.
        barriers = [outline if grown.covers(spot) else grown for _, outline, grown in closed]
        ways = [shapely.LineString([spot, point]) for point in points]
        if not any(is_held(way) and not any(wall.intersects(way) for wall in barriers) for way in ways):
            what = "has no straight way to any point of its patrol route"
            yield None, _fault([walker], what, "move it, or what blocks it")

    def reports(self) -> Iterator[Fault]:
        placed = {report.id: report for report in self.realized.reports}
        for report in self.simspec.intelligence:
            where, placed_report = f"realized: report {report.id}", placed.pop(report.id, None)
            if placed_report is None:
                yield Fault(where, "is missing", "place the SimSpec again")
            elif self.members.get(report.about):
                error = apart_m(placed_report, self.members[report.about][0])
                remedy = f"at most {report.uncertainty_m:g} m"
                if error > report.uncertainty_m + SLACK_M:
                    yield Fault(where, f"is {error:.1f} m from the truth", remedy)
        for extra in placed:
            yield Fault(f"realized: report {extra}", "has no entry in intelligence", "remove it")
