"""Small decompositions, made for one test each: what a node is called and asks says nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bench.contracts import Observation
from bench.scoring import (
    Difficulty,
    Explanation,
    ScoredRun,
    Sources,
    explain,
    node_reports,
    score_table,
    summary_frame,
)
from decompositions import Decomposition, DecompositionDocument, DecompositionVocabulary, decomposition_of

Layer = Mapping[str, Sequence[str]] | Sequence[dict[str, Any]]
"""The nodes of a level: the children of each by its id, or as they stand in a document."""


def factor_row(
    factor: str, ratings: Sequence[float], values: Sequence[float], unit: str = "level", **more: Any
) -> dict[str, Any]:
    """A key factor table."""
    row = {"factor": factor, "unit": unit, "ratings": ratings, "values": values, "reason": "For the test."}
    return row | more


def leaf(name: str, *rows: dict[str, Any], **more: Any) -> dict[str, Any]:
    """An observable with these key factor tables, achieved from one half on."""
    return {
        "id": name,
        "title": name,
        "asks": "?",
        "measure": "detection_share",
        "threshold": 0.5,
        "threshold_reason": "Half.",
        "considered": "Always.",
        "key_factors": list(rows),
    } | more


def node(name: str, children: Sequence[str], **more: Any) -> dict[str, Any]:
    """A node above the observables."""
    return {"id": name, "title": name, "asks": "?", "children": list(children), **more}


def made_decomposition(
    observables: Iterable[dict[str, Any]],
    vabs: Layer,
    attributes: Layer,
    principles: Layer = (),
    *,
    given: bool = False,
    vocabulary: DecompositionVocabulary | None = None,
    **more: Any,
) -> Decomposition:
    """These levels as a decomposition; with `given`, difficulties are stated with the runs."""
    levels = {"principles": principles, "key_attributes": attributes, "vabs": vabs}
    document = {
        "format": "rebar.decomposition/1",
        "name": "made",
        "title": "Made",
        **{
            level: [node(*row) for row in nodes.items()] if isinstance(nodes, Mapping) else list(nodes)
            for level, nodes in levels.items()
        },
        "observables": list(observables),
    }
    if given:
        vocabulary = DecompositionVocabulary(difficulty="given")
    return decomposition_of(DecompositionDocument.model_validate(document | more), vocabulary)


WORKED = {"OBS1": 30.0, "OBS2": 80.0, "OBS3": 50.0}
"""The observables of the paper's scoring example and their difficulties."""
WORKED_VABS = {"VAB1": ["OBS1", "OBS2"], "VAB2": ["OBS3"]}
WORKED_ATTRIBUTES = {"KA1": ["VAB1", "VAB2"]}


def worked_decomposition(
    observables: Iterable[dict[str, Any]] = tuple(map(leaf, WORKED)), *, given: bool = True, **more: Any
) -> Decomposition:
    """The graph of the paper's scoring example."""
    return made_decomposition(observables, WORKED_VABS, WORKED_ATTRIBUTES, given=given, **more)


def observed(xs: Mapping[str, float | None]) -> tuple[Observation, ...]:
    """What was measured of each observable; None where a run did not consider it."""
    return tuple(Observation(observable=name, considered=x is not None, x=x) for name, x in xs.items())


def rated(difficulty: Difficulty, node: str) -> float:
    """The difficulty of a node that has one."""
    value = difficulty.of(node)
    assert value is not None
    return value


def explained(
    decomposition: Decomposition, runs: Sequence[ScoredRun], node: str, limit: int = 0, **sources: Any
) -> Explanation:
    """Why a node has its score over these runs."""
    scores = score_table(decomposition, runs)
    summary = summary_frame(scores, decomposition).filter(node=node, configuration="all")
    return explain(
        decomposition, node, runs, scores, node_reports(scores, summary), Sources(**sources), limit=limit
    )
