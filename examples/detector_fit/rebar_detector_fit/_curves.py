"""Probabilities and rates that expect as many events as there were."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import expit, logit, ndtr, ndtri, owens_t

from bench.arrays import Bools, Counts, Floats

MIN_SIGHTINGS = 50
"""Fewer sightings, hits or misses than this show no curve; chosen."""

MIN_IN_BIN = 60
"""Sightings, and hits for doubts, that a bin has at least. Chosen: a share of a half is then known to 13 %."""

LONGEST_CORRELATION_S = 30.0

_BOUNDS = ((math.log(0.5), math.log(1000.0)), (math.log(0.3), math.log(30.0)), (-4.0, 9.0))


def crossing(growing: Callable[[float], float], low: float, high: float) -> float:
    """Where a growing function is zero; the bound beyond which it would be."""
    if growing(low) >= 0.0:
        return low
    return high if growing(high) <= 0.0 else float(brentq(growing, low, high))


@dataclass(frozen=True, slots=True)
class SizeCurve:
    """ceiling / (1 + (half / size)^slope)."""

    half_px: float
    slope: float
    ceiling: float

    @property
    def parameters(self) -> dict[str, float]:
        """By the names that a model has for them."""
        return {"half_height_px": self.half_px, "slope": self.slope, "ceiling": self.ceiling}

    def share(self, size_px: Floats) -> Floats:
        """The share of the ceiling at these effective sizes."""
        share: Floats = expit(self.slope * np.log(np.maximum(size_px, 1e-9) / self.half_px))
        return share


def fit_curve(size_px: Floats, hit: Bools, start: SizeCurve) -> SizeCurve | None:
    """The curve of greatest likelihood, taking sightings as independent; None with too few hits or misses.

    Correlated misses make the estimate less certain than independent ones would, not biased.
    """
    if min(np.count_nonzero(hit), np.count_nonzero(~hit)) < MIN_SIGHTINGS:
        return None

    def curve_of(parameters: Floats) -> SizeCurve:
        half, slope, ceiling = parameters
        return SizeCurve(math.exp(half), math.exp(slope), float(expit(ceiling)))

    def badness(parameters: Floats) -> float:
        curve = curve_of(parameters)
        p = np.clip(curve.ceiling * curve.share(size_px), 1e-9, 1.0 - 1e-9)
        return -float(np.log(np.where(hit, p, 1.0 - p)).mean())

    ceiling = float(logit(min(0.999, max(0.02, start.ceiling))))
    first = [math.log(start.half_px), math.log(start.slope), ceiling]
    return curve_of(minimize(badness, np.array(first), method="L-BFGS-B", bounds=_BOUNDS).x)


def fit_points(size_px: Floats, event: Bools, group: Counts) -> tuple[Floats, Floats, Floats]:
    """Logarithms of sizes, probabilities there, and a factor for each group.

    They expect as many events in each bin of sizes, and in each group, as there were; straight lines between the sizes.
    """
    bins, log_px = _bins(size_px)
    sizes: Floats = np.log(np.maximum(size_px, 1e-9))
    in_bin, in_group = (np.bincount(part, weights=event) for part in (bins, group))
    values = (in_bin + 1e-6) / np.bincount(bins)
    factors = np.ones(len(in_group))
    for _ in range(40):
        # By turns (iterative proportional fitting, Deming and Stephan 1940); lines cut corners: points move.
        expected = np.minimum(1.0, np.interp(sizes, log_px, values) * factors[group])
        values *= in_bin / np.maximum(np.bincount(bins, weights=expected), 1e-9)
        expected = np.minimum(1.0, np.interp(sizes, log_px, values) * factors[group])
        factors *= in_group / np.maximum(np.bincount(group, weights=expected), 1e-9)
        # The curve is that of the sightings as they were mixed, as far as probabilities end at 1.
        scale = min(float((in_group * factors).sum() / max(1.0, in_group.sum())), 1.0 / float(values.max()))
        values, factors = values * scale, factors / scale
    return log_px, values, factors


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


def fit_correlation_s(first_p: Floats, second_p: Floats, span_s: Floats, both_hit: int) -> float:
    """The correlation time with which the copula expects that many pairs of hits.

    0 when there were no more pairs than independent misses leave.
    """

    def excess(time_s: float) -> float:
        rho = np.exp(-span_s / max(time_s, 1e-6))
        return float(joint_probability(first_p, second_p, rho).sum()) - both_hit

    return crossing(excess, 0.0, LONGEST_CORRELATION_S)


def joint_probability(first_p: Floats, second_p: Floats, rho: Floats) -> Floats:
    """Probability that two standard normals of correlation rho both lie below the quantiles of these probabilities.

    By Owen's T function (Owen 1956).
    """
    h, k = (ndtri(np.clip(p, 1e-9, 1.0 - 1e-9)) for p in (first_p, second_p))
    # The formula divides by both quantiles.
    h, k = (np.where(np.abs(quantile) < 1e-9, 1e-9, quantile) for quantile in (h, k))
    spread = np.sqrt(1.0 - np.minimum(rho, 0.999999) ** 2)
    tails = owens_t(h, (k / h - rho) / spread) + owens_t(k, (h / k - rho) / spread)
    joint: Floats = (ndtr(h) + ndtr(k)) / 2.0 - tails - np.where(h * k < 0.0, 0.5, 0.0)
    return joint


def solve_rate(span_s: Floats, events: int) -> float:
    """The rate per second with which 1 - exp(-rate * span) over these spans adds up to the number of events."""
    if not len(span_s):
        return 0.0
    least_s = float(span_s.min())
    if events >= len(span_s):
        return 1.0 / least_s
    return crossing(lambda rate: float(-np.expm1(-rate * span_s).sum()) - events, 0.0, 50.0 / least_s)
