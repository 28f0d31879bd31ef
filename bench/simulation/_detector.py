"""The truth-based detector: what perception makes of a frame. docs/detection.md gives the formulas and their sources.

All randomness of a frame is drawn in one block for the whole cast, keyed by the frame's number; row i is actor i's. So the
draws do not depend on who is in view or how well: two configurations that differ in fog alone see the same luck.
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
"""A wrong label hangs together this many times longer than a miss does."""

TRACK_GAP_S = 2.0
"""An object out of the detections for longer than this comes back under a new track id."""

PERFECT_VISIBLE = 0.2
PERFECT_SIZE_PX = 4.0
"""What perfect perception needs to see of an actor."""

LEAST_FALSE_PX, MOST_FALSE_PX = 8.0, 80.0
"""Range of the sides of a false detection's box."""

_DRAWS = 8
_SEEN, _CONFUSED, _CHOICE, _EVIDENCE, _BOX = 0, 1, 2, 3, 4
_FRAME_DRAWS, _FALSE_DRAWS = 0, 1

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Clarity:
    """How well one sighting can be detected: apparent contrast, probability of detection, and of a wrong label."""

    contrast: float
    detection: float
    mislabel: float


@dataclass(frozen=True, slots=True)
class DetectionOdds:
    """The stated model without its luck: clarity of a sighting under one weather and light."""

    model: DetectionModel
    extinction_per_m: float
    light: float

    @classmethod
    def of(cls, simspec: SimSpec) -> DetectionOdds:
        """The odds in the weather and light of a SimSpec; light is that of its start."""
        model, weather = simspec.perception.model, simspec.environment
        extinction = model.fog_extinction_per_m * weather.fog_level**2 + model.rain_extinction_per_m * weather.rain_level
        return cls(model, extinction, light_of(sun_of(simspec).elevation_rad, model.night_contrast))

    def clarity(self, sighting: Sighting, concealment: float) -> Clarity:
        """The clarity of one sighting of an actor with that concealment."""
        model = self.model
        contrast = math.exp(-self.extinction_per_m * sighting.range_m) * self.light
        contrast *= 1.0 - model.concealment_weight * concealment
        above = max(0.0, (contrast - THRESHOLD_CONTRAST) / (1.0 - THRESHOLD_CONTRAST))
        size_px = sighting.height_px * above * sighting.visible
        share = _rise(size_px / model.half_height_px, model.slope)
        return Clarity(contrast, model.ceiling * share, min(1.0, 2.0 * model.mislabel * (1.0 - share)))


def open_detector(simspec: SimSpec, cast: Sequence[CastMember]) -> Detector:
    """The detector that the SimSpec asks for, over a scene's cast."""
    if simspec.perception.mode == "perfect":
        return PerfectDetector(cast)
    return DegradedDetector(simspec, cast)


class PerfectDetector:
    """Reports everybody who shows enough, rightly, surely and at once."""

    def __init__(self, cast: Sequence[CastMember]) -> None:
        self._cast = cast
        self._tracks = _Tracks(len(cast))
        self._outbox = _Outbox(0.0)

    def process(self, frame: CameraFrame) -> None:
        found = [
            _Found(Detection(self._cast[one.actor].class_label, 1.0, one.box), one.actor)
            for one in frame.sightings
            if one.visible >= PERFECT_VISIBLE and one.height_px >= PERFECT_SIZE_PX
        ]
        self._outbox.put(frame.exposed, self._tracks.name(found, frame.exposed))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._outbox.due(now)


class DegradedDetector:
    """Misses, mislabels, displaces, invents and delays, as DetectionModel says."""

    def __init__(self, simspec: SimSpec, cast: Sequence[CastMember]) -> None:
        self._cast = cast
        # With the stream's own seed given, it is not worked out anew for every frame.
        self._seeds = simspec.seeds.model_copy(update={"perception": seed_of(simspec.seeds, "perception")})
        self._model = simspec.perception.model
        self._odds = DetectionOdds.of(simspec)
        self._width_px = float(simspec.vehicle.camera.width_px)
        self._height_px = float(simspec.vehicle.camera.height_px)
        self._luck = _Luck(len(cast), self._model.correlation_s)
        self._tracks = _Tracks(len(cast))
        self._outbox = _Outbox(self._model.latency_s)
        self._labels = sorted({asset.class_label for asset in ASSETS.values() if asset.possible_false_alarm})

    def process(self, frame: CameraFrame) -> None:
        fresh = generator(self._seeds, "perception", _FRAME_DRAWS, frame.number).standard_normal((len(self._cast), _DRAWS))
        self._luck.advance(frame.exposed, fresh)
        found = [one for sighting in frame.sightings if (one := self._detect(sighting, fresh[sighting.actor])) is not None]
        found += self._invented(frame.number)
        self._outbox.put(frame.exposed, self._tracks.name(found, frame.exposed))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        return self._outbox.due(now)

    def _detect(self, sighting: Sighting, fresh: NDArray[np.float64]) -> _Found | None:
        member = self._cast[sighting.actor]
        clarity = self._odds.clarity(sighting, member.concealment)
        if self._luck.uniform(_SEEN, sighting.actor) >= clarity.detection:
            return None
        others = ASSETS[member.asset].confused_with
        doubt = clarity.mislabel if others else 0.0
        wrong = self._luck.uniform(_CONFUSED, sighting.actor) < doubt
        label = member.class_label
        if wrong:
            label = others[min(int(self._luck.uniform(_CHOICE, sighting.actor) * len(others)), len(others) - 1)]
        score = _score(doubt, wrong, float(fresh[_EVIDENCE]))
        return _Found(Detection(label, score, self._displaced(sighting.box, fresh[_BOX:].tolist())), sighting.actor)

    def _displaced(self, box: Box, noise: Sequence[float]) -> Box:
        left, top, right, bottom = (edge + self._model.jitter_px * by for edge, by in zip(box, noise, strict=True))
        left, right = _ordered(left, right, self._width_px)
        top, bottom = _ordered(top, bottom, self._height_px)
        return left, top, right, bottom

    def _invented(self, number: int) -> list[_Found]:
        if self._model.false_per_frame == 0.0:
            return []
        rng = generator(self._seeds, "perception", _FALSE_DRAWS, number)
        return [self._invention(rng) for _ in range(int(rng.poisson(self._model.false_per_frame)))]

    def _invention(self, rng: np.random.Generator) -> _Found:
        wide, high = np.exp(rng.uniform(math.log(LEAST_FALSE_PX), math.log(MOST_FALSE_PX), 2)).tolist()
        x, y = (rng.random(2) * (self._width_px, self._height_px)).tolist()
        left, right = _ordered(x - wide / 2.0, x + wide / 2.0, self._width_px)
        top, bottom = _ordered(y - high / 2.0, y + high / 2.0, self._height_px)
        label = self._labels[int(rng.integers(len(self._labels)))]
        return _Found(Detection(label, float(rng.beta(*FALSE_SCORE)), (left, top, right, bottom)), None)


@dataclass(frozen=True, slots=True)
class _Found:
    """A detection that has no track yet, and the actor behind it, None for an invention."""

    detection: Detection
    actor: int | None


class _Luck:
    """Standard normal processes of every actor, first-order Markov in time: exactly normal at any moment, alike in near ones."""

    def __init__(self, actors: int, correlation_s: float) -> None:
        self._memory_s = np.array([correlation_s, *[LABEL_PERSISTENCE * correlation_s] * 2])
        self._state = np.zeros((actors, 3))
        self._moment: SimTime | None = None

    def advance(self, to: SimTime, fresh: NDArray[np.float64]) -> None:
        keep = np.zeros(3)
        if self._moment is not None:
            keep = np.exp(-to.since(self._moment) / np.maximum(self._memory_s, 1e-9))
        self._state = keep * self._state + np.sqrt(1.0 - keep * keep) * fresh[:, :3]
        self._moment = to

    def uniform(self, process: int, actor: int) -> float:
        return 0.5 * math.erfc(-float(self._state[actor, process]) * math.sqrt(0.5))


class _Tracks:
    """A simulated tracker: names what it sees in the order in which it reports it, which tells nothing about the cast."""

    def __init__(self, actors: int) -> None:
        self._last: list[SimTime | None] = [None] * actors
        self._name = [""] * actors
        self._count = 0

    def name(self, found: list[_Found], exposed: SimTime) -> tuple[Detection, ...]:
        """The detections, surest first, each with its track."""
        found.sort(key=lambda one: (-one.detection.score, one.detection.box))
        return tuple(self._named(one, exposed) for one in found)

    def _named(self, found: _Found, exposed: SimTime) -> Detection:
        seen = found.detection
        return Detection(seen.class_label, seen.score, seen.box, self._track(found.actor, exposed))

    def _track(self, actor: int | None, exposed: SimTime) -> str:
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


class _Outbox:
    """Results on their way, all equally late, so they arrive in the order of exposure."""

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


def _rise(ratio: float, slope: float) -> float:
    """ratio^slope / (1 + ratio^slope), without overflow for absurd slopes; 0 at 0."""
    if ratio <= 0.0:
        return 0.0
    exponent = slope * math.log(ratio)
    return 1.0 / (1.0 + math.exp(-exponent)) if exponent > -700.0 else 0.0


def _score(doubt: float, wrong: bool, noise: float) -> float:
    """Posterior probability that the label is right, after one piece of noisy evidence: calibrated by construction."""
    prior = min(1.0 - LEAST_DOUBT, max(LEAST_DOUBT, doubt))
    evidence = (-0.5 if wrong else 0.5) * LABEL_EVIDENCE + noise
    return 1.0 / (1.0 + prior / (1.0 - prior) * math.exp(-LABEL_EVIDENCE * evidence))


def _ordered(first: float, second: float, limit: float) -> tuple[float, float]:
    """Two edges of a box inside [0, limit], at least one pixel apart."""
    low, high = max(0.0, min(first, second)), min(limit, max(first, second))
    if high - low < 1.0:
        low = min(max(0.0, (low + high) / 2.0 - 0.5), limit - 1.0)
        high = low + 1.0
    return low, high
