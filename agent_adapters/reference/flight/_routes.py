"""The shortest way over corners that see each other: for the agent as it flies, and for its surrogate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING

from ._paths import Place

if TYPE_CHECKING:
    import networkx as nx

# Added to every leg: of two ways that differ by rounding alone, the one with fewer legs is taken.
_LEG_M = 1e-9


def shortest_route(
    begin: Place, end: Place, corners: Sequence[Place], clear: Callable[[int, int], bool]
) -> list[Place]:
    """The shortest way from `begin` to `end` by straight legs over corners, both ends included; straight on where
    there is none.

    `clear` says whether the straight leg between two places is free, by index: 0 is `begin`, 1 is `end`, corners
    follow. It is asked only about legs that may be of use.
    """
    # Imported here: 0.15 s of CPU, which an agent that meets nothing in its way does without. The same search in
    # scipy.sparse.csgraph costs 0.26 s, and wants all legs beforehand.
    import networkx as nx

    places = [begin, end, *corners]

    def leg_m(a: int, b: int, _: object) -> float | None:
        return math.dist(places[a], places[b]) + _LEG_M if clear(a, b) else None

    try:
        route = nx.astar_path(
            _everything_joined(len(places)), 0, 1, lambda a, b: math.dist(places[a], places[b]), leg_m
        )
    except nx.NetworkXNoPath:
        return [begin, end]
    return [places[index] for index in route]


@cache
def _everything_joined(count: int) -> nx.Graph[int]:
    import networkx as nx

    graph: nx.Graph[int] = nx.complete_graph(count)
    return graph
