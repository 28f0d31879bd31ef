"""Seeded sampling: group after group, each place drawn at random and accepted if it keeps all relations."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
import shapely

from bench.arrays import Floats
from bench.errors import PlacementInfeasible
from bench.simspec import ActorGroup, Near, SimSpec, generator

from .._area_counts import areal_ground_parts, drawn_numbers, named_area
from .._footprint import Footprints, empty_footprints, footprints, joined, too_close
from .._geometry import Geometry, areal_parts, grown_at_least, polygon_ground, uniform_places
from .._groups import member_count, region_of
from .._targets import fixed_footprint, target_footprints
from ..relations._between import between_relations
from ..relations._distance_bands import band_ground, lone_member_ground
from ..relations._ground import clearance, ground_relations
from ..relations._headings import facing_target, sampled_headings_deg
from ..relations._line_of_sight import placed_solids
from ..relations._other_groups import group_relations
from ..relations._patrol_routes import access_relations, route_clearances
from ..relations._relation import GroupRelation, Relation, common_ground, kept_places
from ._selection import ChosenMembers, members_at_mean, reachable_means_m

MAX_POOLS = 5

POOL_SIZE = 4096

# The group is crowded when fewer than one in this many places admits a missing member. Chosen, not measured.
CROWDING_RATIO = 4

# Places of which the first that keeps a group's relations is where the group gathers. Chosen, not measured.
GATHERING_PLACES = 400

Placed = dict[str, Footprints]


class SamplingStalled(Exception):
    """This attempt found no place for a member; `sentence` says for which and why, from freshly drawn places.

    `crowded` is true when valid places existed but members excluded each other from them; `share` is the
    share that found one.
    """

    def __init__(self, sentence: Callable[[], str], *, crowded: bool = False, share: float = 1.0) -> None:
        super().__init__()
        self.sentence, self.crowded, self.share = sentence, crowded, share


@dataclass(slots=True)
class SamplingBudget:
    """Candidates that may still be drawn, over all attempts: bounds the time that a hopeless scene takes."""

    remaining: int

    @property
    def spent(self) -> bool:
        """Whether nothing is left."""
        return self.remaining <= 0


def sample_placement(
    simspec: SimSpec,
    order: Sequence[ActorGroup],
    attempt: int,
    budget: SamplingBudget,
    remaining: Mapping[str, Geometry] | None = None,
    anchors: Mapping[str, Sequence[Geometry]] | None = None,
) -> Placed:
    """Places for every group, on its narrowed ground where that is known. Raises SamplingStalled.

    `anchors` are grounds on each of which one member of a group is to stand.
    """
    placed = fixed_places(order)
    stream = () if anchors is None else (zlib.crc32(b"anchored"),)
    for group in order:
        if group.placement.at:
            continue
        if not member_count(simspec, group):
            placed[group.id] = empty_footprints()
        else:
            # One random stream for each group, by its name: adding a group changes no draw of the others.
            rng = generator(simspec.seeds, "placement", zlib.crc32(group.id.encode()), attempt, *stream)
            sampler = Sampler.of(simspec, group, placed, rng, budget, remaining)
            placed[group.id] = sampler.members((anchors or {}).get(group.id, ()))
    return placed


def fixed_places(order: Sequence[ActorGroup]) -> Placed:
    """The groups whose author placed them. Raises PlacementInfeasible where two of them overlap."""
    placed: Placed = {}
    for group in order:
        if group.placement.at:
            candidate = fixed_footprint(group)
            for other, footprint in placed.items():
                # The author decides how close two fixed actors stand; they only must not overlap.
                if too_close(candidate, replace(footprint, gap_m=np.zeros(1))).any():
                    raise PlacementInfeasible(
                        f"groups {other!r} and {group.id!r} are fixed at places where their footprints overlap",
                        clash=(f"actors[{other}].placement.at", f"actors[{group.id}].placement.at"),
                    )
            placed[group.id] = replace(candidate, gap_m=np.full(1, group.placement.separation_m))
    return placed


def placed_relations(
    simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]
) -> list[GroupRelation]:
    """The group's relations to other groups, sight among what is placed included."""
    needs_sight = group.placement.hidden_from or group.placement.visible_from
    return group_relations(simspec, group, placed_solids(simspec, placed) if needs_sight else None)


def kept_relations(
    simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints], waiting: Collection[str] = ()
) -> list[Relation]:
    """All relations to the ground and to what is placed, but clearance and those to groups `waiting`."""
    relations = [*ground_relations(simspec, group), *route_clearances(simspec, group)]
    relations += [
        tie.bound_to(placed)
        for tie in placed_relations(simspec, group, placed)
        if not set(tie.of) & set(waiting)
    ]
    relations += [way.bound(placed.__getitem__) for way in between_relations(simspec, group)]
    return [*relations, *access_relations(simspec, group, placed)]


@dataclass(frozen=True, slots=True)
class Sampler:
    """Samples the members of one group among those already placed."""

    simspec: SimSpec
    group: ActorGroup
    count: int
    region: Geometry
    relations: tuple[Relation, ...]
    ring: _Ring | None
    ground: Geometry | None
    target_m: Floats | None
    facing: Footprints | None
    rng: np.random.Generator
    budget: SamplingBudget

    @classmethod
    def of(
        cls,
        simspec: SimSpec,
        group: ActorGroup,
        placed: Placed,
        rng: np.random.Generator,
        budget: SamplingBudget,
        remaining: Mapping[str, Geometry] | None = None,
    ) -> Sampler:
        """A sampler for a group whose relations are all to what is placed."""
        region = polygon_ground(region_of(simspec, group))
        where = group.placement
        relations = [*kept_relations(simspec, group, placed), clearance(simspec, group, placed)]
        mean = where.mean_distance
        target = target_footprints(simspec, mean.of, placed).centre_m[0] if mean else None
        rings = [
            _Ring(relation, target_footprints(simspec, relation.of, placed).centre_m)
            for relation in (where.near, where.away)
            if relation
        ]
        ring = min(rings, key=lambda candidate: candidate.area_m2, default=None)
        west, south, east, north = region.bounds
        # Rings larger than the region's box would draw most places outside it.
        if ring and ring.area_m2 > (east - west) * (north - south):
            ring = None
        # These leave so little of the region's box that drawing from it would waste the budget.
        grounds = (where.along, where.bearing, where.distances, where.inside, where.between)
        narrow = any((*grounds, where.avoid, where.counts, where.extent_m))
        room = common_ground(relations) if narrow or remaining is not None else None
        if room is not None and remaining is not None:
            lone = lone_member_ground(simspec, group, placed)
            room = areal_parts(shapely.intersection_all([room, remaining[group.id], lone]))
        facing = facing_target(simspec, group, placed)
        return cls(
            simspec,
            group,
            member_count(simspec, group),
            region,
            tuple(relations),
            ring,
            room,
            target,
            facing,
            rng,
            budget,
        )

    def members(self, anchors: Sequence[Geometry] = ()) -> Footprints:
        """The group's members, one of them on each of the anchors. Raises SamplingStalled."""
        sampler = self._gathered() if self.group.placement.extent_m else self
        if self.group.placement.counts:
            return sampler._in_parts()
        if self.target_m is not None:
            return sampler._at_mean_distance(self.target_m)
        return sampler._anywhere(anchors)

    def _gathered(self) -> Sampler:
        """The sampler on ground within reach of a place that keeps the group's relations."""
        extent_m = self.group.placement.extent_m
        assert extent_m is not None
        assert self.ground is not None
        ground = gathering_ground(self.simspec, self.group, self.ground, extent_m, self.target_m)
        if shapely.area(ground) == 0.0:
            return self
        places = kept_places(self._candidates(GATHERING_PLACES, None, ground), self.relations)
        if not len(places):
            return self
        # Half the extent keeps all of them together wherever they stand; all of it finds other shapes than discs.
        reach_m = extent_m * (0.5 if self.rng.random() < 0.5 else 1.0)
        disc = shapely.Point(places.centre_m[0]).buffer(reach_m)
        return replace(self, ground=areal_parts(self.ground.intersection(disc)))

    def _in_parts(self) -> Footprints:
        """Members in numbers that keep the counts inside areas, drawn part by part of the ground."""
        counts = self.group.placement.counts
        assert self.ground is not None
        parts = areal_ground_parts(self.simspec, self.group, self.ground)
        numbers = drawn_numbers(parts, counts, self.count, self.rng)
        words = ", ".join(f"{count.text} inside {count.area!r}" for count in counts)
        sentence = f"group {self.group.id!r}: no places were found for its {self.count} members with {words}"
        if numbers is None or self.target_m is not None:
            # Where the mean distance counts as well, the solver chooses.
            raise SamplingStalled(lambda: sentence, crowded=self.target_m is not None, share=0.0)
        crowd = ChosenMembers.of(self.count, self.group.placement)
        for part, number in zip(parts, numbers, strict=True):
            if number:
                replace(self, ground=part.ground)._admit(crowd, crowd.count + number)
        return crowd.members()[self.rng.permutation(self.count)]

    def _anywhere(self, anchors: Sequence[Geometry] = ()) -> Footprints:
        crowd = ChosenMembers.of(self.count, self.group.placement)
        for anchor in anchors[: self.count]:
            assert self.ground is not None
            ground = areal_parts(self.ground.intersection(anchor))
            replace(self, ground=ground)._admit(crowd, crowd.count + 1)
        self._admit(crowd, self.count)
        # Whom others rely on is not always the first.
        return crowd.members()[self.rng.permutation(self.count)] if anchors else crowd.members()

    def _admit(self, crowd: ChosenMembers, until: int) -> None:
        """Admit members until there are so many."""
        # Sizes chosen, not measured: a few places for each member and a base for small groups.
        for pool in self._pools(4 * (until - crowd.count) + 60):
            missing = until - crowd.count
            if crowd.admit(pool, np.arange(len(pool)), until):
                return
            # Random packings jam: when many places admit few members, more places admit ever fewer.
            if len(pool) >= CROWDING_RATIO * missing and until - crowd.count > missing * (
                1.0 - 1.0 / CROWDING_RATIO
            ):
                # Elsewhere, or in other numbers inside areas, there may be room: one more attempt.
                movable = self.group.placement.extent_m or self.group.placement.counts
                share = 1.0 if movable else crowd.count / self.count
                raise SamplingStalled(lambda: self._explain(crowd.count), crowded=True, share=share)
        raise SamplingStalled(lambda: self._explain(crowd.count))

    def _at_mean_distance(self, target_m: Floats) -> Footprints:
        mean = self.group.placement.mean_distance
        assert mean is not None
        candidates = empty_footprints()
        sentence, crowded = "", False
        for pool in self._pools(10 * self.count + 200):
            candidates = joined([candidates, pool])
            if len(candidates) < self.count:
                continue
            distance_m = np.hypot(*(candidates.centre_m - target_m).T)
            low, high = reachable_means_m(distance_m, self.count)
            sentence = (
                f"group {self.group.id!r}: the mean distance of its {self.count} members to {mean.of!r} is to be {mean.mean_m:g} m, "
                f"but the places that keep its other relations allow means from {low:.1f} to {high:.1f} m "
                f"({len(candidates)} places looked at): change mean_m, widen the region or move {mean.of!r}"
            )
            short_m = max(low - mean.mean_m * (1 + mean.tolerance), mean.mean_m * (1 - mean.tolerance) - high)
            if short_m > high - low and len(candidates) > CROWDING_RATIO * self.count:
                # More places would not double the reach; another place of the target may.
                break
            if short_m > 0.0:
                continue
            # Within half the tolerance, so that rounding never decides whether the mean is kept.
            crowd = ChosenMembers.of(self.count, self.group.placement)
            members = members_at_mean(
                candidates, distance_m, crowd, self.count, mean.mean_m, mean.tolerance / 2.0, self.rng
            )
            if members is not None:
                return members
            # Whether the places crowd each other or were drawn thinly is not known, so neither is stated.
            sentence = sentence.replace("but the", "and no choice of members that was tried has it; the")
            if crowded := len(candidates) >= CROWDING_RATIO**2 * self.count:
                break
        raise SamplingStalled(lambda: sentence or self._explain(len(candidates)), crowded=crowded)

    def _pools(self, size: int) -> Iterator[Footprints]:
        """Ever larger pools of places that keep every relation to what is placed."""
        # Pools double: an easy group is done after one small pool, a hard one gets more.
        for turn in range(MAX_POOLS):
            if self.budget.spent or (self.ground is not None and self.ground.area == 0.0):
                return
            wanted = min(size * 2**turn, 4 * POOL_SIZE)
            self.budget.remaining -= wanted
            yield kept_places(self._candidates(wanted, self.ring, self.ground), self.relations)

    def _candidates(self, count: int, ring: _Ring | None, room: Geometry | None = None) -> Footprints:
        if room is not None:
            centre = uniform_places(room, count, self.rng)
        elif ring is None:
            west, south, east, north = self.region.bounds
            centre = self.rng.uniform((west, south), (east, north), (count, 2))
        else:
            centre = ring.draw(self.rng, count)
        # Documents store millimetres: places are rounded before any relation judges them.
        centre = np.round(centre, 3)
        heading_deg = sampled_headings_deg(self.simspec, self.group, centre, self.facing, self.rng)
        return footprints(self.group.definition, centre, heading_deg, self.group.placement.separation_m)

    def _explain(self, count: int) -> str:
        """A sentence with the smallest set of relations that no place of a fresh pool keeps together."""
        pool = self._candidates(POOL_SIZE, None)
        if self.ring is not None:
            pool = joined([pool, self._candidates(POOL_SIZE, self.ring)])
        if self.ground is not None and self.ground.area > 0.0:
            pool = joined([pool, self._candidates(POOL_SIZE, None, self.ground)])
        satisfied = {
            f"{relation.text} ({relation.path})": relation.keeps(pool) for relation in self.relations
        }
        summary = f"group {self.group.id!r}: {count} of {self.count} members found a place"
        for size in range(1, len(satisfied) + 1):
            for subset in itertools.combinations(satisfied, size):
                if not np.logical_and.reduce([satisfied[text] for text in subset]).any():
                    clash = "; ".join(f"{text}, {int(satisfied[text].sum())} places do" for text in subset)
                    return f"{summary}; of {len(pool)} places tried none does all of this: {clash}. Loosen one of these"
        free = int(np.logical_and.reduce(list(satisfied.values())).sum())
        extent_m = self.group.placement.extent_m
        extent_text = f" and no more than {extent_m:g} m from one to another" if extent_m else ""
        return (
            f"{summary}; of {len(pool)} places tried {free} keep the relations ({'; '.join(satisfied)}), but they crowd each other with a "
            f"separation of {self.group.placement.separation_m:g} m{extent_text}: lower the count or the separation, or widen the region"
        )


def gathering_ground(
    simspec: SimSpec, group: ActorGroup, ground: Geometry, extent_m: float, target_m: Floats | None
) -> Geometry:
    """The ground of members that stand no farther apart than an extent, by what some of them must keep.

    Errs to too much: within the extent of each area that must hold a member, and, seen from the target of a mean
    distance, not farther off that mean than the extent.
    """
    where = group.placement
    for part in (named_area(simspec, count.area) for count in where.counts if count.low):
        ground = ground.intersection(grown_at_least(ground.intersection(part), extent_m))
    if where.mean_distance and target_m is not None:
        mean_m, tolerance = where.mean_distance.mean_m, where.mean_distance.tolerance
        low_m, high_m = mean_m * (1.0 - tolerance) - extent_m, mean_m * (1.0 + tolerance) + extent_m
        ground = ground.intersection(band_ground(shapely.Point(target_m), max(low_m, 0.0), high_m))
    return areal_parts(ground)


class _Ring:
    """Rings around the members of another group: where to look when they leave little of the region."""

    def __init__(self, relation: Near, centres_m: Floats) -> None:
        self._inner, self._outer, self._centres = relation.min_m, relation.max_m, centres_m

    @property
    def area_m2(self) -> float:
        return pi * (self._outer**2 - self._inner**2) * len(self._centres)

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """(count, 2) places, uniform over the ring of a member drawn for each."""
        centre = self._centres[rng.integers(len(self._centres), size=count)]
        radius = np.sqrt(rng.uniform(self._inner**2, self._outer**2, count))
        angle = rng.uniform(0.0, 2 * pi, count)
        return np.asarray(centre + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1))
