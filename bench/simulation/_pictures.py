"""The rendered pictures of a session, drawn only when somebody wants them."""

from __future__ import annotations

import hashlib
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.contracts import (
    CAMERA_OPENED,
    ActorPixelsDocument,
    CameraPicture,
    NamesBuild,
    OpenRenderer,
    PictureDocument,
    Pixels,
    Renderer,
    Scene,
    SimTime,
    Stage,
    Vehicle,
    VehicleState,
    load_plugin,
    plugins,
    truth_depth_topic,
    truth_mask_topic,
)
from bench.simspec import DEFAULT_RENDERER, Camera, SimSpec
from bench.streams import CompressedImage, Header, Image, Time

from ._air_network import AirNetwork
from ._air_topics import CameraPublishers
from ._camera import PinholeCamera
from ._frames import optical_frame
from ._truth import TruthRecorder

if TYPE_CHECKING:
    from bench.camera import RenderedCamera, RenderedFrame


@dataclass(frozen=True, slots=True, eq=False)
class _ExposedPicture:
    exposed: SimTime
    bgr: Pixels


@dataclass(slots=True)
class _DrawnWorld:
    """The stage of the camera that was opened first: ground and looks cost most, and all cameras share them."""

    stage: Stage | None = None


def camera_pictures(
    simspec: SimSpec, air: AirNetwork, truth: TruthRecorder, open_renderer: OpenRenderer | None
) -> list[CameraPictures]:
    """The pictures of each camera of a session, the main one first."""
    world = _DrawnWorld()
    return [
        CameraPictures(simspec, camera, publishers, truth, open_renderer, world)
        for camera, publishers in zip(simspec.vehicle.cameras, air.cameras, strict=True)
    ]


class CameraPictures:
    """Renders the frames of one camera, records their digests, and publishes them with the next tick.

    Until a picture is wanted for the first time, nothing is opened and OpenCV is not even imported.
    """

    def __init__(
        self,
        simspec: SimSpec,
        camera: Camera,
        publishers: CameraPublishers,
        truth: TruthRecorder,
        open_renderer: OpenRenderer | None,
        world: _DrawnWorld,
    ) -> None:
        self._spec = simspec
        self._settings = camera
        self._is_main = camera is simspec.vehicle.camera
        self._mount = PinholeCamera.of(camera)
        self._optical = optical_frame(simspec, camera)
        self._raw, self._compressed = publishers.raw, publishers.compressed
        self._truth = truth
        self._open_renderer = open_renderer
        self._world = world
        self._camera: RenderedCamera | None = None
        self._pending: deque[_ExposedPicture] = deque()

    @property
    def wanted(self) -> bool:
        """Whether the SimSpec asks for the next picture, its detector needs it, or the agent listens."""
        perceiving = self._is_main or self._settings.name in self._spec.perception.more_cameras
        detected = perceiving and self._spec.perception.on_pixels
        listened = self._raw.listened or self._compressed.listened
        return self._settings.draws_for_the_recording or detected or listened

    def capture(self, state: VehicleState, scene: Scene, number: int, now: SimTime) -> Pixels | None:
        """Render frame `number` from where the vehicle is; None when the camera loses it."""
        # Imported here: a session without pictures does not pay for OpenCV.
        from bench.camera import pose_of

        if self._camera is None:
            self._camera = self._open(now)
        pose = pose_of(state, self._mount.axes_enu(state), stabilized=self._mount.stabilized)
        frame = self._camera.capture(pose, scene.positions(), scene.headings(), number)
        self._truth.write_picture(now, self._document(number, frame))
        if frame is None:
            return None
        self._record_truth(now, frame)
        self._pending.append(_ExposedPicture(now, frame.bgr))
        return frame.bgr

    def capture_with_pose(
        self, vehicle: Vehicle, scene: Scene, number: int, now: SimTime
    ) -> CameraPicture | None:
        """The same, with the pose that the vehicle believes to have."""
        bgr = self.capture(vehicle.truth(), scene, number, now)
        if bgr is None:
            return None
        estimate = vehicle.estimate()
        return CameraPicture(bgr, self._mount.axes_enu(estimate), estimate.position_enu_m)

    def publish(self, now: SimTime) -> None:
        """Publish the pictures exposed since the last call to whoever listens."""
        while self._pending:
            picture = self._pending.popleft()
            header = Header(stamp=Time.of(picture.exposed.ns), frame_id=self._optical)
            if self._raw.listened:
                height, width = picture.bgr.shape[:2]
                pixels = picture.bgr.tobytes()
                self._raw.publish(now, Image(header, height, width, "bgr8", step=3 * width, data=pixels))
            if self._compressed.listened or self._compressed.recorded:
                from bench.camera import encode_jpeg

                self._compressed.publish(now, CompressedImage(header, "jpeg", encode_jpeg(picture.bgr)))

    def _open(self, now: SimTime) -> RenderedCamera:
        from bench.camera import open_camera, opencv_build, use_one_thread

        use_one_thread()
        name = self._settings.renderer
        open_renderer: OpenRenderer = self._open_renderer or load_plugin("rebar.renderers", name)
        camera = open_camera(self._spec, self._settings, open_renderer=open_renderer, world=self._world.stage)
        self._world.stage = camera.stage
        build = opencv_build()
        if name != DEFAULT_RENDERER:
            build = f"{name}, {_build_of(camera.renderer, name)}; {build}"
        self._truth.write_event(
            now, CAMERA_OPENED, build if self._is_main else f"{self._settings.name}: {build}"
        )
        return camera

    def _record_truth(self, now: SimTime, frame: RenderedFrame) -> None:
        """Record what the pixels show, as far as the SimSpec asks for it; of a frozen frame, that of its picture."""
        from bench.camera import encode_depth, encode_mask

        header, name = Header(stamp=Time.of(now.ns), frame_id=self._optical), self._settings.name
        if self._settings.record_masks:
            data = encode_mask(frame.picture.instances())
            mask = CompressedImage(header, format="mono16; png compressed", data=data)
            self._truth.write_pixels(now, truth_mask_topic(name), mask)
        if self._settings.record_depth:
            data = encode_depth(frame.picture.depth_m())
            depth = CompressedImage(header, format="32FC1; tiff compressed", data=data)
            self._truth.write_pixels(now, truth_depth_topic(name), depth)

    def _document(self, number: int, frame: RenderedFrame | None) -> PictureDocument:
        name = self._settings.name
        if frame is None:
            return PictureDocument(frame=number, camera=name, shown=None, sha256=None)
        return PictureDocument(
            frame=number,
            camera=name,
            shown=frame.state.shown,
            sha256=hashlib.sha256(frame.bgr.tobytes()).hexdigest(),
            actors=_actor_pixels(frame) if self._settings.record_boxes else None,
        )


def _build_of(renderer: Renderer, name: str) -> str:
    """What a renderer's pixels rest on: what it says itself, else the version of its package."""
    if isinstance(renderer, NamesBuild):
        return renderer.build
    package = plugins("rebar.renderers")[name].dist
    return f"{package.name} {package.version}" if package is not None else "unknown version"


def _actor_pixels(frame: RenderedFrame) -> tuple[ActorPixelsDocument, ...]:
    from bench.camera import actors_in

    return tuple(
        ActorPixelsDocument(
            actor=actor.actor,
            box=actor.box,
            visible_px=actor.visible_px,
            visible=round(actor.visible, 4),
        )
        for actor in actors_in(frame.picture)
    )
