"""Which actors are in the picture, how large, and how much of them is visible.

Bodies are cuboids, upright on flat ground. Each step works on the whole cast at once: a cheap cull by
spheres, then the corners of the candidates, then lines of sight to what is in the picture. Only solid bodies
hide others.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Floats, product
from bench.contracts import NO_DISTORTION, CastMember, Sighting, VehicleState

from ._box_intersection import crosses_box
from ._camera import PinholeCamera

# Chosen, not measured; docs/scene.md lists them for those who write measures.
MAX_RANGE_M = 2000.0
LEAST_DEPTH_M = 0.1
LEAST_SIZE_PX = 1.0
LEAST_VISIBLE = 0.05
"""An actor that is farther, smaller or more hidden than these is not a sighting."""

SAMPLE_SPREAD = 0.8
"""How far from the middle of the silhouette towards its edges the outer sample points lie."""

_ROWS = 128
"""Bodies checked for occlusion at a time, which bounds the memory of a crowded picture."""

_CORNERS = np.array([(a, b, c) for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])
# A lens with distortion bends edges, so that a box may touch them between two corners.
_EDGE_POINTS = np.array(
    [
        point
        for point in itertools.product((-1.0, -0.5, 0.0, 0.5, 1.0), repeat=3)
        if sum(abs(coordinate) == 1.0 for coordinate in point) >= 2
    ]
)
_SAMPLES = (
    np.array([(across, down) for across in (-1.0, 0.0, 1.0) for down in (-1.0, 0.0, 1.0)]) * SAMPLE_SPREAD
)


@dataclass(frozen=True, slots=True)
class Bodies:
    """(n, 3) half length, width, height; (n,) radius of its sphere; (n,) whether it hides others."""

    half_m: Floats
    radius_m: Floats
    solid: NDArray[np.bool_]

    @classmethod
    def of(cls, cast: Sequence[CastMember]) -> Self:
        """The bodies of a cast, in its order."""
        sizes = [(member.length_m, member.width_m, member.height_m) for member in cast]
        half = np.array(sizes, dtype=np.float64).reshape(-1, 3) / 2.0
        solid = np.array([member.definition.solid for member in cast], dtype=np.bool_)
        return cls(half, np.sqrt((half * half).sum(axis=1)), solid)


@dataclass(frozen=True, slots=True)
class _Posed:
    """(k,) indices, (k, 3) centres, (k, 3, 3) axes as rows, halves and radii, in camera coordinates."""

    index: NDArray[np.intp]
    centre: Floats
    axes: Floats
    half: Floats
    radius: Floats

    def only(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> _Posed:
        return _Posed(
            self.index[which], self.centre[which], self.axes[which], self.half[which], self.radius[which]
        )


def sightings(
    camera: PinholeCamera, state: VehicleState, bodies: Bodies, foot_enu_m: Floats, headings_rad: Floats
) -> tuple[Sighting, ...]:
    """Truth about every actor in the picture, in order of the cast; `foot_enu_m` (n, 3) mid footprint."""
    axes = camera.axes_enu(state)
    relative = foot_enu_m - state.position_enu_m
    # Actors are placed by the middle of their footprint; a body's middle is half its height above that.
    relative[:, 2] += bodies.half_m[:, 2]
    centre = product(relative, axes.T)
    candidates = np.flatnonzero(_may_be_in_sight(camera, centre, bodies.radius_m))
    if not len(candidates):
        return ()
    posed = _Posed(
        candidates,
        centre[candidates],
        _body_axes(axes, headings_rad[candidates]),
        bodies.half_m[candidates],
        bodies.radius_m[candidates],
    )
    whole = _boxes(camera, posed)
    size = whole[:, 2:] - whole[:, :2]
    clipped = whole.clip(0.0, (camera.lens.width_px, camera.lens.height_px) * 2)
    inside = clipped[:, 2:] - clipped[:, :2]
    # The floor only avoids a division by zero: a box of no area has no share inside either.
    inside_share = inside[:, 0] * inside[:, 1] / np.maximum(size[:, 0] * size[:, 1], 1e-9)
    apparent = size.max(axis=1)
    large_enough = np.flatnonzero((inside_share >= LEAST_VISIBLE) & (apparent >= LEAST_SIZE_PX))
    if not len(large_enough):
        return ()
    in_picture = posed.only(large_enough)
    # Candidates outside the picture may still hide one inside it, so all of them are tested as solids.
    visible = inside_share[large_enough] * (1.0 - _hidden(in_picture, posed.only(bodies.solid[candidates])))
    columns = zip(
        in_picture.index.tolist(),
        np.sqrt((in_picture.centre * in_picture.centre).sum(axis=1)).tolist(),
        apparent[large_enough].tolist(),
        np.minimum(visible, 1.0).tolist(),
        clipped[large_enough].tolist(),
        strict=True,
    )
    return tuple(
        Sighting(actor, range_m, height_px, visible_share, tuple(box))
        for actor, range_m, height_px, visible_share, box in columns
        if visible_share >= LEAST_VISIBLE
    )


def _may_be_in_sight(camera: PinholeCamera, centre: Floats, radius_m: Floats) -> NDArray[np.bool_]:
    """Whether the sphere round each body meets the frustum (or nearly so: its corners are rounded)."""
    x, y, z = centre.T
    half_width, half_height = camera.half_view
    # Spheres are cheap and never cull too much; the exact corners follow for the few that remain.
    may: NDArray[np.bool_] = (z > LEAST_DEPTH_M - radius_m) & ((x * x + y * y + z * z) < MAX_RANGE_M**2)
    may &= np.abs(x) - z * half_width < radius_m * math.sqrt(1.0 + half_width * half_width)
    may &= np.abs(y) - z * half_height < radius_m * math.sqrt(1.0 + half_height * half_height)
    return may


def _body_axes(camera_axes: Floats, headings_rad: Floats) -> Floats:
    """(k, 3, 3) length, width and height axes of upright bodies, as rows in camera coordinates."""
    s, c = np.sin(headings_rad)[:, None], np.cos(headings_rad)[:, None]
    east, north, up = camera_axes.T
    axes = np.empty((len(headings_rad), 3, 3))
    axes[:, 0], axes[:, 1], axes[:, 2] = s * east + c * north, c * east - s * north, up
    return axes


def _boxes(camera: PinholeCamera, posed: _Posed) -> Floats:
    """(k, 4) left, top, right, bottom round the corners' pixels; through a distorting lens, round points on the edges.

    What reaches behind the camera is cut just before it.
    """
    outline = _CORNERS if camera.lens.distortion == NO_DISTORTION else _EDGE_POINTS
    corners = posed.centre[:, None, :] + product(outline, posed.axes * posed.half[:, :, None])
    # A corner behind the camera is cut just before it: its box then reaches beyond the border.
    depth = np.maximum(corners[..., 2:], LEAST_DEPTH_M)
    pixels = camera.lens.pixels(corners[..., :2] / depth)
    return np.concatenate((pixels.min(axis=1), pixels.max(axis=1)), axis=1)


def _hidden(shown: _Posed, solids: _Posed) -> Floats:
    """(k,) share of nine points on each shown body whose line of sight meets a solid one."""
    hidden = np.zeros(len(shown.index))
    if not len(solids.index):
        return hidden
    if len(hidden) <= _ROWS:
        return _hidden_part(shown, solids)
    # Pairs of shown and solid bodies grow with the square of the crowd.
    for begin in range(0, len(hidden), _ROWS):
        rows = slice(begin, begin + _ROWS)
        part = _Posed(
            shown.index[rows], shown.centre[rows], shown.axes[rows], shown.half[rows], shown.radius[rows]
        )
        hidden[rows] = _hidden_part(part, solids)
    return hidden


def _hidden_part(shown: _Posed, solids: _Posed) -> Floats:
    body, solid = np.nonzero(_may_hide(shown, solids))
    blocked = np.zeros((len(shown.index), len(_SAMPLES)), dtype=np.bool_)
    if not len(body):
        return np.zeros(len(shown.index))
    points = _sample_points(shown)[body]
    # In a solid's axes the box is axis-aligned, as the slab test needs. The camera is the origin.
    eye = -solids.centre[solid][:, None, :]
    turn = solids.axes[solid].transpose(0, 2, 1)
    hits = crosses_box(product(eye, turn), product(points + eye, turn), solids.half[solid][:, None, :])
    # Not `blocked[body] |= hits`: a body occurs once for each solid, and its last row would win.
    np.logical_or.at(blocked, body, hits)
    hidden: Floats = np.count_nonzero(blocked, axis=1) / len(_SAMPLES)
    return hidden


def _may_hide(shown: _Posed, solids: _Posed) -> NDArray[np.bool_]:
    """(k, s) whether a solid's cone overlaps a shown body's and begins before that body ends."""
    range_shown, range_solid = np.sqrt((shown.centre**2).sum(axis=1)), np.sqrt((solids.centre**2).sum(axis=1))
    cosine = product(shown.centre, solids.centre.T) / np.maximum(range_shown[:, None] * range_solid, 1e-9)
    apart = np.arccos(cosine.clip(-1.0, 1.0))
    overlap = apart <= _cone(shown.radius, range_shown)[:, None] + _cone(solids.radius, range_solid)
    before = (range_solid - solids.radius) < (range_shown + shown.radius)[:, None]
    may: NDArray[np.bool_] = overlap & before & (shown.index[:, None] != solids.index)
    return may


def _cone(radius: Floats, distance: Floats) -> Floats:
    """Half angle under which a sphere is seen; everywhere when the eye is inside it."""
    return np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, 1e-9), 1.0)), np.pi)


def _sample_points(shown: _Posed) -> Floats:
    """(k, 9, 3) points of each body, spread over its silhouette: three across times three down.

    They are laid out on the plane through the body's middle, then drawn in to the body.
    """
    edges = shown.axes * shown.half[:, :, None]
    extent = np.abs(edges[..., :2]).sum(axis=1)
    on_plane = _SAMPLES * extent[:, None, :]
    # A body seen at an angle is narrower than its rectangle: clipping keeps samples on it.
    local = product(on_plane, shown.axes[..., :2].transpose(0, 2, 1))
    bound = shown.half[:, None, :]
    points: Floats = shown.centre[:, None, :] + product(local.clip(-bound, bound), shown.axes)
    return points
