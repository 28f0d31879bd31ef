"""Relations of places to other groups and points: inside, distance, bearing, facing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot

import numpy as np
import shapely

from bench.arrays import Bools, Floats
from bench.simspec import ActorGroup, Avoid, Distance, Near, SimSpec

from .._footprint import Footprints, are_inside, too_close_pairs
from .._geometry import Geometry, grown_at_least
from .._groups import centre_ground, inner_radius_m
from .._targets import RelationTarget
from ._distance_bands import band_ground
from ._line_of_sight import Solids, sight_relations, unbounded
from ._relation import GroupRelation, Quantifier, field_path

SOME: Quantifier = "some"
EVERY: Quantifier = "every"


def group_relations(simspec: SimSpec, group: ActorGroup, solids: Solids | None = None) -> list[GroupRelation]:
    """The group's relations to other groups and points; sight only when the solids are given."""
    place = group.placement
    relations = []
    if place.inside and place.inside.of:
        relations.append(_inside_of(group, simspec.group(place.inside.of)))
    for name, relation, whom in (("near", place.near, SOME), ("away", place.away, EVERY)):
        if relation:
            target = RelationTarget.named(simspec, relation.of)
            relations.append(_distance(field_path(group, name), target, whom, relation))
    clear = (
        _keeping_clear(simspec, group, number, avoid) for number, avoid in enumerate(place.avoid) if avoid.of
    )
    relations += [relation for relation in clear if relation is not None]
    for number, distance in enumerate(place.distances):
        target = RelationTarget.of_distance(simspec, group, distance)
        if target.of or target.points is not None or distance.whom == SOME:
            path = field_path(group, f"distances[{number}]")
            relations.append(_distance(path, target, distance.whom, distance))
    if place.bearing:
        target = RelationTarget.referenced(simspec, place.bearing)
        sector = f"{place.bearing.from_deg:g} to {place.bearing.to_deg:g} degrees"
        low, high = place.bearing.from_deg, place.bearing.to_deg
        relations.append(
            _bearing(field_path(group, "bearing"), f"stand at {sector} from {target.name}", target, low, high)
        )
    if place.facing and place.facing.heading_deg is None:
        target = RelationTarget.referenced(simspec, place.facing)
        text = f"head towards {target.name} within {place.facing.within_deg:g} degrees"
        relations.append(_facing(field_path(group, "facing"), text, target, place.facing.within_deg))
    if solids is not None:
        relations += sight_relations(simspec, group, solids)
    return relations


def _keeping_clear(simspec: SimSpec, group: ActorGroup, number: int, avoid: Avoid) -> GroupRelation | None:
    """A gap from every member of other groups, edge to edge; None where they have no members."""
    assert avoid.of is not None
    target, gap_m = RelationTarget.group_or_role(simspec, group, avoid.of), avoid.at_least_m
    if not target.of and target.points is None:
        return None
    # Circles inside two footprints keep the gap of these.
    others_m = min((inner_radius_m(simspec.group(name)) for name in target.of), default=0.0)
    apart_m = gap_m + inner_radius_m(group) + others_m

    def pairs(candidates: Footprints, others: Footprints) -> Bools:
        valid = np.ones((len(candidates), len(others)), dtype=np.bool_)
        wanted = replace(candidates, gap_m=np.full(len(candidates), gap_m))
        valid[too_close_pairs(wanted, replace(others, gap_m=np.zeros(len(others))))] = False
        return valid

    def room(others: Geometry) -> Geometry | None:
        return band_ground(others, apart_m, None)

    text = f"keep {gap_m:g} m clear of {target.described('every')}"
    path = field_path(group, f"avoid[{number}]")
    # Footprints may touch circles inside them up to rounding.
    band_m = (apart_m - 1e-6, np.inf)
    return GroupRelation(path, text, target.of, "every", pairs, room, room, target.points, band_m=band_m)


def _inside_of(group: ActorGroup, host: ActorGroup) -> GroupRelation:
    asset, inner_m = host.definition, inner_radius_m(group)
    # Any heading: the guest's inner circle stays in the host, so centres are at most this far apart.
    reach_m = hypot(max(asset.length_m / 2.0 - inner_m, 0.0), max(asset.width_m / 2.0 - inner_m, 0.0))

    def pairs(candidates: Footprints, others: Footprints) -> Bools:
        inside = distances_m(candidates, others) <= reach_m + 1e-6
        rows, host_rows = np.nonzero(inside)
        inside[rows, host_rows] = are_inside(candidates[rows], others[host_rows])
        return inside

    def among(others: Footprints) -> Geometry:
        return shapely.union_all(
            [centre_ground(outline, group) for outline in shapely.polygons(others.corners())]
        )

    def room(others: Geometry) -> Geometry:
        return grown_at_least(others, reach_m)

    return GroupRelation(
        field_path(group, "inside"),
        f"stand inside a member of {host.id!r}",
        (host.id,),
        "some",
        pairs,
        room,
        room,
        ground_among=among,
    )


def distances_m(candidates: Footprints, others: Footprints) -> Floats:
    """(k, m) distances from centre to centre."""
    offset = candidates.centre_m[:, None, :] - others.centre_m[None, :, :]
    return np.hypot(offset[..., 0], offset[..., 1])


def _distance(
    path: str, target: RelationTarget, quantifier: Quantifier, band: Near | Distance
) -> GroupRelation:
    low_m, high_m = band.min_m, band.max_m
    most_m = np.inf if high_m is None else high_m
    span = f"at least {low_m:g} m" if high_m is None else f"{low_m:g} to {high_m:g} m"
    text = f"stand {span} from {target.described(quantifier)}"

    def pairs(candidates: Footprints, others: Footprints) -> Bools:
        distance = distances_m(candidates, others)
        return np.asarray((distance >= low_m) & (distance <= most_m))

    def room(others: Geometry) -> Geometry | None:
        return band_ground(others, low_m, high_m)

    band_m = (low_m, most_m)
    return GroupRelation(path, text, target.of, quantifier, pairs, room, room, target.points, band_m=band_m)


def bearings_deg(candidates: Footprints, others: Footprints) -> Floats:
    """(k, m) bearings of the places, clockwise from north, seen from the others."""
    offset = candidates.centre_m[:, None, :] - others.centre_m[None, :, :]
    return np.asarray(np.degrees(np.arctan2(offset[..., 0], offset[..., 1])) % 360.0, dtype=np.float64)


def _bearing(path: str, text: str, target: RelationTarget, from_deg: float, to_deg: float) -> GroupRelation:
    span = (to_deg - from_deg) % 360.0

    def pairs(candidates: Footprints, others: Footprints) -> Bools:
        return np.asarray((bearings_deg(candidates, others) - from_deg) % 360.0 <= span)

    there, back = _Sector(from_deg, span), _Sector((from_deg + 180.0) % 360.0, span)
    return GroupRelation(path, text, target.of, "first", pairs, there, back, target.points)


@dataclass(frozen=True, slots=True)
class _Sector:
    """All ground in a sector seen from anywhere in the given ground, beyond any coordinates."""

    from_deg: float
    span_deg: float

    def __call__(self, others: Geometry) -> Geometry | None:
        # Each narrow enough for its sum with a hull to be convex.
        pieces = 1 + int(self.span_deg // 90.0)
        corners = shapely.get_coordinates(shapely.convex_hull(others))
        return shapely.union_all([self._piece(corners, number, pieces) for number in range(pieces)])

    def _piece(self, corners: Floats, number: int, pieces: int) -> Geometry:
        share = self.span_deg / pieces
        # A hair wider than the sector, because sines are rounded.
        arc = np.radians(
            np.linspace(self.from_deg + number * share - 1e-7, self.from_deg + (number + 1) * share + 1e-7, 3)
        )
        # Twice the half side of EVERYWHERE, so that every sector reaches beyond it.
        rim = 6e5 * np.stack([np.sin(arc), np.cos(arc)], axis=-1)
        swept = np.concatenate([corners, (corners[:, None, :] + rim[None]).reshape(-1, 2)])
        return shapely.convex_hull(shapely.MultiPoint(swept))


def _facing(path: str, text: str, target: RelationTarget, within_deg: float) -> GroupRelation:
    def pairs(candidates: Footprints, others: Footprints) -> Bools:
        towards = (bearings_deg(candidates, others) + 180.0) % 360.0
        off = np.abs((np.degrees(candidates.heading_rad)[:, None] - towards + 180.0) % 360.0 - 180.0)
        return np.asarray(off <= within_deg + 1e-9)

    return GroupRelation(path, text, target.of, "first", pairs, unbounded, unbounded, target.points)
