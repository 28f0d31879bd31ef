"""The runs that considered one node, and whether the agent passed them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import polars as pl

from bench.contracts import Outcome
from bench.statistics import Curve, difficulty_response


@dataclass(frozen=True, slots=True)
class NodeTrials:
    """The runs of one agent that considered one node and count: what each was rated, and whether everything
    was achieved.
    """

    difficulty: tuple[float, ...] = ()
    passed: tuple[bool, ...] = ()
    design_points: tuple[str, ...] = ()

    @property
    def passes(self) -> int:
        """How many passed."""
        return sum(self.passed)

    def curve(self) -> Curve:
        """The logistic difficulty-response curve of these runs."""
        return difficulty_response(self.difficulty, self.passed, self.design_points)


AllTrials = Mapping[tuple[str, str], NodeTrials]
"""By agent and node; no entry where the node was never considered."""


def trials_of(scores: pl.DataFrame) -> AllTrials:
    """Every node's trials, by the rule of competence: considered, and ended by something that the agent
    answers for.
    """
    # Outcomes that do not count, such as a lost worker, say nothing about the agent.
    counted = scores.filter(
        pl.col("considered") > 0, ~pl.col("outcome").is_in([str(o) for o in Outcome if not o.counts])
    )
    grouped = counted.group_by("agent", "node", maintain_order=True).agg(
        pl.col("difficulty"),
        (pl.col("achieved") == pl.col("considered")).alias("passed"),
        pl.col("design_point"),
    )
    return {
        (agent, node): NodeTrials(tuple(hard), tuple(ok), tuple(points))
        for agent, node, hard, ok, points in grouped.iter_rows()
    }
