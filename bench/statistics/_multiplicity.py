"""Adjustment of p values for the number of tests.

Benjamini, Y. and Hochberg, Y. (1995), Journal of the Royal Statistical Society B 57(1), 289-300 (controls the
share of false findings); Holm, S. (1979), Scandinavian Journal of Statistics 6(2), 65-70 (controls the chance
of any).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import false_discovery_control

from bench.arrays import Floats

PValues = Sequence[float | None]


def benjamini_hochberg(values: PValues) -> list[float | None]:
    """Adjusted p values in the same places; None stays None and is not counted as a test."""
    return _adjusted(values, false_discovery_control)


def holm(values: PValues) -> list[float | None]:
    """Adjusted p values in the same places; None stays None and is not counted as a test."""

    # SciPy has none, and that of statsmodels takes a second and a half to import.
    def adjust(p: Floats) -> Floats:
        order = np.argsort(p)
        ascending = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
        return np.minimum(ascending, 1.0)[np.argsort(order)]

    return _adjusted(values, adjust)


def _adjusted(values: PValues, adjust: Callable[[Floats], Floats]) -> list[float | None]:
    tested = [value for value in values if value is not None]
    adjusted = iter(adjust(np.array(tested)).tolist() if tested else [])
    return [None if value is None else next(adjusted) for value in values]
