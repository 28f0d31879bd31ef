"""What a realized SimSpec has: its places, its cast as every room knows it, and the escort as the agent is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.errors import Fault, SetupError

from ._documents import EscortDocument, Point
from ._truth_documents import CastMember

if TYPE_CHECKING:
    from bench.simspec import Realized, SimSpec


def realized_of(simspec: SimSpec) -> Realized:
    """The places of a SimSpec. Raises SetupError when it has none."""
    if simspec.realized is None:
        raise SetupError(
            simspec.name,
            "the SimSpec is not realized",
            "place it first (rebar realize, or bench.realization.place)",
        )
    return simspec.realized


def cast_of(simspec: SimSpec) -> tuple[CastMember, ...]:
    """The members in the order of `realized.actors`.

    Raises SetupError for places, groups or assets that are missing.
    """
    realized = realized_of(simspec)
    groups = {group.id: group for group in simspec.actors}
    faults = [
        Fault(
            f"realized.actors[{index}].group",
            f"there is no group {actor.group!r}",
            f"the groups are {', '.join(groups)}",
        )
        for index, actor in enumerate(realized.actors)
        if actor.group not in groups
    ]
    # Collected with the faults above: a person who corrects a file wants all of them at once.
    faults += simspec.asset_faults()
    if faults:
        raise SetupError(faults)
    return tuple(CastMember.of(actor.id, groups[actor.group]) for actor in realized.actors)


def escort_document(simspec: SimSpec) -> EscortDocument | None:
    """The escort of a realized SimSpec as the agent gets it; None for a mission without one."""
    escort = simspec.mission.escort
    if escort is None:
        return None
    group = simspec.group(escort.group)
    return EscortDocument(
        class_label=group.definition.class_label,
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
