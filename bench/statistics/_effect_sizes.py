"""Sizes of differences: pass rates of pairs with Tango's score interval, McNemar's exact test, Cliff's delta.

Tango, T. (1998), "Equivalence test and confidence interval for the difference in proportions for the
paired-sample design", Statistics in Medicine 17, 891-908. Fagerland, M. W., Lydersen, S. and Laake, P.
(2014), "Recommended tests and confidence intervals for paired binomial proportions", Statistics in Medicine
33, 2850-2875. Cliff, N. (1993), "Dominance statistics: ordinal analyses to answer ordinal questions",
Psychological Bulletin 114(3), 494-509; the asymmetric interval is that of Feng, D. and Cliff, N. (2004),
Journal of Modern Applied Statistical Methods 3(2), 322-332.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from bench.arrays import Floats


@dataclass(frozen=True, slots=True)
class DifferenceEstimate:
    """An estimated difference with its two-sided interval, all in [-1, 1]."""

    estimate: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class PairedCounts:
    """Pairs counted by which side passed. Every difference is second minus first."""

    both: int
    only_first: int
    only_second: int
    neither: int

    @property
    def pairs(self) -> int:
        return self.both + self.only_first + self.only_second + self.neither

    @property
    def rates(self) -> tuple[float, float] | None:
        """Pass rates of first and second; None without pairs."""
        if not self.pairs:
            return None
        return (self.both + self.only_first) / self.pairs, (self.both + self.only_second) / self.pairs

    @property
    def mcnemar_p(self) -> float | None:
        """The p value of McNemar's exact two-sided test; None where no pair differs."""
        differing = self.only_first + self.only_second
        return float(stats.binomtest(self.only_first, differing).pvalue) if differing else None

    def difference(self, confidence: float = 0.95) -> DifferenceEstimate | None:
        """Pass rate of second minus that of first, with Tango's score interval; None without pairs."""
        if not self.pairs:
            return None
        estimate = (self.only_second - self.only_first) / self.pairs
        z = float(stats.norm.ppf(0.5 + confidence / 2))
        low = (
            -1.0
            if estimate <= -1.0
            else optimize.brentq(lambda d: self._score(d) - z, -1.0 + 1e-12, estimate)
        )
        high = (
            1.0 if estimate >= 1.0 else optimize.brentq(lambda d: self._score(d) + z, estimate, 1.0 - 1e-12)
        )
        return DifferenceEstimate(estimate, float(low), float(high))

    def _score(self, difference: float) -> float:
        """Tango's statistic of a supposed difference; it falls from positive to negative as the difference rises."""
        n, b, c = self.pairs, self.only_second, self.only_first
        distance = b - c - n * difference
        if distance == 0.0:
            return 0.0
        # The most likely share of pairs that only the first side passes, given the difference: the root of a
        # quadratic.
        half = -b - c + (2 * n - b + c) * difference
        share = (np.sqrt(max(0.0, half**2 + 8 * n * c * difference * (1 - difference))) - half) / (4 * n)
        spread = n * (2 * share + difference * (1 - difference))
        return float(distance / np.sqrt(spread)) if spread > 0.0 else float(np.sign(distance) * np.inf)


def cliffs_delta(
    first: Sequence[float], second: Sequence[float], confidence: float = 0.95
) -> DifferenceEstimate | None:
    """Share of value pairs in which `second` exceeds `first`, minus the share of the reverse; None where either is empty.

    It compares two distributions and uses no pairing. The interval stays within [-1, 1]; it is [-1, 1] where
    a side has a single value, and has no width where the sides do not overlap: there the sample sizes tell
    more.
    """
    if not first or not second:
        return None
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    rows, columns = len(b), len(a)
    of_rows, of_columns = _wins(b, a), -_wins(a, b)
    delta = float(of_rows.mean())
    if min(rows, columns) < 2:
        return DifferenceEstimate(delta, -1.0, 1.0)
    if abs(delta) == 1.0:
        return DifferenceEstimate(delta, delta, delta)
    ties = int((np.searchsorted(np.sort(a), b, "right") - np.searchsorted(np.sort(a), b, "left")).sum())
    cells = rows * columns * (1 - delta**2) - ties
    above = columns**2 * float(((of_rows - delta) ** 2).sum()) + rows**2 * float(
        ((of_columns - delta) ** 2).sum()
    )
    variance = (above - cells) / (rows * columns * (rows - 1) * (columns - 1))
    # The unbiased estimate can be negative in small samples; Cliff (1993) gives this lower limit.
    variance = max(variance, (1 - delta**2) / (rows * columns - 1))
    z2v = float(stats.norm.ppf(0.5 + confidence / 2)) ** 2 * variance
    centre, reach = delta - delta**3, np.sqrt(z2v * ((1 - delta**2) ** 2 + z2v))
    low, high = (centre - reach) / (1 - delta**2 + z2v), (centre + reach) / (1 - delta**2 + z2v)
    return DifferenceEstimate(delta, max(-1.0, float(low)), min(1.0, float(high)))


def _wins(values: Floats, opponents: Floats) -> Floats:
    """For each value the share of `others` below it minus the share above it."""
    ordered = np.sort(opponents)
    below, not_above = np.searchsorted(ordered, values, "left"), np.searchsorted(ordered, values, "right")
    return np.asarray((below + not_above) / len(opponents) - 1.0)
