"""The escorted group: what the agent is told about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.simspec import ASSETS

from ._documents import EscortDocument, Point
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
        route=tuple(Point(corner.east_m, corner.north_m) for corner in group.motion.route),
        speed_mps=group.motion.speed_mps,
        depart_s=group.motion.depart_s,
        halt_s=group.motion.halt_s,
        within_m=escort.within_m,
        warn_before_m=escort.warn_before_m,
    )
