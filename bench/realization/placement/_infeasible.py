"""Smallest sets of groups that refuse a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bench.simspec import ActorGroup


def fewest_groups(
    groups: Sequence[ActorGroup], fails: Callable[[list[ActorGroup]], bool]
) -> list[ActorGroup]:
    """A smallest set of groups that fail together: none can be left out."""
    core = list(groups)
    for group in groups:
        rest = [member for member in core if member is not group]
        if rest and fails(rest):
            core = rest
    return core
