"""The differences of two agents scene by scene, so that the scenes cannot explain them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import polars as pl


@dataclass(frozen=True, slots=True)
class Pairing:
    """One node, two agents: the differences (second minus first) over the scenes in which both were considered.

    How sure a difference is, and the counts of passes, are in the NodeComparison of the same node.
    """

    node: str
    confidence_differences: tuple[float, ...]
    score_differences: tuple[float, ...]

    @property
    def scenes(self) -> int:
        return len(self.confidence_differences)

    @property
    def mean_confidence_difference(self) -> float | None:
        """Second minus first, in [-1, 1]."""
        return _mean(self.confidence_differences)

    @property
    def mean_score_difference(self) -> float | None:
        """Second minus first, over the scenes in which both have a score."""
        return _mean(self.score_differences)


def pair_agents(scores: pl.DataFrame, nodes: Sequence[str], first: str, second: str) -> tuple[Pairing, ...]:
    """The differences of two agents on every node, over the (design point, replicate) pairs that both flew."""
    return tuple(_pair(scores.filter(pl.col("node") == node), node, first, second) for node in nodes)


def _pair(rows: pl.DataFrame, node: str, first: str, second: str) -> Pairing:
    columns = ["design_point", "replicate", "score", "confidence"]
    first_rows, second_rows = (
        rows.filter(pl.col("agent") == agent).select(columns) for agent in (first, second)
    )
    shared = first_rows.join(second_rows, on=["design_point", "replicate"], suffix="_second").sort(
        "design_point", "replicate"
    )
    # A scene in which only one agent was considered shows no difference between the two.
    shared = shared.drop_nulls(["confidence", "confidence_second"])
    scored = shared.drop_nulls(["score", "score_second"])
    return Pairing(
        node=node,
        confidence_differences=tuple((shared["confidence_second"] - shared["confidence"]).to_list()),
        score_differences=tuple((scored["score_second"] - scored["score"]).to_list()),
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
