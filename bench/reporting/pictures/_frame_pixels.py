"""The pixels of one recorded frame: from the recording, or drawn again from its state and its scene."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from bench.camera import decode_jpeg, open_camera, pose_of
from bench.contracts import (
    TRUTH_PICTURES,
    OpenRenderer,
    OpenScene,
    PictureDocument,
    Pixels,
    SimTime,
    VehicleTopics,
    load_plugin,
    parse_document,
)
from bench.recording import read_records
from bench.simspec import Camera, SimSpec
from bench.simulation import PinholeCamera
from bench.streams import CompressedImage, String, decode

from ._recorded_state import RecordedStates

RECORDED = "as recorded"
DRAWN_AGAIN = "drawn again from the recording, equal in every pixel to the picture of the session"
DRAWN_OTHERWISE = "drawn again from the recording; not every pixel is equal to the picture of the session"


@dataclass(frozen=True, slots=True, eq=False)
class FramePixels:
    """The picture of a frame, and where it comes from."""

    bgr: Pixels
    origin: str


def frame_pixels(
    recording: Path, simspec: SimSpec, camera: Camera, number: int, exposed: SimTime
) -> FramePixels | None:
    """The picture that frame `number` of a camera showed; None when that cannot be told.

    Raises SetupError where the scene, the renderer or a look is not installed.
    """
    jpeg_topic = VehicleTopics(simspec.vehicle.name).image_compressed(camera.name)
    states = RecordedStates(simspec, camera)
    exposures: dict[int, SimTime] = {}
    shown: PictureDocument | None = None
    for record in read_records(recording):
        if record.topic == TRUTH_PICTURES:
            document = _picture(record.data)
            if document is not None and document.camera == camera.name:
                exposures[document.frame] = record.time
                shown = document if document.frame == number else shown
        elif record.topic == jpeg_topic:
            image = decode(CompressedImage, record.data)
            if image is not None and image.header.stamp.ns == exposed.ns:
                bgr = decode_jpeg(image.data)
                return FramePixels(bgr, RECORDED) if bgr is not None else None
        else:
            states.take(record)
    # A frozen frame shows the picture of an older one.
    source = shown.shown if shown is not None and shown.shown is not None else number
    return _drawn_again(simspec, camera, states, source, exposures.get(source, exposed), shown)


def _drawn_again(
    simspec: SimSpec,
    camera: Camera,
    states: RecordedStates,
    number: int,
    exposed: SimTime,
    shown: PictureDocument | None,
) -> FramePixels | None:
    state = states.at(exposed)
    if state is None:
        return None
    open_scene: OpenScene = load_plugin("rebar.scenes", simspec.world.scene)
    scene = open_scene(simspec)
    scene.advance(exposed)
    pose = pose_of(state, PinholeCamera.of(camera).axes_enu(state), stabilized=camera.stabilized)
    open_renderer: OpenRenderer = load_plugin("rebar.renderers", camera.renderer)
    frame = open_camera(simspec, camera, open_renderer=open_renderer).capture(
        pose, scene.positions(), scene.headings(), number
    )
    if frame is None:
        return None
    equal = shown is not None and hashlib.sha256(frame.bgr.tobytes()).hexdigest() == shown.sha256
    return FramePixels(frame.bgr, DRAWN_AGAIN if equal else DRAWN_OTHERWISE)


def _picture(data: bytes) -> PictureDocument | None:
    message = decode(String, data)
    return parse_document(PictureDocument, message.data) if message is not None else None
