"""The default renderer: OpenCV's warps and polygon fills, deterministic on one build of OpenCV, on every CPU core alike.

Ground: mip-mapped `warpPerspective` in bands of equal detail. Solids: their faces from far to near, ordered by planes
that separate them. Light, shadow on the ground and haze are one multiplication and one addition of maps that are drawn
at an eighth of the resolution. What it cannot do stands in docs/camera.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Counts, Floats, Narrow, product
from bench.contracts import CameraPose, Geometry, Labels, Light, Picture, Pixels, Renderer, Stage

from ._canvas import Canvas
from ._ground_painter import FAR_CORNER_PX, GAMMA, SHIFT, GroundPainter, cut_to_frame, fixed_point
from ._painter_order import SolidOrder, body_edges, far_to_near
from ._view import LEAST_BODY_PX, NEAR_M, actor_axes, in_view

_SHADOW_STEPS = 720
"""Shadows are kept for headings in steps of half a degree: below a pixel for all but the largest buildings."""

_SHADOW_CORNERS = 16
_MAX_SHADOW_SOLIDS = 8


def open_opencv_renderer(stage: Stage) -> Renderer:
    """The renderer `opencv` of group `rebar.renderers`."""
    return OpenCvRenderer(stage)


@dataclass(frozen=True, slots=True, eq=False)
class _Kind:
    """What all actors with one geometry share."""

    order: SolidOrder
    first_face: int
    normals: Floats
    offsets: Floats
    middle_m: Floats
    half_m: Floats
    solid_size_m: Floats  # of the solid of each face
    shadow_solids: tuple[Floats, ...]  # corners of the largest solids


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """The polygons of one picture, from far to near: what the truth is read from."""

    polygons: list[NDArray[np.int32]]
    actors: Counts  # (p,) place in the cast
    planes: Floats  # (p, 3) n / (n . p) in the optical frame: one over the depth along a ray is their product
    inverse_depths: Floats  # (p, 2) one over the depth of the farthest and of the nearest corner


class OpenCvRenderer:
    """The `Renderer` contract."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._canvas = Canvas.of(stage.lens)
        self._ground = GroundPainter(stage, self._canvas.lens)
        kinds: dict[int, int] = {}
        geometries: list[Geometry] = []
        for look in stage.looks:
            if id(look.geometry) not in kinds:
                kinds[id(look.geometry)] = len(geometries)
                geometries.append(look.geometry)
        self._kind_of = np.array([kinds[id(look.geometry)] for look in stage.looks], dtype=np.int64)
        faces = np.cumsum([0] + [len(geometry.normals) for geometry in geometries])
        self._kinds = [
            _kind(geometry, int(first)) for geometry, first in zip(geometries, faces[:-1], strict=True)
        ]
        self._corners_m = _stacked([geometry.corners_m for geometry in geometries], (12, 3))
        self._normals = _stacked([geometry.normals for geometry in geometries], (3,))
        self._corner_counts = _stacked([geometry.corner_counts for geometry in geometries], ()).astype(
            np.int64
        )
        looks = np.cumsum([0] + [len(look.colours_bgr) for look in stage.looks])
        self._first_colour = looks[:-1]
        self._colours_bgr = _stacked([look.colours_bgr for look in stage.looks], (3,))
        self._glows = _stacked([look.glows for look in stage.looks], ()).astype(np.bool_)
        self._middles_m = _stacked([kind.middle_m[None] for kind in self._kinds], (3,))
        self._halves_m = _stacked([kind.half_m[None] for kind in self._kinds], (3,))
        self._shadows: dict[tuple[int, int], Floats] = {}

    def render(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Picture:
        axes = actor_axes(headings_rad)
        image = self._ground.paint(pose, self._shadow_polygons(pose, positions_enu_m, headings_rad))
        drawn = self._draw_bodies(image, pose, positions_enu_m, axes)
        return _OpenCvPicture(self._canvas, pose, drawn, self._canvas.smooth(image))

    def _draw_bodies(self, image: Pixels, pose: CameraPose, positions_enu_m: Floats, axes: Floats) -> _Drawn:
        actors, faces, ranges_m = self._visible_faces(pose, positions_enu_m, axes)
        lens = self._canvas.lens
        turn = np.einsum("ij,nkj->nik", pose.axes_enu, axes)[
            actors
        ]  # columns: the actor's axes as the camera sees them
        shift = pose.to_optical(positions_enu_m)[actors]
        corners = np.einsum("fij,fkj->fki", turn, self._corners_m[faces]) + shift[:, None]
        normals = np.einsum("fij,fj->fi", turn, self._normals[faces])
        colours = self._lit(actors, faces, normals, pose, ranges_m).tolist()
        plane = (normals * corners[:, 0]).sum(axis=1)
        planes = normals / np.where(np.abs(plane) > 1e-9, plane, 1e-9)[:, None]
        ahead = corners[..., 2] > NEAR_M
        whole, any_ahead = ahead.all(axis=1), ahead.any(axis=1)
        depth = np.maximum(corners[..., 2], NEAR_M)
        pixels = np.stack(
            (
                lens.fx * corners[..., 0] / depth + (lens.cx - 0.5),
                lens.fy * corners[..., 1] / depth + (lens.cy - 0.5),
            ),
            axis=-1,
        )
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        inside = (
            (high[:, 0] > -1.0)
            & (low[:, 0] < lens.width_px)
            & (high[:, 1] > -1.0)
            & (low[:, 1] < lens.height_px)
        )
        # Far corners come from faces that pass beside the camera; cutting at the frame keeps them in range.
        tame = whole & (np.abs(pixels).max(axis=(1, 2)) < FAR_CORNER_PX)
        points = fixed_point(np.clip(pixels, -1e6, 1e6))
        counts = self._corner_counts[faces].tolist()
        polygons: list[NDArray[np.int32]] = []
        rows: list[int] = []
        fill, smooth_edges = cv2.fillConvexPoly, cv2.LINE_AA
        for index in np.flatnonzero((whole & inside) | (any_ahead & ~tame)).tolist():
            if tame[index]:
                polygon = points[index, : counts[index]]
            else:
                cut = cut_to_frame(corners[index, : counts[index]], lens)
                if len(cut) < 3:
                    continue
                polygon = fixed_point(cut)
            fill(image, polygon, colours[index], smooth_edges, SHIFT)
            polygons.append(polygon)
            rows.append(index)
        inverse_depths = 1.0 / np.stack((depth.max(axis=1), depth.min(axis=1)), axis=-1)
        return _Drawn(polygons, actors[rows], planes[rows], inverse_depths[rows])

    def _visible_faces(
        self, pose: CameraPose, positions_enu_m: Floats, axes: Floats
    ) -> tuple[Counts, Counts, Floats]:
        """(p,) the actor and the face of everything that faces the camera, from far to near; (p,) the actor's range."""
        nothing = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
        if not len(positions_enu_m):
            return nothing
        halves = self._halves_m[self._kind_of]
        centres = positions_enu_m + np.einsum("nij,ni->nj", axes, self._middles_m[self._kind_of])
        lens = self._canvas.lens
        index = in_view(lens, self._stage.light, pose, centres, np.sqrt((halves * halves).sum(axis=1)))
        if not len(index):
            return nothing
        centres, halves, frame = centres[index], halves[index], axes[index]
        order = far_to_near(
            np.sqrt(((centres - pose.position_enu_m) ** 2).sum(axis=1)),
            body_edges(
                centres, frame, halves, pose.position_enu_m, self._windows(pose, centres, frame, halves)
            ),
        )
        local = np.einsum("nij,nj->ni", frame, pose.position_enu_m - positions_enu_m[index])
        ranges = np.sqrt((local * local).sum(axis=1))
        actors, faces = [], []
        for place in order:
            kind = self._kinds[self._kind_of[index[place]]]
            front: Bools = product(kind.normals, local[place]) > kind.offsets
            visible = kind.order.faces(front)
            visible = visible[kind.solid_size_m[visible] * lens.fx > LEAST_BODY_PX * ranges[place]]
            actors.append(np.full(len(visible), place))
            faces.append(visible + kind.first_face)
        rows = np.concatenate(actors)
        return index[rows], np.concatenate(faces), ranges[rows]

    def _windows(self, pose: CameraPose, centres: Floats, frame: Floats, halves: Floats) -> Floats:
        """(k, 4) left, top, right, bottom of boxes in the picture; all of it for boxes that reach behind the camera."""
        signs = np.array([(a, b, c) for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])
        corners = centres[:, None] + np.einsum("ksi,kij->ksj", signs * halves[:, None], frame)
        points = pose.to_optical(corners)
        behind = (points[..., 2] <= NEAR_M).any(axis=1)
        rays = points[..., :2] / np.maximum(points[..., 2], NEAR_M)[..., None]
        windows = np.concatenate((rays.min(axis=1), rays.max(axis=1)), axis=1)
        windows[behind] = (-np.inf, -np.inf, np.inf, np.inf)
        return windows

    def _lit(
        self, actors: Counts, faces: Counts, normals: Floats, pose: CameraPose, ranges_m: Floats
    ) -> Floats:
        """(p, 3) colours of faces in light and haze."""
        light = self._stage.light
        sunward = product(pose.axes_enu, light.sunward_enu)
        up = product(normals, pose.axes_enu[:, 2])
        # Walls see half of the sky, and the ground below reflects some: the factor is 1 facing up, 0.5 facing down.
        sky = 0.75 + 0.25 * up
        linear = (
            sky[:, None] * light.ambient_bgr
            + np.maximum(product(normals, sunward), 0.0)[:, None] * light.direct_bgr
        )
        # Colours belong to looks, faces to geometries: the face's place in its geometry is the same in both.
        place = (
            faces - np.array([kind.first_face for kind in self._kinds], dtype=np.int64)[self._kind_of[actors]]
        )
        row = self._first_colour[actors] + place
        shown = self._colours_bgr[row] * linear**GAMMA
        shown = np.where(self._glows[row][:, None], np.maximum(shown, light.glow_bgr), shown)
        clear = np.exp(-light.extinction_per_m * ranges_m)[:, None]
        lit: Floats = np.clip(shown * clear + (1.0 - clear) * light.haze_bgr, 0, 255)
        return lit

    def _shadow_polygons(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Floats:
        """(s, c, 2) east and north of the shadows' corners on the ground."""
        light = self._stage.light
        nothing = np.zeros((0, _SHADOW_CORNERS, 2))
        if not len(positions_enu_m) or not light.direct_bgr.any() or light.sunward_enu[2] <= 0.0:
            return nothing
        stretch = math.hypot(light.sunward_enu[0], light.sunward_enu[1]) / light.sunward_enu[2]
        halves = self._halves_m[self._kind_of]
        # The sphere holds the body and the far end of its shadow.
        radii = np.sqrt((halves * halves).sum(axis=1)) + 2.0 * halves[:, 2] * stretch
        polygons = [nothing]
        for actor in in_view(self._canvas.lens, light, pose, positions_enu_m, radii).tolist():
            step = round(float(headings_rad[actor]) / (2.0 * math.pi) * _SHADOW_STEPS) % _SHADOW_STEPS
            key = (int(self._kind_of[actor]), step)
            if key not in self._shadows:
                self._shadows[key] = _shadow(self._kinds[key[0]], step, light)
            polygons.append(self._shadows[key] + positions_enu_m[actor, :2])
        return np.concatenate(polygons)


class _OpenCvPicture:
    """The `Picture` contract: the truth is drawn from the picture's own polygons when it is asked for."""

    def __init__(self, canvas: Canvas, pose: CameraPose, drawn: _Drawn, bgr: Pixels) -> None:
        self._canvas, self._pose, self._drawn, self._bgr = canvas, pose, drawn, bgr
        self._polygon_numbers: NDArray[np.int32] | None = None

    @property
    def bgr(self) -> Pixels:
        return self._bgr

    def instances(self) -> Labels:
        # Drawn once more rather than looked up in the polygons' numbers, which costs more than all fills.
        lens = self._canvas.lens
        labels = np.zeros((lens.height_px, lens.width_px), np.uint16)
        for actor, polygon in zip(self._drawn.actors.tolist(), self._drawn.polygons, strict=True):
            cv2.fillConvexPoly(labels, polygon, (actor + 1,), cv2.LINE_8, SHIFT)
        return self._canvas.exact(labels)

    def depth_m(self) -> Narrow:
        lens, up = self._canvas.lens, self._pose.axes_enu[:, 2]
        # The ground is one more plane: below the camera, with its normal upwards.
        ground = (-up / max(float(self._pose.position_enu_m[2]), 0.1)).astype(np.float32)
        x = ((np.arange(lens.width_px) + 0.5 - lens.cx) / lens.fx).astype(np.float32)
        y = ((np.arange(lens.height_px) + 0.5 - lens.cy) / lens.fy).astype(np.float32)
        inverse = ground[0] * x + (ground[1] * y + ground[2])[:, None]
        numbers = self._numbers()
        rows, columns = np.nonzero(numbers)
        polygons = numbers[rows, columns] - 1
        plane = self._drawn.planes.astype(np.float32)[polygons]
        on_plane = plane[:, 0] * x[columns] + plane[:, 1] * y[rows] + plane[:, 2]
        # A pixel on the outline of a steep face has its middle beside it, where the plane is far from the face.
        farthest, nearest = self._drawn.inverse_depths.astype(np.float32)[polygons].T
        inverse[rows, columns] = np.clip(on_plane, farthest, nearest)
        depth: Narrow = np.full(inverse.shape, np.inf, np.float32)
        np.divide(np.float32(1.0), inverse, out=depth, where=inverse > 1e-6)
        return self._canvas.exact(depth)

    def silhouette_px(self, actor: int) -> int:
        lens = self._canvas.lens
        polygons = [
            self._drawn.polygons[index] for index in np.flatnonzero(self._drawn.actors == actor).tolist()
        ]
        if not polygons:
            return 0
        corner, size = np.zeros(2, np.int64), np.array((lens.width_px, lens.height_px))
        if self._canvas.nearest is None:
            # Without distortion the actor's own window is enough; a picture of its own for each costs 0.1 ms.
            every = np.concatenate(polygons)
            corner = np.clip((every.min(axis=0) >> SHIFT) - 1, 0, size)
            size = np.clip((every.max(axis=0) >> SHIFT) + 3, 0, size) - corner
        alone = np.zeros((int(size[1]), int(size[0])), np.uint8)
        for polygon in polygons:
            moved = (polygon - (corner << SHIFT)).astype(np.int32)
            cv2.fillConvexPoly(alone, moved, (1,), cv2.LINE_8, SHIFT)
        return int(np.count_nonzero(self._canvas.exact(alone)))

    def _numbers(self) -> NDArray[np.int32]:
        """(h, w) 1 + the place of the polygon on top of each pixel of the canvas, 0 for the ground and the sky."""
        if self._polygon_numbers is None:
            lens = self._canvas.lens
            numbers = np.zeros((lens.height_px, lens.width_px), np.int32)
            for index, polygon in enumerate(self._drawn.polygons):
                cv2.fillConvexPoly(numbers, polygon, (index + 1,), cv2.LINE_8, SHIFT)
            self._polygon_numbers = numbers
        return self._polygon_numbers


def _kind(geometry: Geometry, first_face: int) -> _Kind:
    every = geometry.corners_m.reshape(-1, 3)
    low, high = every.min(axis=0), every.max(axis=0)
    solids = [
        geometry.corners_m[(geometry.solids == solid) & ~geometry.details].reshape(-1, 3)
        for solid in range(int(geometry.solids.max()) + 1)
    ]
    sizes = np.sqrt([product(extent, extent) for extent in (np.ptp(corners, axis=0) for corners in solids)])
    # The largest solids carry the shape of a shadow; a mirror's or a hand's would not be noticed.
    largest = np.argsort(-sizes, kind="stable")[:_MAX_SHADOW_SOLIDS].tolist()
    # Details shrink out of sight sooner than the solid that they lie on.
    extents = np.ptp(geometry.corners_m, axis=1)
    face_sizes = np.where(
        geometry.details, np.sqrt((extents * extents).sum(axis=1)) / 2.0, sizes[geometry.solids]
    )
    return _Kind(
        SolidOrder(geometry),
        first_face,
        geometry.normals,
        (geometry.normals * geometry.corners_m[:, 0]).sum(axis=1),
        (low + high) / 2.0,
        (high - low) / 2.0,
        face_sizes,
        tuple(solids[solid] for solid in largest),
    )


def _shadow(kind: _Kind, step: int, light: Light) -> Floats:
    """(s, c, 2) outlines of the solids' shadows relative to the foot point, for a heading in steps."""
    axes = actor_axes(np.array([step * 2.0 * math.pi / _SHADOW_STEPS]))[0]
    outlines = np.empty((len(kind.shadow_solids), _SHADOW_CORNERS, 2))
    for row, corners in enumerate(kind.shadow_solids):
        points = product(corners, axes)
        fallen = points[:, :2] - points[:, 2:] / light.sunward_enu[2] * light.sunward_enu[:2]
        hull = cv2.convexHull(fallen.astype(np.float32))[:, 0]
        if len(hull) > _SHADOW_CORNERS:
            hull = hull[np.linspace(0, len(hull) - 1, _SHADOW_CORNERS).astype(np.int64)]
        outlines[row, : len(hull)] = hull
        outlines[row, len(hull) :] = hull[-1]
    return outlines


def _stacked(parts: Sequence[Floats] | Sequence[Counts] | Sequence[Bools], shape: tuple[int, ...]) -> Floats:
    """The parts along their first axis; without any part, an empty array of rows of that shape."""
    stacked: Floats = np.concatenate([np.zeros((0, *shape)), *parts])
    return stacked
