"""How long something took, over a session."""

from __future__ import annotations

from bisect import insort


class Latencies:
    """Spans of host time, and their median and 99th percentile in milliseconds."""

    def __init__(self) -> None:
        self._sorted_s: list[float] = []

    def add(self, span_s: float) -> None:
        insort(self._sorted_s, span_s)

    def summary(self) -> dict[str, float]:
        """Empty without a span."""
        if not self._sorted_s:
            return {}
        last = len(self._sorted_s) - 1
        ranks = {"median_ms": 0.5, "p99_ms": 0.99, "max_ms": 1.0}
        return {name: round(1000.0 * self._sorted_s[round(rank * last)], 3) for name, rank in ranks.items()}
