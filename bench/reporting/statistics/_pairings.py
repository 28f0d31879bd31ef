"""Two agents compared scene by scene, so that the scenes cannot explain a difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import polars as pl
from scipy.stats import binomtest


@dataclass(frozen=True, slots=True)
class Pairing:
    """One node, two agents, the scenes that both were considered in.

    A scene is passed when every considered observable under the node was achieved (confidence 1 in that run).
    `p_value` is McNemar's exact two-sided test on the scenes that only one of them passed; None when there is
    no such scene.
    """

    node: str
    first: str
    second: str
    both: int
    only_first: int
    only_second: int
    neither: int
    confidence_differences: tuple[float, ...]
    score_differences: tuple[float, ...]
    p_value: float | None

    @property
    def scenes(self) -> int:
        return self.both + self.only_first + self.only_second + self.neither

    @property
    def mean_confidence_difference(self) -> float | None:
        """Second minus first, in [-1, 1]."""
        return _mean(self.confidence_differences)

    @property
    def mean_score_difference(self) -> float | None:
        """Second minus first, over the scenes in which both have a score."""
        return _mean(self.score_differences)


def pair_agents(scores: pl.DataFrame, nodes: Sequence[str], first: str, second: str) -> tuple[Pairing, ...]:
    """Compare two agents on every node, over the (design point, replicate) pairs that both flew."""
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
    passed = [
        (a >= 1.0, b >= 1.0) for a, b in zip(shared["confidence"], shared["confidence_second"], strict=True)
    ]
    only_first, only_second = passed.count((True, False)), passed.count((False, True))
    scored = shared.drop_nulls(["score", "score_second"])
    return Pairing(
        node=node,
        first=first,
        second=second,
        both=passed.count((True, True)),
        only_first=only_first,
        only_second=only_second,
        neither=passed.count((False, False)),
        confidence_differences=tuple((shared["confidence_second"] - shared["confidence"]).to_list()),
        score_differences=tuple((scored["score_second"] - scored["score"]).to_list()),
        # McNemar's exact test: if the agents are equal, either of them passes a discordant scene with
        # probability 1/2.
        p_value=float(binomtest(only_first, only_first + only_second).pvalue)
        if only_first + only_second
        else None,
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
