"""What the runs of a campaign show about its factors: tests, effects left open, and where passing turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from bench.realization import INACTIVE, Design, FactorLevel
from bench.reporting import ReportData, campaign_design_points, campaign_design_quality, factor_effects
from bench.statistics import difference_bounds, difficulty_response, factor_columns

EFFECT_P = 0.05
"""Confidence or passes follow a factor if an adjusted p is below this: the usual level of a test."""

UNDECIDED_PASS_RATES = (0.1, 0.9)
"""Pass rates between which a value of a factor is worth flying. Chosen, not measured."""


@dataclass(frozen=True, slots=True)
class OpenDifference:
    """The largest difference in confidence between two levels of a factor that the runs of one agent do not rule out.

    `difference` is between 0 and 1, at 95 %. None if the design points cannot separate the factor from the
    others.
    """

    agent: str
    node: str
    runs: int
    difference: float | None

    def text(self) -> str:
        """The difference in words."""
        return f"{100 * (self.difference or 0.0):.0f} points in {self.node} of {self.agent}"


@dataclass(frozen=True, slots=True)
class FactorEvidence:
    """Tests of every factor, and the runs with their levels.

    `runs` has the columns agent, node, design_point, confidence and passed. `open_differences` has those of
    each factor, the largest first. `aliases` has the interactions that cannot be separated from the main
    effect of a factor.
    """

    tests: pl.DataFrame
    runs: pl.DataFrame
    levels: Mapping[str, Mapping[str, FactorLevel]]
    open_differences: Mapping[str, Sequence[OpenDifference]]
    aliases: Mapping[str, Sequence[str]]

    @classmethod
    def of(cls, data: ReportData, design: Design) -> FactorEvidence:
        """The evidence in the results of a campaign with this design."""
        levels = {point.id: point.levels for point in campaign_design_points(data) or ()}
        rows = data.scores.filter(
            pl.col("node").is_in(data.study), pl.col("design_point").is_in(list(levels))
        )
        passed = (
            rows.drop_nulls("confidence").sort("realization").with_columns(passed=pl.col("confidence") >= 1.0)
        )
        runs = passed.select("agent", "node", "design_point", "confidence", "passed")
        quality = campaign_design_quality(data)
        chains = [alias.split(" = ") for alias in (quality.aliased if quality else ())]
        aliases = {main: interactions for main, *interactions in chains}
        return cls(factor_effects(data).frame, runs, levels, _open_differences(runs, levels, design), aliases)

    def tests_of(self, factor: str) -> list[dict[str, Any]]:
        """Tests of a factor and of its interactions, by analysis of variance and by regression, without failed ones."""
        rows = self.tests.filter(pl.col("test").is_in(["anova", "logistic"])).iter_rows(named=True)
        return [
            row for row in rows if factor in row["factor"].split(" x ") and not math.isnan(row["p"] or 0.0)
        ]

    def untested(self, factor: str) -> str:
        """Why a test of this factor could not be made.

        Empty if each was made, or had no variance to explain.
        """
        main_effects = [row for row in self.tests_of(factor) if row["factor"] == factor]
        missing = next((row for row in main_effects if row["p"] is None), None)
        if missing is not None:
            return str(missing["note"] or "it could not be tested")
        if not main_effects:
            notes = self.tests.filter(pl.col("factor") == "all")["note"].unique().sort().to_list()
            return "; ".join(note for note in notes if note) or "it was not tested"
        return ""

    def effects(self, factor: str, max_p: float) -> list[dict[str, Any]]:
        """Tests of a factor with an adjusted p below `max_p`."""
        return [
            row
            for row in self.tests_of(factor)
            if row["p_adjusted"] is not None and row["p_adjusted"] < max_p
        ]

    def largest_share(self, factor: str) -> Mapping[str, Any] | None:
        """The test in which a factor, or an interaction of it, explains the largest share of variance.

        None without one.
        """
        shares = [
            row
            for row in self.tests_of(factor)
            if row["effect"] == "omega2" and row["effect_size"] is not None
        ]
        return max(shares, key=lambda row: float(row["effect_size"]), default=None)

    def value_count(self, factor: str) -> int:
        """Number of values at which a factor was flown."""
        return len({levels[factor] for levels in self.levels.values()})

    def undecided_range(self, factor: str, *, by_band: bool) -> tuple[float, float] | None:
        """The values of a numeric factor at which passing is undecided, over all nodes and agents that follow it.

        By the logistic curve, or by its 95 % band, which is wider. None if nothing follows the factor.
        """
        affected = {
            (row["agent"], row["node"])
            for row in self.effects(factor, EFFECT_P)
            if row["of"] in ("confidence", "passes")
        }
        ranges = [
            undecided
            for agent, node in sorted(affected)
            if (undecided := self._undecided_range(factor, agent, node, by_band)) is not None
        ]
        return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None

    def _undecided_range(
        self, factor: str, agent: str, node: str, by_band: bool
    ) -> tuple[float, float] | None:
        # Where a conditional factor is inactive its level is a word, and its value had no influence.
        active = [point for point, levels in self.levels.items() if not isinstance(levels[factor], str)]
        runs = self.runs.filter(
            pl.col("agent") == agent, pl.col("node") == node, pl.col("design_point").is_in(active)
        )
        x = np.array([float(self.levels[point][factor]) for point in runs["design_point"]])
        passed = runs["passed"].to_numpy().astype(np.float64)
        # The curve takes difficulties, with which passing falls. If it rises with the factor, the negative
        # takes their place.
        sign = -1.0 if float(((x - x.mean()) * (passed - passed.mean())).sum()) > 0.0 else 1.0
        curve = difficulty_response(sign * x, passed, runs["design_point"].to_list())
        low, high = (curve.low, curve.high) if by_band else (curve.probability, curve.probability)
        undecided = (high >= UNDECIDED_PASS_RATES[0]) & (low <= UNDECIDED_PASS_RATES[1])
        if not undecided.any():
            return None
        values = sign * curve.difficulty[undecided]
        return float(values.min()), float(values.max())


def _open_differences(
    runs: pl.DataFrame, levels: Mapping[str, Mapping[str, FactorLevel]], design: Design
) -> dict[str, list[OpenDifference]]:
    """By factor, those that cannot be separated first, then the largest first."""
    conditional = {factor.name for factor in design.factors if factor.when}
    # A factor with a formula is part of the factors in the formula, and would hide their effect beside them.
    by_factor: dict[str, list[OpenDifference]] = {
        factor.name: [] for factor in design.factors if factor.formula is None
    }
    active = {
        point: {
            name: None if name in conditional and point_levels[name] == INACTIVE else point_levels[name]
            for name in by_factor
        }
        for point, point_levels in levels.items()
    }
    for (agent, node), rows in runs.group_by("agent", "node", maintain_order=True):
        points = rows["design_point"].to_list()
        bounds = difference_bounds(
            rows["confidence"].to_list(), factor_columns([active[point] for point in points]), points
        )
        for name, difference in bounds.items():
            by_factor[name].append(OpenDifference(str(agent), str(node), len(points), difference))

    def order(difference: OpenDifference) -> float:
        return -math.inf if difference.difference is None else -difference.difference

    return {name: sorted(differences, key=order) for name, differences in by_factor.items()}
