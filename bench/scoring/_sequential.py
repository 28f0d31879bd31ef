"""Intervals that hold at every look, so that one may look after each run and stop: confidence sequences for a pass rate.

Robbins' mixture of binomial likelihoods under a uniform prior. For the true rate p the ratio of the mixture's likelihood to
p's is a non-negative martingale of mean 1, so by Ville's inequality it ever reaches 1 / (1 - level) with probability at most
1 - level; the rates for which it has not are the sequence.

Robbins, H. (1970), "Statistical methods related to the law of the iterated logarithm", Annals of Mathematical Statistics
41(5), 1397-1409. Howard, S. R., Ramdas, A., McAuliffe, J. and Sekhon, J. (2021), "Time-uniform, nonparametric, nonasymptotic
confidence sequences", Annals of Statistics 49(2), 1055-1080.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ._plan import Bools, Floats

LEVEL = 0.95
_HALVINGS = 40


def confidence_sequence(passed: ArrayLike, level: float = LEVEL) -> tuple[Floats, Floats]:
    """Two-sided interval after each trial, in order, along the last axis; never wider than after the trial before.

    With probability `level` all of them hold the true rate at once, for independent trials of one pass probability. (Where
    they do not, the lower end may come to lie above the upper.)
    """
    ok = np.asarray(passed, dtype=np.float64)
    passes = np.cumsum(ok, axis=-1)
    fails = np.cumsum(1.0 - ok, axis=-1)
    limit = special.betaln(1.0 + passes, 1.0 + fails) + np.log(1.0 - level)
    best = passes / np.maximum(passes + fails, 1.0)
    low = np.where(passes > 0, _edge(passes, fails, limit, np.zeros_like(best), best), 0.0)
    high = np.where(fails > 0, _edge(passes, fails, limit, np.ones_like(best), best), 1.0)
    return np.maximum.accumulate(low, axis=-1), np.minimum.accumulate(high, axis=-1)


def _edge(passes: Floats, fails: Floats, limit: Floats, outside: Floats, inside: Floats) -> Floats:
    """Where the likelihood falls to `limit` between a rate that it rules out and the best one, by halving."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (outside + inside)
        holds = special.xlogy(passes, middle) + special.xlog1py(fails, -middle) > limit
        inside, outside = np.where(holds, middle, inside), np.where(holds, outside, middle)
    return outside


class Verdict(StrEnum):
    """Where a pass rate lies, as far as trials tell."""

    ABOVE = "above"
    BELOW = "below"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """Trials may end when the sequence of their pass rate lies wholly on one side of `threshold`.

    Whatever the rule, and whoever looks how often, a verdict is wrong with probability at most 1 - `level`. Raises ValueError
    for a threshold or level that is not between 0 and 1.
    """

    threshold: float
    level: float = LEVEL

    def __post_init__(self) -> None:
        if not (0.0 < self.threshold < 1.0 and 0.0 < self.level < 1.0):
            raise ValueError(f"threshold {self.threshold:g} and level {self.level:g} must lie between 0 and 1")

    def settled_after(self, passed: ArrayLike) -> int | None:
        """After how many of these trials, taken in order, the verdict stood; None while it is open.

        It depends on nothing but the trials up to there: hand them over in the order of the plan, not in that of their ending.
        """
        ruled_out = self._ruled_out(passed)
        return int(np.argmax(ruled_out)) + 1 if ruled_out.any() else None

    def verdict(self, passed: ArrayLike) -> Verdict:
        """On which side the pass rate lies."""
        after = self.settled_after(passed)
        if after is None:
            return Verdict.OPEN
        rate = float(np.mean(np.asarray(passed, dtype=np.float64)[:after]))
        return Verdict.ABOVE if rate > self.threshold else Verdict.BELOW

    def _ruled_out(self, passed: ArrayLike) -> Bools:
        ok = np.asarray(passed, dtype=np.float64)
        passes, fails = np.cumsum(ok), np.cumsum(1.0 - ok)
        own = passes * np.log(self.threshold) + fails * np.log1p(-self.threshold)
        return np.asarray(special.betaln(1.0 + passes, 1.0 + fails) - own >= -np.log(1.0 - self.level), dtype=np.bool_)
