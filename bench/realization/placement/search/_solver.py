"""Places by CP-SAT, for scenes in which sampling stalls: which of many places to take, so that everything is kept at once.

Every group gets a pool of places that keep its relations to the ground and to what stands: lattices that pack without a gap to
spare, and random ones. One Boolean for each place; whoever would crowd another excludes it, and ties between groups are
clauses over their places. The solver runs with one worker, a seed and a deterministic limit: same seed, same places.
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
from bench.simspec import ASSETS, ActorGroup, SimSpec, generator, seed_of

from .._footprint import Footprints, empty_footprints, footprints, gaps, joined
from .._geometry import Geometry, areal_parts, polygon_ground, uniform_places
from .._groups import member_count, prerequisite_groups, region_of
from .._targets import target_footprints
from ..proofs._proof import narrowed_ground
from ..relations._between import between_relations
from ..relations._distance_bands import lone_member_ground
from ..relations._ground import clearance, ground_relations
from ..relations._headings import facing_target, sampled_headings_deg
from ..relations._line_of_sight import placed_solids
from ..relations._other_groups import group_relations
from ..relations._patrol_routes import access_relations, blocking_pairs, is_obstacle, patrols, placed_obstacles, route_clearances
from ..relations._relation import GroupRelation, common_ground
from ._lattices import lattices
from ._sampling import Placed, fixed_places

MAX_ATTEMPTS = 2


MAX_DEPENDENT_ATTEMPTS = 12
"""Where somebody stands in or between others, who are placed first and cannot know what comes."""


HOST_FILL = 0.5
"""Share of a host's ground that its guests are reckoned to fill."""


ATTEMPT_LIMIT = 1.0
"""CP-SAT's deterministic seconds for one try; about as many of a core."""


MAX_PLACES = 6000


TRIED_PER_WANTED = 12
"""Places of one lattice that are tried for each that is wanted."""


MAX_LATTICE_HOSTS = 12
"""In so many hosts the guests' places are tried in rows."""


Literal = cp_model.IntVar


def solve_placement(simspec: SimSpec, order: Sequence[ActorGroup]) -> Placed | None:
    """Places for every group, None where none were found."""
    left = narrowed_ground(simspec, order)
    effort = 0.0
    for attempt in range(MAX_DEPENDENT_ATTEMPTS if any(_is_dependent(group) for group in order) else MAX_ATTEMPTS):
        if attempt >= MAX_ATTEMPTS and effort > MAX_ATTEMPTS * ATTEMPT_LIMIT:
            break
        rng = generator(simspec.seeds, "placement", zlib.crc32(b"cp-sat"), attempt)
        placed: Placed | None = fixed_places(order)
        for phase in _phases(simspec, order):
            if placed is not None:
                choice = _Phase(simspec, phase, placed, left, rng)
                placed = choice.placed()
                effort += choice.effort
        if placed is not None:
            return placed
    return None


def _phases(simspec: SimSpec, order: Sequence[ActorGroup]) -> list[list[ActorGroup]]:
    """Free groups that are placed together: all at once, but for who must see, face, be at a mean distance from, in or between
    what stands. Hosts wait for those to whom their guests relate, where they can."""
    needs = {group.id: prerequisite_groups(simspec, group) for group in order}
    stage = {group.id: 0 for group in order}
    for _ in order:
        before = dict(stage)
        for group in order:
            for host in _hosts(group):
                others = {name for name in needs[group.id] - {host} if host not in _with_prerequisites(needs, name)}
                stage[host] = max(stage[host], *(stage[name] + 1 for name in others), 0)
        for group in order:
            place = group.placement
            later = any((place.hidden_from, place.visible_from, place.facing, place.mean_distance)) or _is_dependent(group)
            stage[group.id] = max(stage[group.id], max((stage[name] for name in needs[group.id]), default=0) + later)
        if stage == before:
            break
    free = [group for group in order if not group.placement.at]
    return [some for number in range(max(stage.values(), default=0) + 1) if (some := [g for g in free if stage[g.id] == number])]


def _hosts(group: ActorGroup) -> tuple[str, ...]:
    inside = group.placement.inside
    return (inside.of,) if inside and inside.of else ()


def _is_dependent(group: ActorGroup) -> bool:
    return bool(_hosts(group)) or group.placement.between is not None


def _with_prerequisites(needs: Mapping[str, set[str]], name: str) -> set[str]:
    """The group and all that must stand before it."""
    found = {name}
    while more := {other for one in found for other in needs[one]} - found:
        found |= more
    return found


@dataclass(slots=True)
class _Phase:
    """Groups that are placed together among what stands."""

    simspec: SimSpec
    groups: Sequence[ActorGroup]
    standing: Placed
    left: Mapping[str, Geometry]
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
        self._keep_ways(peopled)
        self._keep_hosts(peopled)
        for group in peopled:
            for tie in self._ties(group):
                if set(tie.of) & self.pools.keys():
                    self._tie(group, tie)
            self._mean(group)
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = seed_of(self.simspec.seeds, "placement") % 2**31
        solver.parameters.max_deterministic_time = ATTEMPT_LIMIT
        status = solver.solve(self.model)
        self.effort = solver.response_proto.deterministic_time
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            return None
        return {**self.standing, **{group.id: self._members(group, solver) for group in self.groups}}

    def _members(self, group: ActorGroup, solver: cp_model.CpSolver) -> Footprints:
        """The chosen places in a drawn order, behind the one that relations to the first member were kept to."""
        if group.id not in self.pools:
            return empty_footprints()
        chosen = np.array([index for index, one in enumerate(self.taken[group.id]) if solver.boolean_value(one)])
        chosen = self.rng.permutation(chosen)
        if group.id in self.first:
            leader = next(index for index, one in enumerate(self.first[group.id]) if solver.boolean_value(one))
            chosen = np.array([leader, *chosen[chosen != leader]])
        return self.pools[group.id][chosen]

    def _ties(self, group: ActorGroup) -> list[GroupRelation]:
        looks = group.placement.hidden_from or group.placement.visible_from
        return group_relations(self.simspec, group, placed_solids(self.simspec, self.standing) if looks else None)

    def _pool(self, group: ActorGroup, groups: int) -> Footprints:
        """Places that keep whatever does not depend on the other members of this phase."""
        count = member_count(self.simspec, group)
        wanted = int(min(max(8 * count, 160), max(900, 1.5 * count), max(MAX_PLACES / groups, 1.2 * count)))
        relations = [*ground_relations(self.simspec, group), *route_clearances(self.simspec, group)]
        for tie in self._ties(group):
            if not set(tie.of) & {one.id for one in self.groups}:
                others = tie.points if tie.points is not None else joined([self.standing[name] for name in tie.of])
                relations.append(tie.bound(others))
        relations.append(clearance(self.simspec, group, self.standing))
        relations += [way.bound(self.standing.__getitem__) for way in between_relations(self.simspec, group)]
        relations += access_relations(self.simspec, group, self.standing)
        room = areal_parts(shapely.intersection(self.left[group.id], lone_member_ground(self.simspec, group, self.standing)))
        if _is_dependent(group):
            room = shapely.intersection(room, common_ground(relations))
        found = empty_footprints()
        for some in self._candidates(group, room, wanted):
            for relation in relations:
                some = some[relation.keeps(some)]
            if len(some) > wanted - len(found):  # any part of a lattice is one whose places do not crowd each other
                some = some[np.sort(self.rng.permutation(len(some))[: wanted - len(found)])]
            found = joined([found, some])
            if len(found) >= wanted:
                break
        return found

    def _candidates(self, group: ActorGroup, room: Geometry, wanted: int) -> Iterator[Footprints]:
        """Random places and lattices in turn, the random ones where the group's relations leave room for them."""
        lattices = [] if _has_dependent_heading(group) else self._lattices(group)
        share = wanted // 4 if lattices else wanted
        yield self._random(group, room, share)
        shapely.prepare(room)
        for lattice in lattices:  # of small things in a wide yard there are a hundred thousand
            within = np.flatnonzero(shapely.intersects_xy(room, lattice.centre_m[:, 0], lattice.centre_m[:, 1]))
            if len(within) > TRIED_PER_WANTED * wanted:
                within = np.sort(self.rng.permutation(within)[: TRIED_PER_WANTED * wanted])
            yield lattice[within]
        for _ in range(4):
            yield self._random(group, room, wanted)

    def _lattices(self, group: ActorGroup) -> list[Footprints]:
        for host in _hosts(group):
            outlines = shapely.polygons(self.standing[host].corners())
            return [one for outline in outlines[:MAX_LATTICE_HOSTS] for one in lattices(group, outline)]
        inside = group.placement.inside
        area = next((one for one in self.simspec.world.areas if inside and one.id == inside.area), None)
        return lattices(group, polygon_ground(area or region_of(self.simspec, group)))

    def _random(self, group: ActorGroup, room: Geometry, count: int) -> Footprints:
        if shapely.area(room) == 0.0:
            return empty_footprints()
        centre_m = np.round(uniform_places(room, count, self.rng), 3)
        return footprints(ASSETS[group.asset], centre_m, self._headings_deg(group, centre_m), group.placement.separation_m)

    def _headings_deg(self, group: ActorGroup, centre_m: Floats) -> Floats:
        target = facing_target(self.simspec, group, self.standing)
        return sampled_headings_deg(self.simspec, group, centre_m, target, self.rng)

    def _choose(self, groups: Sequence[ActorGroup]) -> None:
        """One Boolean for each place, as many of them true as the group has members, and one for the first member."""
        led = {name for group in groups for tie in self._ties(group) if tie.whom == "first" for name in tie.of}
        for group in groups:
            count = member_count(self.simspec, group)
            own = [self.model.new_bool_var("") for _ in range(len(self.pools[group.id]))]
            self.taken[group.id] = own
            self.model.add(sum(own) == count)
            if group.id in led:
                self.first[group.id] = own if count == 1 else [self.model.new_bool_var("") for _ in own]
                self.model.add_exactly_one(self.first[group.id])
                if count > 1:
                    for one, leads in zip(own, self.first[group.id], strict=True):
                        self.model.add_implication(leads, one)

    def _keep_clear(self, groups: Sequence[ActorGroup]) -> None:
        """Whoever would crowd another, or stand nearer to a member of its group than the group is spread, excludes it."""
        everywhere = joined([self.pools[group.id] for group in groups])
        all_taken = [one for group in groups for one in self.taken[group.id]]
        whose = np.concatenate([np.full(len(self.pools[group.id]), index) for index, group in enumerate(groups)])
        spread_m = np.array([group.placement.spread_m or 0.0 for group in groups])[whose]
        for index, others in enumerate(_conflicts(everywhere, whose, spread_m)):
            self._exclude(all_taken[index], [all_taken[other] for other in others])

    def _keep_ways(self, groups: Sequence[ActorGroup]) -> None:
        """Whatever would close a patrol's way to its route, the shortest that what stands leaves it, excludes the walker there."""
        walls = placed_obstacles(self.simspec, self.standing)
        for walker in groups:
            for other in groups if patrols(self.simspec, walker) else ():
                if is_obstacle(other) and other is not walker:
                    pools = self.pools[walker.id], self.pools[other.id]
                    for one, index in blocking_pairs(self.simspec, walker, *pools, walls):
                        self._exclude(self.taken[walker.id][one], [self.taken[other.id][index]])

    def _keep_hosts(self, groups: Sequence[ActorGroup]) -> None:
        """So many hosts stand where guests who come later may stand that these have room."""
        for guest in self.simspec.actors:
            for host in groups:
                count = member_count(self.simspec, guest)
                if count and host.id in _hosts(guest):
                    outlines = shapely.polygons(self.pools[host.id].corners())
                    useful = shapely.area(shapely.intersection(outlines, self._room_so_far(guest))) > 0.0
                    own = ASSETS[guest.asset]
                    grown_m2 = (own.length_m + guest.placement.separation_m) * (own.width_m + guest.placement.separation_m)
                    least = ceil(count * grown_m2 / (HOST_FILL * float(shapely.area(outlines[0]))))
                    taken = [self.taken[host.id][index] for index in np.flatnonzero(useful).tolist()]
                    self.model.add(sum(taken) >= min(least, member_count(self.simspec, host)))

    def _room_so_far(self, group: ActorGroup) -> Geometry:
        """Where members may stand for all that is known: of whoever does not stand yet, only their ground is."""
        known = [tie for tie in group_relations(self.simspec, group) if set(tie.of) <= self.standing.keys()]
        bound = [
            tie.bound(tie.points if tie.points is not None else joined([self.standing[name] for name in tie.of])) for tie in known
        ]
        return shapely.intersection(self.left[group.id], common_ground(bound))

    def _exclude(self, one: Literal, others: Sequence[Literal]) -> None:
        if others:
            self.model.add_bool_and([other.negated() for other in others]).only_enforce_if(one)

    def _tie(self, group: ActorGroup, tie: GroupRelation) -> None:
        own, pool = self.taken[group.id], self.pools[group.id]
        for name in tie.of if tie.whom != "some" else ():
            others = self.pools.get(name, self.standing.get(name, empty_footprints()))
            matrix = tie.pairs(pool, others)
            literals = (self.first if tie.whom == "first" else self.taken).get(name)
            if literals is None:
                kept = matrix[:, 0] if tie.whom == "first" else matrix.all(axis=1)
                self._drop(own, np.logical_not(kept))
                continue
            for column, other in enumerate(literals):
                self._exclude(other, [own[row] for row in np.flatnonzero(~matrix[:, column]).tolist()])
        if tie.whom == "some":
            self._some(own, pool, tie)

    def _some(self, own: Sequence[Literal], pool: Footprints, tie: GroupRelation) -> None:
        """Each place that is taken has somebody who keeps the tie with it."""
        met = np.zeros(len(pool), dtype=np.bool_)
        helpers: list[list[Literal]] = [[] for _ in own]
        for name in tie.of:
            if name in self.pools:
                matrix = tie.pairs(pool, self.pools[name])
                for row, column in zip(*np.nonzero(matrix), strict=True):
                    helpers[row].append(self.taken[name][column])
            else:
                met |= tie.pairs(pool, self.standing[name]).any(axis=1)
        for row in np.flatnonzero(~met).tolist():
            self.model.add_bool_or([own[row].negated(), *helpers[row]])

    def _drop(self, own: Sequence[Literal], which: NDArray[np.bool_]) -> None:
        for row in np.flatnonzero(which).tolist():
            self.model.add_bool_and([own[row].negated()])

    def _mean(self, group: ActorGroup) -> None:
        """The members' distances add up to the mean that is wanted, halfway into its tolerance."""
        mean = group.placement.mean_distance
        if mean is None:
            return
        own, pool, count = self.taken[group.id], self.pools[group.id], member_count(self.simspec, group)
        leader_m = target_footprints(self.simspec, mean.of, self.standing).centre_m[0]
        distance_mm = np.round(1000.0 * np.hypot(*(pool.centre_m - leader_m).T)).astype(int).tolist()
        total = cp_model.LinearExpr.weighted_sum(own, distance_mm)
        self.model.add(total >= ceil(1000.0 * count * mean.mean_m * (1.0 - mean.tolerance / 2.0)))
        self.model.add(total <= int(1000.0 * count * mean.mean_m * (1.0 + mean.tolerance / 2.0)))


def _has_dependent_heading(group: ActorGroup) -> bool:
    """Whether headings follow from relations, so that no lattice of one heading will do."""
    along = group.placement.along
    facing = group.placement.facing
    return (facing is not None and facing.heading_deg is None) or (along is not None and along.parallel_deg is not None)


def _conflicts(some: Footprints, whose: NDArray[np.int_], spread_m: Floats) -> Iterator[list[int]]:
    """For each place the later ones that cannot be taken with it."""
    reach = some.radius_m
    for start in range(0, len(some), 256):
        rows = np.arange(start, min(start + 256, len(some)))
        offset = some.centre_m[rows, None, :] - some.centre_m[None, start:, :]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        later = rows[:, None] < np.arange(start, len(some))[None, :]
        wanted = np.maximum(some.gap_m[rows, None], some.gap_m[None, start:])
        near = later & (distance < reach[rows, None] + reach[None, start:] + wanted)
        hit = later & (whose[rows, None] == whose[None, start:]) & (distance < spread_m[rows, None])
        one, other = np.nonzero(near & ~hit)
        gap = gaps(some[rows[one]], some[start + other])
        hit[one, other] = (gap == 0.0) | (gap < wanted[one, other])
        for row in hit:
            yield (start + np.flatnonzero(row)).tolist()
