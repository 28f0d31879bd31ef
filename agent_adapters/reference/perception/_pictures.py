"""Detections that the agent makes itself: a detector on its camera's pictures, and identities over them."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.camera import use_one_thread
from bench.clock import SimTime
from bench.contracts import Detection, PixelDetector
from bench.perception import BegunTracks, KalmanTracker, ground_homography, ground_warp
from bench.perception.pixels import SmallDetector, SmallDetectorOptions, load_model
from bench.streams import (
    BoundingBox2D,
    CompressedImage,
    Detection2D,
    Detection2DArray,
    Header,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
    Point2D,
    Pose2D,
)

from ._camera import GroundCamera
from ._pose import PoseHistory

# Below this the ground is too near, and the plane that the tracker follows would lie over the camera. Chosen.
LEAST_HEIGHT_M = 3.0


class PictureDetections:
    """From pictures to what the bench would publish as detections.

    `camera` is None until the agent knows its camera; pictures before that are not looked at.
    """

    def __init__(
        self, detector: PixelDetector, poses: PoseHistory, camera: Callable[[], GroundCamera | None]
    ) -> None:
        self._detector, self._poses, self._camera = detector, poses, camera
        self._tracker: KalmanTracker | None = None
        self._begun = BegunTracks()
        self._ground: NDArray[np.float64] | None = None
        self._last: SimTime | None = None

    def detections(self, image: CompressedImage) -> Detection2DArray | None:
        """What is in the picture, with the stamp of its exposure; None when it cannot be read, or is an old one."""
        camera, exposed = self._camera(), SimTime(image.header.stamp.ns)
        data = np.frombuffer(image.data, np.uint8)
        # OpenCV raises for no bytes at all, and gives None for what is no picture.
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
        # In real time a picture may overtake another.
        if camera is None or bgr is None or (self._last is not None and exposed <= self._last):
            return None
        self._last = exposed
        if self._tracker is None:
            self._tracker = KalmanTracker(camera.lens.fx, lens=camera.lens.model())
        found = self._detector.detect(np.asarray(bgr, np.uint8))
        named = self._tracker.name(found, exposed, self._warp(camera, exposed))
        return Detection2DArray(
            image.header, tuple(_detection(image.header, detection) for detection in self._begun.of(named))
        )

    def _warp(self, camera: GroundCamera, exposed: SimTime) -> NDArray[np.float64] | None:
        """From the last picture to this one; None where a pose is missing."""
        before, self._ground = self._ground, None
        pose = self._poses.at(exposed.s)
        if pose is None or pose.height_m < LEAST_HEIGHT_M:
            return None
        place = np.array([pose.east_m, pose.north_m, pose.height_m])
        lens = camera.lens
        self._ground = ground_homography((lens.fx, lens.fy), (lens.cx, lens.cy), camera.axes_enu(pose), place)
        return None if before is None else ground_warp(before, self._ground)


def open_shipped_detector() -> PixelDetector:
    """The small network that ships with the bench, on one thread: the machine's other cores fly other sessions."""
    use_one_thread()
    return SmallDetector(load_model(), SmallDetectorOptions())


def _detection(header: Header, detection: Detection) -> Detection2D:
    left, top, right, bottom = detection.box
    middle = Pose2D(Point2D((left + right) / 2.0, (top + bottom) / 2.0))
    return Detection2D(
        header,
        (ObjectHypothesisWithPose(ObjectHypothesis(detection.class_label, detection.score)),),
        BoundingBox2D(middle, right - left, bottom - top),
        detection.track,
    )
