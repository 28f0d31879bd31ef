"""The convoy that a mission escorts: when it comes where, and where to be to look ahead of it."""

from __future__ import annotations

import math

import numpy as np

from bench.contracts import (
    EscortDocument,
    convoy_places_m,
)

from ..flight._paths import Place

# Of the distance within which to stay: so far ahead of the first member, where the camera sees the road before it.
# Chosen, not measured.
AHEAD_SHARE = 0.5
# Chosen, not measured: some metres of driving.
STEP_S = 1.0
# Before it sets off, so that a second look does not make the vehicle late. Chosen, not measured.
READY_S = 30.0


class Convoy:
    """The plan of the escorted group, which the mission order states."""

    def __init__(self, escort: EscortDocument, limit_s: float) -> None:
        self._escort = escort
        halt_s = math.inf if escort.halt_s is None else escort.halt_s
        self._halt_s = min(halt_s, limit_s)
        self._times_s = np.arange(escort.depart_s, self._halt_s + STEP_S, STEP_S)
        self._places_m = convoy_places_m(escort, self._times_s)
        starts = np.array([(point.east_m, point.north_m) for point in escort.starts])
        route = np.array([(point.east_m, point.north_m) for point in escort.route])
        # Whoever starts nearest to its first point of the route drives at the head.
        self._head = int(np.linalg.norm(starts[:, None] - route, axis=2).min(axis=1).argmin())

    def moves_until(self, now_s: float) -> bool:
        """Whether it is still to move after `now_s`."""
        return now_s < self._halt_s

    def calls(self, now_s: float) -> bool:
        """Whether the vehicle is to be with it now, or soon."""
        return self._escort.depart_s - READY_S <= now_s < self._halt_s

    def share_driven(self, now_s: float) -> float:
        """How much of the time in which it drives is over; less than 0 before it sets off."""
        depart_s = self._escort.depart_s
        return (now_s - depart_s) / max(self._halt_s - depart_s, STEP_S)

    def near_s(self, place: Place, now_s: float) -> float:
        """When a member first comes within `warn_before_m` of a place; infinity when none will any more."""
        in_reach = (np.linalg.norm(self._places_m - place, axis=2) <= self._escort.warn_before_m).any(axis=1)
        due = self._times_s[in_reach]
        return float(due[0]) if len(due) and due[-1] > now_s else math.inf

    def station(self, now_s: float) -> Place:
        """Where to be now: on the road ahead of its head; before it sets off, where it will come by first."""
        ahead_s = AHEAD_SHARE * self._escort.within_m / self._escort.speed_mps
        at_s = max(now_s, self._escort.depart_s) + ahead_s
        east_m, north_m = convoy_places_m(self._escort, [at_s])[0, self._head]
        return float(east_m), float(north_m)
