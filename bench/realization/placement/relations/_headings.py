"""Headings of members: drawn for places, and, as arcs of the compass, whether two can both be kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from bench.arrays import Floats
from bench.simspec import ActorGroup, SimSpec

from .._footprint import Footprints
from .._geometry import Geometry, grown_at_least, hull_ways, road_heading_deg
from .._targets import point_footprint, target_footprints
from ._relation import field_path


def sampled_headings_deg(
    simspec: SimSpec,
    group: ActorGroup,
    places_m: Floats,
    targets: Footprints | None,
    rng: np.random.Generator,
) -> Floats:
    """(n,) headings drawn for (n, 2) places: within the group's heading relations, else uniform."""
    along, facing = group.placement.along, group.placement.facing
    count = len(places_m)
    aimed: Floats
    if facing and facing.heading_deg is not None:
        aimed, within_deg = np.full(count, facing.heading_deg), facing.within_deg
    elif facing and targets is not None:
        offset = targets.centre_m[0] - places_m
        aimed, within_deg = np.degrees(np.arctan2(offset[:, 0], offset[:, 1])), facing.within_deg
    elif along and along.parallel_deg is not None:
        # Along a road either direction counts, so half of the members are turned around.
        stretch = road_heading_deg(simspec.world.road(along.road), places_m)
        aimed, within_deg = stretch + 180.0 * rng.integers(2, size=count), along.parallel_deg
    else:
        return np.round(rng.uniform(0.0, 360.0, count), 1) % 360.0
    # Slightly inside the tolerance, so that rounding to the millidegree stays within it.
    limit = 0.999 * within_deg
    return np.asarray(np.round(aimed + rng.uniform(-limit, limit, count), 3) % 360.0)


def facing_target(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> Footprints | None:
    """The footprints that members face; None without `facing`, or with `facing.heading_deg`."""
    facing = group.placement.facing
    if facing is None or facing.heading_deg is not None:
        return None
    if facing.of is not None:
        return target_footprints(simspec, facing.of, placed)
    assert facing.point is not None
    return point_footprint(facing.point)


_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class RequiredHeading:
    """A required heading, within some degrees: one of these courses (either way), or towards a target.

    `lines` are the stretches of the road, one for each course. Off roads there is one course, or none when
    members face a target: the group `of` or the place `point`.
    """

    path: str
    text: str
    within_deg: float
    courses_deg: tuple[float, ...] = ()
    lines: tuple[Geometry, ...] = ()
    of: str | None = None
    point: Geometry | None = None

    @property
    def common(self) -> tuple[float, float] | None:
        """One course, and within how many degrees of it or its opposite all head; None for a target."""
        if not self.courses_deg:
            return None
        first = self.courses_deg[0]
        return first, self.within_deg + max(_slant_deg(first, other) for other in self.courses_deg)

    def arc(self, ground: Geometry, theirs: Geometry) -> tuple[float, float] | None:
        """The middle and the half width of all courses from some place to another; None for any course."""
        if self.courses_deg:
            return self.courses_deg[0], 0.0
        ways = hull_ways(ground, theirs)
        hull = shapely.convex_hull(shapely.multipoints(ways))
        # The grounds touch or overlap, so the target may be in any direction.
        if shapely.distance(hull, shapely.Point(0.0, 0.0)) < _TOLERANCE:
            return None
        middle = float(np.degrees(np.arctan2(hull.centroid.x, hull.centroid.y)))
        off = (np.degrees(np.arctan2(ways[:, 0], ways[:, 1])) - middle + 180.0) % 360.0 - 180.0
        return middle + float(off.max() + off.min()) / 2.0, float(off.max() - off.min()) / 2.0


def _slant_deg(one_deg: float, other_deg: float) -> float:
    """The turn between two lines without direction."""
    # Modulo 180 degrees, because a line has no direction.
    return abs((one_deg - other_deg + 90.0) % 180.0 - 90.0)


def road_heading(simspec: SimSpec, group: ActorGroup) -> RequiredHeading | None:
    """The heading along a road, if one is required."""
    along = group.placement.along
    if along is None or along.parallel_deg is None:
        return None
    road = simspec.world.road(along.road)
    points = np.array([(point.east_m, point.north_m) for point in road.points])
    step = np.diff(points, axis=0)
    courses = np.degrees(np.arctan2(step[:, 0], step[:, 1])).tolist()
    lines = tuple(shapely.LineString(pair) for pair in pairwise(points))
    text = f"head along road {road.id!r} within {along.parallel_deg:g} degrees"
    return RequiredHeading(
        field_path(group, "along.parallel_deg"), text, along.parallel_deg, tuple(courses), lines
    )


def facing_heading(group: ActorGroup) -> RequiredHeading | None:
    """The heading of `facing`: to a group, a point, or along a course."""
    facing = group.placement.facing
    if facing is None:
        return None
    courses_deg: tuple[float, ...] = ()
    point = None
    if facing.heading_deg is not None:
        courses_deg, what = (facing.heading_deg,), f"{facing.heading_deg:g} degrees"
    elif facing.point is not None:
        point = shapely.Point(facing.point.east_m, facing.point.north_m)
        what = f"towards the point {facing.point.east_m:g} east, {facing.point.north_m:g} north"
    else:
        what = f"towards {facing.of!r}"
    text = f"head {what} within {facing.within_deg:g} degrees"
    path = field_path(group, "facing")
    return RequiredHeading(path, text, facing.within_deg, courses_deg, of=facing.of, point=point)


def headings_conflict(
    parallel: RequiredHeading,
    facing: RequiredHeading,
    ground: Geometry,
    theirs: Geometry,
    reach_m: float | None,
) -> bool:
    """Whether no heading on the ground follows the road and faces the target.

    `theirs` is the ground of the target; `reach_m` how far from its stretch of the road a member can be, None
    if unbounded.
    """
    for course, line in zip(parallel.courses_deg, parallel.lines, strict=True):
        cell = ground if reach_m is None else shapely.intersection(ground, grown_at_least(line, reach_m))
        if cell.is_empty:
            continue
        arc = facing.arc(cell, theirs)
        if (
            arc is None
            or _slant_deg(arc[0], course) <= arc[1] + facing.within_deg + parallel.within_deg + _TOLERANCE
        ):
            return False
    return True
