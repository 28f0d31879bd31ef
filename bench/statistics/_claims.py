"""What a count of passes supports, as numbers and as a sentence (docs/rulings.md 18).

All bounds are one-sided and exact (Clopper and Pearson 1934), for independent runs of one pass rate.
"""

from __future__ import annotations

import math

from scipy import stats

from ._intervals import CONFIDENCE_LEVEL
from ._power import least


def pass_rate_at_least(passed: int, tried: int, level: float = CONFIDENCE_LEVEL) -> float:
    """Lower bound of the pass rate with confidence `level`; 0 without a pass."""
    _require_counts(passed, tried)
    return float(stats.beta.ppf(1.0 - level, passed, tried - passed + 1)) if passed else 0.0


def pass_rate_at_most(passed: int, tried: int, level: float = CONFIDENCE_LEVEL) -> float:
    """Upper bound of the pass rate with confidence `level`; 1 where all passed."""
    return 1.0 - pass_rate_at_least(tried - passed, tried, level)


def further_passes_for_claim(passed: int, tried: int, share: float, level: float = CONFIDENCE_LEVEL) -> int:
    """Further straight passes that support a claim of `share`; 0 where it holds already. After nothing 59 for 95 % at 95 %
    confidence, as 0.95^59 < 0.05.

    Raises ValueError unless 0 < share < 1.
    """
    _require_counts(passed, tried)
    if not 0.0 < share < 1.0:
        raise ValueError(
            f"no number of passes supports a claim of {share:g}; give a share above 0 and below 1"
        )
    if _claims(passed, tried, share, level):
        return 0
    more = least(lambda more: _claims(passed + more, tried + more, share, level), most=math.inf)
    assert more is not None  # without a limit it is found
    return more


def claim(passed: int, tried: int, share: float = 0.95, level: float = CONFIDENCE_LEVEL) -> str:
    """A sentence: what `passed` of `tried` runs support, and how many straight passes a claim of `share` needs."""
    _require_counts(passed, tried)
    if tried == 0:
        return f"Nothing was tried, so nothing can be claimed; {_needed_text(further_passes_for_claim(0, 0, share, level), share)}."
    counted = f"{passed} of {tried} runs passed"
    if passed == 0:
        # Printed bounds are rounded to the safe side.
        upper_percent = math.ceil(pass_rate_at_most(0, tried, level) * 1000 - 1e-9) / 10
        return f"{counted}: with {_percent(level)} confidence at most {upper_percent:.1f} % of such runs would (one-sided, exact)."
    lower_percent = math.floor(pass_rate_at_least(passed, tried, level) * 1000 + 1e-9) / 10
    further_passes = further_passes_for_claim(passed, tried, share, level)
    if further_passes == 0:
        rest = f"which is enough to claim {_percent(share)}"
    elif passed == tried:
        rest = f"{_needed_text(further_passes_for_claim(0, 0, share, level), share)}: {further_passes} more"
    else:
        rest = f"{further_passes} more straight {'pass is' if further_passes == 1 else 'passes are'} needed to claim {_percent(share)}"
    return f"{counted}: with {_percent(level)} confidence at least {lower_percent:.1f} % of such runs would (one-sided, exact); {rest}."


def _claims(passed: int, tried: int, share: float, level: float) -> bool:
    """Whether this many passes or more are too unlikely at a pass rate of `share`."""
    # The tail probability is computed directly; the bound of `pass_rate_at_least` is a root that may be
    # rounded to the wrong side.
    return tried > 0 and float(stats.binom.sf(passed - 1, tried, share)) <= 1.0 - level


def _require_counts(passed: int, tried: int) -> None:
    if not 0 <= passed <= tried:
        raise ValueError(f"{passed} of {tried} is not a count of passes")


def _needed_text(count: int, share: float) -> str:
    return f"{count} straight passes are needed to claim {_percent(share)}"


def _percent(share: float) -> str:
    return f"{share * 100:g} %"
