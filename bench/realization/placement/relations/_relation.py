"""Relations that members of a group must keep, each with the path of its field and its words for messages.

A `Relation` judges places alone: the region, a road, what is placed already. A `GroupRelation` judges places
against members of other groups; bound to placed members it becomes a `Relation`. Each may also give the
ground in which valid centres lie: never too little ground, often too much.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely

from bench.arrays import Bools
from bench.simspec import ActorGroup

from .._footprint import Footprints, joined
from .._geometry import EVERYWHERE, Geometry

HOME_CLEARANCE_M = 3.0

Quantifier = Literal["some", "every", "first"]


@dataclass(frozen=True, slots=True)
class Relation:
    """A condition on one place. `room()` contains every valid centre, or is None when unrestricted."""

    path: str
    text: str
    keeps: Callable[[Footprints], Bools]
    ground: Callable[[], Geometry | None] = lambda: None


@dataclass(frozen=True, slots=True)
class GroupRelation:
    """A relation to the members of other groups, or to points.

    `pairs` is (k, m): whether a place keeps it towards a member. `room` holds every centre that may keep it
    towards a member that stands somewhere in the ground given; `back` every centre of the member, seen from
    ours. `points` stand for members where no group is meant. `among` is as `room`, for members that stand,
    where their headings tell more. `band_m` bounds the distance to each member who counts.
    """

    path: str
    text: str
    of: tuple[str, ...]
    quantifier: Quantifier
    pairs: Callable[[Footprints, Footprints], Bools]
    ground: Callable[[Geometry], Geometry | None]
    reverse_ground: Callable[[Geometry], Geometry | None]
    points: Footprints | None = None
    ground_among: Callable[[Footprints], Geometry | None] | None = None
    band_m: tuple[float, float] | None = None

    def keeps(self, candidates: Footprints, others: Footprints) -> Bools:
        """(k,) whether places keep it towards all of the others who count."""
        counted = others[np.arange(1)] if self.quantifier == "first" else others
        matrix = self.pairs(candidates, counted)
        return np.asarray(np.any(matrix, axis=1) if self.quantifier == "some" else np.all(matrix, axis=1))

    def bound(self, others: Footprints) -> Relation:
        """The relation to members that stand."""
        return Relation(
            self.path,
            self.text,
            lambda candidates: self.keeps(candidates, others),
            lambda: self._common_ground(others),
        )

    def bound_to(self, placed: Mapping[str, Footprints]) -> Relation:
        """The relation to its points, or to the placed members of its groups."""
        return self.bound(
            self.points if self.points is not None else joined([placed[name] for name in self.of])
        )

    def _common_ground(self, others: Footprints) -> Geometry | None:
        points = shapely.points(others.centre_m)
        # No members: nothing to relate to, so nothing is restricted.
        if len(points) == 0:
            return None
        if self.ground_among is not None:
            return self.ground_among(others)
        if self.quantifier == "some":
            return self.ground(shapely.MultiPoint(points))
        # 64 members bound the work; leaving the others out only makes the ground larger, which is allowed.
        rooms = [self.ground(point) for point in points[: 1 if self.quantifier == "first" else 64]]
        return None if rooms[0] is None else shapely.intersection_all(rooms)


def field_path(group: ActorGroup, name: str) -> str:
    """The path of one of the group's placement fields, as a campaign's factors write it."""
    return f"actors[{group.id}].placement.{name}"


def common_ground(relations: Sequence[Relation]) -> Geometry:
    """Where centres that keep all of them must lie."""
    rooms = [room for relation in relations if (room := relation.ground()) is not None]
    return shapely.intersection_all(rooms) if rooms else EVERYWHERE


def kept_places(places: Footprints, relations: Sequence[Relation]) -> Footprints:
    """Those of the places that keep all of the relations."""
    for relation in relations:
        places = places[relation.keeps(places)]
    return places
