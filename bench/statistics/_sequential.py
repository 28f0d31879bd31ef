"""Anytime-valid intervals, which allow a look after every run and a stop: confidence sequences for a pass
rate and a mean.

Robbins' mixture of binomial likelihoods under a uniform prior. For the true rate p the ratio of the mixture's
likelihood to p's is a non-negative martingale of mean 1, so by Ville's inequality it ever reaches 1 / (1 -
level) with probability at most 1 - level; the rates for which it has not are the sequence.

Robbins, H. (1970), "Statistical methods related to the law of the iterated logarithm", Annals of Mathematical
Statistics 41(5), 1397-1409. Howard, S. R., Ramdas, A., McAuliffe, J. and Sekhon, J. (2021), "Time-uniform,
nonparametric, nonasymptotic confidence sequences", Annals of Statistics 49(2), 1055-1080.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from bench.arrays import Bools, Floats

from ._intervals import CONFIDENCE_LEVEL

# 2**-40 is below any difference that a report shows.
_BISECTION_STEPS = 40
# Exponents of the mixture in `mean_bounds`. Any fixed ones are valid; these are near the best for 5 to
# 100,000 trials.
_TILTS = 2.0 ** np.arange(-5, 5)


def pass_rate_bounds(
    passes: ArrayLike, trials: ArrayLike, level: float = CONFIDENCE_LEVEL
) -> tuple[Floats, Floats]:
    """Two-sided interval of a pass rate from counts, valid whenever and for whatever reason the trials ended;
    [0, 1] without any.

    For independent trials of one pass probability.
    """
    k, n = np.asarray(passes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    limit = special.betaln(1.0 + k, 1.0 + n - k) + np.log(1.0 - level)
    best = k / np.maximum(n, 1.0)

    def holds(rate: Floats) -> Bools:
        return np.asarray(special.xlogy(k, rate) + special.xlog1py(n - k, -rate) > limit, dtype=np.bool_)

    low = np.where(k > 0, _bisected(holds, np.zeros_like(best), best), 0.0)
    high = np.where(n - k > 0, _bisected(holds, np.ones_like(best), best), 1.0)
    return low, high


def mean_bounds(
    total: ArrayLike, trials: ArrayLike, level: float = CONFIDENCE_LEVEL
) -> tuple[Floats, Floats]:
    """Two-sided interval of a mean of values in [0, 1], valid whenever and for whatever reason the trials ended.

    Trials may have different situations and depend on earlier ones: the interval is for the mean of the
    expectations that the trials had before they began. For independent replicates of design points it is the
    mean over the design points of their expectations, weighted by the trials that each has. `total` is the
    sum of the values.

    For X in [0, 1] of expectation mu, E exp(tX) <= 1 - mu + mu exp(t); the logarithm of the right side is
    concave in mu. So exp(t total) / (1 - m + m exp(t)) ** trials, with m the mean of the expectations, is
    never above a supermartingale that begins at 1, and a fixed mixture over t ever reaches 2 / (1 - level)
    with probability at most (1 - level) / 2 (Ville).
    """
    summed, n = np.asarray(total, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    return _mean_lower_bound(summed, n, level), 1.0 - _mean_lower_bound(n - summed, n, level)


def _mean_lower_bound(total: Floats, trials: Floats, level: float) -> Floats:
    """The lower bound of the mean; the mixture falls with the mean."""
    limit = np.log(2.0 / (1.0 - level)) + np.log(_TILTS.size)

    def holds(mean: Floats) -> Bools:
        gained = [tilt * total - trials * np.log1p(mean * np.expm1(tilt)) for tilt in _TILTS]
        return np.asarray(special.logsumexp(gained, axis=0) < limit, dtype=np.bool_)

    return _bisected(holds, np.zeros_like(trials), total / np.maximum(trials, 1.0))


def _bisected(holds: Callable[[Floats], Bools], outside: Floats, inside: Floats) -> Floats:
    """The edge of what holds, by bisection between an excluded value and one inside."""
    for _ in range(_BISECTION_STEPS):
        middle = 0.5 * (outside + inside)
        is_inside = holds(middle)
        inside, outside = np.where(is_inside, middle, inside), np.where(is_inside, outside, middle)
    return outside


class PassRateVerdict(StrEnum):
    """On which side of a threshold the pass rate lies; OPEN while the trials do not tell."""

    ABOVE = "above"
    BELOW = "below"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """Trials may stop when the confidence sequence of their pass rate lies entirely on one side of `threshold`.

    A verdict is wrong with probability at most 1 - `level`, however often somebody looks. Raises ValueError
    for a threshold or a level that is not between 0 and 1.
    """

    threshold: float
    level: float = CONFIDENCE_LEVEL

    def __post_init__(self) -> None:
        if not (0.0 < self.threshold < 1.0 and 0.0 < self.level < 1.0):
            raise ValueError(
                f"threshold {self.threshold:g} and level {self.level:g} must lie between 0 and 1"
            )

    def decided_after(self, passed: ArrayLike) -> int | None:
        """Number of trials, taken in order, after which the verdict was final; None while it is open.

        It depends on the trials up to that one only. Pass them in the order of the plan, not in the order of
        their completion.
        """
        ruled_out = self._ruled_out(passed)
        return int(np.argmax(ruled_out)) + 1 if ruled_out.any() else None

    def verdict(self, passed: ArrayLike) -> PassRateVerdict:
        """The side on which the pass rate lies."""
        after = self.decided_after(passed)
        if after is None:
            return PassRateVerdict.OPEN
        rate = float(np.mean(np.asarray(passed, dtype=np.float64)[:after]))
        return PassRateVerdict.ABOVE if rate > self.threshold else PassRateVerdict.BELOW

    def _ruled_out(self, passed: ArrayLike) -> Bools:
        results = np.asarray(passed, dtype=np.float64)
        passes, fails = np.cumsum(results), np.cumsum(1.0 - results)
        log_likelihood = passes * np.log(self.threshold) + fails * np.log1p(-self.threshold)
        return np.asarray(
            special.betaln(1.0 + passes, 1.0 + fails) - log_likelihood >= -np.log(1.0 - self.level),
            dtype=np.bool_,
        )
