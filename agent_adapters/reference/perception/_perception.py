"""From detections in pixels to tracks on the ground, with the agent's own pose at the moment of exposure."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from bench.streams import CameraInfo, Detection2D, Detection2DArray, Quaternion, TFMessage

from ._camera import GroundCamera
from ._pose import PoseHistory, VehiclePose
from ._quality import DetectionQuality
from ._tracks import PEOPLE, PlacedDetection, Tracks

FRAMES_KEPT = 512
# Spacing of the places at which a disc is checked for having been seen. Chosen, not measured.
DISC_STEP_M = 8.0
# A place farther away has not been looked at, whatever the image shows: people are too small there. Chosen,
# not measured.
USEFUL_M = 140.0

# Half the usual height of things: a box's middle is taken to be this high above the ground.
_MIDDLE_M = {
    "civilian": 0.9,
    "combatant": 0.9,
    "aid_worker": 0.9,
    "building": 2.5,
    "tree": 3.0,
    "mobile_radar": 2.0,
}
_USUAL_MIDDLE_M = 1.0


class ObjectPerception:
    """What the camera has shown so far."""

    def __init__(self, poses: PoseHistory, mount: str, *, own_identities: bool = False) -> None:
        self.tracks = Tracks()
        self.quality = DetectionQuality()
        self.frames = 0
        self.heard_s = 0.0  # when the detector last said anything
        self.unplaced = 0  # frames without a pose, or before the camera was known
        self._poses = poses
        self._mount_setting = mount
        # Whether the ids of detections are those of the agent's own tracker. How far those of the bench are to be trusted
        # is not known, so nothing is made of them.
        self._own_identities = own_identities
        self._info: CameraInfo | None = None
        self._mount: tuple[Quaternion, bool] | None = None
        self._camera: GroundCamera | None = None
        self._views: deque[tuple[float, float, float, float, float]] = deque(maxlen=FRAMES_KEPT)

    @property
    def camera(self) -> GroundCamera | None:
        """None until both camera_info and /tf_static have been heard."""
        if self._camera is None and self._info is not None and self._mount is not None:
            quaternion, level = self._mount
            self._camera = GroundCamera.of(self._info, quaternion, level=level)
        return self._camera

    @property
    def knows_camera(self) -> bool:
        return self._info is not None

    def take_info(self, info: CameraInfo) -> None:
        self._info = info

    def take_mount(self, transforms: TFMessage) -> None:
        """The first transform to an optical frame is the camera's.

        A parent named base_level is a mount that keeps level.
        """
        for transform in transforms.transforms:
            if transform.child_frame_id.endswith("optical"):
                level = (
                    transform.header.frame_id.endswith("level")
                    if self._mount_setting == "auto"
                    else self._mount_setting == "level"
                )
                self._mount = (transform.transform.rotation, level)
                return

    def process_detections(self, now_s: float) -> None:
        """The detector has said something, be it that it sees nothing."""
        self.heard_s = now_s

    def see(self, frame: Detection2DArray, doubt_m: float = 0.0) -> bool:
        """Take in one frame; False when it could not be placed. `doubt_m`: one sigma that the agent's own
        place is off by.
        """
        time_s = frame.header.stamp.ns * 1e-9
        self.quality.take(time_s, (d.results[0].hypothesis.score for d in frame.detections if d.results))
        pose = self._poses.at(time_s)
        camera = self.camera
        if pose is None or camera is None or pose.height_m < 1.0:
            self.unplaced += 1
            return False
        self.frames += 1
        self._views.append((time_s, pose.east_m, pose.north_m, pose.height_m, pose.yaw_rad))
        self.tracks.take(
            time_s,
            [
                sight
                for detection in frame.detections
                if (sight := self._sight(detection, time_s, pose, camera, doubt_m))
            ],
        )
        self._notice_absence(time_s, camera)
        return True

    def _sight(
        self, detection: Detection2D, time_s: float, pose: VehiclePose, camera: GroundCamera, doubt_m: float
    ) -> PlacedDetection | None:
        """One detection on the ground; None when it has no class or meets no ground."""
        results, box = detection.results, detection.bbox
        if not results:
            return None
        best = max(results, key=lambda result: result.hypothesis.score).hypothesis
        middle_m = _MIDDLE_M.get(best.class_id, _USUAL_MIDDLE_M)
        point = camera.ground_point(box.center.position.x, box.center.position.y, pose, middle_m)
        if point is None:
            return None
        east_m, north_m = pose.east_m - point[0], pose.north_m - point[1]
        return PlacedDetection(
            time_s,
            *point,
            best.class_id,
            min(max(best.score, 0.0), 1.0),
            math.atan2(east_m, north_m),
            math.sqrt(east_m**2 + north_m**2 + pose.height_m**2),
            doubt_m,
            detection.id if self._own_identities else "",
        )

    def _notice_absence(self, time_s: float, camera: GroundCamera) -> None:
        """People whose place this frame shows without them were missed, or have gone."""
        _, *view = self._views[-1]
        # In a square first: what is left for the camera is often nobody, and arrays of a few are slow.
        people = [
            track
            for track in self.tracks
            if track.label in PEOPLE
            and track.last_s < time_s
            and abs(track.east_m - view[0]) < USEFUL_M
            and abs(track.north_m - view[1]) < USEFUL_M
        ]
        if people:
            places = np.array([(track.east_m, track.north_m) for track in people])
            pose = np.array([view])
            in_range = np.hypot(places[:, 0] - pose[0, 0], places[:, 1] - pose[0, 1]) < USEFUL_M
            shown = camera.in_view(places, pose)[0] & in_range
            self.tracks.miss(track for track, was_shown in zip(people, shown, strict=True) if was_shown)

    def unseen_share(self, east_m: float, north_m: float, radius_m: float, since_s: float) -> float:
        """Share of a disc on the ground that fewer than two frames since a moment have shown."""
        poses = np.array([view[1:] for view in self._views if view[0] >= since_s])
        if len(poses) == 0 or self.camera is None:
            return 1.0
        steps = np.arange(-radius_m, radius_m + DISC_STEP_M, DISC_STEP_M)
        places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        places = places[np.hypot(places[:, 0], places[:, 1]) <= radius_m] + (east_m, north_m)
        in_range = np.hypot(*(places[None, :, :] - poses[:, None, :2]).transpose(2, 0, 1)) < USEFUL_M
        frame_counts = (self.camera.in_view(places, poses) & in_range).sum(axis=0)
        return float((frame_counts < 2).mean())
