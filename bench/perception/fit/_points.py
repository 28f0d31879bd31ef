"""A curve over size through points, for detectors that the stated form does not fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from bench.arrays import Bools, Counts, Floats
from bench.simspec import SizePoint

MIN_IN_BIN = 60
"""Sightings, and hits for doubts, that a bin has at least. Chosen: a share of a half is then known to 13 %."""

MISFIT_SHARE = 0.05
MISFIT_DEVIATIONS = 6.0
"""The stated form does not fit where a band has more or fewer detections than expected by both. Chosen: successive frames
are alike, so that the deviation of independent sightings counts double and more."""

_ROUNDS = 40


def misfits(groups: Counts, hits: Bools, probability: Floats) -> bool:
    """Whether the hits in groups differ from those expected by more than chance and the tolerance of a fit."""
    observed: Floats = np.bincount(groups, weights=hits).astype(np.float64)
    expected: Floats = np.bincount(groups, weights=probability).astype(np.float64)
    apart = np.abs(observed - expected)
    allowed = np.maximum(MISFIT_SHARE * observed, MISFIT_DEVIATIONS * np.sqrt(np.maximum(expected, 1.0)))
    return bool((apart > allowed).any())


@dataclass(frozen=True, slots=True, eq=False)
class PointCurve:
    """Probability of detection and doubt at some effective sizes; lines over the logarithm between them."""

    log_px: Floats
    detected: Floats
    doubt: Floats

    def probability(self, size_px: Floats) -> Floats:
        """The probability of detection at these sizes."""
        return self._at(size_px, self.detected)

    def doubt_at(self, size_px: Floats) -> Floats:
        """The factor on the probabilities of wrong labels."""
        return self._at(size_px, self.doubt)

    def points(self) -> tuple[SizePoint, ...]:
        """As a model has them."""
        return tuple(
            SizePoint(
                px=round(float(np.exp(size)), 3),
                detected=round(float(share), 5),
                doubt=round(float(doubt), 4),
            )
            for size, share, doubt in zip(self.log_px, self.detected, self.doubt, strict=True)
        )

    def _at(self, size_px: Floats, values: Floats) -> Floats:
        sizes: Floats = np.log(np.maximum(size_px, 1e-9))
        result: Floats = np.interp(sizes, self.log_px, values)
        return result


def fit_points(size_px: Floats, hit: Bools, group: Sequence[str]) -> tuple[PointCurve, dict[str, float]]:
    """A curve and a factor for each group that expect in each bin of sizes, and in each group, as many hits as there were.

    Doubts are all 1.
    """
    bins, log_px = _bins(size_px)
    sizes: Floats = np.log(np.maximum(size_px, 1e-9))
    names, members = np.unique(np.array(group), return_inverse=True)
    in_bin, in_group = (np.bincount(part, weights=hit) for part in (bins, members))
    values = (in_bin + 1e-6) / np.bincount(bins)
    factors = np.ones(len(names))
    for _ in range(_ROUNDS):
        # By turns (iterative proportional fitting, Deming and Stephan 1940); lines cut corners: points move.
        expected = np.minimum(1.0, np.interp(sizes, log_px, values) * factors[members])
        values *= in_bin / np.maximum(np.bincount(bins, weights=expected), 1e-9)
        expected = np.minimum(1.0, np.interp(sizes, log_px, values) * factors[members])
        factors *= in_group / np.maximum(np.bincount(members, weights=expected), 1e-9)
        # The curve is that of the sightings as they were mixed, as far as probabilities end at 1.
        scale = min(float((in_group * factors).sum() / max(1.0, in_group.sum())), 1.0 / float(values.max()))
        values, factors = values * scale, factors / scale
    curve = PointCurve(log_px, np.clip(values, 0.0, 1.0), np.ones(len(log_px)))
    return curve, {str(name): float(factor) for name, factor in zip(names, factors, strict=True)}


def fit_doubts(curve: PointCurve, size_px: Floats, wrong: Bools, group: Sequence[str]) -> PointCurve:
    """The curve with doubts that expect as many wrong labels in each bin as there were, over the hits with a known label.

    Each group of them has a probability of its own beside the doubt.
    """
    if len(size_px) < 2 * MIN_IN_BIN or not wrong.any():
        return curve
    bins, log_px = _bins(size_px)
    sizes: Floats = np.log(size_px)
    observed = np.bincount(bins, weights=wrong)
    values = np.ones(len(log_px))
    _, members = np.unique(np.array(group), return_inverse=True)
    for _ in range(_ROUNDS):
        doubt = np.interp(sizes, log_px, values)
        expected = np.bincount(bins, weights=_expected_wrong(doubt, wrong, members))
        values = np.clip(values * (observed + 0.1) / (expected + 0.1), 0.0, 20.0)
    return PointCurve(curve.log_px, curve.detected, np.interp(curve.log_px, log_px, values))


def at_threshold(doubt: Floats, wrong: int) -> float:
    """The probability with which as many wrong labels are expected as there were: 1 where no probability is enough."""

    def excess(probability: float) -> float:
        return float(np.minimum(1.0, probability * doubt).sum()) - wrong

    return 1.0 if excess(1.0) <= 0.0 else float(brentq(excess, 0.0, 1.0))


def _expected_wrong(doubt: Floats, wrong: Bools, members: Counts) -> Floats:
    expected = np.zeros(len(doubt))
    for number in range(int(members.max()) + 1):
        chosen = members == number
        probability = at_threshold(doubt[chosen], int(wrong[chosen].sum()))
        expected[chosen] = np.minimum(1.0, probability * doubt[chosen])
    return expected


def _bins(size_px: Floats) -> tuple[Counts, Floats]:
    """The number of the bin of each size, and the median logarithm in each bin.

    Bins are half octaves; one with too few sizes is joined with the next, the last with the one before.
    """
    sizes: Floats = np.log(np.maximum(size_px, 1e-9))
    steps: Counts = np.floor(2.0 * sizes / math.log(2.0)).astype(np.int64)
    borders, count = [], 0
    for step in np.unique(steps):
        if count >= MIN_IN_BIN:
            borders.append(int(step))
            count = 0
        count += int((steps == step).sum())
    if borders and count < MIN_IN_BIN:
        borders.pop()
    bins: Counts = np.searchsorted(np.array(borders), steps, side="right").astype(np.int64)
    return bins, np.array([float(np.median(sizes[bins == number])) for number in range(len(borders) + 1)])
