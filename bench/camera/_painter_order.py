"""Which of two things is drawn first: by planes that separate them, and only without one by distance.

Painting from far to near by distance alone draws a person beside a long wall behind it. Two convex bodies that do not
touch have a plane between them, mostly one through a face; the body on the camera's side of it is the nearer one,
wherever their middles are.
Source: the idea of binary space partitions, H. Fuchs, Z. Kedem, B. Naylor (1980), SIGGRAPH 80, 124-133.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable

import numpy as np

from bench.arrays import Bools, Counts, Floats, product
from bench.contracts import Geometry

_TOUCH_M = 1e-3
"""Bodies may overlap by this much and still count as separate: looks are made of solids that touch."""

_CACHED_ORDERS = 4096


class SolidOrder:
    """Faces of one geometry from far to near, for every place of the camera.

    The order depends only on the sides of the separating planes that the camera is on, so it is kept for each pattern
    of sides: an actor costs nothing after the first pictures.
    """

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        self._middles = np.array(
            [
                geometry.corners_m[geometry.solids == solid].reshape(-1, 3).mean(axis=0)
                for solid in range(int(geometry.solids.max()) + 1)
            ]
        )
        self._planes, self._separator, self._outer = _separators(geometry)
        self._orders: dict[bytes, Counts] = {}

    def faces(self, front: Bools) -> Counts:
        """Indices of the faces that show their front, from far to near. front (f,): whether a face shows it."""
        sides = front[self._planes]
        key = sides.tobytes()
        order = self._orders.get(key)
        if order is None:
            # The bound keeps a session of hours from growing; a pattern that comes again is worked out again.
            if len(self._orders) >= _CACHED_ORDERS:
                self._orders.clear()
            order = self._orders[key] = self._face_order(sides)
        visible: Counts = order[front[order]]
        return visible

    def _face_order(self, sides: Bools) -> Counts:
        count = len(self._middles)
        # The mean direction to the camera, for solids that no plane separates: they run into each other.
        towards = (self._geometry.normals[self._planes] * np.where(sides, 1.0, -1.0)[:, None]).sum(axis=0)
        depth = -product(self._middles, towards)
        edges = []
        for i in range(count):
            for j in range(i + 1, count):
                plane = self._separator[i, j]
                if plane >= 0:
                    # `outer` is the solid beyond the plane; it is the nearer one when the camera is there too.
                    nearer_is_outer = bool(sides[plane])
                    outer = int(self._outer[i, j])
                    inner = i + j - outer
                    edges.append((inner, outer) if nearer_is_outer else (outer, inner))
        rank = np.empty(count, dtype=np.int64)
        rank[far_to_near(depth, edges)] = np.arange(count)
        # Details lie on faces of their own solid, and those never hide each other.
        key = 2 * rank[self._geometry.solids] + self._geometry.details
        order: Counts = np.argsort(key, kind="stable")
        return order


def _separators(geometry: Geometry) -> tuple[Counts, Counts, Counts]:
    """(p,) faces whose planes separate solids; (s, s) for each pair its plane in that list or -1; (s, s) the solid
    beyond the plane.
    """
    count = int(geometry.solids.max()) + 1
    offsets = (geometry.normals * geometry.corners_m[:, 0]).sum(axis=1)
    least, most = np.empty((len(offsets), count)), np.empty((len(offsets), count))
    for solid in range(count):
        corners = geometry.corners_m[geometry.solids == solid].reshape(-1, 3)
        heights = product(geometry.normals, corners.T) - offsets[:, None]
        least[:, solid], most[:, solid] = heights.min(axis=1), heights.max(axis=1)
    everywhere = np.arange(len(offsets))
    beyond = least >= -_TOUCH_M
    # A solid without thickness, such as a piece of a net, has a plane that others may lie behind.
    flat = least[everywhere, geometry.solids] > -_TOUCH_M
    behind = (most <= _TOUCH_M) & flat[:, None]
    for side in (beyond, behind):
        side[everywhere, geometry.solids] = False
        side[geometry.details] = False
    separator = np.full((count, count), -1, dtype=np.int64)
    outer = np.zeros((count, count), dtype=np.int64)
    planes: list[int] = []
    # Few planes mean few patterns of sides, so those that separate the most pairs come first.
    for face in np.argsort(-(beyond | behind).sum(axis=1), kind="stable").tolist():
        host = int(geometry.solids[face])
        pairs = [(other, other) for other in np.flatnonzero(beyond[face]).tolist()]
        pairs += [(other, host) for other in np.flatnonzero(behind[face] & ~beyond[face]).tolist()]
        fresh = [
            (min(host, other), max(host, other), far)
            for other, far in pairs
            if separator[min(host, other), max(host, other)] < 0
        ]
        if fresh:
            for i, j, far in fresh:
                separator[i, j], outer[i, j] = len(planes), far
            planes.append(face)
    return np.array(planes, dtype=np.int64), separator, outer


def far_to_near(depth: Floats, edges: Iterable[tuple[int, int]]) -> list[int]:
    """All indices of depth (n,), such that the first of each edge comes before the second, and otherwise the deepest
    first. A cycle is cut at its deepest member.
    """
    followers: dict[int, list[int]] = {}
    waiting = [0] * len(depth)
    for first, second in edges:
        followers.setdefault(first, []).append(second)
        waiting[second] += 1
    keys = (-depth).tolist()
    # The index breaks ties, so that equal depths have one order on every machine.
    ready = [(keys[i], i) for i, count in enumerate(waiting) if count == 0]
    heapq.heapify(ready)
    left = sorted((keys[i], i) for i, count in enumerate(waiting) if count)
    done = [False] * len(depth)
    order: list[int] = []
    cursor = 0
    while len(order) < len(depth):
        if not ready:
            while done[left[cursor][1]]:
                cursor += 1
            ready.append(left[cursor])
        _, index = heapq.heappop(ready)
        if done[index]:
            continue
        done[index] = True
        order.append(index)
        for follower in followers.get(index, ()):
            waiting[follower] -= 1
            if waiting[follower] == 0 and not done[follower]:
                heapq.heappush(ready, (keys[follower], follower))
    return order


def body_edges(
    centres_m: Floats, axes: Floats, halves_m: Floats, camera_m: Floats, windows_px: Floats
) -> list[tuple[int, int]]:
    """Pairs (farther, nearer) of boxes whose windows in the picture overlap and that a side of one of them separates.

    centres_m (k, 3), axes (k, 3, 3) with the box's axes as rows, halves_m (k, 3), camera_m (3,); windows_px (k, 4)
    are left, top, right, bottom.
    """
    left, top, right, bottom = windows_px.T
    overlap = (left[:, None] < right) & (left < right[:, None])
    overlap &= (top[:, None] < bottom) & (top < bottom[:, None])
    first, second = np.nonzero(np.triu(overlap, 1))
    if not len(first):
        return []
    gap, nearer = _separated(first, second, centres_m, axes, halves_m, camera_m)
    other_gap, other_nearer = _separated(second, first, centres_m, axes, halves_m, camera_m)
    # The wider gap is the safer witness where boxes nearly touch.
    swap = other_gap > gap
    nearest = np.where(swap, other_nearer, nearer)
    known = np.maximum(gap, other_gap) >= -_TOUCH_M
    farther = first + second - nearest
    return list(zip(farther[known].tolist(), nearest[known].tolist(), strict=True))


def _separated(
    host: Counts, guest: Counts, centres_m: Floats, axes: Floats, halves_m: Floats, camera_m: Floats
) -> tuple[Floats, Counts]:
    """For each pair: the widest gap beyond a side of the host, and which of both is nearer to the camera."""
    frame = axes[host]
    offset = np.einsum("pij,pj->pi", frame, centres_m[guest] - centres_m[host])
    turned = np.einsum("pij,pkj->pik", frame, axes[guest])
    reach = (np.abs(turned) * halves_m[guest][:, None, :]).sum(axis=2)
    gaps = np.abs(offset) - reach - halves_m[host]
    axis = gaps.argmax(axis=1)
    rows = np.arange(len(host))
    camera = np.einsum("pij,pj->pi", frame, camera_m - centres_m[host])[rows, axis]
    beyond = camera * np.sign(offset[rows, axis]) > halves_m[host][rows, axis]
    return gaps[rows, axis], np.where(beyond, guest, host)
