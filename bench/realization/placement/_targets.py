"""Targets of relations: groups, all groups of a role, points, and the vehicle's home."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.simspec import ActorGroup, Distance, PlaceReference, Point, SimSpec

from ._footprint import Footprints, footprints
from ._groups import groups_named, is_home, member_count
from .relations._relation import HOME_CLEARANCE_M


def home_obstacle(simspec: SimSpec) -> Footprints:
    """The vehicle's home as an obstacle with a clearance around it."""
    return replace(point_footprint(simspec.vehicle.home), gap_m=np.full(1, HOME_CLEARANCE_M))


@dataclass(frozen=True, slots=True)
class RelationTarget:
    """The target of a relation: groups or a point, with a name for messages."""

    name: str
    of: tuple[str, ...] = ()
    points: Footprints | None = None

    @classmethod
    def named(cls, simspec: SimSpec, name: str) -> RelationTarget:
        """The target of that name: a group or the vehicle's home."""
        if is_home(simspec, name):
            return cls("the vehicle's home", points=point_footprint(simspec.vehicle.home))
        return cls(repr(name), (name,))

    @classmethod
    def referenced(cls, simspec: SimSpec, reference: PlaceReference) -> RelationTarget:
        """The target of a relation to a point or to a group's first member."""
        return cls.named(simspec, reference.of) if reference.of is not None else cls._point(reference.point)

    @classmethod
    def of_distance(cls, simspec: SimSpec, group: ActorGroup, distance: Distance) -> RelationTarget:
        """The target of a distance, which may be all groups of a role."""
        if distance.of is None:
            return cls._point(distance.point)
        return cls.group_or_role(simspec, group, distance.of)

    @classmethod
    def group_or_role(cls, simspec: SimSpec, group: ActorGroup, name: str) -> RelationTarget:
        """The target of that name: a group, all other groups of a role, or the vehicle's home."""
        if is_home(simspec, name):
            return cls.named(simspec, name)
        # Groups without members are left out: a distance to nobody is kept.
        names = groups_named(simspec, group, name)
        return cls(repr(name), tuple(other for other in names if member_count(simspec, simspec.group(other))))

    @classmethod
    def _point(cls, point: Point | None) -> RelationTarget:
        # The document has either a group or a point.
        assert point is not None
        return cls(f"the point {point.east_m:g} east, {point.north_m:g} north", points=point_footprint(point))

    def described(self, quantifier: str) -> str:
        """The target in words, for some or every member; a point needs no quantifier."""
        return self.name if self.points is not None else f"{quantifier} member of {self.name}"


def point_footprint(point: Point) -> Footprints:
    """A point as a footprint without size."""
    return Footprints(np.array([[point.east_m, point.north_m]]), np.zeros(1), np.zeros((1, 2)), np.zeros(1))


def fixed_footprint(group: ActorGroup) -> Footprints:
    """The footprint of a fixed actor, with no gap around it."""
    at = group.placement.at
    assert at is not None
    centre_m = np.array([[at.east_m, at.north_m]])
    return footprints(group.definition, centre_m, np.array([at.heading_deg]), 0.0)


def target_footprints(simspec: SimSpec, name: str, placed: Mapping[str, Footprints]) -> Footprints:
    """The placed members of a group, or the vehicle's home."""
    return point_footprint(simspec.vehicle.home) if is_home(simspec, name) else placed[name]
