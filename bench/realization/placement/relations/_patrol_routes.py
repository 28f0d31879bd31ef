"""Patrol routes: the straight ways from places to routes, and round the routes.

A patrol walks straight legs, begins with the nearest point of its route that it can walk to, and skips points
that it cannot. Placement promises more than that: some point of the route can be walked to from every
walker's place, and every leg of the route is open. A leg is blocked by solid actors that stand still, grown
along and across by half the walker's width, and by the area's border for walkers that start inside it; route
points beyond the border are then moved half a metre inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import shapely

from bench.arrays import Bools, Floats
from bench.errors import Fault, PlacementInfeasible
from bench.simspec import ActorGroup, SimSpec

from .._footprint import Footprints, joined
from .._geometry import EVERYWHERE, Geometry, polygon_ground
from .._groups import member_count, region_of, smallest_failing
from ._relation import Relation, field_path

# How far inside the border a route point beyond it is moved; the simulation does the same.
BORDER_INSET_M = 0.5

# Extra width over what the simulation needs, so that rounding on either side blocks no way.
ROUNDING_MARGIN_M = 1e-6

# Beyond EVERYWHERE, so that a wall's shadow ends outside any ground.
_SHADOW_M = 1e6


def patrols(simspec: SimSpec, group: ActorGroup) -> bool:
    """Whether the group has members that patrol."""
    return group.motion.kind == "patrol" and member_count(simspec, group) > 0


def is_obstacle(group: ActorGroup) -> bool:
    """Whether members of the group block ways: solid and standing still."""
    return group.definition.solid and group.motion.kind == "still"


def half_width_m(walker: ActorGroup) -> float:
    """Half the walker's width: the free room that it needs on either side."""
    return walker.definition.width_m / 2.0


def route_points(simspec: SimSpec, walker: ActorGroup) -> dict[bool, Floats]:
    """(k, 2) points of the route as walked, by whether members start inside the area, where possible."""
    area = polygon_ground(simspec.world.area)
    at = walker.placement.at
    if at is not None:
        starts = [bool(shapely.contains_xy(area, at.east_m, at.north_m))]
    else:
        region = polygon_ground(region_of(simspec, walker))
        starts = [True] if area.intersects(region) else []
        starts += [] if area.buffer(ROUNDING_MARGIN_M).covers(region) else [False]
    points = np.array([(point.east_m, point.north_m) for point in walker.motion.route])
    return {inside: _moved_inside(area, points) if inside else points for inside in starts}


def _moved_inside(area: Geometry, points: Floats) -> Floats:
    drawn = points.copy()
    for index in np.flatnonzero(~shapely.contains_xy(area, points[:, 0], points[:, 1])):
        way = shapely.get_coordinates(shapely.shortest_line(shapely.Point(points[index]), area.exterior))
        length = max(float(np.hypot(*(way[1] - way[0]))), 1e-9)
        drawn[index] += (way[1] - way[0]) * (1.0 + BORDER_INSET_M / length)
    return drawn


def _legs(points: Floats) -> Floats:
    """(k, 2, 2) the legs of a loop, the one back to its first point the last."""
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


def route_faults(simspec: SimSpec) -> Iterator[Fault]:
    """Routes that no placement makes walkable: a leg leaves the area that confines its walkers."""
    if not polygon_ground(simspec.world.area).is_valid:
        return
    area = shapely.buffer(polygon_ground(simspec.world.area), ROUNDING_MARGIN_M)
    for index, group in enumerate(simspec.actors):
        if (
            group.is_known
            and patrols(simspec, group)
            and (points := route_points(simspec, group).get(True)) is not None
        ):
            out = np.flatnonzero(~shapely.covers(area, shapely.linestrings(_legs(points))))
            if len(out):
                first, second = int(out[0]) + 1, (int(out[0]) + 1) % len(points) + 1
                yield Fault(
                    f"actors[{index}] ({group.id}).motion.route",
                    f"the straight way from point {first} to point {second} leaves world.area, which confines walkers that start inside it",
                    "add points that lead round, or widen the area",
                )


def grown_outlines(walls: Footprints, by_m: float) -> Floats:
    """(n,) polygons: footprints grown along and across."""
    return np.asarray(shapely.polygons(replace(walls, half_m=walls.half_m + by_m).corners()))


def route_clearances(simspec: SimSpec, group: ActorGroup) -> list[Relation]:
    """The routes of other groups that members of an obstacle group must leave open."""
    if not is_obstacle(group):
        return []
    return [
        _clear_of_route(simspec, walker)
        for walker in simspec.actors
        if walker.id != group.id and patrols(simspec, walker)
    ]


def _clear_of_route(simspec: SimSpec, walker: ActorGroup) -> Relation:
    def keeps(candidates: Footprints) -> Bools:
        return np.asarray(~np.any(list(blocked_routes(simspec, walker, candidates).values()), axis=0))

    return Relation(_route_field(walker), f"leave the patrol route of {walker.id!r} open", keeps)


def blocked_routes(simspec: SimSpec, walker: ActorGroup, walls: Footprints) -> dict[bool, Bools]:
    """(n,) which of the walls block the route, for each possible start, inside the area or outside."""
    outlines = grown_outlines(walls, half_width_m(walker) + ROUNDING_MARGIN_M)
    routes = {
        inside: shapely.multilinestrings(shapely.linestrings(_legs(points)))
        for inside, points in route_points(simspec, walker).items()
    }
    shapely.prepare(list(routes.values()))
    return {
        inside: np.asarray(shapely.intersects(route, outlines), dtype=np.bool_)
        for inside, route in routes.items()
    }


def _route_field(walker: ActorGroup) -> str:
    return f"actors[{walker.id}].motion.route"


def access_relations(simspec: SimSpec, group: ActorGroup, placed: Mapping[str, Footprints]) -> list[Relation]:
    """Relations that keep every patrol's way to its route open, given what is placed."""
    if patrols(simspec, group):
        return [_reaches_route(simspec, group, placed_obstacles(simspec, placed))]
    if not is_obstacle(group):
        return []
    walkers = [
        walker for walker in simspec.actors if patrols(simspec, walker) and len(placed.get(walker.id, ()))
    ]
    return [_clear_of_approaches(simspec, walker, placed) for walker in walkers]


def placed_obstacles(simspec: SimSpec, placed: Mapping[str, Footprints]) -> Footprints:
    """What closes ways, of what stands."""
    return joined([placed[group.id] for group in simspec.actors if is_obstacle(group) and group.id in placed])


def _reaches_route(simspec: SimSpec, walker: ActorGroup, walls: Footprints) -> Relation:
    blocked_starts = {
        inside for inside, which in blocked_routes(simspec, walker, walls).items() if which.any()
    }
    area = polygon_ground(simspec.world.area)

    def keeps(candidates: Footprints) -> Bools:
        valid: Bools = np.any(open_legs(simspec, walker, candidates, walls)[1], axis=1)
        inside = shapely.contains_xy(area, candidates.centre_m[:, 0], candidates.centre_m[:, 1])
        for start in blocked_starts:
            valid = valid & (inside != start)
        return valid

    return Relation(
        _route_field(walker), "walk straight from its place to some point of its patrol route", keeps
    )


def open_legs(
    simspec: SimSpec, walker: ActorGroup, candidates: Footprints, walls: Footprints
) -> tuple[Floats, Bools]:
    """(n, k, 2) the route's points as walkers at n places walk them, and (n, k) which are open."""
    area = polygon_ground(simspec.world.area)
    inside: Bools = np.asarray(
        shapely.contains_xy(area, candidates.centre_m[:, 0], candidates.centre_m[:, 1])
    )
    routes = route_points(simspec, walker)
    any_route = next(iter(routes.values()))
    ends = np.where(
        inside[:, None, None], routes.get(True, any_route)[None], routes.get(False, any_route)[None]
    )
    free = ~_blocked(candidates.centre_m, ends, walls, half_width_m(walker))
    # In a convex area no straight way between inside points crosses the border.
    if not area.equals(area.convex_hull) and free.any():
        confined = free & inside[:, None]
        starts = np.broadcast_to(candidates.centre_m[:, None, :], ends.shape)
        free[confined] = shapely.covers(
            area.buffer(ROUNDING_MARGIN_M),
            shapely.linestrings(np.stack([starts[confined], ends[confined]], axis=1)),
        )
    return ends, free


def _blocked(starts_m: Floats, ends_m: Floats, walls: Footprints, need_m: float) -> Bools:
    """(n, k) whether an obstacle blocks the way from n places to k points of each."""
    closed = np.zeros(ends_m.shape[:2], dtype=np.bool_)
    axes = walls.axes()
    for index in range(len(walls)):
        centre, half = walls.centre_m[index], walls.half_m[index]
        begin, end = (starts_m - centre) @ axes[index].T, (ends_m - centre) @ axes[index].T
        # As in the simulation, who stands closer may walk away, but never through the solid.
        touching = (np.abs(begin) <= half + need_m).all(axis=1)
        for who, wide in (
            (touching, half + ROUNDING_MARGIN_M),
            (~touching, half + need_m + ROUNDING_MARGIN_M),
        ):
            closed[who] |= _crosses(begin[who][:, None, :], end[who], wide)
    return closed


def _crosses(begin: Floats, end: Floats, half: Floats) -> Bools:
    """Whether segments touch the box from `-half` to `half`: inside both slabs at some moment."""
    way = end - begin
    # A way parallel to a side would divide by zero.
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    first, second = (-half - begin) / way, (half - begin) / way
    enters = np.maximum(np.minimum(first, second).max(axis=-1), 0.0)
    leaves = np.minimum(np.maximum(first, second).min(axis=-1), 1.0)
    return np.asarray(enters <= leaves)


def approach_legs(simspec: SimSpec, walker: ActorGroup, candidates: Footprints, walls: Footprints) -> Floats:
    """(n,) lines from places to the nearest point of the route that is open to them; None where none is."""
    ends, free = open_legs(simspec, walker, candidates, walls)
    distance_m = np.linalg.norm(ends - candidates.centre_m[:, None, :], axis=-1)
    nearest = np.where(free, distance_m, np.inf).argmin(axis=1)
    legs = shapely.linestrings(np.stack([candidates.centre_m, ends[np.arange(len(ends)), nearest]], axis=1))
    legs[~free.any(axis=1)] = None
    return np.asarray(legs)


def _clear_of_approaches(simspec: SimSpec, walker: ActorGroup, placed: Mapping[str, Footprints]) -> Relation:
    legs = approach_legs(simspec, walker, placed[walker.id], placed_obstacles(simspec, placed))
    ways = shapely.multilinestrings([leg for leg in legs if leg is not None])
    shapely.prepare(ways)

    def keeps(candidates: Footprints) -> Bools:
        return np.asarray(
            ~shapely.intersects(ways, grown_outlines(candidates, half_width_m(walker) + ROUNDING_MARGIN_M))
        )

    return Relation(_route_field(walker), f"leave {walker.id!r} a straight way to its patrol route", keeps)


def blocking_pairs(
    simspec: SimSpec, walker: ActorGroup, walkers: Footprints, walls: Footprints, standing: Footprints
) -> Iterator[tuple[int, int]]:
    """The pairs of a walker's place and an obstacle's place that exclude each other."""
    legs = approach_legs(simspec, walker, walkers, standing)
    tree = shapely.STRtree(grown_outlines(walls, half_width_m(walker) + ROUNDING_MARGIN_M))
    yield from ((first, second) for first, second in tree.query(legs, predicate="intersects").T.tolist())


def visible_ground(points_m: Floats, walls: Sequence[Geometry]) -> Geometry:
    """All ground from which a straight line to one of the points misses the solids; errs to too much."""
    return shapely.union_all([_visible_from(point, walls) for point in points_m])


def _visible_from(point: Floats, walls: Sequence[Geometry]) -> Geometry:
    room = EVERYWHERE
    for wall in walls:
        if shapely.intersects_xy(wall, *point):
            return shapely.Polygon()
        corners = shapely.get_coordinates(wall)
        away = corners - point
        behind = corners + _SHADOW_M * away / np.hypot(away[:, 0], away[:, 1])[:, None]
        room = room.difference(shapely.convex_hull(shapely.multipoints(np.concatenate([corners, behind]))))
    return room


def check_fixed_routes(simspec: SimSpec, placed: Mapping[str, Footprints]) -> None:
    """Refuse at once fixed obstacles on a patrol route, or around a walker that is fixed too.

    Raises PlacementInfeasible.
    """
    walls = [group for group in simspec.actors if group.id in placed and is_obstacle(group)]
    walkers = [group for group in simspec.actors if patrols(simspec, group)]
    for walker in walkers:
        others = [wall for wall in walls if wall is not walker]
        if shutting := _blocking_groups(simspec, walker, others, placed):
            path, paths = _route_field(walker), [field_path(wall, "at") for wall in shutting]
            wall_text = ", ".join(
                f"{wall.id!r} is fixed ({at})" for wall, at in zip(shutting, paths, strict=True)
            )
            raise PlacementInfeasible(
                f"impossible, and proved so: {wall_text} on the patrol route of {walker.id!r} ({path}). Move one of them",
                clash=(*paths, path),
            )

    def confined(walker: ActorGroup, subset: Sequence[ActorGroup]) -> bool:
        standing = joined([placed[group.id] for group in subset])
        return approach_legs(simspec, walker, placed[walker.id], standing)[0] is None

    for walker in walkers:
        if walker.id in placed and confined(walker, walls):
            path, at = _route_field(walker), field_path(walker, "at")
            # By the border alone nothing else is to blame.
            needed = [] if confined(walker, []) else smallest_failing(walls, partial(confined, walker))
            raise PlacementInfeasible(
                f"impossible, and proved so: {walker.id!r} is fixed ({at}) where no straight way leads to any point "
                f"of its patrol route ({path}), for what is fixed or the area's border. Move it, the route or what is in between",
                clash=(at, path, *(field_path(group, "at") for group in needed)),
            )


def _blocking_groups(
    simspec: SimSpec, walker: ActorGroup, walls: Sequence[ActorGroup], placed: Mapping[str, Footprints]
) -> list[ActorGroup]:
    """The fewest fixed obstacles that block the route from every start; none when one is open."""

    def fails(subset: Sequence[ActorGroup]) -> bool:
        standing = joined([placed[group.id] for group in subset])
        return all(which.any() for which in blocked_routes(simspec, walker, standing).values())

    return smallest_failing(walls, fails) if walls and fails(walls) else []
