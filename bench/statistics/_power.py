"""Numbers of runs to plan for: pairs for McNemar's test, runs for an interval of a given width.

The power of McNemar's exact test is computed, not approximated: over the number of pairs that differ (binomial), the share of
outcomes that the exact test rejects. Duffy, S. W. (1984), "Asymptotic and exact power for the McNemar test and its analogue
with R controls per case", Biometrics 40(4), 1005-1015.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats

from bench.arrays import Counts, Floats

from ._intervals import clopper_pearson

# The search stops here: a difference that needs more runs than any campaign has is of no use. Chosen, not
# measured.
MAX_RUNS = 10_000


def mcnemar_power(pairs: int, only_first: float, only_second: float, alpha: float = 0.05) -> float:
    """The probability that McNemar's exact two-sided test rejects with this number of pairs.

    `only_first` and `only_second` are the true shares of pairs that only that side passes. Raises ValueError
    where they are not shares of the same pairs.
    """
    differing = _discordant_share(only_first, only_second)
    if differing == 0.0:
        return 0.0
    # Eight standard deviations leave out less than 1e-14 of the outcomes.
    middle, reach = pairs * differing, 8 * np.sqrt(pairs * differing * (1 - differing)) + 8
    counts = np.arange(max(0, int(middle - reach)), min(pairs, int(middle + reach)) + 1)
    return float(
        stats.binom.pmf(counts, pairs, differing) @ _rejection_chance(counts, only_second / differing, alpha)
    )


def pairs_for_difference(
    only_first: float, only_second: float, *, power: float = 0.8, alpha: float = 0.05
) -> int | None:
    """The least number of pairs with which McNemar's exact test finds such a difference with this power.

    Power does not rise evenly with the number of pairs; where it goes back and forth, the result is one of
    the rising edges. None where the shares are equal or more than MAX_RUNS pairs are needed.
    """
    if _discordant_share(only_first, only_second) == 0.0 or only_first == only_second:
        return None
    return _least(lambda pairs: mcnemar_power(pairs, only_first, only_second, alpha) >= power)


def runs_for_half_width(share: float, half_width: float, confidence: float = 0.95) -> int | None:
    """The least number of independent runs whose Clopper-Pearson interval is at most twice `half_width` wide."""
    if not 0.0 <= share <= 1.0 or half_width <= 0.0:
        raise ValueError(f"share {share} must lie in [0, 1] and half_width {half_width} above 0")

    def narrow(runs: int) -> bool:
        low, high = clopper_pearson(share * runs, runs, confidence)
        return bool((high - low) / 2 <= half_width)

    return _least(narrow)


def _rejection_chance(counts: Counts, share: float, alpha: float) -> Floats:
    """The probability that the exact test rejects, by differing pairs; `share` of them go to the second side."""
    # ppf gives the least k whose lower tail reaches alpha / 2; the test needs the greatest whose tail does
    # not exceed it.
    edge = stats.binom.ppf(alpha / 2, counts, 0.5)
    edge = np.where(stats.binom.cdf(edge, counts, 0.5) > alpha / 2, edge - 1, edge)
    return np.asarray(stats.binom.cdf(edge, counts, share) + stats.binom.sf(counts - edge - 1, counts, share))


def _discordant_share(only_first: float, only_second: float) -> float:
    if min(only_first, only_second) < 0.0 or only_first + only_second > 1.0 + 1e-12:
        raise ValueError(f"{only_first} and {only_second} are not shares of the same pairs")
    return min(1.0, only_first + only_second)


def _least(holds: Callable[[int], bool]) -> int | None:
    """The least number for which a condition holds that mostly keeps holding; None above MAX_RUNS."""
    high = 1
    while not holds(high):
        high *= 2
        if high > MAX_RUNS:
            return None
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
