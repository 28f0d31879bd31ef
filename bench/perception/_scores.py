"""Scores by their quantiles: of detections with the right label, with a wrong one, and of nothing."""

from __future__ import annotations

from collections.abc import Sequence


def score_at(quantiles: Sequence[float], uniform: float) -> float:
    """The score that a draw on [0, 1] picks: quantiles in equal steps, straight lines between them."""
    place = uniform * (len(quantiles) - 1)
    low = min(int(place), len(quantiles) - 2)
    return quantiles[low] + (place - low) * (quantiles[low + 1] - quantiles[low])
