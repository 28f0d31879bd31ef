"""A plug-in of group `rebar.detectors` on the pictures of a camera."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.arrays import Floats
from bench.contracts import (
    CameraFrame,
    CameraPicture,
    Detection,
    DetectionFrame,
    OpenPixelDetector,
    PixelDetector,
    Pixels,
    SimTime,
    VersionedDetector,
    lens_of,
    load_plugin,
    plugins,
    remedy_for,
)
from bench.errors import DetectorFault, SetupError
from bench.simspec import Camera, SimSpec

from ._boxes import PictureSize
from ._delays import DelayedResults, FrameLatency
from ._draws import name_before_tracks
from ._tracker import BegunTracks, KalmanTracker, ground_homography, ground_warp


def open_picture_detectors(
    simspec: SimSpec, open_on_pixels: OpenPixelDetector | None = None
) -> tuple[PictureDetector, ...]:
    """The plug-in that `perception.detector` names, or `open_on_pixels` in its place, on each perceiving camera.

    Raises SetupError when there is none of that name, when it cannot be loaded, or when it refuses its options.
    """
    name = simspec.perception.detector_name
    origin = name
    if open_on_pixels is None:
        open_on_pixels = _plugin(name)
        distribution = plugins("rebar.detectors")[name].dist
        if distribution is not None:
            origin = f"{name} ({distribution.name} {distribution.version})"
    # Opened once: it keeps nothing between pictures, and its weights may be large.
    detector = open_on_pixels(simspec)
    return tuple(PictureDetector(simspec, camera, detector, origin) for camera in simspec.perceiving_cameras)


def _plugin(name: str) -> OpenPixelDetector:
    field = "perception.detector"
    if name not in plugins("rebar.detectors"):
        raise SetupError(field, f"there is no detector {name!r}", remedy_for("rebar.detectors", name))
    try:
        plugin: OpenPixelDetector = load_plugin("rebar.detectors", name)
    except ImportError as error:
        raise SetupError(
            field, f"detector {name!r} cannot be loaded: {error}", "install what it needs"
        ) from error
    return plugin


class PictureDetector:
    """Checks what the plug-in reports, names tracks, and adds the delay of `perception.model`.

    `description` says which detector it is. What the plug-in does wrong raises DetectorFault.
    """

    def __init__(self, simspec: SimSpec, camera: Camera, detector: PixelDetector, origin: str) -> None:
        self._detector, self._labels = detector, simspec.class_labels
        self._name = simspec.perception.detector_name
        version = detector.version if isinstance(detector, VersionedDetector) else ""
        self.description = f"{origin}: {version}" if version else origin
        self._picture = PictureSize(float(camera.width_px), float(camera.height_px))
        self._lens = lens_of(camera)
        prefix = name_before_tracks(simspec, camera)
        self._tracks = KalmanTracker(self._lens.fx, lens=self._lens, prefix=prefix)
        self._begun = BegunTracks(simspec.perception.begin_score, simspec.perception.begin_detections)
        self._ground: Floats | None = None
        self._latency = FrameLatency.of(simspec, camera)
        self._camera = camera.name if prefix else ""
        self._results = DelayedResults(self._camera)

    def process(self, frame: CameraFrame, picture: CameraPicture | None = None) -> None:
        # A frame that the camera lost has no result: its pixels never reached the detector.
        if picture is None:
            return
        detections = self._tracks.name(
            self._detect(frame.number, picture.bgr), frame.exposed, self._warp(picture)
        )
        self._results.put(frame.exposed, self._latency.of_frame(frame.number), self._begun.of(detections))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._results.due(now)

    def _warp(self, picture: CameraPicture) -> Floats | None:
        """From the picture before to this one, over the ground; None for the first. As without the lens's distortion."""
        lens, before = self._lens, self._ground
        self._ground = ground_homography(
            (lens.fx, lens.fy), (lens.cx, lens.cy), picture.axes_enu, np.array(picture.position_enu_m)
        )
        return None if before is None else ground_warp(before, self._ground)

    def _detect(self, number: int, bgr: Pixels) -> list[Detection]:
        of_camera = f" of camera {self._camera!r}" if self._camera else ""
        where = f"detector {self._name!r} in the picture of frame {number}{of_camera}"
        # The same array goes to whoever listens to the camera.
        unchangeable = bgr.view()
        unchangeable.flags.writeable = False
        try:
            return [self._checked(detection) for detection in self._detector.detect(unchangeable)]
        except DetectorFault as fault:
            raise DetectorFault(f"{where}: {fault}") from fault
        except Exception as error:  # a plug-in may raise anything; no agent is to blame for it
            raise DetectorFault(f"{where}: {type(error).__name__}: {error}") from error

    def _checked(self, detection: Detection) -> Detection:
        """The detection in plain numbers, its box inside the picture."""
        if detection.class_label not in self._labels:
            raise DetectorFault(
                f"no class label: {detection.class_label!r}; known: {', '.join(self._labels)}"
            )
        score = float(detection.score)
        if not 0.0 <= score <= 1.0:
            raise DetectorFault(f"the score is {score}: it must be from 0 to 1")
        left, top, right, bottom = (float(edge) for edge in detection.box)
        # Comparisons with NaN are false, so an edge without a number fails them too.
        inside = (
            left < self._picture.width_px and right > 0.0 and top < self._picture.height_px and bottom > 0.0
        )
        if not (inside and left < right and top < bottom and math.isfinite(right - left + bottom - top)):
            raise DetectorFault(
                f"the box is ({left}, {top}, {right}, {bottom}): it must be left, top, right, bottom, each smaller than "
                f"its opposite, and touch the picture of {self._picture.width_px:g} x {self._picture.height_px:g} pixels"
            )
        return Detection(detection.class_label, score, self._picture.fitted(left, top, right, bottom))
