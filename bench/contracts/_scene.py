"""What a scene promises: a world of actors in motion, seen by cameras; and what a detector makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Floats
from bench.clock import SimTime
from bench.values import value_class

from ._rendering import Pixels
from ._truth_documents import CastMember
from ._vehicle import Vector, VehicleState

if TYPE_CHECKING:
    from bench.simspec import Camera, SimSpec


@value_class(frozen=True, slots=True)
class Sighting:
    """Truth about one actor in one frame. `box` is left, top, right, bottom in pixels, clipped to the frame.

    `height_px` is the apparent size (the larger side of the unclipped box); `visible` the share of the actor
    that lies inside the frame and is hidden by no other actor, in (0, 1].
    """

    actor: int
    range_m: float
    height_px: float
    visible: float
    box: tuple[float, float, float, float]


@value_class(frozen=True, slots=True)
class CameraFrame:
    """One exposure of one camera, as truth has it."""

    number: int
    camera: str
    exposed: SimTime
    sightings: tuple[Sighting, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CameraPicture:
    """The pixels of one exposure, and the camera's pose by the vehicle's own estimate: all that a tracker on board has.

    `axes_enu` (3, 3) has the camera's right, down and forward axes as rows.
    """

    bgr: Pixels
    axes_enu: Floats
    position_enu_m: Vector


@value_class(frozen=True, slots=True)
class Detection:
    """One box that perception reports.

    `score` is its confidence in [0, 1]; `track` an identity kept over frames, or empty.
    """

    class_label: str
    score: float
    box: tuple[float, float, float, float]
    track: str = ""


@value_class(frozen=True, slots=True)
class DetectionFrame:
    """What perception says about one exposure, and when it said so."""

    exposed: SimTime
    published: SimTime
    detections: tuple[Detection, ...]
    camera: str = ""
    """The name of a further camera; empty for the main one."""


class Scene(Protocol):
    """The world of one realized SimSpec, with its own seeded motion.

    Asking never changes it; `advance` does.
    """

    @property
    def cast(self) -> tuple[CastMember, ...]:
        """Who the actors are; fixes the order of every array."""

    def advance(self, to: SimTime) -> None:
        """Move everybody to the moment `to`, which never lies before the present one."""

    def positions(self) -> NDArray[np.float64]:
        """(n, 3) ENU metres of the actors' foot points, at the present moment."""

    def headings(self) -> NDArray[np.float64]:
        """(n,) radians clockwise from north, at the present moment."""

    def observe(self, state: VehicleState, number: int) -> CameraFrame:
        """What the vehicle's camera would see from `state` at the present moment."""


@runtime_checkable
class ObservesCameras(Protocol):
    """What a scene promises beside `Scene` when it knows what further cameras see."""

    def observe_with(self, camera: Camera, state: VehicleState, number: int) -> CameraFrame:
        """What another camera of the vehicle would see from `state` at the present moment."""


class OpenScene(Protocol):
    """The entry point of group `rebar.scenes`."""

    def __call__(self, simspec: SimSpec) -> Scene: ...


class Detector(Protocol):
    """Turns frames into detections, with the delays of its model."""

    def process(self, frame: CameraFrame, picture: CameraPicture | None = None) -> None:
        """Take in one exposure and its picture, None where there is none; draws all that is random about it."""

    # Apart from `process`, because a detection is published later than its frame was exposed.
    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        """The results that are published by `now` and were not handed out before, in order of exposure."""


class PixelDetector(Protocol):
    """Finds objects in one picture. Equal pictures give equal detections: nothing is kept between pictures."""

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        """What is in the picture, (h, w, 3) uint8 of ROS encoding bgr8, which it does not change.

        Boxes are in continuous pixels, labels the class labels of the asset catalogue, scores in [0, 1], and `track`
        is empty: the bench names tracks.
        """


@runtime_checkable
class VersionedDetector(Protocol):
    """A PixelDetector that tells which one it is, for the recording and the result."""

    @property
    def version(self) -> str:
        """Its version and the digest of its weights, in a few words."""


class OpenPixelDetector(Protocol):
    """The entry point of group `rebar.detectors`.

    Takes its options from `simspec.perception.detector_options`. Raises SetupError, naming
    `perception.detector_options.FIELD` and the fix, for an option that it does not know or cannot use.
    """

    def __call__(self, simspec: SimSpec) -> PixelDetector: ...
