"""A camera over a SimSpec: stage, renderer and sensor together, and the truth about each frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import find_objects

from bench.arrays import Floats, product
from bench.contracts import (
    CameraPose,
    CastMember,
    Ground,
    Lens,
    OpenRenderer,
    Picture,
    Pixels,
    Stage,
    VehicleState,
    body_axes_enu,
    cast_of,
    lens_of,
)
from bench.simspec import Camera, Seeds, SimSpec, generator

from ._conditions import Conditions, conditions_of, light_of_conditions
from ._ground import GroundType, ground_of
from ._looks import look_of
from ._renderer import open_opencv_renderer
from ._sensor import CAMERA_PATH, FrameState, Sensor

_GROUND, _LOOKS = 3, 4  # paths beside those of the sensor


@dataclass(frozen=True, slots=True)
class ActorPixels:
    """What a picture shows of one actor.

    `box` is left, top, right, bottom around its visible pixels; `visible` the share of its silhouette in the picture
    that nothing hides, in (0, 1].
    """

    actor: int
    box: tuple[int, int, int, int]
    visible_px: int
    visible: float


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """One frame as the camera sends it, and what it shows.

    `state.shown` is the frame whose picture `bgr` is, and `picture` holds the truth about the pixels of that one.
    """

    state: FrameState
    bgr: Pixels
    picture: Picture


class RenderedCamera:
    """Pictures of one SimSpec from one camera. Each depends on its arguments alone: frames may be left out."""

    def __init__(
        self,
        stage: Stage,
        conditions: Conditions,
        seeds: Seeds,
        open_renderer: OpenRenderer,
        number: int = 0,
    ) -> None:
        """`number` is the camera's among those of its vehicle: each has noise and faults of its own."""
        self.stage = stage
        self.conditions = conditions
        self.sensor = Sensor(stage.lens, conditions, seeds, number)
        self.renderer = open_renderer(stage)
        self._last: RenderedFrame | None = None

    def capture(
        self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats, number: int
    ) -> RenderedFrame | None:
        """Frame `number` of the camera; None when the camera loses it.

        A frozen camera repeats the picture that it sent last, and the frame's `state.shown` says which. If the caller
        left that one out, nothing can be repeated: the frame shows the present, and freezes repeat it from then on.
        """
        state = self.sensor.state(number)
        if state.shown is None:
            return None
        if state.frozen and self._last is not None and self._repeats(self._last.state.number, state.shown):
            return replace(self._last, state=replace(state, shown=self._last.state.number))
        picture = self.renderer.render(pose, positions_enu_m, headings_rad)
        bgr = self.sensor.expose(picture.bgr, pose, axis_distance_m(pose), number)
        self._last = RenderedFrame(replace(state, shown=number), bgr, picture)
        return self._last

    def _repeats(self, last: int, shown: int) -> bool:
        """Whether the camera has sent no picture from frame `last`, not included, to frame `shown`."""
        between = (self.sensor.state(number) for number in range(last + 1, shown + 1))
        return not any(state.shown == state.number for state in between)


def open_camera(
    simspec: SimSpec,
    camera: Camera | None = None,
    *,
    conditions: Conditions | None = None,
    open_renderer: OpenRenderer = open_opencv_renderer,
    world: Stage | None = None,
) -> RenderedCamera:
    """A camera of a realized SimSpec; `camera` and `conditions` default to the SimSpec's own.

    `world` is the stage of another camera of the same SimSpec, whose ground and looks are shared. Raises SetupError for
    an asset without a look, and for a distortion that cannot be drawn.
    """
    camera = camera or simspec.vehicle.camera
    conditions = conditions or conditions_of(simspec, camera)
    lens = lens_of(camera)
    if world is None:
        stage = stage_of(simspec, lens, conditions, GroundType(simspec.world.ground))
    else:
        stage = replace(world, lens=lens, light=light_of_conditions(conditions))
    # A camera that is not in the SimSpec stands in for its main one.
    names = [each.name for each in simspec.vehicle.cameras]
    number = names.index(camera.name) if camera.name in names else 0
    return RenderedCamera(stage, conditions, simspec.seeds, open_renderer, number)


def stage_of(
    simspec: SimSpec,
    lens: Lens,
    conditions: Conditions,
    kind: GroundType = GroundType.GRASS,
    ground: Ground | None = None,
) -> Stage:
    """The stage of a realized SimSpec: its ground with roads, its light, and a look for each of its cast.

    A `ground` that is given is used as it is: several cameras over one world share it, and it costs most of a stage.
    """
    cast: Sequence[CastMember] = cast_of(simspec)
    ground = ground or ground_of(
        simspec.world.area,
        simspec.world.roads,
        kind,
        generator(simspec.seeds, "perception", CAMERA_PATH, _GROUND),
    )
    average: Floats = ground.texture[::8, ::8].mean(axis=(0, 1)).astype(np.float64)
    looks = tuple(
        look_of(
            member,
            simspec.group(member.group).concealment,
            # One generator for each actor: another actor in the cast changes no other's look.
            generator(simspec.seeds, "perception", CAMERA_PATH, _LOOKS, index),
            average,
        )
        for index, member in enumerate(cast)
    )
    return Stage(lens, ground, light_of_conditions(conditions), looks)


def pose_of(state: VehicleState, axes_enu: Floats, *, stabilized: bool = False) -> CameraPose:
    """The pose of a camera with these axes on a vehicle, at the vehicle's position.

    It turns as the vehicle's body does; on a stabilized mount as the heading alone. A gimbal's own turning is left out.
    """
    if stabilized:
        state = _level_motion(state)
    body = np.array(body_axes_enu(state.roll_rad, state.pitch_rad, state.yaw_rad))
    rates_enu = product(np.array(state.rates_body_radps), body)
    return CameraPose(
        state.time,
        np.array(state.position_enu_m, dtype=np.float64),
        axes_enu,
        np.array(state.velocity_enu_mps, dtype=np.float64),
        product(axes_enu, rates_enu),
    )


def _level_motion(state: VehicleState) -> VehicleState:
    """The attitude and turning of a mount that follows heading alone."""
    _, pitch_radps, yaw_radps = state.rates_body_radps
    roll, pitch = state.roll_rad, state.pitch_rad
    # The rate of the Euler angle yaw. No multicopter flies at a pitch near 90 degrees; the bound keeps it finite.
    turning = (pitch_radps * math.sin(roll) + yaw_radps * math.cos(roll)) / max(0.1, math.cos(pitch))
    return replace(state, roll_rad=0.0, pitch_rad=0.0, rates_body_radps=(0.0, 0.0, turning))


def axis_distance_m(pose: CameraPose) -> float:
    """How far the ground is along the axis; for a camera that looks up or far, as if it fell by a tenth."""
    return float(pose.position_enu_m[2] / max(0.1, -pose.axes_enu[2, 2]))


def actors_in(picture: Picture) -> tuple[ActorPixels, ...]:
    """Every actor with a visible pixel, in the order of the cast."""
    instances = picture.instances()
    actors = []
    for actor, window in enumerate(find_objects(instances)):
        if window is not None:
            visible_px = int(np.count_nonzero(instances[window] == actor + 1))
            rows, columns = window
            box = (columns.start, rows.start, columns.stop, rows.stop)
            share = visible_px / max(1, picture.silhouette_px(actor))
            actors.append(ActorPixels(actor, box, visible_px, share))
    return tuple(actors)
