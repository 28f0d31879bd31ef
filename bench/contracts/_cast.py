"""The cast of a realized SimSpec: its actors as every room knows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.errors import Fault, SetupError
from bench.simspec import asset_fault

from ._realized import realized_of
from ._truth_documents import CastMember

if TYPE_CHECKING:
    from bench.simspec import SimSpec


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
    assets = ((f"actors[{index}].asset", group.asset) for index, group in enumerate(simspec.actors))
    # Collected with the faults above: a person who corrects a file wants all of them at once.
    faults += [fault for where, asset in assets if (fault := asset_fault(where, asset))]
    if faults:
        raise SetupError(faults)
    return tuple(CastMember.of(actor.id, groups[actor.group]) for actor in realized.actors)
