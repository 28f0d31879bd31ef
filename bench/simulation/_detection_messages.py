"""The results of one camera's detector on the air network, as outages and degradations of detections leave them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from bench.contracts import Detection, DetectionFrame, Detector, SimTime
from bench.perception import seeds_of_camera
from bench.simspec import Camera, Outage, SimSpec, generator
from bench.streams import (
    BoundingBox2D,
    Detection2D,
    Detection2DArray,
    Header,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
    Point,
    Point2D,
    Pose,
    Pose2D,
    PoseWithCovariance,
    Quaternion,
    Time,
)

from ._air_topics import RecordedPublisher
from ._frames import optical_frame

# Sub-stream of the perception seed; bench/perception/_draws.py has the others.
_LOSS_DRAWS = 2

_NOWHERE = PoseWithCovariance(
    pose=Pose(position=Point(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
    covariance=(0.0,) * 36,
)


class DetectionMessages:
    """Publishes what a detector has ready."""

    def __init__(self, simspec: SimSpec, camera: Camera, publisher: RecordedPublisher) -> None:
        self._optical = optical_frame(simspec, camera)
        self._outages = simspec.outages
        self._seeds = seeds_of_camera(simspec, camera)
        self._publisher = publisher

    def publish(self, now: SimTime, detector: Detector) -> None:
        """Publish the results that are due; those of an outage are lost."""
        silent = in_outage(self._outages, "detections", now)
        for frame in detector.due(now):
            # A result that came out during an outage is lost, also when the tick comes after the outage.
            if not silent and not in_outage(self._outages, "detections", frame.published):
                self._publisher.publish(now, self._message(self._degraded(frame)))

    def _degraded(self, frame: DetectionFrame) -> DetectionFrame:
        """What a degradation leaves of a frame; the frame itself at any other time."""
        lost_share = max(
            (
                outage.lost_share
                for outage in self._outages
                if outage.lost_share is not None and outage.at_s <= frame.published.s < outage.until_s
            ),
            default=0.0,
        )
        if lost_share == 0.0:
            return frame
        draws = generator(self._seeds, "perception", _LOSS_DRAWS, frame.exposed.ns // 1000)
        # One draw for each detection, in the detector's order, so that a larger share loses the same and more.
        kept = draws.random(len(frame.detections)) >= lost_share
        return replace(
            frame,
            detections=tuple(
                replace(detection, score=detection.score * (1.0 - lost_share / 2.0))
                for detection, is_kept in zip(frame.detections, kept, strict=True)
                if is_kept
            ),
        )

    def _message(self, frame: DetectionFrame) -> Detection2DArray:
        header = Header(stamp=Time.of(frame.exposed.ns), frame_id=self._optical)
        return Detection2DArray(
            header=header, detections=tuple(_detection(header, detection) for detection in frame.detections)
        )


def in_outage(outages: Sequence[Outage], kind: Literal["operator_link", "detections"], time: SimTime) -> bool:
    """Whether an outage of this kind is on; its end is excluded."""
    return any(outage.kind == kind and outage.at_s <= time.s < outage.until_s for outage in outages)


def _detection(header: Header, detection: Detection) -> Detection2D:
    x_min, y_min, x_max, y_max = detection.box
    hypothesis = ObjectHypothesis(class_id=detection.class_label, score=detection.score)
    center = Pose2D(position=Point2D(x=(x_min + x_max) / 2.0, y=(y_min + y_max) / 2.0), theta=0.0)
    return Detection2D(
        header=header,
        results=(ObjectHypothesisWithPose(hypothesis=hypothesis, pose=_NOWHERE),),
        bbox=BoundingBox2D(center=center, size_x=x_max - x_min, size_y=y_max - y_min),
        id=detection.track,
    )
