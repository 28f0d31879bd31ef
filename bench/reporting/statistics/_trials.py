"""The runs that considered one node, and whether the agent passed them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import polars as pl

from bench.contracts import Outcome
from bench.statistics import Curve, difficulty_response


@dataclass(frozen=True, slots=True)
class NodeTrials:
    """The runs of an agent that considered a node and count: how each was rated, and whether it achieved all."""

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
    """Every node's trials, by the rule of competence: considered, and ended by something that the agent answers for."""
    # Outcomes that do not count, such as a lost worker, say nothing about the agent.
    counted = (
        # Without the columns that are not needed: a filter copies all, and a table may be large.
        scores.select("agent", "node", "difficulty", "achieved", "considered", "design_point", "outcome")
        .filter(pl.col("considered") > 0, ~pl.col("outcome").is_in([str(o) for o in Outcome if not o.counts]))
        .with_columns((pl.col("achieved") == pl.col("considered")).alias("passed"))
        .select("agent", "node", "difficulty", "passed", "design_point")
    )
    grouped = counted.group_by("agent", "node", maintain_order=True).all()
    # Replicates share difficulties and names of design points: each is one object, however many trials have it.
    numbers: dict[float, float] = {}
    names: dict[str, str] = {}
    return {
        (agent, node): NodeTrials(
            tuple(numbers.setdefault(number, number) for number in difficulty),
            tuple(passed),
            tuple(names.setdefault(name, name) for name in points),
        )
        # Row by row: Polars would make lists of all rows at once.
        for agent, node, difficulty, passed, points in grouped.iter_rows(buffer_size=1)
    }
