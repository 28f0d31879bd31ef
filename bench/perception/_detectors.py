"""The detectors that work on the truth about a frame. docs/detection.md gives the formulas and their sources.

All randomness of a frame is drawn in blocks for the whole cast, keyed by the frame's number; row i is actor
i's. So the draws do not depend on which actors are in view or how well: two configurations that differ in fog
alone get the same draws.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.contracts import (
    CameraFrame,
    CameraPicture,
    CastMember,
    Detection,
    DetectionFrame,
    Detector,
    OpenPixelDetector,
    Sighting,
    SimTime,
)
from bench.simspec import Camera, SimSpec, generator

from ._boxes import PictureSize
from ._delays import DelayedResults, FrameLatency
from ._draws import FRAME_DRAWS, MORE_FRAME_DRAWS, name_before_tracks, seeds_of_camera
from ._false_alarms import FalseAlarms, score_at
from ._labels import LabelOdds, posterior_score
from ._noise import CorrelatedNoise, uniform_of
from ._odds import DetectionOdds
from ._picture_detector import open_picture_detectors
from ._tracks import TrackNames, UntrackedDetection

LABEL_PERSISTENCE = 5.0
"""A wrong label persists this many times longer than a miss does."""

PERFECT_VISIBLE = 0.2
PERFECT_SIZE_PX = 4.0
"""Least visible share and apparent size of an actor that perception without errors reports."""

# Standard normals of one actor in one frame: three processes, the score's evidence, four edges.
_DRAWS = 8
_SEEN, _CONFUSED, _CHOICE, _EVIDENCE, _BOX = 0, 1, 2, 3, 4
# The second block: displacement of the whole box to the right and down, and the switch of identity.
_MORE_DRAWS = 3
_DRIFT_X, _DRIFT_Y, _SWITCH = 0, 1, 2


def open_detector(
    simspec: SimSpec, cast: Sequence[CastMember], open_on_pixels: OpenPixelDetector | None = None
) -> Detector:
    """The detector of the main camera, as `open_detectors` opens it."""
    return open_detectors(simspec, cast, open_on_pixels)[0]


def open_detectors(
    simspec: SimSpec, cast: Sequence[CastMember], open_on_pixels: OpenPixelDetector | None = None
) -> tuple[Detector, ...]:
    """The detectors that the SimSpec asks for, over a scene's cast: one for each perceiving camera, the main one first.

    `open_on_pixels` takes the place of the plug-in that `perception.detector` names. Raises SetupError for a plug-in that
    is not installed or refuses its options.
    """
    cameras = simspec.perceiving_cameras
    if not simspec.perception.by_bench:
        return tuple(NoDetector() for _ in cameras)
    if simspec.perception.on_pixels:
        return open_picture_detectors(simspec, open_on_pixels)
    if simspec.perception.error_free:
        return tuple(TruthDetector(simspec, camera, cast) for camera in cameras)
    return tuple(SimulatedDetector(simspec, camera, cast) for camera in cameras)


class NoDetector:
    """Publishes nothing: the agent has a perception of its own."""

    def process(self, frame: CameraFrame, picture: CameraPicture | None = None) -> None:
        pass

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return ()


class TruthDetector:
    """Reports every actor that is visible enough, with the right label, full confidence and no delay."""

    def __init__(self, simspec: SimSpec, camera: Camera, cast: Sequence[CastMember]) -> None:
        self._cast = cast
        prefix = name_before_tracks(simspec, camera)
        self._tracks = TrackNames(prefix=prefix)
        self._results = DelayedResults(camera.name if prefix else "")

    def process(self, frame: CameraFrame, picture: CameraPicture | None = None) -> None:
        detections = [
            UntrackedDetection(
                Detection(self._cast[sighting.actor].class_label, 1.0, sighting.box), sighting.actor
            )
            for sighting in frame.sightings
            if sighting.visible >= PERFECT_VISIBLE and sighting.height_px >= PERFECT_SIZE_PX
        ]
        self._results.put(frame.exposed, 0.0, self._tracks.name(detections, frame.exposed))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._results.due(now)


class SimulatedDetector:
    """Misses, mislabels, displaces, invents, renames and delays detections as the DetectionModel states."""

    def __init__(self, simspec: SimSpec, camera: Camera, cast: Sequence[CastMember]) -> None:
        self._cast = cast
        self._seeds = seeds_of_camera(simspec, camera)
        self._model = model = simspec.perception.model
        self._odds = DetectionOdds.of(simspec)
        self._labels = [LabelOdds.of(model, member) for member in cast]
        self._picture = PictureSize(float(camera.width_px), float(camera.height_px))
        label_s = LABEL_PERSISTENCE * model.correlation_s
        self._noise = CorrelatedNoise(len(cast), (model.correlation_s, label_s, label_s))
        self._drift = CorrelatedNoise(len(cast), (model.drift_s, model.drift_s))
        # Most models have neither drift nor switches, and need no second block.
        self._draws_more = model.drift_px > 0.0 or model.id_switches_per_s > 0.0
        self._false_alarms = FalseAlarms(simspec, self._seeds, self._picture)
        prefix = name_before_tracks(simspec, camera)
        self._tracks = TrackNames(model.id_switches_per_s, prefix)
        self._latency = FrameLatency.of(simspec, camera)
        self._results = DelayedResults(camera.name if prefix else "")

    def process(self, frame: CameraFrame, picture: CameraPicture | None = None) -> None:
        draws = self._block(FRAME_DRAWS, frame.number, _DRAWS)
        self._noise.advance(frame.exposed, draws[:, :3])
        more = np.zeros((0, 0))
        if self._draws_more:
            more = self._block(MORE_FRAME_DRAWS, frame.number, _MORE_DRAWS)
            self._drift.advance(frame.exposed, more[:, :2])
        detections = [
            detection
            for sighting in frame.sightings
            if (detection := self._detect(sighting, draws[sighting.actor])) is not None
        ]
        detections += [
            UntrackedDetection(alarm.detection, -alarm.number)
            for alarm in self._false_alarms.advance(frame.number, frame.exposed)
        ]
        named = self._tracks.name(
            detections,
            frame.exposed,
            (lambda actor: uniform_of(float(more[actor, _SWITCH]))) if self._draws_more else None,
        )
        self._results.put(frame.exposed, self._latency.of_frame(frame.number), named)

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._results.due(now)

    def _block(self, stream: int, frame: int, width: int) -> NDArray[np.float64]:
        # One row for every actor, seen or not: what is drawn for one never depends on who else is in view.
        return generator(self._seeds, "perception", stream, frame).standard_normal((len(self._cast), width))

    def _detect(self, sighting: Sighting, draws: NDArray[np.float64]) -> UntrackedDetection | None:
        actor = sighting.actor
        member, labels = self._cast[actor], self._labels[actor]
        clarity = self._odds.clarity(sighting, member.concealment)
        factor = self._model.class_factors.get(member.class_label, 1.0)
        if self._noise.uniform(_SEEN, actor) >= min(1.0, factor * clarity.detection):
            return None
        mislabel = labels.probability(clarity.share)
        wrong = self._noise.uniform(_CONFUSED, actor) < mislabel
        label = labels.wrong_label(self._noise.uniform(_CHOICE, actor)) if wrong else member.class_label
        scores = self._model.scores.wrong if wrong else self._model.scores.right
        # One draw for both: quantiles leave all others as they are.
        evidence = float(draws[_EVIDENCE])
        score = (
            score_at(scores, uniform_of(evidence)) if scores else posterior_score(mislabel, wrong, evidence)
        )
        box = self._picture.displaced(sighting.box, self._displacement_px(actor, sighting.box, draws[_BOX:]))
        return UntrackedDetection(Detection(label, score, box), actor)

    def _displacement_px(
        self, actor: int, box: tuple[float, float, float, float], draws: NDArray[np.float64]
    ) -> list[float]:
        """Of the four edges."""
        deviation: NDArray[np.float64] | float = self._model.jitter_px
        if self._model.jitter_share > 0.0:
            sides = np.array((box[2] - box[0], box[3] - box[1]) * 2)
            deviation = np.hypot(self._model.jitter_px, self._model.jitter_share * sides)
        edges: list[float] = (deviation * draws).tolist()
        if self._model.drift_px == 0.0:
            return edges
        right, down = (
            self._model.drift_px * self._drift.normal(axis, actor) for axis in (_DRIFT_X, _DRIFT_Y)
        )
        return [edges[0] + right, edges[1] + down, edges[2] + right, edges[3] + down]
