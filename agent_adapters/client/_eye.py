"""From pixels to places: detections of the main camera, thrown onto flat ground."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from bench.streams import CameraInfo, Detection2DArray, TFMessage
from bench.values import value_class

# As in bench.contracts, which this client does without.
_TF_STATIC = "/tf_static"
# A ray that falls by less than this on its way of one metre meets the ground far away, if at all. Chosen.
_LEAST_FALL = 0.05


@value_class(frozen=True, slots=True)
class Sighting:
    """A detection on the ground, in metres from the mission's origin."""

    class_label: str
    confidence: float
    east_m: float
    north_m: float


@dataclass(slots=True)
class Thing:
    """What several sightings of one class near each other are taken for; its fields but the last are those of a track."""

    id: str
    class_label: str
    east_m: float
    north_m: float
    confidence: float
    frames: int
    seen_s: float

    def apart_m(self, east_m: float, north_m: float) -> float:
        """Metres to a place."""
        return math.hypot(self.east_m - east_m, self.north_m - north_m)


class Things(list[Thing]):
    """All that was seen, in the order of first sight."""

    def take(self, sighting: Sighting, now_s: float, within_m: float = 15.0) -> None:
        """Count a sighting to the first thing of its class within `within_m`, whose place becomes the mean of all, or begin one."""
        east_m, north_m, label = sighting.east_m, sighting.north_m, sighting.class_label
        near = (
            thing
            for thing in self
            if thing.class_label == label and thing.apart_m(east_m, north_m) < within_m
        )
        thing = next(near, None)
        if thing is None:
            thing = Thing(f"{label}-{len(self)}", label, east_m, north_m, 0.0, 0, now_s)
            self.append(thing)
        thing.frames += 1
        thing.east_m += (east_m - thing.east_m) / thing.frames
        thing.north_m += (north_m - thing.north_m) / thing.frames
        thing.confidence, thing.seen_s = max(thing.confidence, sighting.confidence), now_s


class Eye:
    """Knows the camera, its mount and the vehicle's pose from the messages that it is given.

    Poses are the latest, not those of the exposure, and lenses are taken for straight: good to some metres.
    """

    def __init__(self) -> None:
        self._poses: dict[str, Any] = {}
        self._mount: Any = None
        self._k: Any = None

    def see(self, topic: str, message: object) -> Iterator[Sighting]:
        """Take in a message of /tf, /tf_static, camera_info or detections; what it shows on the ground."""
        if isinstance(message, CameraInfo):
            self._k = message.k
        elif isinstance(message, TFMessage) and topic == _TF_STATIC:
            self._mount = message.transforms[0]
        elif isinstance(message, TFMessage):
            self._poses |= {item.child_frame_id: item.transform for item in message.transforms}
        elif isinstance(message, Detection2DArray) and self._k is not None and self._mount:
            for detection in message.detections:
                # The middle of the lower edge stands on the ground.
                box, best = detection.bbox, detection.results[0].hypothesis
                place = self.ground(box.center.position.x, box.center.position.y + box.size_y / 2)
                if place is not None:
                    yield Sighting(best.class_id, best.score, *place)

    def ground(self, x_px: float, y_px: float) -> tuple[float, float] | None:
        """East and north of where a pixel meets flat ground at the height of the origin; None where it does not."""
        body = self._poses.get(self._mount.header.frame_id) if self._mount else None
        if body is None or self._k is None:
            return None
        ray = ((x_px - self._k[2]) / self._k[0], (y_px - self._k[5]) / self._k[4], 1.0)
        ray = _turned(body.rotation, _turned(self._mount.transform.rotation, ray))
        if ray[2] > -_LEAST_FALL:
            return None
        far = body.translation.z / -ray[2]
        return body.translation.x + far * ray[0], body.translation.y + far * ray[1]


def _turned(q: Any, v: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector turned by a quaternion as ROS writes it."""
    x, y, z = v
    a, b, c = 2 * (q.y * z - q.z * y), 2 * (q.z * x - q.x * z), 2 * (q.x * y - q.y * x)
    return (
        x + q.w * a + q.y * c - q.z * b,
        y + q.w * b + q.z * a - q.x * c,
        z + q.w * c + q.x * b - q.y * a,
    )
