"""Two agents (or one agent in two campaigns), node by node. On the same scenes: what differs, how surely, and how
many pairs would settle it. On other scenes: whether the results are distributed alike.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import polars as pl
from scipy import stats

from ._divergence import Divergence, NodeOutcome, distributions, divergence
from ._effect_sizes import DifferenceEstimate, PairedCounts
from ._multiplicity import benjamini_hochberg
from ._power import pairs_for_difference

SIGNIFICANCE = 0.05
MIN_DIFFERENCE = 0.1
"""Where no difference was seen, the number of pairs is worked out for a difference of this size: chosen, not measured."""


@dataclass(frozen=True, slots=True)
class NodeComparison:
    """One node on the pairs in which both sides were considered; every difference is second minus first.

    `mcnemar_p` is exact and takes pairs as independent. `clustered_p` allows for pairs that share a design
    point (Durkalski et al. 2003, Statistics in Medicine 22, 2417-2428) and is None where no two do. The
    larger of both is adjusted over all nodes compared: `p_adjusted` (Benjamini-Hochberg).
    `settled` means `p_adjusted` below 0.05. `pairs_needed` is the number for 80 % power at the rates seen,
    tested at 0.05 over the number of nodes; None where the node is settled or no number helps.
    `points` counts design points.
    """

    node: str
    level: str
    points: int
    counts: PairedCounts
    difference: DifferenceEstimate | None
    mcnemar_p: float | None
    clustered_p: float | None
    p_adjusted: float | None
    divergence: Divergence | None
    pairs_needed: int | None

    @property
    def settled(self) -> bool:
        return self.p_adjusted is not None and self.p_adjusted < SIGNIFICANCE

    def verdict(self, first: str, second: str) -> str:
        """One sentence for a reader who looks at no number."""
        pairs = f"{self.counts.pairs} {'pair' if self.counts.pairs == 1 else 'pairs'}"
        if self.difference is None:
            return "nothing to compare: no scene considered it for both"
        points = round(100 * self.difference.estimate)
        if not self.counts.only_first + self.counts.only_second:
            result = f"both pass and fail {self.node} on the same scenes"
        elif not points:
            result = f"{first} and {second} pass {self.node} alike"
        else:
            better = second if points > 0 else first
            result = f"{better} passes {self.node} in {abs(points)} more of 100 scenes"
        return f"{result}; {pairs}; {self._certainty()}"

    def _certainty(self) -> str:
        if self.settled:
            return "settled"
        if self.pairs_needed is None:
            return "not settled"
        differs = self.counts.only_first != self.counts.only_second
        effect = "would" if differs else f"would show one of {100 * MIN_DIFFERENCE:.0f} in 100"
        return f"not settled: about {self.pairs_needed} pairs {effect}"


@dataclass(frozen=True, slots=True)
class UnpairedNodeComparison:
    """One node over the runs of two sides that flew other scenes, so that nothing is paired.

    Pairs of numbers are of the first and the second side: `points` (design points), and of the runs those
    `considered` and those of them that `passed`. `results` counts runs by the classes of the divergence. The
    shuffles of `divergence` mix whole design points; `p_adjusted` is its p over all nodes compared
    (Benjamini-Hochberg).
    """

    node: str
    points: tuple[int, int]
    considered: tuple[int, int]
    passed: tuple[int, int]
    results: dict[str, tuple[int, int]]
    divergence: Divergence | None
    p_adjusted: float | None = None

    @property
    def settled(self) -> bool:
        return self.p_adjusted is not None and self.p_adjusted < SIGNIFICANCE

    def verdict(self, first: str, second: str) -> str:
        """One sentence for a reader who looks at no number."""
        if self.divergence is None or not any(self.considered):
            return "nothing to compare: no run considered it; not the same scenes"
        result = f"{first} and {second} differ" if self.settled else "no difference is shown"
        runs = f"{self.divergence.first} and {self.divergence.second} runs"
        return f"{result}; {runs}; not the same scenes"


def compare_unpaired_nodes(
    first: pl.DataFrame,
    second: pl.DataFrame,
    nodes: Sequence[str],
    *,
    excluded_outcomes: Collection[str],
    seed: int = 0,
) -> tuple[UnpairedNodeComparison, ...]:
    """Like `compare_nodes`, for two score tables of other scenes: all runs of both are compared as distributions."""
    compared = [
        _compared_unpaired(
            [_node_rows(side, node, excluded_outcomes) for side in (first, second)], node, seed
        )
        for node in nodes
    ]
    adjusted = benjamini_hochberg(
        [None if node.divergence is None else node.divergence.p for node in compared]
    )
    return tuple(replace(node, p_adjusted=p) for node, p in zip(compared, adjusted, strict=True))


def _compared_unpaired(sides: Sequence[pl.DataFrame], node: str, seed: int) -> UnpairedNodeComparison:
    first, second = (_outcomes(rows, "") for rows in sides)
    points = [rows["design_point"].cast(pl.String).to_list() for rows in sides]
    confidences = [rows["confidence"].drop_nulls() for rows in sides]
    return UnpairedNodeComparison(
        node=node,
        points=(len(set(points[0])), len(set(points[1]))),
        considered=(len(confidences[0]), len(confidences[1])),
        passed=(int((confidences[0] >= 1.0).sum()), int((confidences[1] >= 1.0).sum())),
        results=distributions(first, second),
        divergence=divergence(
            first, second, paired=False, clusters=(points[0], points[1]), seed=_node_seed(seed, node)
        ),
    )


def compare_nodes(
    first: pl.DataFrame,
    second: pl.DataFrame,
    nodes: Sequence[str],
    *,
    excluded_outcomes: Collection[str],
    seed: int = 0,
) -> tuple[NodeComparison, ...]:
    """Compare two score tables (SCORE_COLUMNS, one agent each) over the (design point, replicate) pairs that both hold.

    The caller vouches that a pair is the same scene on both sides. Runs with one of `excluded_outcomes`
    (those that the bench spoilt) are in no pair. A node without a row on either side has no pairs. Shuffles
    are drawn from the seed and the node's name.
    """
    compared = [_compared(_paired_rows(first, second, node, excluded_outcomes), node, seed) for node in nodes]
    p_values = [_conservative_p(comparison) for comparison in compared]
    tested = max(1, sum(p is not None for p in p_values))
    return tuple(
        _with_pairs_needed(replace(comparison, p_adjusted=p_adjusted), tested)
        for comparison, p_adjusted in zip(compared, benjamini_hochberg(p_values), strict=True)
    )


def _compared(rows: pl.DataFrame, node: str, seed: int) -> NodeComparison:
    pairs = rows.drop_nulls(["confidence", "confidence_second"])
    passed = list(
        zip(pairs["confidence"] >= 1.0, pairs["confidence_second"] >= 1.0, pairs["design_point"], strict=True)
    )
    results = [(first, second) for first, second, _ in passed]
    counts = PairedCounts(
        both=results.count((True, True)),
        only_first=results.count((True, False)),
        only_second=results.count((False, True)),
        neither=results.count((False, False)),
    )
    first_outcomes, second_outcomes = _outcomes(rows, ""), _outcomes(rows, "_second")
    return NodeComparison(
        node=node,
        level=str(rows["level"][0]) if rows.height else "",
        points=pairs["design_point"].n_unique(),
        counts=counts,
        difference=counts.difference(),
        mcnemar_p=counts.mcnemar_p,
        clustered_p=_clustered_p(passed),
        p_adjusted=None,
        divergence=divergence(first_outcomes, second_outcomes, paired=True, seed=_node_seed(seed, node)),
        pairs_needed=None,
    )


def _node_seed(seed: int, node: str) -> int:
    # The node's name is part of the seed: adding a node to a comparison leaves the p values of the others as
    # they are.
    return zlib.crc32(f"{seed}/{node}".encode())


def _node_rows(side: pl.DataFrame, node: str, excluded_outcomes: Collection[str]) -> pl.DataFrame:
    columns = ["design_point", "replicate", "level", "score", "confidence"]
    is_counted = ~pl.col("outcome").is_in(list(excluded_outcomes))
    rows = side.filter(pl.col("node") == node, is_counted).select(columns)
    return rows.sort("design_point", "replicate")


def _paired_rows(
    first: pl.DataFrame, second: pl.DataFrame, node: str, excluded_outcomes: Collection[str]
) -> pl.DataFrame:
    first_rows, second_rows = (_node_rows(side, node, excluded_outcomes) for side in (first, second))
    return first_rows.join(second_rows, on=["design_point", "replicate"], suffix="_second").sort(
        "design_point", "replicate"
    )


def _outcomes(rows: pl.DataFrame, suffix: str) -> list[NodeOutcome]:
    pairs = rows.select(f"score{suffix}", f"confidence{suffix}").iter_rows()
    return [NodeOutcome(score, confidence is not None) for score, confidence in pairs]


def _clustered_p(passed: Sequence[tuple[bool, bool, str]]) -> float | None:
    """Durkalski's test: the surplus of passes in each design point against the spread of those surpluses."""
    surplus: dict[str, int] = {}
    for first, second, point in passed:
        surplus[point] = surplus.get(point, 0) + int(second) - int(first)
    spread = sum(points**2 for points in surplus.values())
    if len(surplus) == len(passed) or not any(first != second for first, second, _ in passed):
        return None
    return float(stats.chi2.sf(sum(surplus.values()) ** 2 / spread, 1)) if spread else 1.0


def _conservative_p(comparison: NodeComparison) -> float | None:
    return max((p for p in (comparison.mcnemar_p, comparison.clustered_p) if p is not None), default=None)


def _with_pairs_needed(comparison: NodeComparison, tested: int) -> NodeComparison:
    if comparison.settled or comparison.difference is None:
        return comparison
    pairs = comparison.counts.pairs
    first, second = comparison.counts.only_first / pairs, comparison.counts.only_second / pairs
    shares = (first, second) if first != second else (first, min(1.0 - first, second + MIN_DIFFERENCE))
    needed = pairs_for_difference(*shares, alpha=SIGNIFICANCE / tested)
    # The pairs at hand did not settle it, so at least one more is needed, whatever the power calculation
    # says.
    return replace(comparison, pairs_needed=None if needed is None else max(needed, pairs + 1))
