"""Two agents (or one agent of two campaigns) on the same scenes, node by node: what differs, how surely, and what would settle it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from scipy import stats

from bench.contracts import Outcome
from bench.statistics import (
    Difference,
    Divergence,
    Ended,
    PairedCounts,
    benjamini_hochberg,
    cliffs_delta,
    divergence,
    holm,
    pairs_for_difference,
)

SETTLED_BELOW = 0.05
WORTH_FINDING = 0.1
"""Where no difference was seen, the number of pairs is worked out for one of this size."""
_COUNTED = [str(one) for one in Outcome if one.counts]


@dataclass(frozen=True, slots=True)
class NodeComparison:
    """One node on the pairs in which both sides were considered; every difference is second minus first.

    `mcnemar_p` is exact and takes pairs as independent; `clustered_p` (Durkalski et al. 2003, Statistics in Medicine 22, 2417-2428)
    does not, and is None where no two pairs share a design point. The larger of both is adjusted over all nodes compared:
    `p_adjusted` (Benjamini-Hochberg) and `p_holm`. `settled` means `p_adjusted` below 0.05. `pairs_needed` is for 80 % power at
    the rates seen, tested at 0.05 over the number of nodes; None where it is settled, or no number is of use. `delta` is
    Cliff's, over scores, a failed run being below every score. `points` counts design points.
    """

    node: str
    level: str
    points: int
    counts: PairedCounts
    difference: Difference | None
    mcnemar_p: float | None
    clustered_p: float | None
    p_adjusted: float | None
    p_holm: float | None
    divergence: Divergence | None
    delta: Difference | None
    pairs_needed: int | None

    @property
    def settled(self) -> bool:
        return self.p_adjusted is not None and self.p_adjusted < SETTLED_BELOW

    def verdict(self, first: str, second: str) -> str:
        """A sentence for a reader who will look at no number but this one."""
        pairs = f"{self.counts.pairs} {'pair' if self.counts.pairs == 1 else 'pairs'}"
        if self.difference is None:
            return "nothing to compare: no scene considered it for both"
        points = round(100 * self.difference.estimate)
        if not self.counts.only_first + self.counts.only_second:
            head = f"both pass and fail {self.node} on the same scenes"
        elif not points:
            head = f"{first} and {second} pass {self.node} alike"
        else:
            more = second if points > 0 else first
            head = f"{more} passes {self.node} in {abs(points)} more of 100 scenes"
        return f"{head}; {pairs}; {self._settling()}"

    def _settling(self) -> str:
        if self.settled:
            return "settled"
        if self.pairs_needed is None:
            return "not settled"
        seen = self.counts.only_first != self.counts.only_second
        tail = "would" if seen else f"would show one of {100 * WORTH_FINDING:.0f} in 100"
        return f"not settled: about {self.pairs_needed} pairs {tail}"


def compare_nodes(
    first: pl.DataFrame, second: pl.DataFrame, nodes: Sequence[str], *, seed: int = 0
) -> tuple[NodeComparison, ...]:
    """Compare two score tables (SCORE_COLUMNS, one agent each) over the (design point, replicate) pairs that both hold.

    Who calls vouches that a pair is the same scene on both sides. Runs that the bench spoilt are in no pair. A node without a
    row on either side has no pairs. Shuffles are drawn from the seed and the node's name.
    """
    found = [_compared(first, second, node, seed) for node in nodes]
    p = [_careful(one) for one in found]
    tested = sum(value is not None for value in p)
    adjusted = zip(found, benjamini_hochberg(p), holm(p), strict=True)
    return tuple(_settled(replace(one, p_adjusted=bh, p_holm=strict), max(1, tested)) for one, bh, strict in adjusted)


def _compared(first: pl.DataFrame, second: pl.DataFrame, node: str, seed: int) -> NodeComparison:
    met = _met(first, second, node)
    level = str(met["level"][0]) if met.height else ""
    both = met.drop_nulls(["confidence", "confidence_second"])
    passed = list(zip(both["confidence"] >= 1.0, both["confidence_second"] >= 1.0, both["design_point"], strict=True))
    ways = [(a, b) for a, b, _ in passed]
    counts = PairedCounts(
        ways.count((True, True)), ways.count((True, False)), ways.count((False, True)), ways.count((False, False))
    )
    one, other = _ended(met, ""), _ended(met, "_second")
    return NodeComparison(
        node=node,
        level=level,
        points=both["design_point"].n_unique(),
        counts=counts,
        difference=counts.difference(),
        mcnemar_p=counts.mcnemar_p,
        clustered_p=_clustered(passed),
        p_adjusted=None,
        p_holm=None,
        divergence=divergence(one, other, paired=True, seed=zlib.crc32(f"{seed}/{node}".encode())),
        delta=cliffs_delta(_ranked(one), _ranked(other)),
        pairs_needed=None,
    )


def _met(first: pl.DataFrame, second: pl.DataFrame, node: str) -> pl.DataFrame:
    columns = ["design_point", "replicate", "level", "score", "confidence"]
    mine, other = (
        side.filter(pl.col("node") == node, pl.col("outcome").is_in(_COUNTED)).select(columns) for side in (first, second)
    )
    return mine.join(other, on=["design_point", "replicate"], suffix="_second").sort("design_point", "replicate")


def _ended(met: pl.DataFrame, suffix: str) -> list[Ended]:
    pairs = met.select(f"score{suffix}", f"confidence{suffix}").iter_rows()
    return [Ended(score, confidence is not None) for score, confidence in pairs]


def _ranked(runs: Sequence[Ended]) -> list[float]:
    return [-np.inf if one.score is None else one.score for one in runs if one.considered]


def _clustered(passed: Sequence[tuple[bool, bool, str]]) -> float | None:
    """Durkalski's test: the surplus of each design point against the spread of those surpluses."""
    surplus: dict[str, int] = {}
    for a, b, point in passed:
        surplus[point] = surplus.get(point, 0) + int(b) - int(a)
    spread = sum(one**2 for one in surplus.values())
    if len(surplus) == len(passed) or not any(a != b for a, b, _ in passed):
        return None
    return float(stats.chi2.sf(sum(surplus.values()) ** 2 / spread, 1)) if spread else 1.0


def _careful(one: NodeComparison) -> float | None:
    known = [p for p in (one.mcnemar_p, one.clustered_p) if p is not None]
    return max(known) if known else None


def _settled(one: NodeComparison, tested: int) -> NodeComparison:
    if one.settled or one.difference is None:
        return one
    pairs = one.counts.pairs
    seen = (one.counts.only_first / pairs, one.counts.only_second / pairs)
    shares = seen if seen[0] != seen[1] else (seen[0], min(1.0 - seen[0], seen[1] + WORTH_FINDING))
    needed = pairs_for_difference(*shares, alpha=SETTLED_BELOW / tested)
    return replace(one, pairs_needed=None if needed is None else max(needed, pairs + 1))
