"""A decomposition as arrays, for scoring many runs at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.arrays import Bools, Counts, Floats
from decompositions import Decomposition, Level, Policies


@dataclass(frozen=True, slots=True)
class DecompositionArrays:
    """The parts of a decomposition that scoring needs. Leaves (observables) and nodes are numbered in the
    order of the document.

    `number` is the number of a leaf by its id; `leaf_rows[i]` is the node number of leaf i; `under` (nodes,
    leaves) marks the leaves under a node, each once; `inner` has every inner node with the numbers of its
    children, children before parents. `principle_rows` are the node numbers of the principles, and `essential` (principles,
    leaves) marks the leaves that the verdict of each rests on (ruling 27).
    """

    nodes: tuple[str, ...]
    leaves: tuple[str, ...]
    number: Mapping[str, int]
    leaf_rows: Counts
    under: Bools
    inner: tuple[tuple[int, Counts], ...]
    principle_rows: Counts
    essential: Bools
    threshold: Floats
    near_miss: Floats
    partial_credit: Bools
    policies: Policies


def arrays_of(decomposition: Decomposition) -> DecompositionArrays:
    """The arrays of a decomposition, built once for each document."""
    return _arrays(_DocumentKey(decomposition))


@dataclass(frozen=True, slots=True)
class _DocumentKey:
    """Cache key that is equal for equal documents: a decomposition holds dictionaries and cannot be hashed."""

    decomposition: Decomposition

    def __hash__(self) -> int:
        return hash((self.decomposition.name, len(self.decomposition.nodes)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _DocumentKey):
            return NotImplemented
        # Identity first, because equality compares documents field by field.
        mine, theirs = self.decomposition.document, other.decomposition.document
        return mine is theirs or mine == theirs


# A process scores over one or two decompositions; eight leave room for comparisons. Chosen, not measured.
@lru_cache(maxsize=8)
def _arrays(key: _DocumentKey) -> DecompositionArrays:
    decomposition = key.decomposition
    nodes, leaves = tuple(decomposition.nodes), tuple(decomposition.observables)
    row = {node: index for index, node in enumerate(nodes)}
    column = {leaf: index for index, leaf in enumerate(leaves)}
    principles = decomposition.at_level(Level.PRINCIPLE)
    essential = np.zeros((len(principles), len(leaves)), dtype=np.bool_)
    for index, principle in enumerate(principles):
        essential[index, [column[leaf] for leaf in decomposition.essential_observables(principle)]] = True
    # A matrix, so that counting leaves of all nodes in all runs is one product.
    under = np.zeros((len(nodes), len(leaves)), dtype=np.bool_)
    for node in nodes:
        under[row[node], [column[leaf] for leaf in decomposition.observables_under(node)]] = True
    return DecompositionArrays(
        nodes=nodes,
        leaves=leaves,
        number=column,
        leaf_rows=np.array([row[leaf] for leaf in leaves], dtype=np.int64),
        under=under,
        inner=tuple(
            (row[node], np.array([row[child] for child in decomposition.children(node)], dtype=np.int64))
            for node in decomposition.bottom_up()
            if decomposition.level_of(node) is not Level.OBSERVABLE
        ),
        principle_rows=np.array([row[principle] for principle in principles], dtype=np.int64),
        essential=essential,
        threshold=np.array([observable.threshold for observable in decomposition.observables.values()]),
        near_miss=np.array([decomposition.near_miss(leaf) for leaf in leaves]),
        partial_credit=np.array(
            [observable.partial_credit for observable in decomposition.observables.values()]
        ),
        policies=decomposition.policies,
    )
