"""The escorted group: what the agent is told about it, and where it will be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench.arrays import Floats
from bench.simspec import ASSETS, Point

from ._documents import EscortDocument
from ._realized import realized_of

if TYPE_CHECKING:
    from bench.simspec import SimSpec


def escort_document(simspec: SimSpec) -> EscortDocument | None:
    """The escort of a realized SimSpec as the agent gets it; None for a mission without one."""
    escort = simspec.mission.escort
    if escort is None:
        return None
    group = simspec.group(escort.group)
    return EscortDocument(
        class_label=ASSETS[group.asset].class_label,
        starts=tuple(
            Point(east_m=actor.east_m, north_m=actor.north_m)
            for actor in realized_of(simspec).actors
            if actor.group == group.id
        ),
        route=group.motion.route,
        speed_mps=group.motion.speed_mps,
        depart_s=group.motion.depart_s,
        halt_s=group.motion.halt_s,
        within_m=escort.within_m,
        warn_before_m=escort.warn_before_m,
    )


def convoy_places_m(escort: EscortDocument, times_s: Sequence[float] | Floats) -> Floats:
    """(m, k, 2) east and north of the k members at m simulated times, as planned.

    The plan holds where nothing solid stands on the route and the route lies inside the area of interest.
    """
    halt_s = math.inf if escort.halt_s is None else escort.halt_s
    driven_s = np.clip(np.asarray(times_s, dtype=np.float64), escort.depart_s, halt_s) - escort.depart_s
    route = np.array([(point.east_m, point.north_m) for point in escort.route])
    members = [
        _driven(np.array([start.east_m, start.north_m]), route, driven_s * escort.speed_mps)
        for start in escort.starts
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
