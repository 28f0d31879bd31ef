"""One stage on the GPU, and the pictures of it.

The picture is drawn with four samples a pixel. The truth about its pixels is drawn when it is asked for, with one sample
in the pixel's middle: an actor has the pixels whose middles show it.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import cv2
import numpy as np

from bench.arrays import Counts, Floats, Narrow
from bench.camera import NEAR_M, Canvas, actor_axes, in_view, reach_m
from bench.contracts import CameraPose, Ground, Labels, Lens, Picture, Pixels, Stage
from bench.errors import Fault, SetupError

from . import _shaders
from ._mesh import Mesh
from ._shadow_maps import MAP_SIZE, ShadowMap, shadow_maps

_SAMPLES = 4
_MOTION_ROW = 1024  # texels, as in the shaders
_FAR_M = 12000.0
"""Beyond everything that is drawn: `reach_m` is 4 km at most."""

_DETAIL_OFFSET = (-1.0, -4.0)
"""Slope and steps of depth by which windows and signs are drawn before the face that they lie on. Chosen by sight."""

_GROUND_UNIT, _DETAIL_UNIT, _MOTION_UNIT, _NEAR_MAP_UNIT, _FAR_MAP_UNIT = range(5)


Window = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""


class ModernGlRenderer:
    """The `Renderer` contract, and a `NamesBuild`. It owns its context, which ends with it."""

    def __init__(self, stage: Stage, context: Any) -> None:
        self._stage, self._context = stage, context
        # Without it a campaign would keep the context of every session: the binding never frees one by itself.
        weakref.finalize(self, context.release).atexit = False
        self._canvas = Canvas.of(stage.lens)
        self._mesh = Mesh.of(stage.looks)
        # Weakly, because the scene knows its renderer: a cycle would keep the context until the next collection.
        self._placed: weakref.ref[_Scene] | None = None
        with context:
            self._build()

    @property
    def build(self) -> str:
        """Version of moderngl, and the driver that draws."""
        info = self._context.info
        return f"moderngl {version('moderngl')}, {info['GL_RENDERER']}, OpenGL {info['GL_VERSION']}"

    def render(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Picture:
        scene = _Scene(self, pose, positions_enu_m, headings_rad)
        with self._context:
            return ModernGlPicture(self, scene, self._canvas.smooth(self._draw_picture(scene)))

    def truth(self, scene: _Scene) -> tuple[Labels, Narrow]:
        """(h, w) instances and (h, w) depths in metres, through the lens."""
        lens = self._canvas.lens
        window = (0, 0, lens.width_px, lens.height_px)
        with self._context:
            self._draw_truth(scene, scene.actors, window)
            labels, depth_m = self._labels_in(window), self._depths_in(window)
        return self._canvas.exact(labels), self._canvas.exact(depth_m)

    def silhouette_px(self, scene: _Scene, actor: int) -> int:
        """Pixels of an actor that nothing hides."""
        if actor not in scene.actors:
            return 0
        lens = self._canvas.lens
        window = (0, 0, lens.width_px, lens.height_px)
        if self._canvas.nearest is None:
            # Without distortion the actor's own window is enough: to read the whole picture takes some milliseconds.
            window = scene.window_px(actor, lens)
        if not (window[2] and window[3]):
            return 0
        with self._context:
            self._draw_truth(scene, np.array([actor]), window)
            labels = self._labels_in(window)
        return int(
            np.count_nonzero(self._canvas.exact(labels) if self._canvas.nearest is not None else labels)
        )

    def _build(self) -> None:
        context, lens = self._context, self._canvas.lens
        size = (lens.width_px, lens.height_px)
        largest = min(int(context.info["GL_MAX_TEXTURE_SIZE"]), *context.info["GL_MAX_VIEWPORT_DIMS"])
        if max(size) > largest:
            raise SetupError(
                Fault(
                    f"camera {lens.name}: width_px, height_px",
                    f"the picture before distortion has {size[0]} x {size[1]} pixels",
                    f"this OpenGL draws at most {largest}; make it smaller",
                )
            )
        self._sampled = context.framebuffer(
            [context.renderbuffer(size, 4, samples=_SAMPLES)],
            context.depth_renderbuffer(size, samples=_SAMPLES),
        )
        self._resolved = context.framebuffer([context.renderbuffer(size, 4)])
        self._truth = context.framebuffer(
            [context.texture(size, 1, dtype="u2"), context.texture(size, 1, dtype="f4")],
            context.depth_renderbuffer(size),
        )
        vertices = context.buffer(self._mesh.vertices.tobytes() or bytes(self._mesh.vertices.itemsize))
        self._colour, self._labels, self._ground, self._bare = (
            context.program(vertex_shader=vertex, fragment_shader=fragment)
            for vertex, fragment in (
                (_shaders.SOLID_VERTEX, _shaders.SOLID_COLOUR),
                (_shaders.SOLID_VERTEX, _shaders.SOLID_TRUTH),
                (_shaders.PICTURE_VERTEX, _shaders.GROUND_COLOUR),
                (_shaders.PICTURE_VERTEX, _shaders.GROUND_TRUTH),
            )
        )
        self._shadow = context.program(
            vertex_shader=_shaders.SHADOW_VERTEX, fragment_shader=_shaders.SHADOW_FRAGMENT
        )
        coloured = [(vertices, "3f4 3f4 4f1 1i4", "corner", "normal", "paint", "actor")]
        self._coloured = context.vertex_array(self._colour, coloured)
        self._labelled = context.vertex_array(self._labels, [(vertices, "3f4 16x 1i4", "corner", "actor")])
        self._shading = context.vertex_array(self._shadow, [(vertices, "3f4 16x 1i4", "corner", "actor")])
        corners = context.buffer(np.array(((-1, -1), (3, -1), (-1, 3)), "f4").tobytes())
        self._sheet = context.vertex_array(self._ground, [(corners, "2f4", "corner")])
        self._bare_sheet = context.vertex_array(self._bare, [(corners, "2f4", "corner")])
        actors = max(1, len(self._stage.looks))
        self._motions = context.texture((_MOTION_ROW, -(-3 * actors // _MOTION_ROW)), 4, dtype="f4")
        self._motions.filter = (context.NEAREST, context.NEAREST)
        self._maps = [context.depth_texture((MAP_SIZE, MAP_SIZE)) for _ in range(2)]
        for texture in self._maps:
            texture.compare_func = "<="
            texture.filter = (context.LINEAR, context.LINEAR)
            texture.repeat_x = texture.repeat_y = False
        self._map_buffers = [context.framebuffer(depth_attachment=texture) for texture in self._maps]
        self._earth = self._mip_mapped(_ground_texture(self._stage.ground, largest))
        self._fine = self._mip_mapped(self._stage.ground.detail[..., None])
        self._set_constants()

    def _mip_mapped(self, pixels: Pixels) -> Any:
        context = self._context
        rows, columns, channels = pixels.shape
        texture = context.texture(
            (columns, rows), channels, np.ascontiguousarray(pixels).tobytes(), alignment=1
        )
        texture.build_mipmaps()
        texture.filter = (context.LINEAR_MIPMAP_LINEAR, context.LINEAR)
        texture.repeat_x = texture.repeat_y = True
        return texture

    def _set_constants(self) -> None:
        lens, light, ground = self._canvas.lens, self._stage.light, self._stage.ground
        rows, columns = ground.texture.shape[:2]
        far, near = _FAR_M, NEAR_M
        constants: dict[str, object] = {
            "lens": (
                2.0 * lens.fx / lens.width_px,
                2.0 * lens.fy / lens.height_px,
                2.0 * lens.cx / lens.width_px - 1.0,
                2.0 * lens.cy / lens.height_px - 1.0,
            ),
            "depths": ((far + near) / (far - near), -2.0 * far * near / (far - near)),
            "pinhole": (lens.fx, lens.fy, lens.cx, lens.cy),
            "ambient": tuple(light.ambient_bgr),
            "direct": tuple(light.direct_bgr),
            "haze": tuple(light.haze_bgr / 255.0),
            "zenith": tuple(light.zenith_bgr / 255.0),
            "glow": tuple(light.glow_bgr / 255.0),
            "extinction": light.extinction_per_m,
            "ground_size": (columns * ground.texel_m, rows * ground.texel_m),
            "detail_size": ground.detail.shape[0] * ground.detail_texel_m,
            "ground": _GROUND_UNIT,
            "detail": _DETAIL_UNIT,
            "motions": _MOTION_UNIT,
            "near_map": _NEAR_MAP_UNIT,
            "far_map": _FAR_MAP_UNIT,
        }
        self._set(constants)

    def _set(self, uniforms: dict[str, object]) -> None:
        """Set uniforms in each program that has them: a compiler leaves out what a program does not use."""
        for program in (self._colour, self._labels, self._ground, self._bare, self._shadow):
            for name, value in uniforms.items():
                if name in program:
                    if isinstance(value, np.ndarray):
                        # OpenGL wants columns side by side.
                        program[name].write(np.ascontiguousarray(value.T, "f4").tobytes())
                    else:
                        program[name].value = value

    def _draw_picture(self, scene: _Scene) -> Pixels:
        context, light = self._context, self._stage.light
        self._place(scene)
        sunward = scene.pose.axes_enu @ light.sunward_enu
        maps: list[ShadowMap] = []
        if light.direct_bgr.any() and light.sunward_enu[2] > 0.0 and len(scene.actors):
            maps = self._draw_shadows(scene, sunward)
        self._set({"sunward": tuple(sunward), "shadow_maps": len(maps)})
        if maps:
            near, far = maps
            self._set({"near_sun": near.from_optical, "far_sun": far.from_optical})
            self._set({"shadow_texel_m": (near.texel_m, far.texel_m)})
        self._earth.use(_GROUND_UNIT)
        self._fine.use(_DETAIL_UNIT)
        self._sampled.use()
        self._sampled.clear(depth=1.0)
        # The ground is below everything, so it needs no depth.
        context.disable(context.DEPTH_TEST | context.CULL_FACE)
        self._sheet.render()
        self._draw_actors(self._coloured, scene.actors)
        context.copy_framebuffer(self._resolved, self._sampled)
        lens = self._canvas.lens
        data = np.frombuffer(self._resolved.read(components=4), np.uint8)
        # Four channels come faster than three, which the driver would have to pack.
        return np.ascontiguousarray(data.reshape(lens.height_px, lens.width_px, 4)[..., :3])

    def _draw_truth(self, scene: _Scene, actors: Counts, window: Window) -> None:
        context = self._context
        self._place(scene)
        self._truth.scissor = window
        self._truth.use()
        self._truth.clear(depth=1.0)
        context.disable(context.DEPTH_TEST | context.CULL_FACE)
        self._bare_sheet.render()
        self._draw_actors(self._labelled, actors)

    def _labels_in(self, window: Window) -> Labels:
        data = self._truth.read(viewport=window, components=1, attachment=0, dtype="u2", alignment=1)
        return np.frombuffer(data, np.uint16).reshape(window[3], window[2]).copy()

    def _depths_in(self, window: Window) -> Narrow:
        data = self._truth.read(viewport=window, components=1, attachment=1, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(window[3], window[2]).copy()

    def _place(self, scene: _Scene) -> None:
        """Put camera and actors where they are, unless they are there."""
        if self._placed is not None and self._placed() is scene:
            return
        self._placed = weakref.ref(scene)
        pose, ground = scene.pose, self._stage.ground
        self._motions.write(scene.motions().tobytes())
        self._motions.use(_MOTION_UNIT)
        east, north, up = pose.axes_enu.T
        x, y = float(pose.position_enu_m[0]), float(pose.position_enu_m[1])
        period = ground.detail.shape[0] * ground.detail_texel_m
        self._set(
            {
                "east": tuple(east),
                "north": tuple(north),
                "up": tuple(up),
                # As of the default renderer: a camera on the ground sees it from a tenth of a metre.
                "height": max(float(pose.position_enu_m[2]), 0.1),
                "ground_corner": (x - ground.west_m, ground.north_m - y),
                # Whole periods are taken out here, where numbers have 64 bits.
                "detail_corner": (x % period, -y % period),
            }
        )

    def _draw_shadows(self, scene: _Scene, sunward: Floats) -> list[ShadowMap]:
        context = self._context
        casters = scene.casters(sunward)
        maps = shadow_maps(casters, scene.centres_optical_m[casters], self._mesh.radii_m[casters], sunward)
        context.enable_only(context.DEPTH_TEST)
        for buffer, texture, each, unit in zip(
            self._map_buffers, self._maps, maps, (_NEAR_MAP_UNIT, _FAR_MAP_UNIT), strict=True
        ):
            texture.use(unit)
            if not len(each.actors):
                # Nothing lies inside of such a map, and to clear it takes milliseconds on a CPU.
                continue
            buffer.use()
            buffer.clear(depth=1.0)
            self._set({"sun": each.from_optical})
            self._render(self._shading, self._mesh.plain[each.actors])
        return maps

    def _draw_actors(self, array: Any, actors: Counts) -> None:
        context = self._context
        context.enable_only(context.DEPTH_TEST | context.CULL_FACE)
        context.depth_func = "<="
        # The picture's y points down, which turns the sense of every face round.
        context.front_face = "cw"
        self._render(array, self._mesh.plain[actors])
        context.polygon_offset = _DETAIL_OFFSET
        self._render(array, self._mesh.details[actors])
        context.polygon_offset = (0.0, 0.0)

    def _render(self, array: Any, ranges: Counts) -> None:
        """Draw ranges (k, 2) of vertices with one call: first vertex and count."""
        ranges = ranges[ranges[:, 1] > 0]
        if not len(ranges):
            return
        # moderngl spaces commands of plain draws like those of indexed ones, by five numbers.
        commands = np.zeros((len(ranges), 5), np.uint32)
        commands[:, 0], commands[:, 1], commands[:, 2] = ranges[:, 1], 1, ranges[:, 0]
        buffer = self._context.buffer(commands.tobytes())
        array.render_indirect(buffer, count=len(ranges))
        buffer.release()

    def spheres(self, positions_enu_m: Floats, axes: Floats) -> tuple[Floats, Floats]:
        """(n, 3) middles in ENU and (n,) radii of spheres around the actors."""
        return positions_enu_m + np.einsum("nij,ni->nj", axes, self._mesh.middles_m), self._mesh.radii_m

    def visible(self, pose: CameraPose, centres: Floats, radii: Floats) -> Counts:
        """(k,) actors that the picture may show."""
        return in_view(self._canvas.lens, self._stage.light, pose, centres, radii)

    @property
    def reach_m(self) -> float:
        """How far something is drawn."""
        return reach_m(self._stage.light)

    @property
    def map_rows(self) -> int:
        """Rows of the texture of motions."""
        return int(self._motions.height)


class _Scene:
    """Camera and actors of one picture."""

    def __init__(
        self, renderer: ModernGlRenderer, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats
    ) -> None:
        self._renderer = renderer
        self.pose = pose
        # Kept for the truth, which may be asked for after the caller has moved its actors.
        self._positions_m = np.array(positions_enu_m, dtype=np.float64).reshape(-1, 3)
        self._axes = actor_axes(headings_rad)
        centres, self._radii = renderer.spheres(self._positions_m, self._axes)
        self._centres = centres
        self.actors = renderer.visible(pose, centres, self._radii)
        self.centres_optical_m = pose.to_optical(centres)

    def motions(self) -> Narrow:
        """(rows, 1024, 4) of each actor the three rows of its motion into the optical frame."""
        turn = np.einsum("ij,nkj->nik", self.pose.axes_enu, self._axes)
        shift = self.pose.to_optical(self._positions_m)
        rows = np.concatenate((turn, shift[:, :, None]), axis=2).reshape(-1, 4)
        texture = np.zeros((self._renderer.map_rows * _MOTION_ROW, 4), np.float32)
        texture[: len(rows)] = rows
        return texture.reshape(-1, _MOTION_ROW, 4)

    def window_px(self, actor: int, lens: Lens) -> Window:
        """A window of the picture that holds an actor: left, top, width, height; all of it when the actor is too near."""
        x, y, z = self.centres_optical_m[actor].tolist()
        radius = float(self._radii[actor])
        if z - radius <= NEAR_M:
            return 0, 0, lens.width_px, lens.height_px
        bounds = []
        for middle, focal, centre, size in (
            (x, lens.fx, lens.cx, lens.width_px),
            (y, lens.fy, lens.cy, lens.height_px),
        ):
            # The corners of the cube around the sphere.
            edges = [
                centre + focal * (middle + side) / (z + depth)
                for side in (-radius, radius)
                for depth in (-radius, radius)
            ]
            bounds.append((max(0, math.floor(min(edges))), min(size, math.ceil(max(edges)))))
        (left, right), (top, bottom) = bounds
        return left, top, max(0, right - left), max(0, bottom - top)

    def casters(self, sunward: Floats) -> Counts:
        """(k,) actors whose shadows the picture may show."""
        # The sphere holds the body and the far end of its shadow on the ground.
        up = self.pose.axes_enu[:, 2]
        rise = max(float(sunward @ up), 1e-3)
        longest = np.minimum(2.0 * self._radii / rise, self._renderer.reach_m)
        return self._renderer.visible(self.pose, self._centres, self._radii + longest)


class ModernGlPicture:
    """The `Picture` contract: the truth is drawn when it is asked for, once."""

    def __init__(self, renderer: ModernGlRenderer, scene: _Scene, bgr: Pixels) -> None:
        self._renderer, self._scene, self._bgr = renderer, scene, bgr
        self._truth: tuple[Labels, Narrow] | None = None

    @property
    def bgr(self) -> Pixels:
        return self._bgr

    def instances(self) -> Labels:
        return self._drawn()[0]

    def depth_m(self) -> Narrow:
        return self._drawn()[1]

    def silhouette_px(self, actor: int) -> int:
        return self._renderer.silhouette_px(self._scene, actor)

    def _drawn(self) -> tuple[Labels, Narrow]:
        if self._truth is None:
            self._truth = self._renderer.truth(self._scene)
        return self._truth


def _ground_texture(ground: Ground, largest: int) -> Pixels:
    """The ground's texture, halved until OpenGL takes it."""
    texture = ground.texture
    while max(texture.shape[:2]) > largest:
        size: Sequence[int] = (texture.shape[1] // 2, texture.shape[0] // 2)
        texture = np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), np.uint8)
    return texture
