"""The rendered pictures of a session, drawn only when somebody wants them."""

from __future__ import annotations

import hashlib
import math
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bench.contracts import (
    CAMERA_OPENED,
    ActorPixelsDocument,
    OpenRenderer,
    PictureDocument,
    Pixels,
    Scene,
    SimTime,
    VehicleState,
    load_plugin,
)
from bench.simspec import SimSpec
from bench.streams import CompressedImage, Header, Image, Time

from ._air_network import AirNetwork
from ._camera import PinholeCamera
from ._frames import optical_frame
from ._truth import TruthRecorder

if TYPE_CHECKING:
    from bench.camera import RenderedCamera, RenderedFrame

RENDERER = "opencv"


@dataclass(frozen=True, slots=True, eq=False)
class _ExposedPicture:
    exposed: SimTime
    bgr: Pixels


class SessionPictures:
    """Renders the frames of one session's camera, records their digests, and publishes them with the next tick.

    Until a picture is wanted for the first time, nothing is opened and OpenCV is not even imported.
    """

    def __init__(
        self, simspec: SimSpec, air: AirNetwork, truth: TruthRecorder, open_renderer: OpenRenderer | None
    ) -> None:
        self._spec = simspec
        self._settings = simspec.vehicle.camera
        self._lens = PinholeCamera.of(self._settings)
        self._optical = optical_frame(simspec)
        self._raw, self._compressed = air.image_raw, air.image_compressed
        self._truth = truth
        self._open_renderer = open_renderer
        self._camera: RenderedCamera | None = None
        self._drawn = -1
        self._pending: deque[_ExposedPicture] = deque()

    @property
    def wanted(self) -> bool:
        """Whether the next picture is for anything: the SimSpec asks for it, its detector works on pictures, or the
        agent listens.
        """
        settings = self._settings
        by_simspec = settings.record_frames or settings.record_boxes or self._spec.perception.on_pixels
        return by_simspec or self._raw.listened or self._compressed.listened

    def capture(self, state: VehicleState, scene: Scene, number: int, now: SimTime) -> Pixels | None:
        """Render frame `number` from where the vehicle is; None when the camera loses it."""
        # Imported here: a session without pictures does not pay for OpenCV.
        from bench.camera import pose_of

        if self._camera is None:
            self._camera = self._open(now)
        pose = pose_of(_carrier_motion(state, self._lens.stabilized), self._lens.axes_enu(state))
        frame = self._camera.capture(pose, scene.positions(), scene.headings(), number)
        self._truth.write_picture(now, self._document(number, frame))
        if frame is None:
            return None
        self._pending.append(_ExposedPicture(now, frame.bgr))
        return frame.bgr

    def publish(self, now: SimTime) -> None:
        """Publish the pictures exposed since the last call to whoever listens."""
        while self._pending:
            picture = self._pending.popleft()
            header = Header(stamp=Time.of(picture.exposed.ns), frame_id=self._optical)
            if self._raw.listened:
                self._raw.publish(now, _raw_image(header, picture.bgr))
            if self._compressed.listened or self._compressed.recorded:
                self._compressed.publish(now, _jpeg_image(header, picture.bgr))

    def _open(self, now: SimTime) -> RenderedCamera:
        from bench.camera import open_camera, opencv_build, use_one_thread

        use_one_thread()
        open_renderer: OpenRenderer = self._open_renderer or load_plugin("rebar.renderers", RENDERER)
        camera = open_camera(self._spec, open_renderer=open_renderer)
        self._truth.write_event(now, CAMERA_OPENED, opencv_build())
        return camera

    def _document(self, number: int, frame: RenderedFrame | None) -> PictureDocument:
        name = self._settings.name
        if frame is None:
            return PictureDocument(frame=number, camera=name, shown=None, sha256=None)
        # A camera that freezes while it loses frames repeats the last picture that it had.
        if not frame.state.frozen or self._drawn < 0:
            self._drawn = number
        return PictureDocument(
            frame=number,
            camera=name,
            shown=self._drawn,
            sha256=hashlib.sha256(frame.bgr.tobytes()).hexdigest(),
            actors=_actor_pixels(frame) if self._settings.record_boxes else None,
        )


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


def _carrier_motion(state: VehicleState, stabilized: bool) -> VehicleState:
    """The attitude and turning of what carries the camera: a stabilized mount follows heading alone."""
    if not stabilized:
        return state
    _, pitch_radps, yaw_radps = state.rates_body_radps
    roll, pitch = state.roll_rad, state.pitch_rad
    # The rate of the Euler angle yaw. No multicopter flies at a pitch near 90 degrees; the bound keeps it finite.
    turning = (pitch_radps * math.sin(roll) + yaw_radps * math.cos(roll)) / max(0.1, math.cos(pitch))
    return replace(state, roll_rad=0.0, pitch_rad=0.0, rates_body_radps=(0.0, 0.0, turning))


def _raw_image(header: Header, bgr: Pixels) -> Image:
    height, width = bgr.shape[:2]
    return Image(header, height, width, encoding="bgr8", step=3 * width, data=bgr.tobytes())


def _jpeg_image(header: Header, bgr: Pixels) -> CompressedImage:
    from bench.camera import encode_jpeg

    return CompressedImage(header, format="jpeg", data=encode_jpeg(bgr))
