"""Detections where there is nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.contracts import FALSE_SCORE, Detection, SimTime
from bench.simspec import FALSE_SCORE_MEAN, Seeds, SimSpec, generator

from ._boxes import Box, PictureSize
from ._draws import FALSE_DRAWS, SURVIVAL_DRAWS
from ._labels import false_labels

LEAST_FALSE_PX, MOST_FALSE_PX = 8.0, 80.0
"""Range of the sides of a false detection's box."""


@dataclass(frozen=True, slots=True)
class FalseAlarm:
    """One false detection over all frames in which it stays; `number` tells it from the others."""

    number: int
    detection: Detection
    box: Box


class FalseAlarms:
    """False detections: a Poisson number in each frame, whose members stay for an exponential time."""

    def __init__(self, simspec: SimSpec, seeds: Seeds, picture: PictureSize) -> None:
        self._model = model = simspec.perception.model
        self._seeds, self._picture = seeds, picture
        shares = model.false_labels or dict.fromkeys(false_labels(simspec), 1.0)
        self._labels = [label for label, share in shares.items() if share > 0.0]
        self._reached = np.cumsum([share for share in shares.values() if share > 0.0])
        # The parameters add up to 7, as those of FALSE_SCORE do.
        total = sum(FALSE_SCORE)
        self._beta = (
            FALSE_SCORE
            if model.false_score == FALSE_SCORE_MEAN
            else (total * model.false_score, total * (1.0 - model.false_score))
        )
        self._alive: list[FalseAlarm] = []
        self._count = 0
        self._moment: SimTime | None = None

    def advance(self, frame: int, exposed: SimTime) -> list[FalseAlarm]:
        """The false detections of a frame."""
        if self._model.false_per_frame == 0.0:
            return []
        keep = 0.0
        if self._moment is not None and self._model.false_persistence_s > 0.0:
            keep = math.exp(-exposed.since(self._moment) / self._model.false_persistence_s)
        self._moment = exposed
        remaining = self._remaining(frame, keep)
        # With as many new ones as old ones go, the number in a frame stays Poisson with the stated mean.
        rng = generator(self._seeds, "perception", FALSE_DRAWS, frame)
        fresh = [
            self._appear(rng) for _ in range(int(rng.poisson(self._model.false_per_frame * (1.0 - keep))))
        ]
        self._alive = remaining + fresh
        return self._alive

    def _remaining(self, frame: int, keep: float) -> list[FalseAlarm]:
        if not self._alive or keep == 0.0:
            return []
        # A stream of their own: how many are left must not move the draws of the new ones.
        rng = generator(self._seeds, "perception", SURVIVAL_DRAWS, frame)
        return [self._seen_again(alarm, rng) for alarm in self._alive if rng.random() < keep]

    def _seen_again(self, alarm: FalseAlarm, rng: np.random.Generator) -> FalseAlarm:
        box = self._picture.displaced(alarm.box, (self._model.jitter_px * rng.standard_normal(4)).tolist())
        score = self._score(rng)
        return replace(alarm, detection=replace(alarm.detection, box=box, score=score))

    def _appear(self, rng: np.random.Generator) -> FalseAlarm:
        width, height = np.exp(rng.uniform(math.log(LEAST_FALSE_PX), math.log(MOST_FALSE_PX), 2)).tolist()
        x, y = (rng.random(2) * (self._picture.width_px, self._picture.height_px)).tolist()
        box = self._picture.fitted(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)
        label = self._label(rng)
        self._count += 1
        return FalseAlarm(self._count, Detection(label, self._score(rng), box), box)

    def _score(self, rng: np.random.Generator) -> float:
        quantiles = self._model.scores.false
        return score_at(quantiles, rng.random()) if quantiles else float(rng.beta(*self._beta))

    def _label(self, rng: np.random.Generator) -> str:
        # All alike are drawn as they always were: recordings rest on it.
        if not self._model.false_labels:
            return self._labels[int(rng.integers(len(self._labels)))]
        place = int(np.searchsorted(self._reached, rng.random() * self._reached[-1], side="right"))
        return self._labels[min(place, len(self._labels) - 1)]


def score_at(quantiles: Sequence[float], uniform: float) -> float:
    """The score that a draw on [0, 1] picks: quantiles in equal steps, straight lines between them."""
    place = uniform * (len(quantiles) - 1)
    low = min(int(place), len(quantiles) - 2)
    return quantiles[low] + (place - low) * (quantiles[low + 1] - quantiles[low])
