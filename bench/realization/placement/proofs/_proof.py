"""Proofs that a scene has no arrangement, each with a smallest set of the author's constraints that it needs.

A proof works on a relaxation that every arrangement also satisfies, so a refused scene is certainly
infeasible:

- *ground*: for each group the part of the ground in which centres can lie, narrowed relation by relation
  until nothing changes. Where nothing is left, no arrangement exists.
- *cases*: the same for each part of the ground on which the single member of a group stands that several
  relations refer to.
- *mean distances* that the ground and the members' own sizes leave in reach.
- *headings* along a road that never come near the bearings of what the group faces.
- *numbers*: no more points of a mutual distance lie on the ground that is left than Oler's inequality allows,
  and no more rectangles that keep one course than a lattice of their sides has points.
- *counts* inside areas that no numbers of members in the parts of the ground keep, by how many of them each
  part has room for; *extents* in which so many members find no room.
- *areas*: footprints grown by half their gap do not overlap, so their areas must fit together into the pieces
  of ground in which their groups may stand; CP-SAT decides that.

A scene that is not refused may still be infeasible.
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
from bench.simspec import ASSETS, ActorGroup, AreaCount, MeanDistance, SimSpec

from .._area_counts import GroundPart, feasible_numbers, ground_parts, named_area
from .._footprint import footprints
from .._geometry import EVERYWHERE, Geometry, grown_at_least, polygon_ground, simplified, thickened
from .._groups import (
    centre_ground,
    hosts_of,
    inner_radius_m,
    is_home,
    member_count,
    outer_radius_m,
    region_of,
)
from ..relations._distance_bands import band_ground
from ..relations._headings import RequiredHeading, headings_conflict
from ..relations._patrol_routes import is_obstacle, visible_ground
from ..relations._relation import HOME_CLEARANCE_M, GroupRelation, field_path
from ._capacity import AREA_TOLERANCE_M2, grown_area_m2
from ._constraints import HOME_FIELD, Constraint, scene_constraints, shapely_point
from ._packing import areas_can_be_allocated, max_aligned_rectangles, max_spaced_points, oler_bound

# Rounds in which groups cut each other's ground before the proof looks at what is left. Chosen, not measured.
NARROWING_ROUNDS = 6


# Parts into which the ground of a single member is split at the most. Chosen, not measured.
MAX_CASES = 48


# A part narrower than this is not split further. Chosen, not measured.
MIN_CASE_SIDE_M = 2.0


def prove_infeasible(simspec: SimSpec, order: Sequence[ActorGroup]) -> PlacementInfeasible | None:
    """The refusal of a scene that is proved infeasible, with a smallest conflicting set; None when nothing is
    proved.
    """
    terms = scene_constraints(simspec, order)
    proof: Callable[[_Relaxation], bool]
    # The cheapest proof first; the others include it.
    for proof in (_Relaxation.ground_fails, _Relaxation.areas_fail, _Relaxation.cases_fail):
        if proof(_Relaxation(simspec, order, terms)):
            core = _smallest_conflict(
                terms,
                lambda subset, proof=proof: proof(_Relaxation(simspec, order, subset)),  # type: ignore[misc]
            )
            scene = _Relaxation(simspec, order, core)
            proof(scene)
            constraint_text = "; ".join(f"{term.text} ({term.path})" for term in core)
            note_text = f" ({'; '.join(scene.notes)})" if scene.notes else ""
            return PlacementInfeasible(
                f"impossible, and proved so: not all of this can hold: {constraint_text}{note_text}. Loosen one of these",
                clash=tuple(dict.fromkeys(term.path for term in core)),
            )
    return None


def narrowed_ground(simspec: SimSpec, order: Sequence[ActorGroup]) -> dict[str, Geometry]:
    """For each group with members, ground that contains its centres in every arrangement."""
    scene = _Relaxation(simspec, order, scene_constraints(simspec, order))
    scene.ground_fails()
    return scene.ground


def _smallest_conflict(
    terms: Sequence[Constraint], fails: Callable[[list[Constraint]], bool]
) -> list[Constraint]:
    """A smallest set of constraints that fail together, by deleting ever smaller runs while the rest still
    fails.
    """
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
    """Some constraints of a scene, and the ground that they leave to each group."""

    simspec: SimSpec
    order: Sequence[ActorGroup]
    terms: Sequence[Constraint]
    case: dict[str, Geometry] = dataclass_field(default_factory=dict)
    ground: dict[str, Geometry] = dataclass_field(default_factory=dict)
    notes: list[str] = dataclass_field(default_factory=list)

    def ground_fails(self) -> bool:
        """Whether a group has no ground left, two distances that exclude each other, or a mean distance out
        of reach.
        """
        peopled = [group for group in self.order if member_count(self.simspec, group)]
        self.ground = {group.id: self._own_ground(group) for group in peopled}
        bound = [term for term in self.terms if term.group_relation]
        for _ in range(NARROWING_ROUNDS):
            before = [shapely.area(ground) for ground in self.ground.values()]
            for term in bound:
                self._narrow(term.group, term.group_relation)
            for term in self.terms:
                if term.between and not any(ground.is_empty for ground in self.ground.values()):
                    self._cut(
                        term.group,
                        term.between.ground(*(self._ground_of(name) for name in term.between.ends)),
                    )
            if any(ground.is_empty for ground in self.ground.values()):
                return True
            means = [(term.group, term.mean) for term in self.terms if term.mean]
            if any(self._mean_fails(group_id, mean) for group_id, mean in means):
                return True
            for group_id, mean in means:
                self._narrow_by_mean(group_id, mean)
            for term in self.terms:
                if term.extent_m is not None:
                    self._narrow_by_extent(term.group, term.extent_m)
            if any(ground.is_empty for ground in self.ground.values()):
                return True
            # Narrowing converges geometrically; what is left below this change proves nothing more.
            if np.allclose(before, [shapely.area(ground) for ground in self.ground.values()], rtol=1e-4):
                break
        banded = [term for term in self.terms if term.band]
        if any(
            self._bands_fail(term, other) for number, term in enumerate(banded) for other in banded[:number]
        ):
            return True
        return any(
            self._headings_fail(term.group, term.heading)
            for term in self.terms
            if term.heading and term.heading.lines
        )

    def _headings_fail(self, group_id: str, parallel: RequiredHeading) -> bool:
        """Whether no heading of a group follows its road and faces its target."""
        group = self.simspec.group(group_id)
        facing = next(
            (t.heading for t in self.terms if t.group == group_id and t.heading and not t.heading.lines), None
        )
        if facing is None or group_id not in self.ground:
            return False
        theirs = facing.point if facing.of is None else self._ground_of(facing.of)
        along = group.placement.along
        assert along is not None
        road = next(candidate for candidate in self.simspec.world.roads if candidate.id == along.road)
        # The mitre limit of road corners is 2, so a corner reaches twice as far out as a side.
        reach_m = road.width_m + outer_radius_m(group) + (along.within_m if along.where == "beside" else 0.0)
        along_required = any(term.path == field_path(group, "along") for term in self.terms)
        return headings_conflict(
            parallel, facing, self.ground[group_id], theirs, reach_m if along_required else None
        )

    def _bands_fail(self, first: Constraint, second: Constraint) -> bool:
        """Whether two distances of a group to the same members exclude each other."""
        if first.group != second.group or first.band is None or second.band is None:
            return False
        peopled = is_home(self.simspec, first.band.of) or bool(
            member_count(self.simspec, self.simspec.group(first.band.of))
        )
        return peopled and first.band.excludes(second.band)

    def _own_ground(self, group: ActorGroup) -> Geometry:
        """Where the group's relations to the ground and to what is fixed leave centres."""
        grounds = [term.ground for term in self.terms if term.group == group.id and term.ground is not None]
        grounds += [self.case[group.id]] if group.id in self.case else []
        remaining = thickened(shapely.intersection_all(grounds)) if grounds else EVERYWHERE
        if group.placement.at or remaining.is_empty:
            return remaining
        inner = inner_radius_m(group)
        for term in self.terms:
            if term.group == HOME_FIELD:
                remaining = remaining.difference(shapely.buffer(term.ground, HOME_CLEARANCE_M + inner - 1e-6))
            elif term.path.endswith(".at") and term.group not in hosts_of(self.simspec, group):
                other = self.simspec.group(term.group)
                gap = max(group.placement.separation_m, other.placement.separation_m)
                remaining = remaining.difference(shapely.buffer(_fixed_outline(other), gap + inner - 1e-6))
        routes = [term.route_m for term in self.terms if term.group == group.id and term.route_m is not None]
        return remaining.intersection(visible_ground(routes[0], self._walls())) if routes else remaining

    def _walls(self) -> list[Geometry]:
        """Outlines of fixed obstacles, a hair smaller than they are, so that rounding proves nothing."""
        fixed = [self.simspec.group(term.group) for term in self.terms if term.path.endswith(".at")]
        return [
            shapely.buffer(_fixed_outline(group), -1e-6, join_style="mitre")
            for group in fixed
            if is_obstacle(group)
        ]

    def _narrow(self, group_id: str, tie: GroupRelation | None) -> None:
        """Narrow the ground on both sides to where a relation between them can hold."""
        assert tie is not None
        if any(ground.is_empty for ground in self.ground.values()):
            return
        others = [name for name in tie.of if name in self.ground]
        if tie.quantifier == "some":
            theirs = shapely.union_all([simplified(self.ground[name]) for name in others])
            room = tie.ground(simplified(theirs)) if others else shapely.Polygon()
            self._cut(group_id, room)
        else:
            for name in others:
                self._cut(group_id, tie.ground(simplified(self.ground[name])))
        alone = len(others) == 1 and member_count(self.simspec, self.simspec.group(others[0])) == 1
        for name in others if alone or tie.quantifier == "every" else []:
            if not self.ground[group_id].is_empty:
                self._cut(name, tie.reverse_ground(simplified(self.ground[group_id])))

    def _ground_of(self, name: str) -> Geometry:
        """The ground of a group's centres; for the vehicle's home its point."""
        return (
            shapely_point(self.simspec.vehicle.home)
            if is_home(self.simspec, name)
            else self.ground.get(name, EVERYWHERE)
        )

    def _cut(self, name: str, room: Geometry | None) -> None:
        if room is not None:
            self.ground[name] = thickened(shapely.intersection(self.ground[name], room))

    def _narrow_by_mean(self, group_id: str, mean: MeanDistance) -> None:
        """Narrow by a mean distance: a lone member keeps the mean itself, and so does a lone target seen from
        the group's ground.
        """
        slack_m = mean.tolerance * mean.mean_m + 1e-3
        least_m, most_m = mean.mean_m - slack_m, mean.mean_m + slack_m
        if self._alone(group_id):
            self._cut(group_id, band_ground(simplified(self._ground_of(mean.of)), least_m, most_m))
        if mean.of in self.ground and self._alone(mean.of) and not self.ground[group_id].is_empty:
            self._cut(mean.of, band_ground(simplified(self.ground[group_id]), least_m, most_m))

    def _narrow_by_extent(self, group_id: str, extent_m: float) -> None:
        """Everybody is within the extent of the member that each count puts into its area, and of the mean of all
        distances.
        """
        group = self.simspec.group(group_id)
        for term in self.terms:
            if term.group != group_id:
                continue
            if term.count is not None and term.count.low:
                room = centre_ground(named_area(self.simspec, term.count.area), group)
                self._cut(group_id, grown_at_least(self.ground[group_id].intersection(room), extent_m))
            elif term.mean is not None and not self.ground[group_id].is_empty:
                slack_m = extent_m + term.mean.tolerance * term.mean.mean_m + 1e-3
                low_m, high_m = max(0.0, term.mean.mean_m - slack_m), term.mean.mean_m + slack_m
                self._cut(group_id, band_ground(simplified(self._ground_of(term.mean.of)), low_m, high_m))

    def _extent_fails(self, group_id: str, extent_m: float) -> bool:
        """Whether so many members find no room in ground of that diameter.

        Of all sets of one diameter the disc has the largest area (Bieberbach 1915) and the longest perimeter
        (Rosenthal and Szasz 1916), for Oler's inequality and for the area of the members.
        """
        group, apart_m = self.simspec.group(group_id), self._least_apart_m(group_id)
        count, gap_m = member_count(self.simspec, group), group.placement.separation_m
        if apart_m > 0.0 and count > oler_bound(pi * extent_m**2 / 4.0, pi * extent_m, apart_m):
            return True
        reach_m = extent_m / 2.0 + outer_radius_m(group) + gap_m / 2.0
        need_m2 = next((term.need_m2 for term in self.terms if term.group == group_id and term.need_m2), 0.0)
        return bool(count > 1 and need_m2 > pi * reach_m**2 + AREA_TOLERANCE_M2)

    def _least_apart_m(self, group_id: str) -> float:
        """The least distance between centres of two members that size and spread leave."""
        terms = [term for term in self.terms if term.group == group_id]
        sized = any(term.need_m2 for term in terms)
        return max(
            _centre_distance_m(self.simspec.group(group_id)) if sized else 0.0,
            *(term.spread_m or 0.0 for term in terms),
        )

    def _counts_fail(self, group_id: str) -> bool:
        """Whether no numbers of members in the parts of the ground keep all counts inside areas."""
        group, apart_m = self.simspec.group(group_id), self._least_apart_m(group_id)
        counts = [term.count for term in self.terms if term.group == group_id and term.count is not None]
        sized = any(term.group == group_id and term.need_m2 for term in self.terms)
        parts = ground_parts(self.simspec, group, counts, self.ground[group_id])
        number = member_count(self.simspec, group)
        capacities = [self._capacity(group, part, counts, apart_m, sized) for part in parts]
        return feasible_numbers(parts, counts, number, capacities) is None

    def _capacity(
        self,
        group: ActorGroup,
        part: GroundPart,
        counts: Sequence[AreaCount],
        apart_m: float,
        sized: bool,
    ) -> int:
        """At most so many members stand in a part of the ground."""
        number = member_count(self.simspec, group)
        bounds = [float(number), max(1.0, max_spaced_points(part.ground, apart_m))]
        if sized:
            half_gap_m = group.placement.separation_m / 2.0
            zone = grown_at_least(part.ground, outer_radius_m(group) + half_gap_m)
            for count, is_inside in zip(counts, part.inside, strict=True):
                if is_inside:
                    area = named_area(self.simspec, count.area)
                    zone = zone.intersection(grown_at_least(area, half_gap_m))
            room_m2 = float(shapely.area(zone)) + AREA_TOLERANCE_M2
            bounds.append(room_m2 / grown_area_m2(group, group.placement.separation_m))
        return floor(min(bounds))

    def _mean_fails(self, group_id: str, mean: MeanDistance) -> bool:
        group, mine, theirs = self.simspec.group(group_id), self.ground[group_id], self._ground_of(mean.of)
        nearest = np.full(member_count(self.simspec, group), shapely.distance(mine, theirs))
        if any(term.group == group_id and term.need_m2 for term in self.terms):
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
        """Whether the members need more area than the ground that is left."""
        if self.ground_fails():
            return True
        if any(self._spread_fails(term.group, term.spread_m) for term in self.terms if term.spread_m):
            return True
        if any(self._extent_fails(term.group, term.extent_m) for term in self.terms if term.extent_m):
            return True
        if any(self._counts_fail(name) for name in {term.group: None for term in self.terms if term.count}):
            return True
        if self._numbers_fail([self.simspec.group(term.group) for term in self.terms if term.need_m2]):
            return True
        zones = {
            term.group: (self._zone(self.simspec.group(term.group)), term.need_m2)
            for term in self.terms
            # Guests inside hosts take no ground that their hosts do not take already.
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

    def _spread_fails(self, group_id: str, spread_m: float) -> bool:
        """Circles of half the spread round the centres do not overlap, and Oler's inequality holds of the
        centres.
        """
        count = member_count(self.simspec, self.simspec.group(group_id))
        room = shapely.area(grown_at_least(self.ground[group_id], spread_m / 2.0))
        return bool(
            count > 1
            and (
                count * pi * spread_m**2 / 4.0 > room
                or count > max_spaced_points(self.ground[group_id], spread_m)
            )
        )

    def _numbers_fail(self, groups: Sequence[ActorGroup]) -> bool:
        """Whether there are more members than centres that fit on the ground that is left.

        Circles inside two footprints keep the gap of these. The largest group, the two largest ... are
        counted together.
        """
        if any(self._aligned_fails(group) for group in groups):
            return True
        sized = sorted(
            (group for group in groups if not hosts_of(self.simspec, group)),
            key=_centre_distance_m,
            reverse=True,
        )
        for number in range(1, len(sized) + 1):
            largest = sized[:number]
            apart_m = min(_centre_distance_m(member) for member in largest)
            count = sum(member_count(self.simspec, member) for member in largest)
            if count > 1 and count > max_spaced_points(
                shapely.union_all([self.ground[member.id] for member in largest]), apart_m
            ):
                return True
        return any(
            member_count(self.simspec, member)
            > max(1, max_spaced_points(self.ground[member.id], _centre_distance_m(member)))
            for member in groups
        )

    def _aligned_fails(self, group: ActorGroup) -> bool:
        """Whether a group with one course has more members than parallel rectangles that fit."""
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
        """Whether no ground is left wherever a lone target of several relations stands, tried in ever smaller
        parts.

        Relations to one member are narrowed one by one; they add up only when the place of that member is
        known.
        """
        self.ground_fails()
        tied = Counter(
            name
            for term in self.terms
            for relation in (term.group_relation, term.between)
            if relation
            for name in relation.of
        )
        split = [
            name
            for name, times in tied.items()
            if times > 1
            and name in self.ground
            and shapely.area(self.ground[name]) > 0.0
            and self._alone(name)
        ]
        return any(self._always_fails(name) for name in split)

    def _alone(self, name: str) -> bool:
        return member_count(self.simspec, self.simspec.group(name)) == 1

    def _always_fails(self, name: str) -> bool:
        """Whether the scene fails wherever that member stands; a part that does not fail at once is
        halved.
        """
        # Depth first over a stack: the search ends at the first part that cannot be refused.
        parts = [shapely.box(*shapely.bounds(self.ground[name]))]
        bound = sum(term.group_relation is not None or term.between is not None for term in self.terms)
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
                    parts += [
                        shapely.box(west, south, middle[0], north),
                        shapely.box(middle[0], south, east, north),
                    ]
                else:
                    parts += [
                        shapely.box(west, south, east, middle[1]),
                        shapely.box(west, middle[1], east, north),
                    ]
        return False

    def _zone(self, group: ActorGroup) -> Geometry:
        """All ground that the group's footprints, grown by half their gap, can touch."""
        half_gap = group.placement.separation_m / 2.0
        zone = grown_at_least(self.ground[group.id], outer_radius_m(group) + half_gap)
        if any(
            term.group == group.id and term.path in ("world.area", field_path(group, "region"))
            for term in self.terms
        ):
            zone = zone.intersection(grown_at_least(polygon_ground(region_of(self.simspec, group)), half_gap))
        for term in self.terms:
            if term.group == HOME_FIELD and half_gap < HOME_CLEARANCE_M:
                zone = zone.difference(shapely.buffer(term.ground, HOME_CLEARANCE_M - half_gap))
            elif term.path.endswith(".at") and term.group not in hosts_of(self.simspec, group):
                zone = zone.difference(
                    shapely.buffer(_fixed_outline(self.simspec.group(term.group)), half_gap)
                )
        return zone


def _fixed_outline(group: ActorGroup) -> Geometry:
    """The footprint of a fixed actor."""
    at = group.placement.at
    assert at is not None
    footprint = footprints(
        ASSETS[group.asset], np.array([[at.east_m, at.north_m]]), np.array([at.heading_deg]), 0.0
    )
    return shapely.polygons(footprint.corners())[0]


def _centre_distance_m(group: ActorGroup) -> float:
    """Least distance between centres of two members, or of members of groups with no smaller gap."""
    return 2.0 * inner_radius_m(group) + group.placement.separation_m


def _crowded_distances_m(group: ActorGroup, count: int) -> Floats:
    """(count,) least distances from any point to the nearest, second nearest ... member: k grown footprints
    that reach no further than the k-th centre and their own outer radius must fit into that circle.
    """
    gap = group.placement.separation_m
    area = grown_area_m2(group, gap)
    least: Floats = np.sqrt(np.arange(1, count + 1) * area / pi) - outer_radius_m(group) - gap / 2.0
    return np.maximum(least, 0.0)


def _farthest_m(first_ground: Geometry, second_ground: Geometry) -> float:
    first, second = (
        shapely.get_coordinates(shapely.convex_hull(geometry)) for geometry in (first_ground, second_ground)
    )
    return float(np.hypot(*(first[:, None, :] - second[None, :, :]).transpose(2, 0, 1)).max())
