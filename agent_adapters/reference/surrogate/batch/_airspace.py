"""Ways round what the rules forbid, as the reference agent flies them: round no-fly areas, inside the
geofence.

Every forbidden thing is a convex block with its margin on it. Which straight ways are cut is worked out for
many at once; only those are routed, one by one, by the agent's own airspace.
"""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np
from scipy.sparse.csgraph import floyd_warshall

from bench.arrays import Bools, Floats
from bench.polygons import are_inside

from ...flight._airspace import TOUCH_M, Airspace
from ...flight._paths import Place


class SurrogateAirspace:
    """What is forbidden at one time: the agent's airspace, asked about many ways at once."""

    def __init__(self, airspace: Airspace) -> None:
        self.airspace = airspace
        self._blocks = tuple(np.array(block.corners) for block in airspace.blocks)
        self._fence = None if airspace.fence is None else np.array(airspace.fence)

    def length_m(self, begin_m: Floats, end_m: Floats) -> Floats:
        """(r,) lengths of the ways between places (r, 2)."""
        length_m: Floats = np.hypot(end_m[:, 0] - begin_m[:, 0], end_m[:, 1] - begin_m[:, 1])
        rows = np.flatnonzero(self._needs_route(begin_m, end_m))
        if not len(rows):
            return length_m
        begin, end = self._nearest_allowed(begin_m[rows]), self._nearest_allowed(end_m[rows])
        extra_m = np.hypot(*(begin - begin_m[rows]).T) + np.hypot(*(end - end_m[rows]).T)
        direct_m = np.where(self._cut(begin, end), np.inf, np.hypot(*(end - begin).T))
        round_m = np.full(len(rows), np.inf)
        if self.airspace.nodes:
            to_node_m = (self._straight_m(begin)[:, :, None] + self._route_lengths_m[None]).min(axis=1)
            round_m = (to_node_m + self._straight_m(end)).min(axis=1)
        route_m = extra_m + np.minimum(direct_m, round_m)
        length_m[rows] = np.where(np.isfinite(route_m), route_m, length_m[rows])
        return length_m

    def paths(self, corners_m: Floats) -> Floats:
        """Paths (r, w, 2) with forbidden corners moved and the ways between routed; (r, more, 2), the last
        corner repeated.

        The first corner is where the vehicle is, and stays.
        """
        rows, count, _ = corners_m.shape
        begin_m, end_m = corners_m[:, :-1].reshape(-1, 2), corners_m[:, 1:].reshape(-1, 2)
        needs_route = self._needs_route(begin_m, end_m).reshape(rows, count - 1).any(axis=1)
        routed = {
            row: self.airspace.path([_place(corner) for corner in corners_m[row]])
            for row in np.flatnonzero(needs_route)
        }
        longest = max([count, *(len(path) for path in routed.values())])
        lengthened = padded(corners_m, longest)
        for row, path in routed.items():
            lengthened[row] = padded(np.array([path]), longest)[0]
        return lengthened

    def _needs_route(self, begin_m: Floats, end_m: Floats) -> Bools:
        """(r,) ways that lead through a block, or end in one or outside the fence."""
        return self._cut(begin_m, end_m) | ~self._allowed(end_m) | ~self._allowed(begin_m)

    def _allowed(self, places_m: Floats) -> Bools:
        allowed: Bools = (
            np.ones(len(places_m), dtype=np.bool_)
            if self._fence is None
            else are_inside(places_m, self._fence)
        )
        for block in self._blocks:
            allowed &= ~(_sides(block, places_m) > TOUCH_M).all(axis=1)
        return allowed

    def _cut(self, begin_m: Floats, end_m: Floats) -> Bools:
        """(r,) whether the straight ways lead through the inside of a block (Cyrus and Beck's clipping)."""
        cut = np.zeros(len(begin_m), dtype=np.bool_)
        for block in self._blocks:
            at_begin, at_end = _sides(block, begin_m) - TOUCH_M, _sides(block, end_m) - TOUCH_M
            share = at_begin / np.where(at_begin == at_end, 1.0, at_begin - at_end)
            enter = np.where((at_begin < 0.0) & (at_end > 0.0), share, 0.0).max(axis=1)
            leave = np.where((at_begin >= 0.0) & (at_end < 0.0), share, 1.0).min(axis=1)
            beside = ((at_begin <= 0.0) & (at_end <= 0.0)).any(axis=1)
            cut |= ~beside & (leave - enter > 1e-9)
        return cut

    @cached_property
    def _route_lengths_m(self) -> Floats:
        """Lengths of the shortest ways between nodes."""
        # All pairs once: the same rules serve every mission of a batch.
        return np.asarray(floyd_warshall(self._straight_m(np.array(self.airspace.nodes))))

    def _nearest_allowed(self, places_m: Floats) -> Floats:
        """The nearest allowed places."""
        moved = places_m.copy()
        for row in np.flatnonzero(~self._allowed(places_m)):
            moved[row] = self.airspace.nearest(_place(places_m[row]))
        return moved

    def _straight_m(self, places_m: Floats) -> Floats:
        """(r, nodes) lengths of the straight ways to nodes; inf where one is cut."""
        nodes = np.array(self.airspace.nodes)
        begin, end = np.repeat(places_m, len(nodes), axis=0), np.tile(nodes, (len(places_m), 1))
        length_m = np.where(self._cut(begin, end), np.inf, np.hypot(*(end - begin).T))
        return length_m.reshape(len(places_m), len(nodes))


@cache
def in_arrays(airspace: Airspace) -> SurrogateAirspace:
    """An airspace asked about many ways: one object serves all missions in it."""
    return SurrogateAirspace(airspace)


def padded(paths_m: Floats, count: int) -> Floats:
    """Paths (r, w, 2) with the last corner repeated until there are so many."""
    return np.concatenate((paths_m, np.repeat(paths_m[:, -1:], count - paths_m.shape[1], axis=1)), axis=1)


def _sides(block: Floats, places_m: Floats) -> Floats:
    """(r, m) how far left of each edge places (r, 2) lie: inside where all are positive."""
    along = np.roll(block, -1, axis=0) - block
    along = along / np.hypot(along[:, 0], along[:, 1])[:, None]
    away = places_m[:, None] - block[None]
    return np.asarray(along[:, 0] * away[..., 1] - along[:, 1] * away[..., 0])


def _place(point: Floats) -> Place:
    return float(point[0]), float(point[1])
