"""Checks across the parts of a decomposition document: every fault at once, each with its node and remedy."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import Literal

from bench.errors import Fault, SetupError

from ._document import DecompositionDocument, InnerNode, KeyFactor, Level, Observable, Option

CheckMeasure = Callable[[str, Mapping[str, Option]], object]
"""Raises ValueError or SetupError for an unknown measure, or for options that the measure does not take."""

LEVELS = tuple(Level)
LEVEL_TITLES = {
    Level.PRINCIPLE: "principle",
    Level.KEY_ATTRIBUTE: "key attribute",
    Level.VAB: "VAB",
    Level.OBSERVABLE: "observable",
}
FIELD_OF_LEVEL = {
    Level.PRINCIPLE: "principles",
    Level.KEY_ATTRIBUTE: "key_attributes",
    Level.VAB: "vabs",
    Level.OBSERVABLE: "observables",
}


@dataclass(frozen=True, slots=True)
class DecompositionVocabulary:
    """The names that a decomposition may use; None leaves names of that kind unchecked.

    `factor_units` are the units of the key factors by name. `check_measure` is called for the measure of each
    observable. `difficulty` is the source of difficulties: with `tables` an observable without key factors,
    measure or a reason for its threshold is a fault. With `given` (with the runs, as in a table from elsewhere,
    which has the measured values too) it is not, and key factors may have names of their own.
    """

    factor_units: Mapping[str, str] | None = None
    check_measure: CheckMeasure | None = None
    difficulty: Literal["tables", "given"] = "tables"


@dataclass(frozen=True, slots=True)
class DocumentPlace:
    """A place in the file: the path inside the document, and the node (or table) that it belongs to."""

    path: tuple[str | int, ...]
    node: str

    def at(self, *inner: str | int) -> DocumentPlace:
        return DocumentPlace((*self.path, *inner), self.node)


@dataclass(frozen=True, slots=True)
class DocumentChecks:
    """The checks of one document.

    `lines` are the lines of its paths in the file `source`; both are empty without a file.
    """

    document: DecompositionDocument
    vocabulary: DecompositionVocabulary
    source: str = ""
    lines: Mapping[tuple[str | int, ...], int] = field(default_factory=dict)
    levels: dict[str, Level] = field(default_factory=dict)
    # Faults are found check by check but reported in the order of the file.
    line_of_fault: dict[Fault, int] = field(default_factory=dict)

    def faults(self) -> list[Fault]:
        """Every fault, in the order of the file."""
        self.levels.update({node.id: level for level, _, node in self._nodes()})
        faults = [
            *self._emptiness(),
            *self._duplicates(),
            *self._tables(),
            *self._edges(),
            *self._cycles(),
            *self._orphans(),
        ]
        faults += [*self._observables(), *self._study(), *self._essential()]
        # A table used by many observables gives the same fault many times; it is reported once.
        return sorted(dict.fromkeys(faults), key=lambda fault: self.line_of_fault[fault])

    def _fault(self, place: DocumentPlace, what: str, remedy: str) -> Fault:
        line = self._line(place)
        file = f"{self.source}:{line}" if line and self.source else self.source
        path = "".join(
            f"[{part}]" if isinstance(part, int) else f".{part}" for part in place.path
        ).removeprefix(".")
        fault = Fault(": ".join(part for part in (file, place.node, path) if part), what, remedy)
        self.line_of_fault.setdefault(fault, line)
        return fault

    def _line(self, place: DocumentPlace) -> int:
        """Line of the nearest enclosing path that is in the file, 0 where there is none."""
        paths = (place.path[:length] for length in range(len(place.path), 0, -1))
        return next((self.lines[path] for path in paths if path in self.lines), 0)

    def _emptiness(self) -> Iterator[Fault]:
        if not self.document.observables:
            yield self._fault(
                DocumentPlace(("observables",), ""),
                "there are no observables, so nothing is measured",
                "declare one or more",
            )

    def _nodes(self) -> Iterator[tuple[Level, DocumentPlace, InnerNode | Observable]]:
        for level in LEVELS:
            nodes: tuple[InnerNode | Observable, ...] = getattr(self.document, FIELD_OF_LEVEL[level])
            for index, node in enumerate(nodes):
                yield level, DocumentPlace((FIELD_OF_LEVEL[level], index), node.id), node

    def _inner(self) -> Iterator[tuple[Level, DocumentPlace, InnerNode]]:
        return ((level, place, node) for level, place, node in self._nodes() if isinstance(node, InnerNode))

    def _duplicates(self) -> Iterator[Fault]:
        ids: set[str] = set()
        for _, place, node in self._nodes():
            if node.id in ids:
                yield self._fault(
                    place.at("id"), f"the id {node.id!r} is used twice", "give one of them another id"
                )
            ids.add(node.id)

    def _edges(self) -> Iterator[Fault]:
        for level, place, node in self._inner():
            below = LEVELS[LEVELS.index(level) + 1]
            if not node.children:
                yield self._fault(
                    place.at("children"),
                    f"{LEVEL_TITLES[level]} {node.id} has no children",
                    f"name its {LEVEL_TITLES[below]}s, or drop it",
                )
            for child, count in Counter(node.children).items():
                if count > 1:
                    yield self._fault(
                        place.at("children"),
                        f"{node.id} lists its child {child} {count} times",
                        "list it once",
                    )
                if child not in self.levels:
                    yield self._fault(
                        place.at("children"),
                        f"{node.id} lists a child {child!r} that does not exist",
                        suggestion(child, self.levels),
                    )
                elif self.levels[child] is not below:
                    yield self._fault(
                        place.at("children"),
                        f"{node.id} lists {LEVEL_TITLES[self.levels[child]]} {child} as a child",
                        f"the children of a {LEVEL_TITLES[level]} are {LEVEL_TITLES[below]}s; {self._instead(below, child)}",
                    )

    def _instead(self, below: Level, child: str) -> str:
        # A child two levels down lacks a node between; a child on the same level or above cannot be one.
        deeper = LEVELS.index(self.levels[child]) > LEVELS.index(below)
        return f"no level is skipped: put a {LEVEL_TITLES[below]} between them" if deeper else "drop it"

    def _cycles(self) -> Iterator[Fault]:
        places, edges = {}, {}
        for _, place, node in self._inner():
            places[node.id] = place
            edges[node.id] = node.children
        for cycle in _cycles(edges):
            written = " -> ".join([*cycle, cycle[0]])
            yield self._fault(
                places[cycle[0]].at("children"),
                f"the nodes form a cycle: {written}",
                "remove one of its edges",
            )

    def _orphans(self) -> Iterator[Fault]:
        named = {child for _, _, node in self._inner() for child in node.children}
        # A document may leave out upper levels; nodes of its highest level need no parent.
        tops = next(
            (level for level in LEVELS if getattr(self.document, FIELD_OF_LEVEL[level])), Level.OBSERVABLE
        )
        for level, place, node in self._nodes():
            if level is not tops and node.id not in named:
                above = LEVEL_TITLES[LEVELS[LEVELS.index(level) - 1]]
                yield self._fault(
                    place.at("id"),
                    f"{LEVEL_TITLES[level]} {node.id} is an orphan: no {above} lists it",
                    f"list it under a {above}",
                )

    def _tables(self) -> Iterator[Fault]:
        used = {
            name
            for observable in self.document.observables
            for name in observable.key_factors
            if isinstance(name, str)
        }
        for name, row in self.document.tables.items():
            place = DocumentPlace(("tables", name), name)
            yield from self._row(place, row)
            if name not in used:
                yield self._fault(
                    place, f"no observable uses the table {name!r}", "list it under key_factors, or drop it"
                )

    def _row(self, place: DocumentPlace, row: KeyFactor) -> Iterator[Fault]:
        yield from self._columns(place, row)
        units = self.vocabulary.factor_units
        if units is None:
            return
        if row.factor not in units and self.vocabulary.difficulty == "given":
            # The values come with the runs, so the factor may be any that their author knows.
            return
        if row.factor not in units:
            yield self._fault(
                place.at("factor"), f"there is no key factor {row.factor!r}", suggestion(row.factor, units)
            )
        elif units[row.factor] != row.unit:
            unit = units[row.factor]
            yield self._fault(
                place.at("unit"),
                f"the unit {row.unit!r} is not the unit of the key factor {row.factor!r}"
                + (", which has no dimension" if unit == "1" else ""),
                f'write unit: "{unit}", and convert the values',
            )

    def _columns(self, place: DocumentPlace, row: KeyFactor) -> Iterator[Fault]:
        ratings, values = row.ratings, row.values
        # Ratings must rise, values may rise or fall, but not both: ruling 1.
        steps = [b - a for a, b in pairwise(values)]
        rises, falls = any(step > 0 for step in steps), any(step < 0 for step in steps)
        for is_wrong, name, what, remedy in (
            (
                len(ratings) != len(values),
                "values",
                f"{len(ratings)} ratings and {len(values)} values for {row.factor}",
                "give one value for each rating",
            ),
            (
                len(ratings) < 2,
                "ratings",
                f"the table of {row.factor} has fewer than two columns, and thus no direction",
                "give two or more columns",
            ),
            (
                any(not 0.0 <= rating <= 100.0 for rating in ratings),
                "ratings",
                f"a rating of {row.factor} lies outside 0 to 100",
                "keep ratings in [0, 100]",
            ),
            (
                any(b <= a for a, b in pairwise(ratings)),
                "ratings",
                f"the ratings of {row.factor} do not rise",
                "order the columns by rising rating",
            ),
            (
                len(values) > 1 and not any(steps),
                "values",
                f"the values of {row.factor} are all equal and give no direction",
                "give values that rise or fall",
            ),
            (
                rises and falls,
                "values",
                f"the values of {row.factor} rise and fall: the table is not monotone",
                "let them only rise or only fall along the ratings",
            ),
        ):
            if is_wrong:
                yield self._fault(place.at(name), what, remedy)
        if row.absent is not None and any(steps) and not (rises and falls):
            yield from self._absent(place, row, row.absent)

    def _absent(self, place: DocumentPlace, row: KeyFactor, absent: float) -> Iterator[Fault]:
        first = row.values[0]
        rises = row.values[-1] > first
        # A comparison that NaN fails too.
        if not (absent <= first if rises else absent >= first):
            side = "at or below" if rises else "at or above"
            yield self._fault(
                place.at("absent"),
                f"the absent value {absent:g} of {row.factor} lies among its columns or beyond the last one",
                f"keep it {side} the first value, {first:g}: nothing of the kind is easier than any of it",
            )

    def _observables(self) -> Iterator[Fault]:
        for index, observable in enumerate(self.document.observables):
            place = DocumentPlace((FIELD_OF_LEVEL[Level.OBSERVABLE], index), observable.id)
            yield from self._threshold(place, observable)
            yield from self._key_factors(place, observable)
            yield from self._measure(place, observable)

    def _threshold(self, place: DocumentPlace, observable: Observable) -> Iterator[Fault]:
        if observable.threshold_reason is None and self.vocabulary.difficulty == "tables":
            yield self._fault(
                place.at("threshold_reason"),
                f"{observable.id} does not say why its threshold is {observable.threshold:g}",
                "write a sentence",
            )
        if not 0.0 <= observable.threshold <= 1.0:
            yield self._fault(
                place.at("threshold"),
                f"the threshold {observable.threshold:g} lies outside 0 to 1",
                "keep it in [0, 1]",
            )
        if observable.near_miss is None:
            return
        if not 0.0 <= observable.near_miss <= 1.0:
            yield self._fault(
                place.at("near_miss"),
                f"near_miss {observable.near_miss:g} lies outside 0 to 1",
                "keep it in [0, 1]",
            )
        if observable.near_miss > 0.0 and not observable.partial_credit:
            yield self._fault(
                place.at("near_miss"),
                "near_miss has no effect without partial_credit",
                "set partial_credit, or drop it",
            )

    def _key_factors(self, place: DocumentPlace, observable: Observable) -> Iterator[Fault]:
        place = place.at("key_factors")
        if not observable.key_factors and self.vocabulary.difficulty == "tables":
            yield self._fault(
                place,
                f"{observable.id} has no key factors, so no difficulty",
                "name a table, or write a row with its factor and values",
            )
        # Two rows of one factor would contradict each other: which of them rates its value?
        factors: Counter[str] = Counter()
        for index, row in enumerate(observable.key_factors):
            if isinstance(row, KeyFactor):
                yield from self._row(place.at(index), row)
                factors[row.factor] += 1
            elif row in self.document.tables:
                factors[self.document.tables[row].factor] += 1
            else:
                yield self._fault(
                    place.at(index), f"there is no table {row!r}", suggestion(row, self.document.tables)
                )
        for factor, count in factors.items():
            if count > 1:
                yield self._fault(
                    place,
                    f"{observable.id} rates the key factor {factor!r} {count} times",
                    "keep one row for each factor",
                )

    def _measure(self, place: DocumentPlace, observable: Observable) -> Iterator[Fault]:
        if observable.measure is None:
            if self.vocabulary.difficulty == "tables":
                yield self._fault(
                    place.at("measure"),
                    f"{observable.id} names no measure, so nothing can be measured",
                    "name a measure (docs/measures.md has all). Only runs of a table (rebar score --observations) need none",
                )
            return
        if self.vocabulary.check_measure is None:
            return
        try:
            self.vocabulary.check_measure(observable.measure, observable.options)
        except SetupError as error:
            for fault in error.faults:
                yield self._fault(place.at("measure"), fault.what, fault.remedy)
        except ValueError as error:
            yield self._fault(
                place.at("options"),
                str(error),
                f"correct the options; `rebar measures {observable.measure}` explains them",
            )

    def _essential(self) -> Iterator[Fault]:
        for index, node in enumerate(self.document.principles):
            place = DocumentPlace(("principles", index), node.id)
            for number, name in enumerate(node.essential):
                if name not in node.children:
                    yield self._fault(
                        place.at("essential", number),
                        f"{name!r} is not a key attribute under {node.id}",
                        suggestion(name, node.children),
                    )
            if len(set(node.essential)) != len(node.essential):
                yield self._fault(place.at("essential"), "a key attribute is named twice", "name each once")
            if bool(node.essential) != (node.essential_reason is not None):
                yield self._fault(
                    place.at("essential_reason"),
                    "essential key attributes and their reason belong together",
                    "give both `essential` and `essential_reason`, or neither: then all are essential",
                )

    def _study(self) -> Iterator[Fault]:
        place = DocumentPlace(("study",), "")
        ids = [node.id for node in self.document.key_attributes]
        for index, node in enumerate(self.document.study):
            if node not in ids:
                yield self._fault(
                    place.at(index), f"there is no key attribute {node!r} to study", suggestion(node, ids)
                )
        if len(set(self.document.study)) != len(self.document.study):
            yield self._fault(place, "a key attribute is studied twice", "list each once")


def _cycles(edges: Mapping[str, Sequence[str]]) -> Iterator[list[str]]:
    """The nodes of each cycle in its order; nothing where there is none."""
    try:
        TopologicalSorter(edges).prepare()
        return
    except CycleError:
        pass
    # Imported here: every worker and command loads a decomposition, and networkx takes longer to import than that.
    import networkx as nx

    graph: nx.DiGraph[str] = nx.DiGraph()
    for node, children in edges.items():
        graph.add_edges_from((node, child) for child in children)
    # Each round gives one cycle and removes one of its edges, so that the next round finds another.
    while True:
        try:
            cycle = [str(edge[0]) for edge in nx.find_cycle(graph)]
        except nx.NetworkXNoCycle:
            return
        yield cycle
        graph.remove_edge(cycle[-1], cycle[0])


def suggestion(name: str, candidates: Iterable[str]) -> str:
    """A hint with the names that were probably meant, or else with the known names."""
    names = list(candidates)
    matches = difflib.get_close_matches(name, names, n=3)
    if matches:
        return f"did you mean {' or '.join(matches)}?"
    # A list of 135 observables would hide the message. 20 is chosen, not measured.
    shown = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
    return f"known: {shown}" if names else "none is declared"
