"""Sizes of differences: pass rates of pairs with Tango's score interval, McNemar's exact test.

Tango, T. (1998), "Equivalence test and confidence interval for the difference in proportions for the
paired-sample design", Statistics in Medicine 17, 891-908. Fagerland, M. W., Lydersen, S. and Laake, P.
(2014), "Recommended tests and confidence intervals for paired binomial proportions", Statistics in Medicine
33, 2850-2875.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats


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
