"""What a count of passes can claim, in a plain sentence (docs/rulings.md 18).

All bounds are one-sided and exact (Clopper and Pearson 1934), for runs that are independent draws of the runs that are spoken of.
"""

from __future__ import annotations

import math

from scipy import stats

LEVEL = 0.95


def pass_rate_at_least(passed: int, tried: int, level: float = LEVEL) -> float:
    """The share of runs of which it can be said with confidence `level` that at least so many would pass; 0 for no passes."""
    _require_counts(passed, tried)
    return float(stats.beta.ppf(1.0 - level, passed, tried - passed + 1)) if passed else 0.0


def pass_rate_at_most(passed: int, tried: int, level: float = LEVEL) -> float:
    """The share of which it can be said that at most so many would pass; 1 where all passed."""
    return 1.0 - pass_rate_at_least(tried - passed, tried, level)


def passes_for_claim(share: float, level: float = LEVEL) -> int:
    """Passes without a failure that it takes to claim a share: 59 for 95 % with 95 % confidence, for 0.95^59 < 0.05."""
    return further_passes_for_claim(0, 0, share, level)


def further_passes_for_claim(passed: int, tried: int, share: float, level: float = LEVEL) -> int:
    """Further straight passes after which `share` can be claimed; 0 where it can be now. Raises ValueError unless 0 < share < 1."""
    _require_counts(passed, tried)
    if not 0.0 < share < 1.0:
        raise ValueError(f"no number of passes claims a share of {share:g}; give one above 0 and below 1")
    if _claims(passed, tried, share, level):
        return 0
    low, high = 0, 1  # it does not with `low` more; doubled until it does with `high` more
    while not _claims(passed + high, tried + high, share, level):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _claims(passed + middle, tried + middle, share, level) else (middle, high)
    return high


def claim(passed: int, tried: int, share: float = 0.95, level: float = LEVEL) -> str:
    """What `passed` of `tried` runs say, and how many straight passes would claim `share`."""
    _require_counts(passed, tried)
    if tried == 0:
        return f"Nothing was tried, so nothing can be claimed; {_needed_text(passes_for_claim(share, level), share)}."
    counted = f"{passed} of {tried} runs passed"
    if passed == 0:
        most = math.ceil(pass_rate_at_most(0, tried, level) * 1000 - 1e-9) / 10
        return f"{counted}: with {_percent(level)} confidence at most {most:.1f} % of such runs would (one-sided, exact)."
    least = math.floor(pass_rate_at_least(passed, tried, level) * 1000 + 1e-9) / 10
    more = further_passes_for_claim(passed, tried, share, level)
    if more == 0:
        rest = f"which is enough to claim {_percent(share)}"
    elif passed == tried:
        rest = f"{_needed_text(passes_for_claim(share, level), share)}: {more} more"
    else:
        rest = f"{more} more straight {'pass is' if more == 1 else 'passes are'} needed to claim {_percent(share)}"
    return f"{counted}: with {_percent(level)} confidence at least {least:.1f} % of such runs would (one-sided, exact); {rest}."


def _claims(passed: int, tried: int, share: float, level: float) -> bool:
    """Whether so many passes or more are too unlikely below the share; the tail itself, which has no root to round."""
    return tried > 0 and float(stats.binom.sf(passed - 1, tried, share)) <= 1.0 - level


def _require_counts(passed: int, tried: int) -> None:
    if not 0 <= passed <= tried:
        raise ValueError(f"{passed} of {tried} is no count of passes")


def _needed_text(count: int, share: float) -> str:
    return f"{count} straight passes are needed to claim {_percent(share)}"


def _percent(share: float) -> str:
    return f"{share * 100:g} %"
