"""The truth-based detector: what perception makes of a frame. docs/detection.md gives the formulas and their
sources.

All randomness of a frame is drawn in one block for the whole cast, keyed by the frame's number; row i is
actor i's. So the draws do not depend on which actors are in view or how well: two configurations that differ
in fog alone get the same draws.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.contracts import (
    FALSE_SCORE,
    LABEL_EVIDENCE,
    LEAST_DOUBT,
    THRESHOLD_CONTRAST,
    CameraFrame,
    CastMember,
    Detection,
    DetectionFrame,
    Detector,
    Sighting,
    SimTime,
    light_of,
)
from bench.simspec import ASSETS, DetectionModel, SimSpec, generator, seed_of, sun_of

LABEL_PERSISTENCE = 5.0
"""A wrong label persists this many times longer than a miss does."""

TRACK_GAP_S = 2.0
"""An object out of the detections for longer than this comes back under a new track id."""

PERFECT_VISIBLE = 0.2
PERFECT_SIZE_PX = 4.0
"""Least visible share and apparent size of an actor that perfect perception reports."""

LEAST_FALSE_PX, MOST_FALSE_PX = 8.0, 80.0
"""Range of the sides of a false detection's box."""

# Standard normals of one actor in one frame: three processes, the evidence of the score, four edges of the
# box.
_DRAWS = 8
_SEEN, _CONFUSED, _CHOICE, _EVIDENCE, _BOX = 0, 1, 2, 3, 4
# Sub-streams of the perception seed. False detections draw a varying count, so they need a stream of their
# own.
_FRAME_DRAWS, _FALSE_DRAWS = 0, 1

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Clarity:
    """How well one sighting can be detected: apparent contrast, probability of detection, and of a wrong
    label.
    """

    contrast: float
    detection: float
    mislabel: float


@dataclass(frozen=True, slots=True)
class DetectionOdds:
    """The stated model without its random draws: clarity of a sighting under one weather and light."""

    model: DetectionModel
    extinction_per_m: float
    light: float

    @classmethod
    def of(cls, simspec: SimSpec) -> DetectionOdds:
        """The odds in the weather and light of a SimSpec; light is that of its start."""
        model, weather = simspec.perception.model, simspec.environment
        # Fog counts with its square: the default levels then span the meteorological ranges of
        # docs/detection.md,
        # 1300 m at level 5 and 400 m at level 9.
        extinction = (
            model.fog_extinction_per_m * weather.fog_level**2
            + model.rain_extinction_per_m * weather.rain_level
        )
        return cls(model, extinction, light_of(sun_of(simspec).elevation_rad, model.night_contrast))

    def clarity(self, sighting: Sighting, concealment: float) -> Clarity:
        """The clarity of one sighting of an actor with that concealment."""
        model = self.model
        # Koschmieder (1924): contrast falls exponentially with range.
        contrast = math.exp(-self.extinction_per_m * sighting.range_m) * self.light
        contrast *= 1.0 - model.concealment_weight * concealment
        above = max(0.0, (contrast - THRESHOLD_CONTRAST) / (1.0 - THRESHOLD_CONTRAST))
        # Piper's law: for objects of middling size contrast and size trade one to one, so their product
        # decides.
        size_px = sighting.height_px * above * sighting.visible
        # Form of the target transfer probability function used with Johnson's criteria (1958), with a fixed
        # exponent.
        share = _logistic(size_px / model.half_height_px, model.slope)
        return Clarity(contrast, model.ceiling * share, min(1.0, 2.0 * model.mislabel * (1.0 - share)))


def open_detector(simspec: SimSpec, cast: Sequence[CastMember]) -> Detector:
    """The detector that the SimSpec asks for, over a scene's cast."""
    if simspec.perception.mode == "perfect":
        return PerfectDetector(cast)
    return DegradedDetector(simspec, cast)


class PerfectDetector:
    """Reports every actor that is visible enough, with the right label, full confidence and no delay."""

    def __init__(self, cast: Sequence[CastMember]) -> None:
        self._cast = cast
        self._tracks = _TrackNames(len(cast))
        self._results = _DelayedResults(0.0)

    def process(self, frame: CameraFrame) -> None:
        detections = [
            _UntrackedDetection(
                Detection(self._cast[sighting.actor].class_label, 1.0, sighting.box), sighting.actor
            )
            for sighting in frame.sightings
            if sighting.visible >= PERFECT_VISIBLE and sighting.height_px >= PERFECT_SIZE_PX
        ]
        self._results.put(frame.exposed, self._tracks.name(detections, frame.exposed))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._results.due(now)


class DegradedDetector:
    """Misses, mislabels, displaces, invents and delays detections as the DetectionModel states."""

    def __init__(self, simspec: SimSpec, cast: Sequence[CastMember]) -> None:
        self._cast = cast
        # Deriving the stream's seed from the root takes a hash: done once here, not for every frame.
        self._seeds = simspec.seeds.model_copy(update={"perception": seed_of(simspec.seeds, "perception")})
        self._model = simspec.perception.model
        self._odds = DetectionOdds.of(simspec)
        self._width_px = float(simspec.vehicle.camera.width_px)
        self._height_px = float(simspec.vehicle.camera.height_px)
        self._noise = _CorrelatedNoise(len(cast), self._model.correlation_s)
        self._tracks = _TrackNames(len(cast))
        self._results = _DelayedResults(self._model.latency_s)
        # Sorted, because a set has no order and the drawn index must name the same label in every process.
        self._labels = sorted({asset.class_label for asset in ASSETS.values() if asset.possible_false_alarm})

    def process(self, frame: CameraFrame) -> None:
        # One row for every actor, seen or not: what is drawn for one never depends on who else is in view.
        draws = generator(self._seeds, "perception", _FRAME_DRAWS, frame.number).standard_normal(
            (len(self._cast), _DRAWS)
        )
        self._noise.advance(frame.exposed, draws)
        detections = [
            detection
            for sighting in frame.sightings
            if (detection := self._detect(sighting, draws[sighting.actor])) is not None
        ]
        detections += self._false_detections(frame.number)
        self._results.put(frame.exposed, self._tracks.name(detections, frame.exposed))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._results.due(now)

    def _detect(self, sighting: Sighting, draws: NDArray[np.float64]) -> _UntrackedDetection | None:
        member = self._cast[sighting.actor]
        clarity = self._odds.clarity(sighting, member.concealment)
        if self._noise.uniform(_SEEN, sighting.actor) >= clarity.detection:
            return None
        confusable = ASSETS[member.asset].confused_with
        mislabel = clarity.mislabel if confusable else 0.0
        wrong = self._noise.uniform(_CONFUSED, sighting.actor) < mislabel
        label = member.class_label
        if wrong:
            label = confusable[
                min(int(self._noise.uniform(_CHOICE, sighting.actor) * len(confusable)), len(confusable) - 1)
            ]
        score = _score(mislabel, wrong, float(draws[_EVIDENCE]))
        return _UntrackedDetection(
            Detection(label, score, self._displaced(sighting.box, draws[_BOX:].tolist())), sighting.actor
        )

    def _displaced(self, box: Box, noise: Sequence[float]) -> Box:
        x_min, y_min, x_max, y_max = (
            edge + self._model.jitter_px * deviation for edge, deviation in zip(box, noise, strict=True)
        )
        x_min, x_max = _ordered(x_min, x_max, self._width_px)
        y_min, y_max = _ordered(y_min, y_max, self._height_px)
        return x_min, y_min, x_max, y_max

    def _false_detections(self, number: int) -> list[_UntrackedDetection]:
        if self._model.false_per_frame == 0.0:
            return []
        rng = generator(self._seeds, "perception", _FALSE_DRAWS, number)
        return [self._false_detection(rng) for _ in range(int(rng.poisson(self._model.false_per_frame)))]

    def _false_detection(self, rng: np.random.Generator) -> _UntrackedDetection:
        width, height = np.exp(rng.uniform(math.log(LEAST_FALSE_PX), math.log(MOST_FALSE_PX), 2)).tolist()
        x, y = (rng.random(2) * (self._width_px, self._height_px)).tolist()
        x_min, x_max = _ordered(x - width / 2.0, x + width / 2.0, self._width_px)
        y_min, y_max = _ordered(y - height / 2.0, y + height / 2.0, self._height_px)
        label = self._labels[int(rng.integers(len(self._labels)))]
        return _UntrackedDetection(
            Detection(label, float(rng.beta(*FALSE_SCORE)), (x_min, y_min, x_max, y_max)), None
        )


@dataclass(frozen=True, slots=True)
class _UntrackedDetection:
    """A detection that has no track yet, and its actor; None for a false detection."""

    detection: Detection
    actor: int | None


class _CorrelatedNoise:
    """Standard normal processes of every actor, first-order Markov in time: exactly normal at any moment,
    alike in near ones.
    """

    def __init__(self, actors: int, correlation_s: float) -> None:
        # The process of misses, then those of wrong labels and of their choice, which persist longer.
        self._memory_s = np.array([correlation_s, *[LABEL_PERSISTENCE * correlation_s] * 2])
        self._state = np.zeros((actors, 3))
        self._moment: SimTime | None = None

    def advance(self, to: SimTime, draws: NDArray[np.float64]) -> None:
        keep = np.zeros(3)
        if self._moment is not None:
            # A correlation time of 0 is allowed and means independent frames; the floor only keeps the
            # division
            # finite.
            keep = np.exp(-to.since(self._moment) / np.maximum(self._memory_s, 1e-9))
        self._state = keep * self._state + np.sqrt(1.0 - keep * keep) * draws[:, :3]
        self._moment = to

    def uniform(self, process: int, actor: int) -> float:
        return 0.5 * math.erfc(-float(self._state[actor, process]) * math.sqrt(0.5))


class _TrackNames:
    """A simulated tracker.

    Track ids follow the order of the reports, so they reveal nothing about the cast.
    """

    def __init__(self, actors: int) -> None:
        self._last: list[SimTime | None] = [None] * actors
        self._name = [""] * actors
        self._count = 0

    def name(self, detections: list[_UntrackedDetection], exposed: SimTime) -> tuple[Detection, ...]:
        """The detections, surest first, each with its track."""
        # By score and box, never by actor: the order of the list must not reveal the order of the cast.
        detections.sort(key=lambda detection: (-detection.detection.score, detection.detection.box))
        return tuple(self._with_track(detection, exposed) for detection in detections)

    def _with_track(self, untracked: _UntrackedDetection, exposed: SimTime) -> Detection:
        detection = untracked.detection
        return Detection(
            detection.class_label, detection.score, detection.box, self._track(untracked.actor, exposed)
        )

    def _track(self, actor: int | None, exposed: SimTime) -> str:
        # A false detection has no actor to be recognized by, so it never continues a track.
        if actor is None:
            return self._next()
        last = self._last[actor]
        if last is None or exposed.since(last) > TRACK_GAP_S:
            self._name[actor] = self._next()
        self._last[actor] = exposed
        return self._name[actor]

    def _next(self) -> str:
        self._count += 1
        return f"t{self._count}"


class _DelayedResults:
    """Results on their way. All have the same latency, so they arrive in the order of exposure."""

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._waiting: deque[DetectionFrame] = deque()

    def put(self, exposed: SimTime, detections: tuple[Detection, ...]) -> None:
        self._waiting.append(DetectionFrame(exposed, exposed.after(self._latency_s), detections))

    def due(self, now: SimTime) -> list[DetectionFrame]:
        ready: list[DetectionFrame] = []
        while self._waiting and self._waiting[0].published <= now:
            ready.append(self._waiting.popleft())
        return ready


def _logistic(ratio: float, slope: float) -> float:
    """ratio^slope / (1 + ratio^slope), without overflow for absurd slopes; 0 at 0."""
    if ratio <= 0.0:
        return 0.0
    exponent = slope * math.log(ratio)
    # math.exp overflows above 709.
    return 1.0 / (1.0 + math.exp(-exponent)) if exponent > -700.0 else 0.0


def _score(mislabel: float, wrong: bool, noise: float) -> float:
    """Posterior probability that the label is right, after one piece of noisy evidence: calibrated by
    construction.
    """
    # Held away from 0 and 1, where no evidence could change the score.
    prior = min(1.0 - LEAST_DOUBT, max(LEAST_DOUBT, mislabel))
    evidence = (-0.5 if wrong else 0.5) * LABEL_EVIDENCE + noise
    return 1.0 / (1.0 + prior / (1.0 - prior) * math.exp(-LABEL_EVIDENCE * evidence))


def _ordered(first: float, second: float, limit: float) -> tuple[float, float]:
    """Two edges of a box inside [0, limit], at least one pixel apart."""
    low, high = max(0.0, min(first, second)), min(limit, max(first, second))
    # Jitter may swap the edges or push both over the border; docs/detection.md promises a box of at least one
    # pixel.
    if high - low < 1.0:
        low = min(max(0.0, (low + high) / 2.0 - 0.5), limit - 1.0)
        high = low + 1.0
    return low, high
