"""How good the detections are, by the agent's own standard: their scores, compared with what is usual."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

# Scores of the last seconds; fewer say nothing about the detector, only about what is in view. Chosen.
WINDOW_S, MIN_SCORES = 4.0, 12
# The best quarter of the scores: what is near and clear. The rest depends on what happens to be in view.
BEST_SHARE = 0.25
# Of the usual: below it perception is worse, above it good again. Apart, so that it does not flutter. Chosen.
WORSE, GOOD = 0.93, 0.96
# How quickly the usual follows, by windows. Chosen, not measured.
MEMORY = 0.02


class DetectionQuality:
    """Follows the best scores of the detector. `degraded` says whether they are worse than usual."""

    def __init__(self) -> None:
        self.degraded = False
        self.best = 0.0
        self.usual: float | None = None
        self._scores: deque[tuple[float, float]] = deque()

    def take(self, time_s: float, scores: Iterable[float]) -> None:
        """Take in the scores of one frame."""
        self._scores.extend((time_s, score) for score in scores)
        while self._scores and self._scores[0][0] < time_s - WINDOW_S:
            self._scores.popleft()
        if len(self._scores) < MIN_SCORES:
            return
        ranked = sorted((score for _, score in self._scores), reverse=True)
        self.best = ranked[int(BEST_SHARE * len(ranked))]
        if self.usual is None:
            self.usual = self.best
        self.degraded = self.best < self.usual * (GOOD if self.degraded else WORSE)
        # What is worse than usual must not become the usual while it lasts.
        if not self.degraded:
            self.usual += MEMORY * (self.best - self.usual)
