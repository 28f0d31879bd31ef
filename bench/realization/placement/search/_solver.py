"""Places by CP-SAT, for scenes in which sampling stalls: a choice from pools of places.

Every group gets a pool of places that keep its relations to the ground and to what is placed: tight lattices
and random places. Each place has one Boolean; places that are too close exclude each other, and relations
between groups are clauses over their places. The solver runs with one worker, a seed and a deterministic
limit: same seed, same places.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil

import numpy as np
import shapely
from numpy.typing import NDArray
from ortools.sat.python import cp_model

from bench.arrays import Floats
from bench.simspec import ActorGroup, SimSpec, generator, seed_of

from .._area_counts import areal_ground_parts, named_area
from .._footprint import Footprints, empty_footprints, footprints, gaps, joined
from .._geometry import Geometry, areal_parts, polygon_ground, uniform_places
from .._groups import member_count, prerequisite_groups, region_of
from .._targets import target_footprints
from ..proofs._proof import narrowed_ground
from ..relations._distance_bands import lone_member_ground
from ..relations._ground import clearance
from ..relations._headings import facing_target, sampled_headings_deg
from ..relations._other_groups import group_relations
from ..relations._patrol_routes import blocking_pairs, is_obstacle, patrols, placed_obstacles
from ..relations._relation import GroupRelation, Relation, common_ground, kept_places
from ._lattices import lattices
from ._sampling import (
    GATHERING_PLACES,
    Placed,
    fixed_places,
    gathering_ground,
    kept_relations,
    placed_relations,
)

MAX_ATTEMPTS = 2

# Attempts where members stand in or between others, which are placed first and know no later groups.
MAX_DEPENDENT_ATTEMPTS = 12

# Share of a host's ground that its guests are assumed to fill. Chosen, not measured.
HOST_FILL = 0.5

# CP-SAT's deterministic limit for one attempt, roughly core seconds: same seed, same places.
ATTEMPT_LIMIT = 1.0

MAX_PLACES = 6000

# Places of one lattice that are tried for each place wanted. Chosen, not measured.
TRIED_PER_WANTED = 12

# Number of hosts in which lattices for guests are tried. Chosen, not measured.
MAX_LATTICE_HOSTS = 12

Literal = cp_model.IntVar


def solve_placement(simspec: SimSpec, order: Sequence[ActorGroup]) -> Placed | None:
    """Places for every group, or None when none were found."""
    remaining = narrowed_ground(simspec, order)
    effort = 0.0
    dependent = any(_is_dependent(group) or group.placement.extent_m for group in order)
    for attempt in range(MAX_DEPENDENT_ATTEMPTS if dependent else MAX_ATTEMPTS):
        if attempt >= MAX_ATTEMPTS and effort > MAX_ATTEMPTS * ATTEMPT_LIMIT:
            break
        rng = generator(simspec.seeds, "placement", zlib.crc32(b"cp-sat"), attempt)
        placed: Placed | None = fixed_places(order)
        for phase in _phases(simspec, order):
            if placed is not None:
                choice = _Phase(simspec, phase, placed, remaining, rng)
                placed = choice.placed()
                effort += choice.effort
        if placed is not None:
            return placed
    return None


def _phases(simspec: SimSpec, order: Sequence[ActorGroup]) -> list[list[ActorGroup]]:
    """Groups that are placed together: all free groups at once, except that sight, facing, mean distance,
    inside and between need placed targets. Hosts wait for the targets of their guests where they can.
    """
    needs = {group.id: prerequisite_groups(simspec, group) for group in order}
    stage = {group.id: 0 for group in order}
    for _ in order:
        before = dict(stage)
        for group in order:
            for host in _hosts(group):
                others = {
                    name for name in needs[group.id] - {host} if host not in _with_prerequisites(needs, name)
                }
                stage[host] = max(stage[host], *(stage[name] + 1 for name in others), 0)
        for group in order:
            place = group.placement
            looks = (place.hidden_from, place.visible_from, place.facing, place.mean_distance)
            later = any(looks) or _is_dependent(group)
            before_it = max((stage[name] for name in needs[group.id]), default=0)
            stage[group.id] = max(stage[group.id], before_it + later)
        if stage == before:
            break
    free = [group for group in order if not group.placement.at]
    return [
        phase
        for number in range(max(stage.values(), default=0) + 1)
        if (phase := [g for g in free if stage[g.id] == number])
    ]


def _hosts(group: ActorGroup) -> tuple[str, ...]:
    inside = group.placement.inside
    return (inside.of,) if inside and inside.of else ()


def _is_dependent(group: ActorGroup) -> bool:
    return bool(_hosts(group)) or group.placement.between is not None


def _with_prerequisites(needs: Mapping[str, set[str]], name: str) -> set[str]:
    """The group and all groups that must be placed before it."""
    names = {name}
    while more := {other for known in names for other in needs[known]} - names:
        names |= more
    return names


@dataclass(slots=True)
class _Phase:
    """One phase: groups that are placed together among those already placed."""

    simspec: SimSpec
    groups: Sequence[ActorGroup]
    standing: Placed
    remaining: Mapping[str, Geometry]
    rng: np.random.Generator
    effort: float = 0.0
    model: cp_model.CpModel = field(default_factory=cp_model.CpModel)
    pools: dict[str, Footprints] = field(default_factory=dict)
    taken: dict[str, list[Literal]] = field(default_factory=dict)
    first: dict[str, list[Literal]] = field(default_factory=dict)

    def placed(self) -> Placed | None:
        """What stands, and these groups with it; None where no choice of places was found."""
        peopled = [group for group in self.groups if member_count(self.simspec, group)]
        for group in peopled:
            self.pools[group.id] = self._pool(group, len(peopled))
            if len(self.pools[group.id]) < member_count(self.simspec, group):
                return None
        self._choose(peopled)
        self._keep_clear(peopled)
        self._keep_routes_open(peopled)
        self._keep_hosts(peopled)
        for group in peopled:
            for tie in placed_relations(self.simspec, group, self.standing):
                if set(tie.of) & self.pools.keys():
                    self._require_relation(group, tie)
            self._require_mean(group)
            self._require_counts(group)
        solver = cp_model.CpSolver()
        # One worker: with more, the result would depend on the timing of threads.
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = seed_of(self.simspec.seeds, "placement") % 2**31
        solver.parameters.max_deterministic_time = ATTEMPT_LIMIT
        status = solver.solve(self.model)
        self.effort = solver.response_proto.deterministic_time
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            return None
        return {**self.standing, **{group.id: self._members(group, solver) for group in self.groups}}

    def _members(self, group: ActorGroup, solver: cp_model.CpSolver) -> Footprints:
        """The chosen places in a drawn order, behind the one that stands for the first member."""
        if group.id not in self.pools:
            return empty_footprints()
        chosen = self.rng.permutation(np.flatnonzero(list(map(solver.boolean_value, self.taken[group.id]))))
        if group.id in self.first:
            leader = list(map(solver.boolean_value, self.first[group.id])).index(True)
            chosen = np.array([leader, *chosen[chosen != leader]])
        return self.pools[group.id][chosen]

    def _pool(self, group: ActorGroup, groups: int) -> Footprints:
        """Places that keep every relation not involving other groups of this phase."""
        count = member_count(self.simspec, group)
        wanted = int(min(max(8 * count, 160), max(900, 1.5 * count), max(MAX_PLACES / groups, 1.2 * count)))
        phase = [member.id for member in self.groups]
        relations = kept_relations(self.simspec, group, self.standing, phase)
        relations.append(clearance(self.simspec, group, self.standing))
        lone = lone_member_ground(self.simspec, group, self.standing)
        room = areal_parts(shapely.intersection(self.remaining[group.id], lone))
        if _is_dependent(group):
            room = shapely.intersection(room, common_ground(relations))
        pool = empty_footprints()
        if group.placement.extent_m:
            room = self._gathered(group, room, relations)
        for candidates in self._candidates(group, room, wanted):
            candidates = kept_places(candidates, relations)
            # Any part of a lattice is one whose places do not crowd each other.
            if len(candidates) > wanted - len(pool):
                candidates = candidates[np.sort(self.rng.permutation(len(candidates))[: wanted - len(pool)])]
            pool = joined([pool, candidates])
            if len(pool) >= wanted:
                break
        return pool

    def _gathered(self, group: ActorGroup, room: Geometry, relations: Sequence[Relation]) -> Geometry:
        """The part of the room within the extent of a place that keeps the relations."""
        extent_m, mean = group.placement.extent_m, group.placement.mean_distance
        assert extent_m is not None
        target_m = target_footprints(self.simspec, mean.of, self.standing).centre_m[0] if mean else None
        ground = gathering_ground(self.simspec, group, room, extent_m, target_m)
        places = kept_places(self._random(group, ground, GATHERING_PLACES), relations)
        if not len(places):
            return room
        return areal_parts(room.intersection(shapely.Point(places.centre_m[0]).buffer(extent_m)))

    def _candidates(self, group: ActorGroup, room: Geometry, wanted: int) -> Iterator[Footprints]:
        """Random places and lattices in turn, the random ones where the group's relations have room."""
        if group.placement.counts:
            # By parts, because small areas would get hardly any of the places.
            parts = areal_ground_parts(self.simspec, group, room)
            for part in parts:
                yield self._random(group, part.ground, ceil(0.5 * wanted / len(parts)))
        lattices = [] if _has_dependent_heading(group) else self._lattices(group)
        share = wanted // 4 if lattices else wanted
        yield self._random(group, room, share)
        shapely.prepare(room)
        # A lattice of small assets in a wide yard has a hundred thousand places.
        for lattice in lattices:
            within = np.flatnonzero(
                shapely.intersects_xy(room, lattice.centre_m[:, 0], lattice.centre_m[:, 1])
            )
            if len(within) > TRIED_PER_WANTED * wanted:
                within = np.sort(self.rng.permutation(within)[: TRIED_PER_WANTED * wanted])
            yield lattice[within]
        for _ in range(4):
            yield self._random(group, room, wanted)

    def _lattices(self, group: ActorGroup) -> list[Footprints]:
        for host in _hosts(group):
            outlines = shapely.polygons(self.standing[host].corners())
            return [item for outline in outlines[:MAX_LATTICE_HOSTS] for item in lattices(group, outline)]
        inside = group.placement.inside
        areas = [named_area(self.simspec, count.area) for count in group.placement.counts if count.low]
        region = polygon_ground(region_of(self.simspec, group))
        areas.append(named_area(self.simspec, inside.area) if inside and inside.area else region)
        return [item for area in areas for item in lattices(group, area)]

    def _random(self, group: ActorGroup, room: Geometry, count: int) -> Footprints:
        if shapely.area(room) == 0.0:
            return empty_footprints()
        centre_m = np.round(uniform_places(room, count, self.rng), 3)
        target = facing_target(self.simspec, group, self.standing)
        heading_deg = sampled_headings_deg(self.simspec, group, centre_m, target, self.rng)
        return footprints(group.definition, centre_m, heading_deg, group.placement.separation_m)

    def _choose(self, groups: Sequence[ActorGroup]) -> None:
        """One Boolean for each place, as many true as there are members, and one for the first member."""
        led = {
            name
            for group in groups
            for tie in placed_relations(self.simspec, group, self.standing)
            if tie.quantifier == "first"
            for name in tie.of
        }
        for group in groups:
            count = member_count(self.simspec, group)
            literals = [self.model.new_bool_var("") for _ in range(len(self.pools[group.id]))]
            self.taken[group.id] = literals
            self.model.add(sum(literals) == count)
            if group.id in led:
                self.first[group.id] = (
                    literals if count == 1 else [self.model.new_bool_var("") for _ in literals]
                )
                self.model.add_exactly_one(self.first[group.id])
                if count > 1:
                    for literal, leads in zip(literals, self.first[group.id], strict=True):
                        self.model.add_implication(leads, literal)

    def _keep_clear(self, groups: Sequence[ActorGroup]) -> None:
        """Places too close, closer than the spread or farther than the extent exclude each other."""
        everywhere = joined([self.pools[group.id] for group in groups])
        all_taken = [literal for group in groups for literal in self.taken[group.id]]
        whose = np.concatenate(
            [np.full(len(self.pools[group.id]), index) for index, group in enumerate(groups)]
        )
        spread_m = np.array([group.placement.spread_m or 0.0 for group in groups])[whose]
        extent_m = np.array([group.placement.extent_m or np.inf for group in groups])[whose]
        for index, others in enumerate(_conflicts(everywhere, whose, spread_m, extent_m)):
            self._exclude(all_taken[index], [all_taken[other] for other in others])

    def _keep_routes_open(self, groups: Sequence[ActorGroup]) -> None:
        """An obstacle's place on a walker's shortest way to its route excludes the walker's place."""
        walls = placed_obstacles(self.simspec, self.standing)
        for walker in groups:
            for other in groups if patrols(self.simspec, walker) else ():
                if is_obstacle(other) and other is not walker:
                    pools = self.pools[walker.id], self.pools[other.id]
                    for first, index in blocking_pairs(self.simspec, walker, *pools, walls):
                        self._exclude(self.taken[walker.id][first], [self.taken[other.id][index]])

    def _keep_hosts(self, groups: Sequence[ActorGroup]) -> None:
        """Enough hosts stand where later guests may stand."""
        for guest in self.simspec.actors:
            for host in groups:
                count = member_count(self.simspec, guest)
                if count and host.id in _hosts(guest):
                    outlines = shapely.polygons(self.pools[host.id].corners())
                    useful = shapely.area(shapely.intersection(outlines, self._known_ground(guest))) > 0.0
                    asset, gap_m = guest.definition, guest.placement.separation_m
                    grown_m2 = (asset.length_m + gap_m) * (asset.width_m + gap_m)
                    least = ceil(count * grown_m2 / (HOST_FILL * float(shapely.area(outlines[0]))))
                    taken = [self.taken[host.id][index] for index in np.flatnonzero(useful).tolist()]
                    self.model.add(sum(taken) >= min(least, member_count(self.simspec, host)))

    def _known_ground(self, group: ActorGroup) -> Geometry:
        """The ground of members as far as it is known; of groups not yet placed, only their ground is."""
        known = [tie for tie in group_relations(self.simspec, group) if set(tie.of) <= self.standing.keys()]
        bound = [tie.bound_to(self.standing) for tie in known]
        return shapely.intersection(self.remaining[group.id], common_ground(bound))

    def _exclude(self, literal: Literal, others: Sequence[Literal]) -> None:
        if others:
            self.model.add_bool_and([other.negated() for other in others]).only_enforce_if(literal)

    def _require_relation(self, group: ActorGroup, tie: GroupRelation) -> None:
        literals, pool = self.taken[group.id], self.pools[group.id]
        for name in tie.of if tie.quantifier != "some" else ():
            others = self.pools.get(name, self.standing.get(name, empty_footprints()))
            matrix = tie.pairs(pool, others)
            other_literals = (self.first if tie.quantifier == "first" else self.taken).get(name)
            if other_literals is None:
                valid = matrix[:, 0] if tie.quantifier == "first" else matrix.all(axis=1)
                for row in np.flatnonzero(~valid).tolist():
                    self.model.add_bool_and([literals[row].negated()])
                continue
            for column, other in enumerate(other_literals):
                self._exclude(other, [literals[row] for row in np.flatnonzero(~matrix[:, column]).tolist()])
        if tie.quantifier == "some":
            self._require_some(literals, pool, tie)

    def _require_some(self, literals: Sequence[Literal], pool: Footprints, tie: GroupRelation) -> None:
        """Each chosen place has a chosen partner that keeps the relation with it."""
        met = np.zeros(len(pool), dtype=np.bool_)
        helpers: list[list[Literal]] = [[] for _ in literals]
        for name in tie.of:
            if name in self.pools:
                matrix = tie.pairs(pool, self.pools[name])
                for row, column in zip(*np.nonzero(matrix), strict=True):
                    helpers[row].append(self.taken[name][column])
            else:
                met |= tie.pairs(pool, self.standing[name]).any(axis=1)
        for row in np.flatnonzero(~met).tolist():
            self.model.add_bool_or([literals[row].negated(), *helpers[row]])

    def _require_counts(self, group: ActorGroup) -> None:
        """The wanted numbers of members inside areas."""
        corners = self.pools[group.id].corners()
        for count in group.placement.counts:
            # No place is across the border, so one corner tells.
            area = named_area(self.simspec, count.area)
            inside = shapely.contains_xy(area, corners[:, 0, 0], corners[:, 0, 1])
            total = sum(self.taken[group.id][index] for index in np.flatnonzero(inside).tolist())
            self.model.add(total >= count.low)
            self.model.add(total <= count.high(member_count(self.simspec, group)))

    def _require_mean(self, group: ActorGroup) -> None:
        """The members' distances add up to the mean, within half its tolerance."""
        mean = group.placement.mean_distance
        if mean is None:
            return
        literals, pool, count = self.taken[group.id], self.pools[group.id], member_count(self.simspec, group)
        leader_m = target_footprints(self.simspec, mean.of, self.standing).centre_m[0]
        distance_mm = np.round(1000.0 * np.hypot(*(pool.centre_m - leader_m).T)).astype(int).tolist()
        total = cp_model.LinearExpr.weighted_sum(literals, distance_mm)
        # CP-SAT takes whole numbers, hence millimetres.
        self.model.add(total >= ceil(1000.0 * count * mean.mean_m * (1.0 - mean.tolerance / 2.0)))
        self.model.add(total <= int(1000.0 * count * mean.mean_m * (1.0 + mean.tolerance / 2.0)))


def _has_dependent_heading(group: ActorGroup) -> bool:
    """Whether headings follow from relations, so that no lattice of one heading will do."""
    along, facing = group.placement.along, group.placement.facing
    return bool((facing and facing.heading_deg is None) or (along and along.parallel_deg is not None))


def _conflicts(
    places: Footprints, whose: NDArray[np.int_], spread_m: Floats, extent_m: Floats
) -> Iterator[list[int]]:
    """For each place the later places that exclude it."""
    reach = places.radius_m
    for start in range(0, len(places), 256):
        rows = np.arange(start, min(start + 256, len(places)))
        offset = places.centre_m[rows, None, :] - places.centre_m[None, start:, :]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        later = rows[:, None] < np.arange(start, len(places))[None, :]
        wanted = np.maximum(places.gap_m[rows, None], places.gap_m[None, start:])
        within_reach = later & (distance < reach[rows, None] + reach[None, start:] + wanted)
        alike = later & (whose[rows, None] == whose[None, start:])
        hit = alike & ((distance < spread_m[rows, None]) | (distance > extent_m[rows, None]))
        first, second = np.nonzero(within_reach & ~hit)
        gap = gaps(places[rows[first]], places[start + second])
        hit[first, second] = (gap == 0.0) | (gap < wanted[first, second])
        for row in hit:
            yield (start + np.flatnonzero(row)).tolist()
