"""Distances to keep from others, as bands: which ground keeps them, and whether two exclude each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Literal

import shapely

from bench.simspec import HOME, ActorGroup, SimSpec

from .._footprint import Footprints
from .._geometry import EVERYWHERE, QUARTER_SEGMENTS, Geometry, bounding_octagon, grown_at_least
from .._groups import inner_radius_m, is_home, member_count
from .._targets import target_footprints
from ._relation import field_path


@dataclass(frozen=True, slots=True)
class DistanceBand:
    """Distances to some or every member of a group, or in the mean to its first member."""

    of: str
    quantifier: Literal["some", "every", "mean"]
    low_m: float
    high_m: float

    def excludes(self, other: DistanceBand) -> bool:
        """Whether no place satisfies both.

        Bands that may refer to different members never exclude each other.
        """
        # `some` and `mean` may be kept by other members than those of the other band.
        if self.of != other.of or "every" not in (self.quantifier, other.quantifier):
            return False
        return max(self.low_m, other.low_m) > min(self.high_m, other.high_m)


def distance_bands(simspec: SimSpec, group: ActorGroup) -> dict[str, DistanceBand]:
    """The bands around groups and the vehicle's home by field path, without those around roles and points."""
    place = group.placement
    bands: dict[str, DistanceBand] = {}
    if place.near:
        bands[field_path(group, "near")] = DistanceBand(
            place.near.of, "some", place.near.min_m, place.near.max_m
        )
    if place.away:
        bands[field_path(group, "away")] = DistanceBand(
            place.away.of, "every", place.away.min_m, place.away.max_m
        )
    for number, distance in enumerate(place.distances):
        if distance.of is not None and distance.of in {HOME, *(other.id for other in simspec.actors)}:
            most_m = inf if distance.max_m is None else distance.max_m
            bands[field_path(group, f"distances[{number}]")] = DistanceBand(
                distance.of, distance.whom, distance.min_m, most_m
            )
    for number, avoid in enumerate(place.avoid):
        if avoid.of in {HOME, *(other.id for other in simspec.actors)}:
            home = is_home(simspec, avoid.of)
            other_m = 0.0 if home else inner_radius_m(simspec.group(avoid.of))
            least_m = avoid.at_least_m + inner_radius_m(group) + other_m
            # Footprints may touch circles inside them up to rounding.
            bands[field_path(group, f"avoid[{number}]")] = DistanceBand(
                avoid.of, "every", least_m - 1e-6, inf
            )
    if mean := place.mean_distance:
        # Positions are rounded to the millimetre.
        slack_m = mean.tolerance * mean.mean_m + 1e-3
        bands[field_path(group, "mean_distance")] = DistanceBand(
            mean.of, "mean", mean.mean_m - slack_m, mean.mean_m + slack_m
        )
    return bands


def band_ground(others: Geometry, min_m: float, max_m: float | None) -> Geometry | None:
    """Ground within `max_m` of some place, and not closer than `min_m` to all; None when unrestricted."""
    if max_m is None and min_m <= 0.0:
        return None
    # At least: ground may be too large, never too small (`_relation`).
    reach = grown_at_least(others, max_m) if max_m is not None else None
    if min_m > 0.0:
        corners = shapely.get_coordinates(bounding_octagon(others))
        # Centres too close to all of the place: within the distance of each corner of an octagon around it.
        too_near = shapely.intersection_all(
            shapely.buffer(shapely.points(corners), max(min_m - 1e-6, 0.0), quad_segs=QUARTER_SEGMENTS)
        )
        reach = (EVERYWHERE if reach is None else reach).difference(too_near)
    return reach


def lone_member_ground(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> Geometry:
    """The ground on which a lone member keeps the mean distance; everywhere for several members."""
    mean = group.placement.mean_distance
    if mean is None or member_count(simspec, group) != 1:
        return EVERYWHERE
    slack_m = mean.tolerance * mean.mean_m / 2.0
    target = shapely.Point(target_footprints(simspec, mean.of, placed).centre_m[0])
    return band_ground(target, mean.mean_m - slack_m, mean.mean_m + slack_m)
