"""The refusal of a scene that has no arrangement, and smallest sets of what refuses it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bench.errors import RebarError
from bench.simspec import ActorGroup


class PlacementInfeasible(RebarError):
    """No place was found for somebody; the text names the relations that clash and the numbers found.

    `proved` tells whether there is no arrangement at all; `clash` are the fields of a smallest set of constraints that
    cannot hold together, empty where nothing is proved.
    """

    def __init__(self, text: str, *, proved: bool = True, clash: tuple[str, ...] = ()) -> None:
        super().__init__(text)
        self.proved, self.clash = proved, clash


def fewest_groups(groups: Sequence[ActorGroup], fails: Callable[[list[ActorGroup]], bool]) -> list[ActorGroup]:
    """Groups that fail together and of which none can be left out."""
    core = list(groups)
    for group in groups:
        rest = [one for one in core if one is not group]
        if rest and fails(rest):
            core = rest
    return core
