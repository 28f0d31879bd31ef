"""Why a scene cannot be: proofs of impossibility, and the smallest set of the user's own constraints that they need.

A proof works on a relaxation that every true arrangement also keeps, so what it refuses is impossible indeed:

- *ground*: for each group the part of the ground in which centres can lie, narrowed relation by relation until nothing changes.
  Where nothing is left, no arrangement exists.
- *cases*: the same for each part of the ground on which a single member may stand whom several relations are about.
- *mean distances* that the ground and the members' own sizes leave in reach.
- *headings* along a road that never come near those towards whom a group faces.
- *numbers*: no more points of a mutual distance lie on the ground that is left than Oler's inequality allows, and no more
  rectangles that keep one course than a lattice of their sides has points.
- *areas*: footprints grown by half their gap do not overlap, so their areas must fit together into the pieces of ground in which
  their groups may stand; CP-SAT decides that.

What is not refused may still be impossible.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from math import ceil, floor, pi

import numpy as np
import shapely

from bench.arrays import Floats
from bench.errors import PlacementInfeasible
from bench.simspec import ASSETS, ActorGroup, MeanDistance, SimSpec

from .._footprint import footprints
from .._geometry import EVERYWHERE, Geometry, grown_at_least, polygon_ground, simplified, thickened
from .._groups import hosts_of, inner_radius_m, is_home, member_count, outer_radius_m, region_of
from ..relations._distance_bands import band_ground
from ..relations._headings import RequiredHeading, headings_conflict
from ..relations._patrol_routes import is_obstacle, visible_ground
from ..relations._relation import HOME_CLEARANCE_M, GroupRelation, field_path
from ._capacity import AREA_TOLERANCE_M2, grown_area_m2
from ._constraints import HOME_FIELD, Constraint, scene_constraints, shapely_point
from ._packing import areas_can_be_allocated, max_aligned_rectangles, max_spaced_points

NARROWING_ROUNDS = 6


MAX_CASES = 48


MIN_CASE_SIDE_M = 2.0


def prove_infeasible(simspec: SimSpec, order: Sequence[ActorGroup]) -> PlacementInfeasible | None:
    """The refusal of a scene that can be proved impossible, with a smallest clashing set; None where nothing is proved."""
    terms = scene_constraints(simspec, order)
    proof: Callable[[_Relaxation], bool]
    for proof in (_Relaxation.ground_fails, _Relaxation.areas_fail, _Relaxation.cases_fail):
        if proof(_Relaxation(simspec, order, terms)):
            core = _smallest_conflict(terms, lambda some, proof=proof: proof(_Relaxation(simspec, order, some)))  # type: ignore[misc]
            scene = _Relaxation(simspec, order, core)
            proof(scene)
            said = "; ".join(f"{term.text} ({term.path})" for term in core)
            noted = f" ({'; '.join(scene.notes)})" if scene.notes else ""
            return PlacementInfeasible(
                f"impossible, and proved so: not all of this can hold: {said}{noted}. Loosen one of these",
                clash=tuple(dict.fromkeys(term.path for term in core)),
            )
    return None


def narrowed_ground(simspec: SimSpec, order: Sequence[ActorGroup]) -> dict[str, Geometry]:
    """For each group that has members, ground that holds every centre that any arrangement could have."""
    scene = _Relaxation(simspec, order, scene_constraints(simspec, order))
    scene.ground_fails()
    return scene.ground


def _smallest_conflict(terms: Sequence[Constraint], fails: Callable[[list[Constraint]], bool]) -> list[Constraint]:
    """Terms that fail together and of which none can be left out: deleted in ever smaller runs while the rest still fails."""
    core = list(terms)
    run = max(1, len(core) // 2)
    while True:
        start = 0
        while start < len(core):
            rest = core[:start] + core[start + run :]
            if rest and fails(rest):
                core = rest
            else:
                start += run
        if run == 1:
            return core
        run //= 2


@dataclass(slots=True)
class _Relaxation:
    """Some of a scene's constraints, and what follows from them."""

    simspec: SimSpec
    order: Sequence[ActorGroup]
    terms: Sequence[Constraint]
    case: dict[str, Geometry] = dataclass_field(default_factory=dict)
    ground: dict[str, Geometry] = dataclass_field(default_factory=dict)
    notes: list[str] = dataclass_field(default_factory=list)

    def ground_fails(self) -> bool:
        """Whether some group has no ground left, is to keep two distances at once, or a mean distance that is out of reach."""
        peopled = [group for group in self.order if member_count(self.simspec, group)]
        self.ground = {group.id: self._own_ground(group) for group in peopled}
        bound = [term for term in self.terms if term.tie]
        for _ in range(NARROWING_ROUNDS):
            before = [shapely.area(one) for one in self.ground.values()]
            for term in bound:
                self._narrow(term.group, term.tie)
            for term in self.terms:
                if term.midway and not any(one.is_empty for one in self.ground.values()):
                    self._cut(term.group, term.midway.ground(*(self._ground_of(name) for name in term.midway.ends)))
            if any(one.is_empty for one in self.ground.values()):
                return True
            means = [(term.group, term.mean) for term in self.terms if term.mean]
            if any(self._mean_fails(own, mean) for own, mean in means):
                return True
            for own, mean in means:
                self._narrow_by_mean(own, mean)
            if any(one.is_empty for one in self.ground.values()):
                return True
            if np.allclose(before, [shapely.area(one) for one in self.ground.values()], rtol=1e-4):
                break
        banded = [term for term in self.terms if term.band]
        if any(self._bands_fail(term, other) for number, term in enumerate(banded) for other in banded[:number]):
            return True
        return any(self._headings_fail(term.group, term.heading) for term in self.terms if term.heading and term.heading.lines)

    def _headings_fail(self, own: str, parallel: RequiredHeading) -> bool:
        """Whether nobody of a group can head along its road and face what it is to face."""
        group = self.simspec.group(own)
        facing = next((t.heading for t in self.terms if t.group == own and t.heading and not t.heading.lines), None)
        if facing is None or own not in self.ground:
            return False
        theirs = facing.point if facing.of is None else self._ground_of(facing.of)
        along = group.placement.along
        assert along is not None
        road = next(one for one in self.simspec.world.roads if one.id == along.road)
        # A mitred corner of the road reaches twice as far out as its side.
        reach_m = road.width_m + outer_radius_m(group) + (along.within_m if along.where == "beside" else 0.0)
        kept = any(term.path == field_path(group, "along") for term in self.terms)
        return headings_conflict(parallel, facing, self.ground[own], theirs, reach_m if kept else None)

    def _bands_fail(self, one: Constraint, other: Constraint) -> bool:
        """Whether two of a group's distances to the same others, of whom there are some, exclude each other."""
        if one.group != other.group or one.band is None or other.band is None:
            return False
        peopled = is_home(self.simspec, one.band.of) or bool(member_count(self.simspec, self.simspec.group(one.band.of)))
        return peopled and one.band.excludes(other.band)

    def _own_ground(self, group: ActorGroup) -> Geometry:
        """Where the group's relations to the ground and to what is fixed leave centres."""
        rooms = [term.ground for term in self.terms if term.group == group.id and term.ground is not None]
        rooms += [self.case[group.id]] if group.id in self.case else []
        left = thickened(shapely.intersection_all(rooms)) if rooms else EVERYWHERE
        if group.placement.at or left.is_empty:
            return left
        inner = inner_radius_m(group)
        for term in self.terms:
            if term.group == HOME_FIELD:
                left = left.difference(shapely.buffer(term.ground, HOME_CLEARANCE_M + inner - 1e-6))
            elif term.path.endswith(".at") and term.group not in hosts_of(self.simspec, group):
                other = self.simspec.group(term.group)
                gap = max(group.placement.separation_m, other.placement.separation_m)
                left = left.difference(shapely.buffer(_fixed_outline(other), gap + inner - 1e-6))
        routes = [term.route_m for term in self.terms if term.group == group.id and term.route_m is not None]
        return left.intersection(visible_ground(routes[0], self._walls())) if routes else left

    def _walls(self) -> list[Geometry]:
        """What is fixed and closes ways, as the least that it closes."""
        fixed = [self.simspec.group(term.group) for term in self.terms if term.path.endswith(".at")]
        return [shapely.buffer(_fixed_outline(one), -1e-6, join_style="mitre") for one in fixed if is_obstacle(one)]

    def _narrow(self, own: str, tie: GroupRelation | None) -> None:
        """Keep of the ground on both sides what a tie between them can be kept on."""
        assert tie is not None
        if any(one.is_empty for one in self.ground.values()):
            return
        others = [name for name in tie.of if name in self.ground]
        if tie.whom == "some":
            theirs = shapely.union_all([simplified(self.ground[name]) for name in others])
            room = tie.ground(simplified(theirs)) if others else shapely.Polygon()
            self._cut(own, room)
        else:
            for name in others:
                self._cut(own, tie.ground(simplified(self.ground[name])))
        alone = len(others) == 1 and member_count(self.simspec, self.simspec.group(others[0])) == 1
        for name in others if alone or tie.whom == "every" else []:
            if not self.ground[own].is_empty:
                self._cut(name, tie.reverse_ground(simplified(self.ground[own])))

    def _ground_of(self, name: str) -> Geometry:
        """Where members of a group may stand; the vehicle's home has its place."""
        return shapely_point(self.simspec.vehicle.home) if is_home(self.simspec, name) else self.ground.get(name, EVERYWHERE)

    def _cut(self, name: str, room: Geometry | None) -> None:
        if room is not None:
            self.ground[name] = thickened(shapely.intersection(self.ground[name], room))

    def _narrow_by_mean(self, own: str, mean: MeanDistance) -> None:
        """Whom a mean distance is about is near enough to some ground of the group and far enough from some; who is alone keeps
        the mean itself."""
        slack_m = mean.tolerance * mean.mean_m + 1e-3
        least_m, most_m = mean.mean_m - slack_m, mean.mean_m + slack_m
        if self._alone(own):
            self._cut(own, band_ground(simplified(self._ground_of(mean.of)), least_m, most_m))
        if mean.of in self.ground and self._alone(mean.of) and not self.ground[own].is_empty:
            self._cut(mean.of, band_ground(simplified(self.ground[own]), least_m, most_m))

    def _mean_fails(self, own: str, mean: MeanDistance) -> bool:
        group, mine, theirs = self.simspec.group(own), self.ground[own], self._ground_of(mean.of)
        nearest = np.full(member_count(self.simspec, group), shapely.distance(mine, theirs))
        if any(term.group == own and term.need_m2 for term in self.terms):
            nearest = np.maximum(nearest, _crowded_distances_m(group, len(nearest)))
        low, high = float(nearest.mean()), _farthest_m(mine, theirs)
        if low > mean.mean_m * (1 + mean.tolerance) + 1e-3:
            self.notes.append(f"no mean under {floor(10 * low) / 10:g} m is in reach")
            return True
        if high < mean.mean_m * (1 - mean.tolerance) - 1e-3:
            self.notes.append(f"no mean over {ceil(10 * high) / 10:g} m is in reach")
            return True
        return False

    def areas_fail(self) -> bool:
        """Whether the members are more than the ground left to them holds."""
        if self.ground_fails():
            return True
        if any(self._spread_fails(term.group, term.spread_m) for term in self.terms if term.spread_m):
            return True
        if self._numbers_fail([self.simspec.group(term.group) for term in self.terms if term.need_m2]):
            return True
        zones = {
            term.group: (self._zone(self.simspec.group(term.group)), term.need_m2)
            for term in self.terms
            # Who stands inside others takes none of the ground that these do not take.
            if term.need_m2 and not hosts_of(self.simspec, self.simspec.group(term.group))
        }
        if not zones:
            return False
        areas = {name: zone.area for name, (zone, _) in zones.items()}
        needs = {name: need for name, (_, need) in zones.items()}
        if any(needs[name] > areas[name] + AREA_TOLERANCE_M2 for name in zones):
            return True
        if sum(needs.values()) <= min(areas.values()):
            return False
        return not areas_can_be_allocated({name: zone for name, (zone, _) in zones.items()}, needs)

    def _spread_fails(self, own: str, spread_m: float) -> bool:
        """Circles of half the spread round the centres do not overlap, and Oler's inequality holds of the centres."""
        count = member_count(self.simspec, self.simspec.group(own))
        room = shapely.area(grown_at_least(self.ground[own], spread_m / 2.0))
        return bool(
            count > 1 and (count * pi * spread_m**2 / 4.0 > room or count > max_spaced_points(self.ground[own], spread_m))
        )

    def _numbers_fail(self, groups: Sequence[ActorGroup]) -> bool:
        """Whether more members stand on the ground that is left than centres can lie there.

        Circles inside two footprints are as far apart as these. Of several groups the largest, two largest ... are counted together.
        """
        if any(self._aligned_fails(group) for group in groups):
            return True
        sized = sorted((group for group in groups if not hosts_of(self.simspec, group)), key=_centre_distance_m, reverse=True)
        for number in range(1, len(sized) + 1):
            some = sized[:number]
            apart_m = min(_centre_distance_m(one) for one in some)
            count = sum(member_count(self.simspec, one) for one in some)
            if count > 1 and count > max_spaced_points(shapely.union_all([self.ground[one.id] for one in some]), apart_m):
                return True
        return any(
            member_count(self.simspec, one) > max(1, max_spaced_points(self.ground[one.id], _centre_distance_m(one)))
            for one in groups
        )

    def _aligned_fails(self, group: ActorGroup) -> bool:
        """Whether a group that keeps one course has more members than so many rectangles have room."""
        asset, count = ASSETS[group.asset], member_count(self.simspec, group)
        commons = [t.heading.common for t in self.terms if t.group == group.id and t.heading]
        return any(
            count
            > max_aligned_rectangles(
                self.ground[group.id], (asset.length_m, asset.width_m), group.placement.separation_m, *common
            )
            for common in commons
            if common is not None and common[1] < 45.0 and asset.length_m >= asset.width_m
        )

    def cases_fail(self) -> bool:
        """Whether there is no ground left wherever one member stands whom others relate to, tried in ever smaller parts.

        Ties to one member are narrowed one by one; only with the place of that member known do they add up.
        """
        self.ground_fails()
        tied = Counter(name for term in self.terms for tie in (term.tie, term.midway) if tie for name in tie.of)
        split = [
            name
            for name, times in tied.items()
            if times > 1 and name in self.ground and shapely.area(self.ground[name]) > 0.0 and self._alone(name)
        ]
        return any(self._always_fails(name) for name in split)

    def _alone(self, name: str) -> bool:
        return member_count(self.simspec, self.simspec.group(name)) == 1

    def _always_fails(self, name: str) -> bool:
        """Whether the scene fails wherever that member stands; parts in which it does not at once are halved."""
        parts = [shapely.box(*shapely.bounds(self.ground[name]))]
        bound = sum(term.tie is not None or term.midway is not None for term in self.terms)
        for _ in range(min(MAX_CASES, 8 + 8 * MAX_CASES // bound)):
            if not parts:
                return True
            part = parts.pop()
            if not _Relaxation(self.simspec, self.order, self.terms, {name: part}).ground_fails():
                west, south, east, north = shapely.bounds(part)
                if max(east - west, north - south) < MIN_CASE_SIDE_M:
                    return False
                middle = ((west + east) / 2.0, (south + north) / 2.0)
                if east - west > north - south:
                    parts += [shapely.box(west, south, middle[0], north), shapely.box(middle[0], south, east, north)]
                else:
                    parts += [shapely.box(west, south, east, middle[1]), shapely.box(west, middle[1], east, north)]
        return False

    def _zone(self, group: ActorGroup) -> Geometry:
        """All ground that the group's footprints, grown by half their gap, can touch."""
        half_gap = group.placement.separation_m / 2.0
        zone = grown_at_least(self.ground[group.id], outer_radius_m(group) + half_gap)
        if any(term.group == group.id and term.path in ("world.area", field_path(group, "region")) for term in self.terms):
            zone = zone.intersection(grown_at_least(polygon_ground(region_of(self.simspec, group)), half_gap))
        for term in self.terms:
            if term.group == HOME_FIELD and half_gap < HOME_CLEARANCE_M:
                zone = zone.difference(shapely.buffer(term.ground, HOME_CLEARANCE_M - half_gap))
            elif term.path.endswith(".at") and term.group not in hosts_of(self.simspec, group):
                zone = zone.difference(shapely.buffer(_fixed_outline(self.simspec.group(term.group)), half_gap))
        return zone


def _fixed_outline(group: ActorGroup) -> Geometry:
    """The footprint of a fixed actor."""
    at = group.placement.at
    assert at is not None
    one = footprints(ASSETS[group.asset], np.array([[at.east_m, at.north_m]]), np.array([at.heading_deg]), 0.0)
    return shapely.polygons(one.corners())[0]


def _centre_distance_m(group: ActorGroup) -> float:
    """Least distance between the centres of two members, or of a member and one of a group that wants no less."""
    return 2.0 * inner_radius_m(group) + group.placement.separation_m


def _crowded_distances_m(group: ActorGroup, count: int) -> Floats:
    """(count,) least distances from any point to the nearest, second nearest ... member: k grown footprints that reach no
    further than the k-th centre and their own outer radius must fit into that circle."""
    gap = group.placement.separation_m
    area = grown_area_m2(group, gap)
    least: Floats = np.sqrt(np.arange(1, count + 1) * area / pi) - outer_radius_m(group) - gap / 2.0
    return np.maximum(least, 0.0)


def _farthest_m(one: Geometry, other: Geometry) -> float:
    first, second = (shapely.get_coordinates(shapely.convex_hull(geometry)) for geometry in (one, other))
    return float(np.hypot(*(first[:, None, :] - second[None, :, :]).transpose(2, 0, 1)).max())
