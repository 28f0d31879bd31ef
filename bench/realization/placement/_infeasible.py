"""Smallest sets of groups that cannot be placed together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bench.simspec import ActorGroup


def fewest_groups(groups: Sequence[ActorGroup], fails: Callable[[list[ActorGroup]], bool]) -> list[ActorGroup]:
    """Groups that fail together and of which none can be left out."""
    core = list(groups)
    for group in groups:
        rest = [one for one in core if one is not group]
        if rest and fails(rest):
            core = rest
    return core
