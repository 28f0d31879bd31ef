"""The stated model without its random draws: docs/detection.md gives the formulas and their sources."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

from bench.contracts import THRESHOLD_CONTRAST, Sighting, light_of
from bench.simspec import DetectionModel, SimSpec, sun_of


@dataclass(frozen=True, slots=True)
class Clarity:
    """How well one sighting can be detected: apparent contrast, probability of detection, and of a wrong
    label; `share` of the ceiling is what size and contrast leave.
    """

    contrast: float
    detection: float
    mislabel: float
    share: float


@dataclass(frozen=True, slots=True)
class DetectionOdds:
    """Clarity of a sighting under one weather and light."""

    model: DetectionModel
    extinction_per_m: float
    light: float

    @classmethod
    def of(cls, simspec: SimSpec) -> DetectionOdds:
        """The odds in the weather and light of a SimSpec; light is that of its start."""
        model = simspec.perception.model
        extinction = model.extinction_per_m(simspec.environment)
        return cls(model, extinction, light_of(sun_of(simspec).elevation_rad, model.night_contrast))

    def clarity(self, sighting: Sighting, concealment: float) -> Clarity:
        """The clarity of one sighting of an actor with that concealment."""
        contrast = self._contrast(sighting, concealment)
        size_px = self._effective_px(sighting, contrast)
        if self.model.size_curve:
            detected, doubt = self.at_point(size_px)
            share = 1.0 - doubt / 2.0
            return Clarity(contrast, detected, mislabel_probability(self.model.mislabel, share), share)
        # Form of the target transfer probability function for Johnson's criteria (1958).
        share = _logistic(size_px / self.model.half_height_px, self.model.slope)
        return Clarity(
            contrast, self.model.ceiling * share, mislabel_probability(self.model.mislabel, share), share
        )

    def at_point(self, size_px: float) -> tuple[float, float]:
        """Probability of detection, and doubt, on the model's `size_curve`."""
        points = self.model.size_curve
        place = bisect_right(points, size_px, key=lambda point: point.px)
        # Constant beyond both ends; there a size of 0 needs no logarithm.
        if place in (0, len(points)):
            end = points[min(place, len(points) - 1)]
            return end.detected, end.doubt
        low, high = points[place - 1], points[place]
        share = math.log(size_px / low.px) / math.log(high.px / low.px)
        return (
            low.detected + share * (high.detected - low.detected),
            low.doubt + share * (high.doubt - low.doubt),
        )

    def effective_px(self, sighting: Sighting, concealment: float) -> float:
        """The size that counts: apparent size times contrast above the threshold times visible share."""
        return self._effective_px(sighting, self._contrast(sighting, concealment))

    def _contrast(self, sighting: Sighting, concealment: float) -> float:
        # Koschmieder (1924): contrast falls exponentially with range.
        contrast = math.exp(-self.extinction_per_m * sighting.range_m) * self.light
        return contrast * (1.0 - self.model.concealment_weight * concealment)

    def _effective_px(self, sighting: Sighting, contrast: float) -> float:
        above = max(0.0, (contrast - THRESHOLD_CONTRAST) / (1.0 - THRESHOLD_CONTRAST))
        # Piper's law: for objects of middling size contrast and size trade one to one.
        return sighting.height_px * above * sighting.visible


def mislabel_probability(at_threshold: float, share: float) -> float:
    """Probability of a wrong label, from the one at the threshold of detection and the share of the ceiling."""
    return min(1.0, 2.0 * at_threshold * (1.0 - share))


def _logistic(ratio: float, slope: float) -> float:
    """ratio^slope / (1 + ratio^slope), without overflow for absurd slopes; 0 at 0."""
    if ratio <= 0.0:
        return 0.0
    exponent = slope * math.log(ratio)
    # math.exp overflows above 709.
    return 1.0 / (1.0 + math.exp(-exponent)) if exponent > -700.0 else 0.0
