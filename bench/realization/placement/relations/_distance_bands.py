"""The ground on which a distance from others is kept."""

from __future__ import annotations

from collections.abc import Mapping

import shapely

from bench.simspec import ActorGroup, SimSpec

from .._footprint import Footprints
from .._geometry import EVERYWHERE, QUARTER_SEGMENTS, Geometry, bounding_octagon, grown_at_least
from .._groups import member_count
from .._targets import target_footprints


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
