"""How far two flights of one session came apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.contracts import Tape

# Moments of the truth are whole nanoseconds; tapes hold them in seconds.
_NS_PER_S = 1e9


@dataclass(frozen=True, slots=True)
class TruthDistance:
    """The largest distance between the true places of the vehicle in two recordings, over the moments that both have: it was
    at `time_s`, and they end at `until_s`.
    """

    distance_m: float
    time_s: float
    until_s: float

    def __str__(self) -> str:
        return (
            f"the vehicles were at most {self.distance_m:.3g} m apart, at {self.time_s:.1f} s, in the first "
            f"{self.until_s:.1f} s that both flew"
        )


def truth_distance(first: Tape, second: Tape) -> TruthDistance | None:
    """How far apart the vehicle was in two recordings; None where they have no moment in common."""
    times_ns, places, other_places = np.intersect1d(
        np.rint(first.vehicle_time_s * _NS_PER_S),
        np.rint(second.vehicle_time_s * _NS_PER_S),
        assume_unique=True,
        return_indices=True,
    )
    if not times_ns.size:
        return None
    apart_m = np.linalg.norm(
        first.vehicle_position_enu_m[places] - second.vehicle_position_enu_m[other_places], axis=1
    )
    largest = int(np.argmax(apart_m))
    return TruthDistance(
        float(apart_m[largest]), float(times_ns[largest] / _NS_PER_S), float(times_ns[-1] / _NS_PER_S)
    )
