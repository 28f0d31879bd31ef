"""The decomposition as a graph that scoring walks: checked once, then only asked."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import networkx as nx

from ._document import DecompositionDocument, KeyFactor, Level, Observable, Policies


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
    """A directed acyclic graph of principles, key attributes, VABs and observables, many-to-many at every level.

    `nodes` come in the order of the document, the most general level first, so every node stands before its children.
    Made by `decomposition_of`; asking for a node that there is not is a KeyError.
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
        """The key attributes whose difficulties make a difficulty configuration: those named, else all."""
        return self.document.study or self.key_attributes

    @property
    def digest(self) -> str:
        """SHA-256 of the document's canonical JSON, for provenance: equal exactly when scores mean the same."""
        return hashlib.sha256(self.document.model_dump_json().encode()).hexdigest()

    def at_level(self, level: Level) -> tuple[str, ...]:
        """Ids of the nodes of one level, in the order of the document."""
        return tuple(node.id for node in self.nodes.values() if node.level is level)

    def level_of(self, node: str) -> Level:
        """The level that a node belongs to."""
        return self.nodes[node].level

    def children(self, node: str) -> tuple[str, ...]:
        """Ids of the node's children; none for an observable."""
        return self.nodes[node].children

    def observables_under(self, node: str) -> tuple[str, ...]:
        """Distinct descendant observables in the order of the document; an observable is its own."""
        return self.descendants[node]

    def bottom_up(self) -> tuple[str, ...]:
        """A topological order in which every node follows all of its children."""
        return tuple(reversed(tuple(self.nodes)))

    def key_factors(self, observable: str) -> tuple[KeyFactor, ...]:
        """The rows of an observable's key factor table, shared ones written out."""
        return self.tables[observable]

    def factors(self) -> tuple[str, ...]:
        """Names of all key factors that some observable is rated by, each once."""
        return tuple(dict.fromkeys(row.factor for rows in self.tables.values() for row in rows))

    def near_miss(self, observable: str) -> float:
        """How far below its threshold the observable still scores: its own word, else the policy; 0 without partial credit."""
        one = self.observables[observable]
        own = self.policies.near_miss if one.near_miss is None else one.near_miss
        return own if one.partial_credit else 0.0

    def graph(self) -> nx.DiGraph[str]:
        """The same as a networkx graph, edges from parent to child, with `level` and `title` on every node."""
        graph: nx.DiGraph[str] = nx.DiGraph()
        for node in self.nodes.values():
            graph.add_node(node.id, level=str(node.level), title=node.title)
        graph.add_edges_from((node.id, child) for node in self.nodes.values() for child in node.children)
        return graph


def graph_of(document: DecompositionDocument) -> Decomposition:
    """The graph of a document in which the checks found nothing."""
    nodes = {node.id: node for node in _nodes(document)}
    order = [one.id for one in document.observables]
    below = {one: frozenset((one,)) for one in order}
    for node in reversed(nodes.values()):
        if node.level is not Level.OBSERVABLE:
            below[node.id] = frozenset().union(*(below[child] for child in node.children))
    return Decomposition(
        document=document,
        nodes=nodes,
        observables={one.id: one for one in document.observables},
        parents={one: tuple(node.id for node in nodes.values() if one in node.children) for one in nodes},
        descendants={one: tuple(leaf for leaf in order if leaf in below[one]) for one in nodes},
        tables={one.id: tuple(_written_out(one.key_factors, document.tables)) for one in document.observables},
    )


def _nodes(document: DecompositionDocument) -> Iterable[DecompositionNode]:
    levels = (
        (Level.PRINCIPLE, document.principles),
        (Level.KEY_ATTRIBUTE, document.key_attributes),
        (Level.VAB, document.vabs),
    )
    for level, inner in levels:
        for node in inner:
            yield DecompositionNode(node.id, node.title, node.asks, level, node.children)
    for leaf in document.observables:
        yield DecompositionNode(leaf.id, leaf.title, leaf.asks, Level.OBSERVABLE, ())


def _written_out(rows: Iterable[str | KeyFactor], tables: Mapping[str, KeyFactor]) -> Iterable[KeyFactor]:
    return (tables[row] if isinstance(row, str) else row for row in rows)
