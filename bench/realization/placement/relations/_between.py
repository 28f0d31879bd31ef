"""The `between` relation: a place near the straight line from one member to another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from bench.arrays import Bools
from bench.simspec import HOME, ActorGroup, SimSpec

from .._footprint import Footprints
from .._geometry import Geometry, grown_at_least
from .._groups import is_home
from .._targets import point_footprint
from ._relation import Relation, field_path


@dataclass(frozen=True, slots=True)
class BetweenRelation:
    """A place near the straight line between two ends: groups, one group twice, or the vehicle's home."""

    path: str
    text: str
    first: str
    second: str
    within_m: float
    home: Footprints | None

    @property
    def of(self) -> tuple[str, ...]:
        """The groups at its ends."""
        return tuple(name for name in self.ends if self.home is None or name != HOME)

    @property
    def ends(self) -> tuple[str, str]:
        """The names of both ends, the vehicle's home included."""
        return self.first, self.second

    def bound(self, placed: Callable[[str], Footprints]) -> Relation:
        """The relation to placed members."""
        start_m = self._at(self.first, placed).centre_m[0]
        # The same group twice: its first and its second member.
        end_m = self._at(self.second, placed).centre_m[1 if self.first == self.second else 0]

        def keeps(candidates: Footprints) -> Bools:
            way = end_m - start_m
            length_m = np.hypot(*way)
            # Two ends at one place have nothing between them.
            if length_m == 0.0:
                return np.zeros(len(candidates), dtype=np.bool_)
            forward, offset = way / length_m, candidates.centre_m - start_m
            along = offset @ forward
            aside = offset[:, 0] * forward[1] - offset[:, 1] * forward[0]
            # Strictly between: beside an end is not between.
            return np.asarray((along > 0.0) & (along < length_m) & (np.abs(aside) <= self.within_m))

        return Relation(
            self.path, self.text, keeps, lambda: self.ground(shapely.Point(start_m), shapely.Point(end_m))
        )

    def _at(self, name: str, placed: Callable[[str], Footprints]) -> Footprints:
        return self.home if self.home is not None and name == HOME else placed(name)

    def ground(self, start: Geometry, end: Geometry) -> Geometry:
        """Ground that contains every valid centre when the ends lie anywhere in these two grounds."""
        # Two points: the exact strip. Larger grounds: the hull of all possible lines.
        if shapely.get_num_coordinates(start) == 1 and shapely.get_num_coordinates(end) == 1:
            line = shapely.LineString([start, end])
            if line.length == 0.0:
                return shapely.Polygon()
            return shapely.buffer(line, self.within_m + 1e-6, cap_style="flat")
        return grown_at_least(shapely.convex_hull(shapely.union_all([start, end])), self.within_m)


def between_relations(simspec: SimSpec, group: ActorGroup) -> list[BetweenRelation]:
    """The group's between relation, if it has one."""
    between = group.placement.between
    if between is None:
        return []
    home = point_footprint(simspec.vehicle.home) if is_home(simspec, HOME) else None
    first, second, within_m = between.first, between.second, between.within_m
    ends = f"the first two members of {first!r}," if first == second else f"{first!r} and {second!r},"
    text = f"stand between {ends} within {within_m:g} m of the way"
    return [BetweenRelation(field_path(group, "between"), text, first, second, within_m, home)]
