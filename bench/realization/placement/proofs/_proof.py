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
  of ground in which their groups may stand; a linear program decides that.

A scene that is not refused may still be infeasible.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from math import ceil, floor, pi
from typing import Any

import numpy as np
import shapely

from bench.errors import PlacementInfeasible
from bench.simspec import HOME, ActorGroup, AreaCount, MeanDistance, SimSpec

from .._area_counts import GroundPart, feasible_numbers, ground_parts, named_area
from .._geometry import EVERYWHERE, Geometry, grown_at_least, hull_ways, polygon_ground, simplified, thickened
from .._groups import (
    centre_distance_m,
    centre_ground,
    hosts_of,
    inner_radius_m,
    is_home,
    member_count,
    outer_radius_m,
    region_of,
    smallest_failing,
)
from ..relations._between import BetweenRelation
from ..relations._distance_bands import band_ground
from ..relations._headings import RequiredHeading, headings_conflict
from ..relations._patrol_routes import is_obstacle, visible_ground
from ..relations._relation import HOME_CLEARANCE_M, GroupRelation, field_path
from ._capacity import AREA_TOLERANCE_M2, crowded_distances_m, grown_area_m2
from ._constraints import Constraint, Kind, fixed_outline, scene_constraints, shapely_point
from ._packing import areas_can_be_allocated, max_aligned_rectangles, max_spaced_points, oler_bound

# Rounds in which groups cut each other's ground before the proof looks at what is left. Chosen, not measured.
NARROWING_ROUNDS = 6

# Parts into which the ground of a single member is split at the most. Chosen, not measured.
MAX_CASES = 48

# A part narrower than this is not split further. Chosen, not measured.
MIN_CASE_SIDE_M = 2.0


def prove_infeasible(simspec: SimSpec, order: Sequence[ActorGroup]) -> PlacementInfeasible | None:
    """The refusal of a scene that is proved infeasible, with a smallest conflicting set; else None."""
    terms = scene_constraints(simspec, order)
    # The cheapest proof first; the others include it.
    for proof in (_Relaxation.narrow, _Relaxation.check_areas, _Relaxation.check_cases):
        contradiction = partial(_contradiction, proof, simspec, order)
        if contradiction(terms) is None:
            continue
        core = smallest_failing(
            terms,
            lambda subset, contradiction=contradiction: contradiction(subset) is not None,  # type: ignore[misc]
            max(1, len(terms) // 2),
        )
        constraint_text = "; ".join(f"{term.text} ({term.path})" for term in core)
        note_text = f" ({note})" if (note := contradiction(core)) else ""
        return PlacementInfeasible(
            f"impossible, and proved so: not all of this can hold: {constraint_text}{note_text}. Loosen one of these",
            clash=tuple(dict.fromkeys(term.path for term in core)),
        )
    return None


def narrowed_ground(simspec: SimSpec, order: Sequence[ActorGroup]) -> dict[str, Geometry]:
    """Ground that holds the centres of each group with members in every arrangement, and home."""
    scene = _Relaxation(simspec, order, scene_constraints(simspec, order))
    # What is left of a contradiction is still true of every arrangement: there is none.
    with suppress(_Contradiction):
        scene.narrow()
    return scene.ground


class _Contradiction(Exception):
    """Some constraints cannot hold together; the words are what a proof has to add to theirs, or empty."""

    @classmethod
    def unless(cls, holds: object, note: str = "") -> None:
        if not holds:
            raise cls(note)


def _contradiction(
    proof: Callable[[_Relaxation], None],
    simspec: SimSpec,
    order: Sequence[ActorGroup],
    terms: Sequence[Constraint],
    case: dict[str, Geometry] | None = None,
) -> str | None:
    """What a proof has to add where the constraints contradict each other; None where it finds no contradiction."""
    try:
        proof(_Relaxation(simspec, order, terms, case or {}))
    except _Contradiction as contradiction:
        return str(contradiction)
    return None


@dataclass(slots=True)
class _Relaxation:
    """Some constraints of a scene, and the ground that they leave to each group and to the vehicle's home.

    Each check raises `_Contradiction` where the constraints cannot hold together.
    """

    simspec: SimSpec
    order: Sequence[ActorGroup]
    terms: Sequence[Constraint]
    case: dict[str, Geometry] = field(default_factory=dict)
    ground: dict[str, Geometry] = field(default_factory=dict)

    def narrow(self) -> None:
        """No group is without ground, no two distances exclude each other, and each mean distance is in reach."""
        self.ground = {HOME: shapely_point(self.simspec.vehicle.home)}
        self.ground |= {
            group.id: self._own_ground(group) for group in self.order if member_count(self.simspec, group)
        }
        _Contradiction.unless(not any(ground.is_empty for ground in self.ground.values()))
        for _ in range(NARROWING_ROUNDS):
            before = [shapely.area(ground) for ground in self.ground.values()]
            self._each("relation", self._narrow_by_relation)
            self._each("between", self._narrow_by_between)
            self._each("mean", self._check_mean)
            self._each("mean", self._narrow_by_mean)
            self._each("extent_m", self._narrow_by_extent)
            # Narrowing converges geometrically; what is left below this change proves nothing more.
            if np.allclose(before, [shapely.area(ground) for ground in self.ground.values()], rtol=1e-4):
                break
        for group in self.order:
            self._check_bands(group.id)
        self._each("heading", self._check_headings)

    def _facts(self, kind: Kind) -> list[tuple[str, Any]]:
        """The group and the fact of every constraint of a kind."""
        return [(term.group, term.fact) for term in self.terms if term.kind == kind]

    def _each(self, kind: Kind, step: Callable[[str, Any], None]) -> None:
        for group_id, fact in self._facts(kind):
            step(group_id, fact)

    def _facts_of(self, kind: Kind, group_id: str) -> list[Any]:
        return [fact for name, fact in self._facts(kind) if name == group_id]

    def _alone(self, name: str) -> bool:
        return member_count(self.simspec, self.simspec.group(name)) == 1

    def _own_ground(self, group: ActorGroup) -> Geometry:
        """Where the group's relations to the ground and to what is fixed leave centres."""
        grounds = self._facts_of("at", group.id) + self._facts_of("ground", group.id)
        grounds += [self.case[group.id]] if group.id in self.case else []
        remaining = thickened(shapely.intersection_all(grounds)) if grounds else EVERYWHERE
        if group.placement.at or remaining.is_empty:
            return remaining
        inner = inner_radius_m(group)
        for other in self._fixed_beside(group):
            gap = max(group.placement.separation_m, other.placement.separation_m)
            remaining = remaining.difference(shapely.buffer(fixed_outline(other), gap + inner - 1e-6))
        for _, home in self._facts("home"):
            remaining = remaining.difference(shapely.buffer(home, HOME_CLEARANCE_M + inner - 1e-6))
        for route_m in self._facts_of("route", group.id):
            # A hair smaller than they are, so that rounding proves nothing.
            walls = [
                shapely.buffer(fixed_outline(wall), -1e-6, join_style="mitre")
                for name, _ in self._facts("at")
                if is_obstacle(wall := self.simspec.group(name))
            ]
            remaining = remaining.intersection(visible_ground(route_m, walls))
        return remaining

    def _fixed_beside(self, group: ActorGroup) -> list[ActorGroup]:
        """The fixed groups that a group must keep clear of: all but its hosts."""
        hosts = hosts_of(self.simspec, group)
        return [self.simspec.group(name) for name, _ in self._facts("at") if name not in hosts]

    def _cut(self, name: str, room: Geometry | None) -> None:
        if room is not None:
            self.ground[name] = thickened(shapely.intersection(self.ground[name], room))
            _Contradiction.unless(not self.ground[name].is_empty)

    def _narrow_by_relation(self, group_id: str, tie: GroupRelation) -> None:
        """Narrow the ground on both sides to where a relation between them can hold."""
        others = [name for name in tie.of if name in self.ground]
        grounds = [simplified(self.ground[name]) for name in others]
        if tie.quantifier == "some":
            grounds = [simplified(shapely.union_all(grounds))]
        for ground in grounds:
            self._cut(group_id, tie.ground(ground) if others else shapely.Polygon())
        if tie.quantifier == "every" or (len(others) == 1 and self._alone(others[0])):
            for name in others:
                self._cut(name, tie.reverse_ground(simplified(self.ground[group_id])))

    def _narrow_by_between(self, group_id: str, between: BetweenRelation) -> None:
        self._cut(group_id, between.ground(*(self.ground[name] for name in between.ends)))

    def _check_bands(self, group_id: str) -> None:
        """No two distances of a group to the same members exclude each other.

        Some member who keeps the one, or the mean of all, may be another than who keeps the other.
        """
        bands = [
            (tie.of, tie.quantifier, tie.band_m) for tie in self._facts_of("relation", group_id) if tie.band_m
        ]
        for mean in self._facts_of("mean", group_id):
            # Positions are rounded to the millimetre.
            slack_m = mean.tolerance * mean.mean_m + 1e-3
            bands.append(((mean.of,), "mean", (mean.mean_m - slack_m, mean.mean_m + slack_m)))
        for (of, quantifier, (low_m, high_m)), (other, other_quantifier, band_m) in combinations(bands, 2):
            if of == other and "every" in (quantifier, other_quantifier):
                _Contradiction.unless(max(low_m, band_m[0]) <= min(high_m, band_m[1]))

    def _check_headings(self, group_id: str, parallel: RequiredHeading) -> None:
        """Some heading of a group follows its road and faces its target."""
        group = self.simspec.group(group_id)
        along = group.placement.along
        if along is None or not parallel.lines:
            return
        road = self.simspec.world.road(along.road)
        # The mitre limit of road corners is 2, so a corner reaches twice as far out as a side.
        reach_m = road.width_m + outer_radius_m(group) + (along.within_m if along.where == "beside" else 0.0)
        along_required = any(term.path == field_path(group, "along") for term in self.terms)
        for facing in self._facts_of("heading", group.id):
            if not facing.lines:
                theirs = facing.point if facing.of is None else self.ground[facing.of]
                _Contradiction.unless(
                    not headings_conflict(
                        parallel, facing, self.ground[group.id], theirs, reach_m if along_required else None
                    )
                )

    def _check_mean(self, group_id: str, mean: MeanDistance) -> None:
        group, mine, theirs = self.simspec.group(group_id), self.ground[group_id], self.ground[mean.of]
        nearest = np.full(member_count(self.simspec, group), shapely.distance(mine, theirs))
        if self._facts_of("need_m2", group_id):
            nearest = np.maximum(nearest, crowded_distances_m(group, len(nearest)))
        low, high = float(nearest.mean()), float(np.hypot(*hull_ways(mine, theirs).T).max())
        _Contradiction.unless(
            low <= mean.mean_m * (1 + mean.tolerance) + 1e-3,
            f"no mean under {floor(10 * low) / 10:g} m is in reach",
        )
        _Contradiction.unless(
            high >= mean.mean_m * (1 - mean.tolerance) - 1e-3,
            f"no mean over {ceil(10 * high) / 10:g} m is in reach",
        )

    def _narrow_by_mean(self, group_id: str, mean: MeanDistance) -> None:
        """A lone member keeps the mean itself, and so does a lone target seen from the group's ground."""
        for name, other in ((group_id, mean.of), (mean.of, group_id)):
            if not is_home(self.simspec, name) and self._alone(name):
                self._keep_mean(name, other, mean, 0.0)

    def _keep_mean(self, name: str, other: str, mean: MeanDistance, more_m: float) -> None:
        """Keep the ground within the mean distance from the other ground, up to its tolerance and so much more."""
        slack_m = more_m + mean.tolerance * mean.mean_m + 1e-3
        band = max(0.0, mean.mean_m - slack_m), mean.mean_m + slack_m
        self._cut(name, band_ground(simplified(self.ground[other]), *band))

    def _narrow_by_extent(self, group_id: str, extent_m: float) -> None:
        """Everybody is within the extent of each counted member, and of the mean of all distances."""
        for count in self._facts_of("count", group_id):
            if count.low:
                area = named_area(self.simspec, count.area)
                room = centre_ground(area, self.simspec.group(group_id))
                self._cut(group_id, grown_at_least(self.ground[group_id].intersection(room), extent_m))
        for mean in self._facts_of("mean", group_id):
            self._keep_mean(group_id, mean.of, mean, extent_m)

    def check_areas(self) -> None:
        """The members need no more area than the ground that is left."""
        self.narrow()
        self._each("spread_m", self._check_spread)
        self._each("extent_m", self._check_extent)
        for group_id in dict.fromkeys(group_id for group_id, _ in self._facts("count")):
            self._check_counts(group_id)
        groups = [self.simspec.group(group_id) for group_id, _ in self._facts("need_m2")]
        for group in groups:
            self._check_aligned(group)
        # Guests inside hosts take no ground that their hosts do not take already.
        free = [group for group in groups if not hosts_of(self.simspec, group)]
        self._check_numbers(groups, free)
        self._check_zones(free)

    def _check_spread(self, group_id: str, spread_m: float) -> None:
        """Circles of half the spread round the centres do not overlap, and Oler's inequality holds."""
        count, ground = member_count(self.simspec, self.simspec.group(group_id)), self.ground[group_id]
        room_m2 = shapely.area(grown_at_least(ground, spread_m / 2.0))
        fits = count * pi * spread_m**2 / 4.0 <= room_m2 and count <= max_spaced_points(ground, spread_m)
        _Contradiction.unless(count == 1 or fits)

    def _check_extent(self, group_id: str, extent_m: float) -> None:
        """So many members find room in ground of that diameter.

        Of all sets of one diameter the disc has the largest area (Bieberbach 1915) and the longest perimeter
        (Rosenthal and Szasz 1916), for Oler's inequality and for the area of the members.
        """
        group, apart_m = self.simspec.group(group_id), self._least_apart_m(group_id)
        count = member_count(self.simspec, group)
        if apart_m > 0.0:
            _Contradiction.unless(count <= oler_bound(pi * extent_m**2 / 4.0, pi * extent_m, apart_m))
        reach_m = extent_m / 2.0 + outer_radius_m(group) + group.placement.separation_m / 2.0
        for need_m2 in self._facts_of("need_m2", group_id):
            _Contradiction.unless(count == 1 or need_m2 <= pi * reach_m**2 + AREA_TOLERANCE_M2)

    def _least_apart_m(self, group_id: str) -> float:
        """The least distance between centres of two members that size and spread leave."""
        sized = self._facts_of("need_m2", group_id)
        sizes_m = [centre_distance_m(self.simspec.group(group_id))] if sized else []
        return float(max([0.0, *sizes_m, *self._facts_of("spread_m", group_id)]))

    def _check_counts(self, group_id: str) -> None:
        """Some numbers of members in the parts of the ground keep all counts inside areas."""
        group, counts = self.simspec.group(group_id), self._facts_of("count", group_id)
        parts = ground_parts(self.simspec, group, counts, self.ground[group_id])
        capacities = [self._capacity(group, part, counts) for part in parts]
        number = member_count(self.simspec, group)
        _Contradiction.unless(feasible_numbers(parts, counts, number, capacities) is not None)

    def _capacity(self, group: ActorGroup, part: GroundPart, counts: Sequence[AreaCount]) -> int:
        """At most so many members stand in a part of the ground."""
        apart_m, gap_m = self._least_apart_m(group.id), group.placement.separation_m
        bounds = [float(member_count(self.simspec, group)), max(1.0, max_spaced_points(part.ground, apart_m))]
        if self._facts_of("need_m2", group.id):
            zone = grown_at_least(part.ground, outer_radius_m(group) + gap_m / 2.0)
            for count, is_inside in zip(counts, part.inside, strict=True):
                if is_inside:
                    area = named_area(self.simspec, count.area)
                    zone = zone.intersection(grown_at_least(area, gap_m / 2.0))
            room_m2 = float(shapely.area(zone)) + AREA_TOLERANCE_M2
            bounds.append(room_m2 / grown_area_m2(group, gap_m))
        return floor(min(bounds))

    def _check_aligned(self, group: ActorGroup) -> None:
        """A group with one course has no more members than parallel rectangles that fit."""
        asset, count = group.definition, member_count(self.simspec, group)
        size_m = (asset.length_m, asset.width_m)
        for heading in self._facts_of("heading", group.id):
            common = heading.common
            if common is not None and common[1] < 45.0 and asset.length_m >= asset.width_m:
                most = max_aligned_rectangles(
                    self.ground[group.id], size_m, group.placement.separation_m, *common
                )
                _Contradiction.unless(count <= most)

    def _check_numbers(self, groups: Sequence[ActorGroup], free: Sequence[ActorGroup]) -> None:
        """There are no more members than centres that fit on the ground that is left.

        Circles inside two footprints keep the gap of these. The largest two groups, the largest three ... are
        counted together.
        """
        largest = sorted(free, key=centre_distance_m, reverse=True)
        sets = [[group] for group in groups] + [largest[:number] for number in range(2, len(largest) + 1)]
        for members in sets:
            count = sum(member_count(self.simspec, group) for group in members)
            ground = shapely.union_all([self.ground[group.id] for group in members])
            apart_m = min(centre_distance_m(group) for group in members)
            _Contradiction.unless(count == 1 or count <= max_spaced_points(ground, apart_m))

    def _check_zones(self, free: Sequence[ActorGroup]) -> None:
        """The zones of the groups hold the areas of their members."""
        zones = {group.id: self._zone(group) for group in free}
        areas = {name: zone.area for name, zone in zones.items()}
        needs = {name: need for name, need in self._facts("need_m2") if name in zones}
        _Contradiction.unless(all(needs[name] <= areas[name] + AREA_TOLERANCE_M2 for name in zones))
        if zones and sum(needs.values()) > min(areas.values()):
            _Contradiction.unless(areas_can_be_allocated(zones, needs))

    def _zone(self, group: ActorGroup) -> Geometry:
        """All ground that the group's footprints, grown by half their gap, can touch."""
        half_gap = group.placement.separation_m / 2.0
        zone = grown_at_least(self.ground[group.id], outer_radius_m(group) + half_gap)
        if {"world.area", field_path(group, "region")} & {
            term.path for term in self.terms if term.group == group.id
        }:
            zone = zone.intersection(grown_at_least(polygon_ground(region_of(self.simspec, group)), half_gap))
        for other in self._fixed_beside(group):
            zone = zone.difference(shapely.buffer(fixed_outline(other), half_gap))
        if half_gap < HOME_CLEARANCE_M:
            for _, home in self._facts("home"):
                zone = zone.difference(shapely.buffer(home, HOME_CLEARANCE_M - half_gap))
        return zone

    def check_cases(self) -> None:
        """Some ground is left wherever a lone target of several relations stands, tried in ever smaller parts.

        Relations to one member are narrowed one by one; they add up only when the place of that member is
        known.
        """
        self.narrow()
        relations = [fact for _, fact in self._facts("relation") + self._facts("between")]
        for name, times in Counter(name for relation in relations for name in relation.of).items():
            if times > 1 and self._alone(name) and shapely.area(self.ground[name]) > 0.0:
                _Contradiction.unless(not self._always_fails(name, len(relations)))

    def _always_fails(self, name: str, relation_count: int) -> bool:
        """Whether the scene fails wherever that member stands; parts that do not fail are halved."""
        # Depth first over a stack: the search ends at the first part that cannot be refused.
        parts = [shapely.box(*shapely.bounds(self.ground[name]))]
        for _ in range(min(MAX_CASES, 8 + 8 * MAX_CASES // relation_count)):
            if not parts:
                return True
            part = parts.pop()
            case = {name: part}
            if _contradiction(_Relaxation.narrow, self.simspec, self.order, self.terms, case) is None:
                bounds = np.array(shapely.bounds(part))
                side = bounds[2:] - bounds[:2]
                if side.max() < MIN_CASE_SIDE_M:
                    return False
                axis = 0 if side[0] > side[1] else 1
                lower, upper = bounds.copy(), bounds.copy()
                lower[2 + axis] = upper[axis] = bounds[axis::2].mean()
                parts += [shapely.box(*lower), shapely.box(*upper)]
        return False
