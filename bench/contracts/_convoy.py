"""Where an escorted group will be, by its plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.arrays import Floats

from ._documents import EscortDocument


def convoy_places_m(plan: EscortDocument, times_s: Sequence[float] | Floats) -> Floats:
    """(m, k, 2) east and north of the k members at m simulated times, as planned.

    The plan holds where nothing solid stands on the route and the route lies inside the area of interest.
    """
    halt_s = math.inf if plan.halt_s is None else plan.halt_s
    driven_s = np.clip(np.asarray(times_s, dtype=np.float64), plan.depart_s, halt_s) - plan.depart_s
    route = np.array([(point.east_m, point.north_m) for point in plan.route])
    members = [
        _driven(np.array([start.east_m, start.north_m]), route, driven_s * plan.speed_mps)
        for start in plan.starts
    ]
    return np.stack(members, axis=1)


def _driven(start: Floats, route: Floats, driven_m: Floats) -> Floats:
    """(m, 2) where a member is after so many metres: straight to the nearest point, then round the loop."""
    nearest = int(np.hypot(*(route - start).T).argmin())
    loop = np.roll(route, -nearest, axis=0)
    loop = np.concatenate([loop, loop[:1]])
    way_m = np.hypot(*np.diff(loop, axis=0).T)
    first_m = float(np.hypot(*(loop[0] - start)))
    # The way to the first point is driven once, the loop again and again.
    round_m = np.concatenate([[0.0], np.cumsum(way_m)])
    on_loop_m = np.mod(np.maximum(driven_m - first_m, 0.0), max(float(round_m[-1]), 1e-9))
    on_loop = np.stack([np.interp(on_loop_m, round_m, loop[:, axis]) for axis in (0, 1)], axis=-1)
    share = np.clip(driven_m / max(first_m, 1e-9), 0.0, 1.0)[:, None]
    places: Floats = np.where((driven_m < first_m)[:, None], start + share * (loop[0] - start), on_loop)
    return places
