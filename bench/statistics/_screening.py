"""Factor screening: the tests of every node over the factors of a design in one frame, adjusted for their number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import polars as pl

from ._anova import Anova, anova
from ._multiplicity import benjamini_hochberg
from ._regression import Logistic, logistic
from ._terms import FactorColumn, FactorLevel, factor_columns

_Row = dict[str, object]

FACTOR_COLUMNS: dict[str, type[pl.DataType]] = {
    "agent": pl.String,
    "node": pl.String,
    "level": pl.String,
    "of": pl.String,
    "test": pl.String,
    "factor": pl.String,
    "n": pl.Int64,
    "points": pl.Int64,
    "effect": pl.String,
    "effect_size": pl.Float64,
    "p": pl.Float64,
    "p_adjusted": pl.Float64,
    "note": pl.String,
}
"""Columns of `factor_frame`. `of` is score, confidence or passes; `test` is anova or logistic; `effect` names the
kind of `effect_size`: omega2, or odds_ratio (for a factor of one degree of freedom). `p_adjusted`
(Benjamini-Hochberg) is over all rows of the same `of` and `test`. Null in `p` is "not tested", and `note` says why.
"""


@dataclass(frozen=True, slots=True)
class NodeFactorAnalysis:
    """The analyses of one node of one agent over the factors of a design."""

    agent: str
    node: str
    level: str
    score: Anova
    confidence: Anova
    passes: Logistic


def node_factors(
    scores: pl.DataFrame, levels: Mapping[str, Mapping[str, FactorLevel | None]], agent: str, node: str
) -> NodeFactorAnalysis | None:
    """Analyse one node of one agent; None where the node was considered in no run at a known design point.

    `scores` has the columns SCORE_COLUMNS; `levels` has the factor levels of each design point. A run passed
    where every considered observable under the node was achieved.
    """
    rows = scores.filter(
        pl.col("agent") == agent, pl.col("node") == node, pl.col("design_point").is_in(list(levels))
    ).sort("realization")
    considered = rows.drop_nulls("confidence")
    if not considered.height:
        return None
    scored = considered.drop_nulls("score")
    of_considered, of_scored = _factors(considered, levels), _factors(scored, levels)
    confidences, values = considered["confidence"].to_list(), scored["score"].to_list()
    points, scored_points = considered["design_point"].to_list(), scored["design_point"].to_list()
    return NodeFactorAnalysis(
        agent=agent,
        node=node,
        level=str(considered["level"][0]),
        score=anova(values, of_scored, scored_points),
        confidence=anova(confidences, of_considered, points),
        passes=logistic([confidence >= 1.0 for confidence in confidences], of_considered, points),
    )


def factor_frame(analyses: Iterable[NodeFactorAnalysis]) -> pl.DataFrame:
    """Every test of every analysis as one frame with the columns FACTOR_COLUMNS."""
    rows = [row for analysis in analyses for row in _rows(analysis)]
    families: dict[tuple[object, object], list[dict[str, object]]] = {}
    for row in rows:
        families.setdefault((row["of"], row["test"]), []).append(row)
    # Tests of different kinds answer different questions, so each kind is one family for the adjustment.
    for family in families.values():
        p = [analysis["p"] if isinstance(analysis["p"], float) else None for analysis in family]
        for row, p_adjusted in zip(family, benjamini_hochberg(p), strict=True):
            row["p_adjusted"] = p_adjusted
    return pl.DataFrame(rows, schema=FACTOR_COLUMNS)


def _factors(
    rows: pl.DataFrame, levels: Mapping[str, Mapping[str, FactorLevel | None]]
) -> tuple[FactorColumn, ...]:
    return factor_columns([levels[point] for point in rows["design_point"]])


def _rows(analysis: NodeFactorAnalysis) -> Iterator[_Row]:
    base: _Row = {"agent": analysis.agent, "node": analysis.node, "level": analysis.level}
    for of, tested in (("score", analysis.score), ("confidence", analysis.confidence)):
        tests = [(effect.term, effect.omega2, effect.p, effect.note) for effect in tested.effects]
        common = {**base, "of": of, "test": "anova", "points": tested.points, "effect": "omega2"}
        yield from _test_rows(common, tested, tests)
    passes = analysis.passes
    tests = [(test.factor, _odds_ratio(passes, test.factor), test.p, test.note) for test in passes.tests]
    common = {**base, "of": "passes", "test": "logistic", "points": analysis.confidence.points}
    yield from _test_rows({**common, "effect": "odds_ratio"}, passes, tests)


def _test_rows(
    base: _Row, fit: Anova | Logistic, tests: Sequence[tuple[str, float | None, float | None, str]]
) -> Iterator[_Row]:
    """A row for each test (factor, effect size, p and note), or one that says why there is none; then what was left out."""
    nothing = {"effect_size": None, "p": None}
    for factor, size, p, note in tests:
        notes = "; ".join(filter(None, (note, fit.note)))
        yield {**base, "n": fit.n, "factor": factor, "effect_size": size, "p": p, "note": notes}
    if not tests:
        yield {**base, "n": fit.n, "factor": "all", **nothing, "note": fit.note}
    for omitted in fit.left_out:
        note = f"left out: {omitted.reason}"
        yield {**base, "n": fit.n, "factor": omitted.term, **nothing, "note": note}


def _odds_ratio(fit: Logistic, factor: str) -> float | None:
    """None for a factor of several degrees of freedom, which has more than one."""
    odds = [ratio.estimate for ratio in fit.odds if ratio.factor == factor]
    return odds[0] if len(odds) == 1 else None
