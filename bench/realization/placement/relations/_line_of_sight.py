"""Lines of sight between members and eyes, blocked by solid actors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Floats
from bench.simspec import ActorGroup, Sight, SimSpec

from .._footprint import Footprints, joined
from .._geometry import Geometry
from .._targets import RelationTarget
from ._relation import GroupRelation, Quantifier, field_path


def unbounded(_: Geometry) -> None:
    return None


@dataclass(frozen=True, slots=True)
class Solids:
    """Solid actors that block sight: footprints, heights (n,) and the group of each."""

    footprints: Footprints
    height_m: Floats
    group: tuple[str, ...]

    def without(self, group: str) -> Solids:
        """The solids of other groups."""
        mask = np.array([name != group for name in self.group], dtype=np.bool_)
        return Solids(
            self.footprints[mask], self.height_m[mask], tuple(name for name in self.group if name != group)
        )

    def between(self, eyes_m: Floats, eye_height_m: float, places_m: Floats, height_m: float) -> Bools:
        """(k, m) whether a solid cuts the line from eye m to the point `height_m` above place k.

        An eye inside sees out.
        """
        blocked = np.zeros((len(places_m), len(eyes_m)), dtype=np.bool_)
        axes = self.footprints.axes()
        for index in range(len(self.height_m)):
            centre, half = self.footprints.centre_m[index], self.footprints.half_m[index]
            eye, end = (eyes_m - centre) @ axes[index].T, (places_m - centre) @ axes[index].T
            begins, ends = _box_crossing(eye, end, half)
            # The line's lowest point over the box is at the end nearer to the lower of eye and top.
            low = eye_height_m + np.where(eye_height_m <= height_m, begins, ends) * (height_m - eye_height_m)
            # An eye inside a solid sees out, as docs/placement.md promises.
            outside = (np.abs(eye) > half).any(axis=1)
            blocked |= outside[None, :] & (begins < ends) & (low < self.height_m[index])
        return blocked


def _box_crossing(eye: Floats, end: Floats, half: Floats) -> tuple[Floats, Floats]:
    """(k, m) shares of the ways from (m, 2) eyes to (k, 2) ends inside a box round the origin."""
    way = end[:, None, :] - eye[None, :, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (-half - eye[None]) / way
        second = (half - eye[None]) / way
    level = way == 0.0
    within = np.abs(eye)[None] <= half
    low = np.where(level, np.where(within, -np.inf, np.inf), np.minimum(first, second))
    high = np.where(level, np.where(within, np.inf, -np.inf), np.maximum(first, second))
    return np.maximum(low.max(axis=-1), 0.0), np.minimum(high.min(axis=-1), 1.0)


def sight_relations(simspec: SimSpec, group: ActorGroup, solids: Solids) -> Iterator[GroupRelation]:
    """Out of sight of every eye, and in sight of some."""
    quantifiers: dict[str, Quantifier] = {"hidden_from": "every", "visible_from": "some"}
    for name, quantifier in quantifiers.items():
        sight = group.placement.place_references.get(name)
        if isinstance(sight, Sight):
            yield _sight_relation(simspec, group, name, sight, quantifier, solids.without(group.id))


def _sight_relation(
    simspec: SimSpec, group: ActorGroup, name: str, sight: Sight, quantifier: Quantifier, solids: Solids
) -> GroupRelation:
    target, is_hidden = RelationTarget.referenced(simspec, sight), name == "hidden_from"

    def pairs(candidates: Footprints, others: Footprints) -> Bools:
        top_m = group.definition.height_m
        hidden = solids.between(others.centre_m, sight.height_m, candidates.centre_m, top_m)
        return hidden if is_hidden else ~hidden

    verb = "out of sight" if is_hidden else "in sight"
    text = f"stand {verb} of {target.described(quantifier)} at {sight.height_m:g} m"
    return GroupRelation(
        field_path(group, name), text, target.of, quantifier, pairs, unbounded, unbounded, target.points
    )


def placed_solids(simspec: SimSpec, placed: Mapping[str, Footprints]) -> Solids:
    """What stands in the way of sight."""
    groups = [group for group in simspec.actors if group.definition.solid and len(placed.get(group.id, ()))]
    heights = [np.full(len(placed[group.id]), group.definition.height_m) for group in groups]
    names = tuple(group.id for group in groups for _ in range(len(placed[group.id])))
    return Solids(
        joined([placed[group.id] for group in groups]), np.concatenate([np.zeros(0), *heights]), names
    )
