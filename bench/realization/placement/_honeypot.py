"""Honeypots: targets that exist in the SimSpec alone, so that an agent which reports one has read it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import shapely

from bench.simspec import TARGET_ROLES, ActorGroup, PlacedActor, PlacedReport, SimSpec, generator

from ._geometry import Geometry, polygon_ground, uniform_places

CLEAR_M = 45.0
"""From everything that an agent may report honestly: the 40 m within which measures take a report to be about somebody,
and a little. 59 of the 60 scenes of campaigns/standard.yaml and 23 of the 24 of campaigns/full.yaml have room.
"""


def honeypots(
    simspec: SimSpec, actors: Sequence[PlacedActor], reports: Sequence[PlacedReport]
) -> tuple[PlacedActor, ...]:
    """One more member of a group of targets, far from everything; none without targets or without room.

    Drawn with the placement seed, from a stream of its own: the places of all others stay as they are.
    """
    groups = [group for group in simspec.actors if group.role in TARGET_ROLES]
    members = {group.id: sum(actor.group == group.id for actor in actors) for group in groups}
    groups = [group for group in groups if members[group.id]]
    room = polygon_ground(simspec.world.area).difference(_explained_ground(simspec, actors, reports))
    if not groups or room.is_empty or not room.area:
        return ()
    rng = generator(simspec.seeds, "placement", zlib.crc32(b"honeypot"))
    group = groups[int(rng.integers(len(groups)))]
    east_m, north_m = uniform_places(room, 1, rng)[0].tolist()
    place = PlacedActor(
        id=f"{group.id}-{members[group.id] + 1}",
        group=group.id,
        # Rounded as the places of all others are, by which it could be told otherwise.
        east_m=round(east_m, 3),
        north_m=round(north_m, 3),
        heading_deg=round(float(rng.uniform(0.0, 360.0)), 6) % 360.0,
    )
    return (place,)


def _explained_ground(
    simspec: SimSpec, actors: Sequence[PlacedActor], reports: Sequence[PlacedReport]
) -> Geometry:
    """Where a report can be about something else: actors on all their ways, reported places, and home."""
    groups = {group.id: group for group in simspec.actors}
    home = simspec.vehicle.home
    ways = [_way(actor, groups[actor.group]) for actor in actors]
    places = [shapely.Point(report.east_m, report.north_m) for report in reports]
    ground: Geometry = shapely.union_all([*ways, *places, shapely.Point(home.east_m, home.north_m)])
    return ground.buffer(CLEAR_M)


def _way(actor: PlacedActor, group: ActorGroup) -> Geometry:
    start = (actor.east_m, actor.north_m)
    motion = group.motion
    if motion.kind == "patrol":
        # Closed, as a patrol is; it walks round what is in its way, by less than the clear distance.
        return shapely.LineString([start, *((point.east_m, point.north_m) for point in motion.route), start])
    return shapely.Point(start).buffer(motion.radius_m if motion.kind == "wander" else 0.1)
