"""Adjustment of p values for the number of tests.

Benjamini, Y. and Hochberg, Y. (1995), Journal of the Royal Statistical Society B 57(1), 289-300 (controls the
share of false findings); Holm, S. (1979), Scandinavian Journal of Statistics 6(2), 65-70 (controls the chance
of any).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

PValues = Sequence[float | None]


def benjamini_hochberg(values: PValues) -> list[float | None]:
    """Adjusted p values in the same places; None stays None and is not counted as a test."""
    places, p = _ascending(values)
    scaled = p * len(p) / np.arange(1, len(p) + 1)
    return _placed(np.minimum.accumulate(scaled[::-1])[::-1], places, len(values))


def holm(values: PValues) -> list[float | None]:
    """Adjusted p values in the same places; None stays None and is not counted as a test."""
    places, p = _ascending(values)
    return _placed(np.maximum.accumulate(p * np.arange(len(p), 0, -1)), places, len(values))


def _ascending(values: PValues) -> tuple[list[int], NDArray[np.float64]]:
    """The p values in ascending order, with their places in `values`."""
    ordered = sorted((value, place) for place, value in enumerate(values) if value is not None)
    return [place for _, place in ordered], np.array([value for value, _ in ordered], dtype=np.float64)


def _placed(adjusted: NDArray[np.float64], places: Sequence[int], count: int) -> list[float | None]:
    result: list[float | None] = [None] * count
    for place, value in zip(places, adjusted, strict=True):
        result[place] = min(1.0, float(value))
    return result
