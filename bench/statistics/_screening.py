"""Which factors matter: every node's tests over the factors of a design, in one frame, adjusted for how many there are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import polars as pl

from ._anova import Anova, anova
from ._multiplicity import benjamini_hochberg, holm
from ._regression import Correlation, Logistic, correlation, logistic
from ._terms import FactorColumn, FactorLevel, OmittedTerm, factor_columns

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
    "p_holm": pl.Float64,
    "note": pl.String,
}
"""Columns of `factor_frame`. `of` is score, confidence or passes; `test` anova, logistic, pearson or spearman; `effect` names what
`effect_size` is: omega2, odds_ratio (of a factor of one degree of freedom), r or rho. `p_adjusted` (Benjamini-Hochberg) and
`p_holm` are over all rows of the same `of` and `test`. Null in `p` is "not tested", and `note` says why."""


@dataclass(frozen=True, slots=True)
class NodeFactorAnalysis:
    """One node of one agent over the factors of a design."""

    agent: str
    node: str
    level: str
    score: Anova
    confidence: Anova
    passes: Logistic
    score_correlations: tuple[Correlation, ...]
    confidence_correlations: tuple[Correlation, ...]


def node_factors(
    scores: pl.DataFrame, levels: Mapping[str, Mapping[str, FactorLevel | None]], agent: str, node: str
) -> NodeFactorAnalysis | None:
    """Analyse one node of one agent; None where none of its runs was considered at a known design point.

    `scores` has the columns SCORE_COLUMNS, `levels` the levels of each design point's factors. A run passed where everything
    considered under the node was achieved.
    """
    rows = scores.filter(pl.col("agent") == agent, pl.col("node") == node, pl.col("design_point").is_in(list(levels))).sort(
        "realization"
    )
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
        passes=logistic([one >= 1.0 for one in confidences], of_considered, points),
        score_correlations=_correlations(values, of_scored, scored_points),
        confidence_correlations=_correlations(confidences, of_considered, points),
    )


def factor_frame(analyses: Iterable[NodeFactorAnalysis]) -> pl.DataFrame:
    """Every test of every analysis as one frame with the columns FACTOR_COLUMNS."""
    rows = [row for one in analyses for row in _rows(one)]
    families: dict[tuple[object, object], list[dict[str, object]]] = {}
    for row in rows:
        families.setdefault((row["of"], row["test"]), []).append(row)
    for family in families.values():
        p = [one["p"] if isinstance(one["p"], float) else None for one in family]
        for row, adjusted, careful in zip(family, benjamini_hochberg(p), holm(p), strict=True):
            row["p_adjusted"], row["p_holm"] = adjusted, careful
    return pl.DataFrame(rows, schema=FACTOR_COLUMNS)


def _factors(rows: pl.DataFrame, levels: Mapping[str, Mapping[str, FactorLevel | None]]) -> tuple[FactorColumn, ...]:
    return factor_columns([levels[point] for point in rows["design_point"]])


def _correlations(values: Sequence[float], factors: Sequence[FactorColumn], points: Sequence[str]) -> tuple[Correlation, ...]:
    return tuple(one for factor in factors if (one := correlation(values, factor, points)) is not None)


def _rows(one: NodeFactorAnalysis) -> Iterator[dict[str, object]]:
    base: dict[str, object] = {"agent": one.agent, "node": one.node, "level": one.level}
    for of, found in (("score", one.score), ("confidence", one.confidence)):
        yield from ({**base, **row} for row in _anova_rows(of, found))
    yield from ({**base, **row} for row in _logistic_rows(one.passes, one.confidence.points))
    for of, points, correlations in (
        ("score", one.score.points, one.score_correlations),
        ("confidence", one.confidence.points, one.confidence_correlations),
    ):
        for each in correlations:
            common = {**base, "of": of, "factor": each.factor, "n": each.n, "points": points, "note": _linearity_note(each)}
            yield {**common, "test": "pearson", "effect": "r", "effect_size": each.pearson, "p": each.pearson_p}
            yield {**common, "test": "spearman", "effect": "rho", "effect_size": each.spearman, "p": each.spearman_p}


def _anova_rows(of: str, found: Anova) -> Iterator[dict[str, object]]:
    base: dict[str, object] = {"of": of, "test": "anova", "n": found.n, "points": found.points, "effect": "omega2"}
    for effect in found.effects:
        note = "; ".join(filter(None, (effect.note, found.note)))
        yield {**base, "factor": effect.term, "effect_size": effect.omega2, "p": effect.p, "note": note}
    if not found.effects:
        yield {**base, "factor": "all", "effect_size": None, "p": None, "note": found.note}
    yield from (_left_out_row(base, each) for each in found.left_out)


def _logistic_rows(found: Logistic, points: int) -> Iterator[dict[str, object]]:
    base: dict[str, object] = {"of": "passes", "test": "logistic", "n": found.n, "points": points, "effect": "odds_ratio"}
    for test in found.tests:
        odds = [one.estimate for one in found.odds if one.factor == test.factor]
        note = "; ".join(filter(None, (test.note, found.note)))
        size = odds[0] if len(odds) == 1 else None
        yield {**base, "factor": test.factor, "effect_size": size, "p": test.p, "note": note}
    if not found.tests:
        yield {**base, "factor": "all", "effect_size": None, "p": None, "note": found.note}
    yield from (_left_out_row(base, each) for each in found.left_out)


def _left_out_row(base: Mapping[str, object], left: OmittedTerm) -> dict[str, object]:
    return {**base, "factor": left.term, "effect_size": None, "p": None, "note": f"left out: {left.reason}"}


def _linearity_note(found: Correlation) -> str:
    return "not a straight line" if found.bend_p is not None and found.bend_p < 0.05 else ""
