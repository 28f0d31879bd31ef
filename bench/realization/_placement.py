"""Places for every actor: seeded sampling of oriented footprints under the relations that a SimSpec states.

Distances between actors run from centre to centre, gaps between footprints from edge to edge. Whatever is free also keeps
`HOME_CLEARANCE_M` from the vehicle's home. Places are rounded to the millimetre before they are judged, so the document
holds exactly what was judged. `check_placement` judges again, by other means.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, pi

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import Fault, RebarError, SetupError
from bench.simspec import (
    ASSETS,
    ActorGroup,
    Home,
    Intelligence,
    Near,
    PlacedActor,
    PlacedReport,
    Polygon,
    Realized,
    SimSpec,
    generator,
)

from ._footprint import Array, Footprints, crowded, footprints, joined, no_footprints

HOME_CLEARANCE_M = 3.0
REPORT_SHARE = 0.8
"""Share of an intelligence report's uncertainty within which its error is drawn, so that the true place lies well inside."""

ATTEMPTS = 8
ROUNDS = 5
POOL = 4096
Mask = NDArray[np.bool_]


class PlacementInfeasible(RebarError):
    """No place was found for somebody; the text names the relations that clash and the numbers found."""


def place(simspec: SimSpec) -> SimSpec:
    """The SimSpec with `realized` filled: the same places for the same seeds.

    Raises SetupError where the relations make no sense (unknown asset, groups related in a circle, a region that crosses
    itself) and PlacementInfeasible where they leave no room.
    """
    order = placement_order(simspec)
    _check_room(simspec)
    budget = _Budget(20_000 + 40 * sum(_members(simspec, group) for group in order))
    stuck: _Stuck | None = None
    for attempt in range(ATTEMPTS):
        try:
            placed = _place_all(simspec, order, attempt, budget)
        except _Stuck as reason:
            stuck = reason
            if budget.spent:
                break
            continue
        return simspec.model_copy(update={"realized": _realized(simspec, placed)})
    assert stuck is not None
    raise PlacementInfeasible(stuck.sentence)


def placement_order(simspec: SimSpec) -> list[ActorGroup]:
    """The groups, each after those that it relates to, fixed ones first. Raises SetupError on what cannot be ordered."""
    faults = list(_misfits(simspec))
    waiting = sorted(simspec.actors, key=lambda group: group.placement.at is None)
    ordered: list[ActorGroup] = []
    while waiting and not faults:
        known = {group.id for group in ordered}
        ready = next((group for group in waiting if _related(group) <= known), None)
        if ready is None:
            names = ", ".join(group.id for group in waiting)
            faults.append(Fault("actors", f"the groups {names} relate to each other in a circle", "drop one of the relations"))
        else:
            waiting.remove(ready)
            ordered.append(ready)
    if faults:
        raise SetupError(faults)
    return ordered


def _related(group: ActorGroup) -> set[str]:
    place = group.placement
    return {relation.of for relation in (place.near, place.away, place.mean_distance) if relation}


def _misfits(simspec: SimSpec) -> Iterator[Fault]:
    yield from _crossings("world.area", simspec.world.area)
    for index, group in enumerate(simspec.actors):
        where = f"actors[{index}] ({group.id})"
        if group.asset not in ASSETS:
            yield Fault(f"{where}.asset", f"there is no asset {group.asset!r}", f"the catalogue has {', '.join(ASSETS)}")
        if len(group.id) > 56:
            yield Fault(f"{where}.id", "is too long for its members' ids", "use at most 56 characters")
        if group.placement.region:
            yield from _crossings(f"{where}.placement.region", group.placement.region)
        if _members(simspec, group) and (empty := [one for one in _related(group) if not _members(simspec, simspec.group(one))]):
            yield Fault(
                f"{where}.placement", f"relates to {empty[0]!r}, which has no members", "give it members or drop the relation"
            )
    for index, report in enumerate(simspec.intelligence):
        if not _members(simspec, simspec.group(report.about)):
            yield Fault(f"intelligence[{index}].about", f"group {report.about!r} has no members", "give it at least one")


def _crossings(where: str, polygon: Polygon) -> Iterator[Fault]:
    if not _ground(polygon).is_valid:
        yield Fault(where, "the polygon crosses itself", "give the corners in order around it")


def _ground(polygon: Polygon) -> shapely.Polygon:
    return shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])


def _members(simspec: SimSpec, group: ActorGroup) -> int:
    return group.members(simspec.world.area.area_m2)


def _region(simspec: SimSpec, group: ActorGroup) -> Polygon:
    return group.placement.region or simspec.world.area


def _check_room(simspec: SimSpec) -> None:
    """Refuse at once what no arrangement could hold: footprints grown by half their gap do not overlap, so their areas add up."""
    needs: dict[Polygon, list[ActorGroup]] = {}
    for group in simspec.actors:
        if group.placement.at is None and _members(simspec, group):
            needs.setdefault(_region(simspec, group), []).append(group)
    for region, groups in needs.items():
        gap = min(group.placement.separation_m for group in groups)
        need = sum(_members(simspec, group) * _grown_area_m2(group, gap) for group in groups)
        room = max(region.area_m2, _ground(region).buffer(gap / 2.0).area)  # buffers of almost nothing come out empty
        if need > room:
            names = ", ".join(f"{_members(simspec, group)} of {group.id!r}" for group in groups)
            raise PlacementInfeasible(
                f"{names} need at least {need:.0f} m2 with {gap:g} m between them, but their region of {region.area_m2:.0f} m2 "
                f"offers {room:.0f} m2: lower the counts, lower separation_m or widen the region"
            )
    for group in simspec.actors:
        if group.placement.near:
            _check_room_near(simspec, group, group.placement.near)


def _check_room_near(simspec: SimSpec, group: ActorGroup, near: Near) -> None:
    """The same for whoever must stay near somebody: no footprint reaches further out than its centre's band, half of itself and
    half of its gap."""
    asset, gap = ASSETS[group.asset], group.placement.separation_m
    reach_m = (hypot(asset.length_m, asset.width_m) + gap) / 2.0
    hole_m = max(0.0, near.min_m - reach_m)
    room = _members(simspec, simspec.group(near.of)) * pi * ((near.max_m + reach_m) ** 2 - hole_m**2)
    need = _members(simspec, group) * _grown_area_m2(group, gap)
    if need > room:
        raise PlacementInfeasible(
            f"{_members(simspec, group)} of {group.id!r} need at least {need:.0f} m2 with {gap:g} m between them, but within "
            f"{near.min_m:g} to {near.max_m:g} m of {near.of!r} there are {room:.0f} m2: lower the count or separation_m, or raise max_m"
        )


def _grown_area_m2(group: ActorGroup, gap_m: float) -> float:
    asset = ASSETS[group.asset]
    return asset.length_m * asset.width_m + (asset.length_m + asset.width_m) * gap_m + pi * gap_m**2 / 4.0


class _Stuck(Exception):
    """This attempt found no place for somebody."""

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence)
        self.sentence = sentence


@dataclass(slots=True)
class _Budget:
    """Candidates that may still be looked at, over all attempts: what bounds the time of a hopeless scene."""

    left: int

    @property
    def spent(self) -> bool:
        return self.left <= 0


Placed = dict[str, Footprints]


def _place_all(simspec: SimSpec, order: Sequence[ActorGroup], attempt: int, budget: _Budget) -> Placed:
    placed: Placed = {}
    for group in order:
        if group.placement.at:
            placed[group.id] = _fixed(group, group.placement.at, placed)
        elif not _members(simspec, group):
            placed[group.id] = no_footprints()
        else:
            # A stream for each group by its name: adding a group leaves the draws of the others as they were.
            rng = generator(simspec.seeds, "placement", zlib.crc32(group.id.encode()), attempt)
            placed[group.id] = _Sampler.of(simspec, group, placed, rng, budget).members()
    return placed


def _fixed(group: ActorGroup, at: Home, placed: Placed) -> Footprints:
    centre = np.array([[at.east_m, at.north_m]])
    one = footprints(ASSETS[group.asset], centre, np.array([at.heading_deg]), 0.0)
    for other, footprint in placed.items():
        # Two fixed actors stand where their author put them; they only must not overlap.
        if crowded(one, replace(footprint, gap_m=np.zeros(len(footprint)))).any():
            raise PlacementInfeasible(f"groups {other!r} and {group.id!r} are fixed at places where their footprints overlap")
    return replace(one, gap_m=np.full(1, group.placement.separation_m))


@dataclass(frozen=True, slots=True)
class _Relation:
    """One thing that a place must keep, and the words for it."""

    text: str
    keeps: Callable[[Footprints], Mask]


@dataclass(frozen=True, slots=True)
class _Sampler:
    """Finds the members of one group among what already stands."""

    group: ActorGroup
    count: int
    region: shapely.Polygon
    relations: tuple[_Relation, ...]
    ring: _Ring | None
    target_m: Array | None
    rng: np.random.Generator
    budget: _Budget

    @classmethod
    def of(cls, simspec: SimSpec, group: ActorGroup, placed: Placed, rng: np.random.Generator, budget: _Budget) -> _Sampler:
        region = _ground(_region(simspec, group))
        shapely.prepare(region)
        obstacles = joined([_home(simspec), *placed.values()])
        where = group.placement
        relations = [_inside(region)]
        relations += [_near(where.near, placed[where.near.of])] if where.near else []
        relations += [_away(where.away, placed[where.away.of])] if where.away else []
        relations += [_Relation(_clear_text(group, obstacles), lambda some: ~crowded(some, obstacles))]
        mean = where.mean_distance
        target = placed[mean.of].centre_m[0] if mean else None
        rings = [_Ring(relation, placed[relation.of].centre_m) for relation in (where.near, where.away) if relation]
        ring = min(rings, key=lambda one: one.area_m2, default=None)
        if ring and ring.area_m2 > _box_area_m2(region):
            ring = None
        return cls(group, _members(simspec, group), region, tuple(relations), ring, target, rng, budget)

    def members(self) -> Footprints:
        """The group's members. Raises _Stuck."""
        return self._anywhere() if self.target_m is None else self._at_mean_distance(self.target_m)

    def _anywhere(self) -> Footprints:
        crowd = _Crowd.of(self.count)
        for pool in self._pools(4 * self.count + 60):
            if crowd.admit(pool, np.arange(len(pool)), self.count):
                return crowd.members()
        raise _Stuck(self._explain(crowd.count))

    def _at_mean_distance(self, target_m: Array) -> Footprints:
        mean = self.group.placement.mean_distance
        assert mean is not None
        found = no_footprints()
        sentence = ""
        for pool in self._pools(10 * self.count + 200):
            found = joined([found, pool])
            if len(found) < self.count:
                continue
            distance_m = np.hypot(*(found.centre_m - target_m).T)
            low, high = _reachable(distance_m, self.count)
            sentence = (
                f"group {self.group.id!r}: the mean distance of its {self.count} members to {mean.of!r} is to be {mean.mean_m:g} m, "
                f"but the places that keep its other relations allow means from {low:.1f} to {high:.1f} m "
                f"({len(found)} places looked at): change mean_m, widen the region or move {mean.of!r}"
            )
            if not low <= mean.mean_m * (1 + mean.tolerance) or not high >= mean.mean_m * (1 - mean.tolerance):
                continue
            # Halfway into the tolerance, so that nobody's rounding decides whether it is kept.
            choice = _MeanChoice(found, distance_m, self.count, mean.mean_m, mean.tolerance / 2.0, self.rng)
            members = choice.members()
            if members is not None:
                return members
            sentence = sentence.replace("but the", "which crowding prevents; the")
        raise _Stuck(sentence or self._explain(len(found)))

    def _pools(self, size: int) -> Iterator[Footprints]:
        """Ever larger pools of places that keep every relation to what already stands."""
        for turn in range(ROUNDS):
            if self.budget.spent:
                return
            wanted = min(size * 2**turn, 4 * POOL)
            self.budget.left -= wanted
            candidates = self._candidates(wanted, self.ring)
            for relation in self.relations:
                candidates = candidates[relation.keeps(candidates)]
            yield candidates

    def _candidates(self, count: int, ring: _Ring | None) -> Footprints:
        if ring is None:
            west, south, east, north = self.region.bounds
            centre = self.rng.uniform((west, south), (east, north), (count, 2))
        else:
            centre = ring.draw(self.rng, count)
        heading_deg = np.round(self.rng.uniform(0.0, 360.0, count), 1) % 360.0
        return footprints(ASSETS[self.group.asset], np.round(centre, 3), heading_deg, self.group.placement.separation_m)

    def _explain(self, found: int) -> str:
        """The smallest set of relations that no place of a fresh pool keeps together."""
        pool = self._candidates(POOL, None)
        if self.ring is not None:
            pool = joined([pool, self._candidates(POOL, self.ring)])
        kept = {relation.text: relation.keeps(pool) for relation in self.relations}
        who = f"group {self.group.id!r}: {found} of {self.count} members found a place"
        for size in range(1, len(kept) + 1):
            for some in itertools.combinations(kept, size):
                if not np.logical_and.reduce([kept[text] for text in some]).any():
                    clash = "; ".join(f"{text} ({int(kept[text].sum())} places do)" for text in some)
                    return f"{who}; of {len(pool)} places tried none does all of this: {clash}. Loosen one of these"
        free = int(np.logical_and.reduce(list(kept.values())).sum())
        return (
            f"{who}; of {len(pool)} places tried {free} keep the relations ({'; '.join(kept)}), but they crowd each other with a "
            f"separation of {self.group.placement.separation_m:g} m: lower the count or the separation, or widen the region"
        )


def _box_area_m2(region: shapely.Polygon) -> float:
    west, south, east, north = region.bounds
    return float((east - west) * (north - south))


def _home(simspec: SimSpec) -> Footprints:
    home = simspec.vehicle.home
    return Footprints(np.array([[home.east_m, home.north_m]]), np.zeros(1), np.zeros((1, 2)), np.full(1, HOME_CLEARANCE_M))


def _inside(region: shapely.Polygon) -> _Relation:
    convex = region.equals(region.convex_hull)

    def keeps(some: Footprints) -> Mask:
        corners = some.corners()
        inside: Mask = shapely.contains_xy(region, corners[..., 0], corners[..., 1]).all(axis=1)
        if not convex:  # corners alone may reach across a bay
            inside[inside] = shapely.contains(region, shapely.polygons(corners[inside]))
        return inside

    return _Relation(f"stand inside its region of {region.area:.0f} m2", keeps)


def _distances_m(some: Footprints, others: Footprints) -> Array:
    offset = some.centre_m[:, None, :] - others.centre_m[None, :, :]
    return np.hypot(offset[..., 0], offset[..., 1])


def _near(near: Near, others: Footprints) -> _Relation:
    def keeps(some: Footprints) -> Mask:
        distance = _distances_m(some, others)
        kept: Mask = np.any((distance >= near.min_m) & (distance <= near.max_m), axis=1)
        return kept

    return _Relation(f"stand {near.min_m:g} to {near.max_m:g} m from some member of {near.of!r}", keeps)


def _away(away: Near, others: Footprints) -> _Relation:
    def keeps(some: Footprints) -> Mask:
        distance = _distances_m(some, others)
        kept: Mask = np.all((distance >= away.min_m) & (distance <= away.max_m), axis=1)
        return kept

    return _Relation(f"stand {away.min_m:g} to {away.max_m:g} m from every member of {away.of!r}", keeps)


def _clear_text(group: ActorGroup, obstacles: Footprints) -> str:
    return (
        f"keep {group.placement.separation_m:g} m clear of the {len(obstacles) - 1} actors already placed, "
        f"and {HOME_CLEARANCE_M:g} m of the vehicle's home"
    )


class _Ring:
    """The rings around the members of another group: where to look when a relation leaves little of the region."""

    def __init__(self, relation: Near, centres_m: Array) -> None:
        self._inner, self._outer, self._centres = relation.min_m, relation.max_m, centres_m

    @property
    def area_m2(self) -> float:
        return pi * (self._outer**2 - self._inner**2) * len(self._centres)

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """(count, 2) places, uniform over the ring of a member drawn for each."""
        centre = self._centres[rng.integers(len(self._centres), size=count)]
        radius = np.sqrt(rng.uniform(self._inner**2, self._outer**2, count))
        angle = rng.uniform(0.0, 2 * pi, count)
        places: Array = centre + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        return places


class _Crowd:
    """The members found so far, who keep their distance from each other."""

    def __init__(self, room: Footprints) -> None:
        self._room = room
        self.count = 0

    @classmethod
    def of(cls, size: int) -> _Crowd:
        return cls(Footprints(np.zeros((size, 2)), np.zeros(size), np.zeros((size, 2)), np.zeros(size)))

    def members(self) -> Footprints:
        return self._room[np.arange(self.count)]

    def fits(self, one: Footprints, but: int | None = None) -> bool:
        """Whether a single footprint keeps clear of all members, of all but one where it is to take that one's place."""
        room = self._room
        offset = room.centre_m[: self.count] - one.centre_m[0]
        reach = np.hypot(room.half_m[: self.count, 0], room.half_m[: self.count, 1]) + one.radius_m[0]
        reach = reach + np.maximum(room.gap_m[: self.count], one.gap_m[0])
        close = np.nonzero(offset[:, 0] ** 2 + offset[:, 1] ** 2 < reach * reach)[0]
        if but is not None:
            close = close[close != but]
        return len(close) == 0 or not bool(crowded(one, room[close])[0])

    def put(self, index: int, one: Footprints) -> None:
        room = self._room
        room.centre_m[index], room.heading_rad[index] = one.centre_m[0], one.heading_rad[0]
        room.half_m[index], room.gap_m[index] = one.half_m[0], one.gap_m[0]

    def admit(self, pool: Footprints, order: NDArray[np.intp], until: int) -> list[int]:
        """Admit from the pool in that order whoever fits; the pool's indices admitted, empty while fewer than `until` stand."""
        admitted: list[int] = []
        for index in order:
            if self.count == until:
                break
            one = pool[np.array([index])]
            if self.fits(one):
                self.put(self.count, one)
                self.count += 1
                admitted.append(int(index))
        return admitted if self.count == until else []


def _reachable(distance_m: Array, count: int) -> tuple[float, float]:
    """Least and greatest mean distance of `count` places out of those."""
    ordered = np.sort(distance_m)
    return float(ordered[:count].mean()), float(ordered[-count:].mean())


class _MeanChoice:
    """Members out of a pool of places whose mean distance comes out as wanted.

    Places are drawn with weights exp(lambda * distance), lambda such that the weighted mean is the wanted one (the least
    change of the uniform distribution that has this mean); what is left of the error goes by exchanging members.
    """

    def __init__(
        self, pool: Footprints, distance_m: Array, count: int, mean_m: float, tolerance: float, rng: np.random.Generator
    ) -> None:
        self._pool, self._distance_m, self._count = pool, distance_m, count
        self._mean_m, self._tolerance, self._rng = mean_m, tolerance, rng

    def members(self) -> Footprints | None:
        """The members, None when crowding keeps the mean from being reached."""
        crowd = _Crowd.of(self._count)
        chosen = crowd.admit(self._pool, self._lots(), self._count)
        return crowd.members() if chosen and self._exchange(crowd, chosen) else None

    def _lots(self) -> NDArray[np.intp]:
        """All indices in the order of a weighted draw without replacement (Efraimidis and Spirakis 2006)."""
        weight = _tilted(self._distance_m, self._mean_m)
        return np.argsort(self._rng.exponential(size=len(weight)) / np.maximum(weight, 1e-300), kind="stable")

    def _exchange(self, crowd: _Crowd, chosen: list[int]) -> bool:
        distance = self._distance_m
        by_distance = np.argsort(distance, kind="stable")
        ordered = distance[by_distance]
        stride = (ordered[-1] - ordered[0]) / 4.0
        taken = set(chosen)
        for _ in range(60 + 12 * self._count):
            short = self._mean_m * self._count - float(distance[chosen].sum())
            if abs(short) <= self._tolerance * self._mean_m * self._count:
                return True
            member = int(self._rng.integers(self._count))
            wanted = distance[chosen[member]] + np.clip(short, -stride, stride)
            if not ordered[0] <= wanted <= ordered[-1]:
                # The last steps of an extreme mean: move this member by as much as there is.
                wanted = np.clip(wanted, ordered[0], ordered[-1])
            start = int(np.searchsorted(ordered, wanted))
            for index in by_distance[max(start - 3, 0) : start + 3]:
                closer = abs(short - (distance[index] - distance[chosen[member]])) < abs(short)
                if closer and int(index) not in taken and crowd.fits(self._pool[np.array([index])], but=member):
                    taken.symmetric_difference_update({chosen[member], int(index)})
                    crowd.put(member, self._pool[np.array([index])])
                    chosen[member] = int(index)
                    break
        return False


def _tilted(distance_m: Array, mean_m: float) -> Array:
    """Weights exp(lambda * distance) with the wanted weighted mean; lambda by bisection, held where the mean is out of reach."""
    centred = distance_m - distance_m.mean()
    low, high = -0.5, 0.5
    for _ in range(40):
        middle = (low + high) / 2.0
        weight = _exponential(middle * centred)
        if float((weight * distance_m).sum() / weight.sum()) < mean_m:
            low = middle
        else:
            high = middle
    return _exponential(low * centred)


def _exponential(power: Array) -> Array:
    weight: Array = np.exp(power - power.max())
    return weight


def _realized(simspec: SimSpec, placed: Mapping[str, Footprints]) -> Realized:
    actors = [
        PlacedActor(
            id=f"{group.id}-{number}",
            group=group.id,
            east_m=float(centre[0]),
            north_m=float(centre[1]),
            heading_deg=round(float(np.degrees(heading)), 6) % 360.0,
        )
        for group in simspec.actors
        for number, (centre, heading) in enumerate(
            zip(placed[group.id].centre_m, placed[group.id].heading_rad, strict=True), start=1
        )
    ]
    return Realized(actors=tuple(actors), reports=_reports(simspec, placed))


def _reports(simspec: SimSpec, placed: Mapping[str, Footprints]) -> tuple[PlacedReport, ...]:
    area = _ground(simspec.world.area)
    shapely.prepare(area)
    return tuple(
        _report(report, placed[report.about].centre_m[0], area, generator(simspec.seeds, "intelligence", index))
        for index, report in enumerate(simspec.intelligence)
    )


def _report(report: Intelligence, truth_m: Array, area: shapely.Polygon, rng: np.random.Generator) -> PlacedReport:
    """Uniform over the disc of error round the truth; over the part of it inside the area where there is one."""
    radius = REPORT_SHARE * report.uncertainty_m * np.sqrt(rng.uniform(size=64))
    angle = rng.uniform(0.0, 2 * pi, 64)
    places = np.round(truth_m + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1), 3)
    inside = np.nonzero(shapely.contains_xy(area, places[:, 0], places[:, 1]))[0]
    east, north = places[inside[0] if len(inside) else 0]
    return PlacedReport(id=report.id, east_m=float(east), north_m=float(north))
