"""The positions of the nodes in a drawing of a decomposition: a column for each level, a row for each leaf."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from decompositions import Decomposition, Level

# In rows, after the last leaf under a node of that level. Chosen by eye.
GAPS = {Level.PRINCIPLE: 1.0, Level.KEY_ATTRIBUTE: 0.4}


@dataclass(frozen=True, slots=True)
class Edge:
    """An edge from a node to a child.

    `first` means that the child is placed under this parent, not under another one.
    """

    parent: str
    child: str
    first: bool


@dataclass(frozen=True, slots=True)
class Layout:
    """Columns count from 0 at the most general level there is; rows are in heights of one node and may be fractions."""

    columns: tuple[Level, ...]
    column: Mapping[str, int]
    row: Mapping[str, float]
    edges: tuple[Edge, ...]
    rows: float


def lay_out(decomposition: Decomposition) -> Layout:
    """Place each node under the first parent that names it, and beside the middle of the children that are
    placed under it.

    Everything comes in the order of the document, so no two nodes of a column are nearer than a row, edges to
    children that are placed under a node never cross, and equal documents are laid out alike.
    """
    columns = tuple(level for level in Level if decomposition.at_level(level))
    row: dict[str, float] = {}
    beneath: dict[str, str] = {}
    end = 0.0

    def place(name: str) -> float:
        nonlocal end
        node = decomposition.nodes[name]
        # A node may have several parents (docs/rulings.md 12), but only one place.
        children = [child for child in node.children if child not in beneath]
        beneath.update(dict.fromkeys(children, name))
        # Recursion is never deep: a decomposition has four levels.
        rows = [place(child) for child in children]
        if not rows:
            rows = [end]
            end += 1.0
        # Half way between the outer two, and not the mean: a parent then is centred on its children as drawn.
        row[name] = (rows[0] + rows[-1]) / 2.0
        end += GAPS.get(node.level, 0.0)
        return row[name]

    for name in decomposition.nodes:
        if not decomposition.parents[name]:
            place(name)
    edges = tuple(
        Edge(node.id, child, beneath[child] == node.id)
        for node in decomposition.nodes.values()
        for child in node.children
    )
    return Layout(
        columns,
        {name: columns.index(node.level) for name, node in decomposition.nodes.items()},
        row,
        edges,
        end,
    )
