"""The cast of a realized SimSpec: its actors as every room knows them."""

from __future__ import annotations

from bench.errors import Fault, SetupError
from bench.simspec import Realized, SimSpec, asset_fault

from ._documents import CastMember


def realized_of(simspec: SimSpec) -> Realized:
    """The places of a SimSpec. Raises SetupError when it has none."""
    if simspec.realized is None:
        raise SetupError(
            Fault(
                simspec.name,
                "the SimSpec is not realized",
                "place it first (rebar realize, or bench.realization.place)",
            )
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
    assets = ((f"actors[{index}].asset", group.asset) for index, group in enumerate(simspec.actors))
    # Collected with the faults above: a person who corrects a file wants all of them at once.
    faults += [fault for where, asset in assets if (fault := asset_fault(where, asset))]
    if faults:
        raise SetupError(faults)
    return tuple(CastMember.of(actor.id, groups[actor.group]) for actor in realized.actors)
