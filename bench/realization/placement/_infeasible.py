"""Smallest sets of groups, or of constraints, that refuse a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

Item = TypeVar("Item")


def smallest_failing(items: Sequence[Item], fails: Callable[[list[Item]], bool], run: int = 1) -> list[Item]:
    """A smallest set of items that fail together: none can be left out.

    Runs of `run` items are left out first, then ever smaller ones, while the rest still fails.
    """
    core = list(items)
    while True:
        start = 0
        while start < len(core):
            rest = core[:start] + core[start + run :]
            if rest and fails(rest):
                core = rest
            else:
                start += run
        if run == 1:
            return core
        run //= 2
