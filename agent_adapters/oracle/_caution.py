"""Care for people whose places are known."""

from __future__ import annotations

import math

from ..reference.flight._caution import Caution
from ..reference.flight._paths import Place

# Where everybody is, is known: enough for the steps of a moment and for gusts. Chosen, not measured.
NEAR_MARGIN_M, SLOW_SHARE, BRAKING_MPS2, CREEP_SHARE = 2.0, 0.95, 2.5, 0.5


class OracleCaution(Caution):
    """The rules about people, kept with the small margins of a pilot who knows where they are."""

    def speed_mps(self, asked_mps: float, place: Place, people: list[Place]) -> float:
        if self.slow_mps is None or self.slow_within_m is None or not people:
            return asked_mps
        nearest_m = min(math.dist(place, person) for person in people)
        room_m = max(0.0, nearest_m - self.slow_within_m - NEAR_MARGIN_M)
        return min(asked_mps, math.sqrt((SLOW_SHARE * self.slow_mps) ** 2 + 2.0 * BRAKING_MPS2 * room_m))

    def drifted(self, stand: Place, people: list[Place], span_s: float) -> Place:
        """Half as fast as the reference agent creeps: with a drifting position that still counts as standing."""
        return super().drifted(stand, people, CREEP_SHARE * span_s)
