"""The decomposition as a graph that is checked once, when it is built."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ._document import DecompositionDocument, InnerNode, KeyFactor, Level, Observable, Policies

if TYPE_CHECKING:
    import networkx as nx


@dataclass(frozen=True, slots=True)
class DecompositionNode:
    """One node of any level; an observable has no children."""

    id: str
    title: str
    asks: str
    level: Level
    children: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Decomposition:
    """A directed acyclic graph of principles, key attributes, VABs and observables, many-to-many at every
    level.

    `nodes` have the order of the document, with the most general level first, so that a node comes before its
    children. Build it with `decomposition_of`. Methods raise KeyError for an unknown node.
    """

    document: DecompositionDocument
    nodes: Mapping[str, DecompositionNode]
    observables: Mapping[str, Observable]
    parents: Mapping[str, tuple[str, ...]]
    descendants: Mapping[str, tuple[str, ...]]
    tables: Mapping[str, tuple[KeyFactor, ...]]

    @property
    def name(self) -> str:
        return self.document.name

    @property
    def title(self) -> str:
        return self.document.title

    @property
    def policies(self) -> Policies:
        return self.document.policies

    @property
    def key_attributes(self) -> tuple[str, ...]:
        """Ids of the key attributes, in the order of the document."""
        return self.at_level(Level.KEY_ATTRIBUTE)

    @property
    def study(self) -> tuple[str, ...]:
        """The key attributes whose difficulties make a difficulty configuration: those of the document, else
        all.
        """
        return self.document.study or self.key_attributes

    @property
    def digest(self) -> str:
        """SHA-256 of the document's JSON: scores are comparable where it is equal."""
        return hashlib.sha256(self.document.model_dump_json().encode()).hexdigest()

    def at_level(self, level: Level) -> tuple[str, ...]:
        """Ids of the nodes of one level, in the order of the document."""
        return tuple(node.id for node in self.nodes.values() if node.level is level)

    def level_of(self, node: str) -> Level:
        """The level of a node."""
        return self.nodes[node].level

    def children(self, node: str) -> tuple[str, ...]:
        """Ids of the node's children; none for an observable."""
        return self.nodes[node].children

    def observables_under(self, node: str) -> tuple[str, ...]:
        """Distinct descendant observables in the order of the document; for an observable, the observable
        itself.
        """
        return self.descendants[node]

    def essential(self, principle: str) -> tuple[str, ...]:
        """The key attributes that a principle's verdict rests on: those that it names, else all under it."""
        named = {node.id: node.essential for node in self.document.principles}
        return named[principle] or self.children(principle)

    def essential_reason(self, principle: str) -> str:
        """Why these key attributes are essential; empty where the document does not say."""
        reasons = {node.id: node.essential_reason for node in self.document.principles}
        return reasons[principle] or ""

    def essential_observables(self, principle: str) -> tuple[str, ...]:
        """Distinct observables under the essential key attributes of a principle, in the order of the document."""
        below = {leaf for node in self.essential(principle) for leaf in self.descendants[node]}
        return tuple(leaf for leaf in self.descendants[principle] if leaf in below)

    def bottom_up(self) -> tuple[str, ...]:
        """A topological order in which every node follows all of its children."""
        # Levels come from the most general down and edges never skip one, so the reverse order is
        # topological.
        return tuple(reversed(tuple(self.nodes)))

    def key_factors(self, observable: str) -> tuple[KeyFactor, ...]:
        """The rows of an observable's key factor table, with shared rows resolved."""
        return self.tables[observable]

    def factors(self) -> tuple[str, ...]:
        """Names of all key factors that some observable is rated by, each once."""
        return tuple(dict.fromkeys(row.factor for rows in self.tables.values() for row in rows))

    def near_miss(self, observable: str) -> float:
        """How far below its threshold the observable still scores: its own value, else the policy; 0 without
        partial credit.
        """
        declared = self.observables[observable]
        # Without partial credit a near miss would have the full difficulty as its score, like a pass: ruling
        # 8.
        margin = self.policies.near_miss if declared.near_miss is None else declared.near_miss
        return margin if declared.partial_credit else 0.0

    def graph(self) -> nx.DiGraph[str]:
        """The decomposition as a networkx graph: edges from parent to child, with `level` and `title` on
        every node.
        """
        # Imported here: every worker gets a decomposition, and few ask for this.
        import networkx as nx

        graph: nx.DiGraph[str] = nx.DiGraph()
        for node in self.nodes.values():
            graph.add_node(node.id, level=str(node.level), title=node.title)
        graph.add_edges_from((node.id, child) for node in self.nodes.values() for child in node.children)
        return graph


def graph_of(document: DecompositionDocument) -> Decomposition:
    """The graph of a document without faults."""
    nodes = {node.id: node for node in _nodes(document)}
    # Descendants are sets while they are merged, then put into the order of the document.
    order = [observable.id for observable in document.observables]
    below = {node_id: frozenset((node_id,)) for node_id in order}
    for node in reversed(nodes.values()):
        if node.level is not Level.OBSERVABLE:
            below[node.id] = frozenset().union(*(below[child] for child in node.children))
    return Decomposition(
        document=document,
        nodes=nodes,
        observables={observable.id: observable for observable in document.observables},
        parents={
            node_id: tuple(node.id for node in nodes.values() if node_id in node.children)
            for node_id in nodes
        },
        descendants={node_id: tuple(leaf for leaf in order if leaf in below[node_id]) for node_id in nodes},
        tables={
            observable.id: tuple(_resolved(observable.key_factors, document.tables))
            for observable in document.observables
        },
    )


def excerpt(decomposition: Decomposition, node: str) -> Decomposition:
    """The part about one node: what it serves, and all below it. Raises KeyError for an unknown node."""
    below, above = {decomposition.nodes[node].id}, {node}
    # Parents come before their children.
    for name, item in decomposition.nodes.items():
        below |= set(item.children) if name in below else set()
    for name, item in reversed(tuple(decomposition.nodes.items())):
        above |= {name} if above & set(item.children) else set()
    kept = above | below
    document = decomposition.document
    parts: dict[str, object] = {
        "observables": tuple(leaf for leaf in document.observables if leaf.id in kept)
    }
    for part in ("principles", "key_attributes", "vabs"):
        nodes: Sequence[InnerNode] = getattr(document, part)
        parts[part] = tuple(
            inner.model_copy(update={"children": tuple(child for child in inner.children if child in kept)})
            for inner in nodes
            if inner.id in kept
        )
    parts["study"] = tuple(name for name in document.study if name in kept)
    return graph_of(document.model_copy(update=parts))


def _nodes(document: DecompositionDocument) -> Iterable[DecompositionNode]:
    levels: tuple[tuple[Level, Sequence[InnerNode | Observable]], ...] = (
        (Level.PRINCIPLE, document.principles),
        (Level.KEY_ATTRIBUTE, document.key_attributes),
        (Level.VAB, document.vabs),
        (Level.OBSERVABLE, document.observables),
    )
    for level, nodes in levels:
        for node in nodes:
            children = node.children if isinstance(node, InnerNode) else ()
            yield DecompositionNode(node.id, node.title, node.asks, level, children)


def _resolved(rows: Iterable[str | KeyFactor], tables: Mapping[str, KeyFactor]) -> Iterable[KeyFactor]:
    return (tables[row] if isinstance(row, str) else row for row in rows)
