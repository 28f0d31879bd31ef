"""Adjustment of p values for the number of tests.

Benjamini, Y. and Hochberg, Y. (1995), Journal of the Royal Statistical Society B 57(1), 289-300: it controls the share of false
findings.
"""

from __future__ import annotations

from collections.abc import Sequence

from scipy.stats import false_discovery_control


def benjamini_hochberg(values: Sequence[float | None]) -> list[float | None]:
    """Adjusted p values in the same places; None stays None and is not counted as a test."""
    tested = [value for value in values if value is not None]
    adjusted = iter(false_discovery_control(tested).tolist() if tested else [])
    return [None if value is None else next(adjusted) for value in values]
