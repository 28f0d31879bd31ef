"""Which way members head."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bench.arrays import Floats
from bench.simspec import ActorGroup, SimSpec

from ._footprint import Footprints
from ._ground import road_heading_deg
from ._whom import point_of, spots_of


def aimed_deg(
    simspec: SimSpec, group: ActorGroup, places_m: Floats, targets: Footprints | None, rng: np.random.Generator
) -> Floats:
    """(n,) headings that keep the group's relations of heading at (n, 2) places, as far as one draw can."""
    along, facing = group.placement.along, group.placement.facing
    count = len(places_m)
    if facing and facing.heading_deg is not None:
        limit = 0.999 * facing.within_deg
        fixed: Floats = np.round(facing.heading_deg + rng.uniform(-limit, limit, count), 3) % 360.0
        return fixed
    if facing and targets is not None:
        offset = targets.centre_m[0] - places_m
        towards = np.degrees(np.arctan2(offset[:, 0], offset[:, 1]))
        limit = 0.999 * facing.within_deg
        turned: Floats = np.round(towards + rng.uniform(-limit, limit, count), 3) % 360.0
        return turned
    if along and along.parallel_deg is not None:
        road = next(one for one in simspec.world.roads if one.id == along.road)
        limit = 0.999 * along.parallel_deg
        stretch = road_heading_deg(road, places_m) + 180.0 * rng.integers(2, size=count)
        aimed: Floats = np.round(stretch + rng.uniform(-limit, limit, count), 3) % 360.0
        return aimed
    return np.round(rng.uniform(0.0, 360.0, count), 1) % 360.0


def facing_target(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> Footprints | None:
    """What the group's members are to head towards; None where nothing or where the compass says it."""
    facing = group.placement.facing
    if facing is None or facing.heading_deg is not None:
        return None
    if facing.of is not None:
        return spots_of(simspec, facing.of, placed)
    assert facing.point is not None
    return point_of(facing.point)
