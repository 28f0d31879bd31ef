"""Whether satellite navigation drifts: the position that the autopilot states moves otherwise than its velocity
says. Pure.

A position that contradicts the velocity is what an estimator calls an innovation. While it lasts, the place
is reckoned from the velocity.
"""

from __future__ import annotations

import math
from collections import deque

# Compared over this span. Chosen, not measured.
WINDOW_S = 8.0
# Apart by more at the two ends of the window, the position drifts. The slow error of a receiver as simulated
# (0.8 m, 60 s) moves 0.03 m/s (one sigma on each axis); a drift of 0.25 m/s is noticed after some 6 s.
SHIFT_M = 1.2
# Means over this long are compared, against the noise of single fixes. Chosen, not measured.
MEAN_S = 1.0
# Of the largest offset: below it the position has jumped back. Chosen, not measured.
BACK_SHARE = 0.5
# A position that has jumped back is believed once it moves less than this in `MEAN_S`. Chosen, not measured.
SETTLED_M = 0.2
# Without a position for longer, nothing is known of what happened meanwhile. Chosen, not measured.
GAP_S = 1.0
# From one position to the next, against the velocity: no drift, the autopilot has set its position anew. Chosen,
# not measured.
JUMP_M = 2.0
# After fixes were away, the estimate moves to where they are. Chosen, not measured.
AGAIN_S = 5.0
# One sigma of a place reckoned from velocity: at once, of the offset, and with time. Chosen, not measured.
DOUBT_M, DOUBT_SHARE, DOUBT_MPS = 1.0, 0.15, 0.03

EastNorth = tuple[float, float]


class DriftCheck:
    """Follows position and velocity. `offset_en_m` is what to take from the position while it drifts."""

    def __init__(self) -> None:
        self.offset_en_m: EastNorth = (0.0, 0.0)
        self.since_s: float | None = None  # None while the position can be believed
        self._last: tuple[float, EastNorth] | None = None  # moment and velocity
        self._reckoned: EastNorth = (0.0, 0.0)
        self._apart: deque[tuple[float, float, float]] = deque()  # moment, position less what is reckoned
        self._reference: EastNorth = (0.0, 0.0)
        self._peak_m = 0.0
        self._returning = False
        self._suspended_s = -math.inf

    @property
    def doubt_m(self) -> float:
        """One sigma of the place while it drifts, as of the latest position; else 0."""
        if self.since_s is None or self._last is None:
            return 0.0
        return (
            DOUBT_M + DOUBT_SHARE * math.hypot(*self.offset_en_m) + DOUBT_MPS * (self._last[0] - self.since_s)
        )

    def suspend(self, now_s: float) -> None:
        """Fixes are away: the position will jump when they return, and this is no drift."""
        self._suspended_s = now_s

    def take(self, time_s: float, place_en_m: EastNorth, velocity_en_mps: EastNorth) -> None:
        """Take in one position and the velocity of the same moment."""
        if self._last is not None:
            last_s, (east, north) = self._last
            span_s = time_s - last_s
            if span_s <= 0.0:
                return
            self._reckoned = (
                self._reckoned[0] + 0.5 * (east + velocity_en_mps[0]) * span_s,
                self._reckoned[1] + 0.5 * (north + velocity_en_mps[1]) * span_s,
            )
            if span_s > GAP_S:
                self._apart.clear()
        self._last = (time_s, velocity_en_mps)
        if self.since_s is None and time_s < self._suspended_s + AGAIN_S:
            self._apart.clear()
            return
        apart = (place_en_m[0] - self._reckoned[0], place_en_m[1] - self._reckoned[1])
        if self.since_s is None and self._apart and math.dist(self._apart[-1][1:], apart) > JUMP_M:
            self._apart.clear()
        self._apart.append((time_s, *apart))
        while self._apart[0][0] < time_s - WINDOW_S:
            self._apart.popleft()
        if self.since_s is None:
            self._look_for_drift(time_s)
        else:
            self._follow_drift(time_s)

    def _look_for_drift(self, time_s: float) -> None:
        if time_s - self._apart[0][0] < 2.0 * MEAN_S:
            return
        begin, end = self._mean(self._apart[0][0] + MEAN_S, first=True), self._mean(time_s - MEAN_S)
        if math.dist(begin, end) > SHIFT_M:
            self.since_s, self._reference = time_s, begin
            self._peak_m, self._returning = 0.0, False
            self._follow_drift(time_s)

    def _follow_drift(self, time_s: float) -> None:
        _, east_m, north_m = self._apart[-1]
        self.offset_en_m = (east_m - self._reference[0], north_m - self._reference[1])
        offset_m = math.hypot(*self.offset_en_m)
        self._peak_m = max(self._peak_m, offset_m)
        self._returning = self._returning or offset_m < BACK_SHARE * self._peak_m
        if self._returning:
            earlier = next(entry for entry in self._apart if entry[0] >= time_s - MEAN_S - 1e-6)
            if math.dist(earlier[1:], (east_m, north_m)) < SETTLED_M:
                self.since_s, self.offset_en_m = None, (0.0, 0.0)
                self._apart.clear()

    def _mean(self, bound_s: float, *, first: bool = False) -> EastNorth:
        """Mean difference up to a moment, or from it on."""
        entries = [entry for entry in self._apart if (entry[0] <= bound_s if first else entry[0] >= bound_s)]
        return (
            sum(entry[1] for entry in entries) / len(entries),
            sum(entry[2] for entry in entries) / len(entries),
        )
