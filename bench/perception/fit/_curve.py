"""Size curve and correlation of misses, from hits and misses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import ndtr, ndtri

from bench.arrays import Bools, Floats

MIN_SIGHTINGS = 50
"""Fewer sightings, hits or misses than this show no curve; chosen."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_BOUNDS = ((math.log(0.5), math.log(1000.0)), (math.log(0.3), math.log(30.0)), (-4.0, 9.0))
LONGEST_CORRELATION_S = 30.0


@dataclass(frozen=True, slots=True)
class SizeCurve:
    """ceiling / (1 + (half / size)^slope)."""

    half_px: float
    slope: float
    ceiling: float

    def share(self, size_px: Floats) -> Floats:
        """The share of the ceiling at these effective sizes."""
        with np.errstate(divide="ignore", over="ignore"):
            share: Floats = 1.0 / (1.0 + np.exp(-self.slope * np.log(size_px / self.half_px)))
        return share

    def probability(self, size_px: Floats) -> Floats:
        """The probability of detection at these effective sizes."""
        return self.ceiling * self.share(size_px)


def fit_curve(size_px: Floats, hit: Bools, start: SizeCurve) -> SizeCurve | None:
    """The curve of greatest likelihood, taking sightings as independent; None with too few hits or misses.

    Correlated misses make the estimate less certain than independent ones would, not biased.
    """
    if min(np.count_nonzero(hit), np.count_nonzero(~hit)) < MIN_SIGHTINGS:
        return None

    def curve_of(parameters: Floats) -> SizeCurve:
        half, slope, ceiling = parameters
        return SizeCurve(math.exp(half), math.exp(slope), 1.0 / (1.0 + math.exp(-ceiling)))

    def badness(parameters: Floats) -> float:
        p = np.clip(curve_of(parameters).probability(size_px), 1e-9, 1.0 - 1e-9)
        return -float(np.log(np.where(hit, p, 1.0 - p)).mean())

    ceiling = min(0.999, max(0.02, start.ceiling))
    first = [math.log(start.half_px), math.log(start.slope), math.log(ceiling / (1.0 - ceiling))]
    result = minimize(badness, np.array(first), method="L-BFGS-B", bounds=_BOUNDS)
    return curve_of(result.x)


def fit_correlation_s(first_p: Floats, second_p: Floats, span_s: Floats, both_hit: int) -> float:
    """The correlation time with which the copula expects that many pairs of hits.

    0 when there were no more pairs than independent misses leave.
    """

    def excess(log_time: float) -> float:
        rho = np.exp(-span_s / math.exp(log_time))
        return float(_both(first_p, second_p, rho).sum()) - both_hit

    low, high = math.log(0.02), math.log(LONGEST_CORRELATION_S)
    if excess(low) >= 0.0:
        return 0.0
    if excess(high) <= 0.0:
        return LONGEST_CORRELATION_S
    return math.exp(float(brentq(excess, low, high, xtol=1e-4)))


def _both(first_p: Floats, second_p: Floats, rho: Floats) -> Floats:
    """Probability that two standard normals of correlation rho both lie below the quantiles of these probabilities.

    Integral of the bivariate density over the angle (Drezner and Wesolowsky 1990), 24 nodes of Gauss and Legendre.
    """
    h, k = (ndtri(np.clip(p, 1e-9, 1.0 - 1e-9)) for p in (first_p, second_p))
    half = np.arcsin(np.minimum(rho, 0.999999)) / 2.0
    angle = half[:, None] * (_NODES[None, :] + 1.0)
    sine, cosine_squared = np.sin(angle), np.cos(angle) ** 2
    exponent = -(h[:, None] ** 2 + k[:, None] ** 2 - 2.0 * (h * k)[:, None] * sine) / (2.0 * cosine_squared)
    integral = half * (np.exp(exponent) * _WEIGHTS[None, :]).sum(axis=1) / (2.0 * math.pi)
    joint: Floats = ndtr(h) * ndtr(k) + integral
    return joint


def solve_rate(spans_s: Sequence[float], events: int) -> float:
    """The rate per second with which 1 - exp(-rate * span) over these spans adds up to the number of events."""
    spans: Floats = np.array(spans_s, dtype=np.float64)
    if not events:
        return 0.0
    if events >= len(spans):
        return 1.0 / float(spans.min())
    high = 1.0
    while float((1.0 - np.exp(-high * spans)).sum()) < events:
        high *= 2.0
    return float(brentq(lambda rate: float((1.0 - np.exp(-rate * spans)).sum()) - events, 0.0, high))
