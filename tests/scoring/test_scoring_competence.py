"""Competence in the summary of a score table: over all configurations, with the numbers of the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from competence_trials import competence_of
from made_decompositions import observed, rated

from bench.contracts import Outcome
from bench.scoring import Difficulty, ScoredRun, difficulty_of_values, score_table, summary_frame
from decompositions import Decomposition, load_decomposition

HALF, NINE_TENTHS = (1, 2), (9, 10)


@pytest.fixture(scope="module")
def decomposition() -> Decomposition:
    return load_decomposition("search-and-report")


@pytest.fixture(scope="module")
def situations(decomposition: Decomposition) -> list[Difficulty]:
    values = {
        "bystander_density_per_km2": 390.1,
        "bystander_proximity_m": 259.1,
        "uav_altitude_m": 60.0,
        "intelligence_uncertainty_m": 60.0,
        "time_limit_s": 300.0,
    }
    return [
        difficulty_of_values(decomposition, values | {"target_concealment": share})
        for share in (0.5, 0.75, 1.0)
    ]


def run(name: str, difficulty: Difficulty, xs: dict[str, float | None], point: str) -> ScoredRun:
    return ScoredRun(name, point, 0, "naive", Outcome.COMPLETED, difficulty, observed(xs))


def whole(decomposition: Decomposition, runs: list[ScoredRun]) -> pl.DataFrame:
    return summary_frame(score_table(decomposition, runs), decomposition).filter(configuration="all")


def test_the_summary_has_it_for_all_runs_together(
    decomposition: Decomposition, situations: list[Difficulty]
) -> None:
    """One row for each node over all configurations; null in a configuration's own row and where never considered."""
    xs: dict[str, float | None] = dict.fromkeys(decomposition.observables, 1.0) | {
        "OBS-181": None,
        "OBS-182": None,
    }
    runs = [run(f"r{i}", situations[i % 3], xs, f"p{i}") for i in range(36)]
    lost = replace(runs[0], realization="lost", outcome=Outcome.BENCH_ERROR, observations=())
    frame = summary_frame(score_table(decomposition, [*runs, lost]), decomposition)
    rows = {(row["configuration"], row["node"]): row for row in frame.iter_rows(named=True)}
    best = max(rated(name, "KA-05") for name in situations)
    top = rows["all", "KA-05"]
    assert (top["competence_50"], top["competence_50_low"], top["competence_50_at_least"]) == (
        best,
        best,
        True,
    )
    assert top["competence_90_low"] == min(
        rated(name, "KA-05") for name in situations
    )  # 36 straight at the easiest and up
    assert rows["all", "KA-18"]["competence_50"] is None
    assert rows["all", "KA-18"]["competence_90_at_least"] is None
    assert frame.filter(pl.col("configuration") != "all")["competence_50"].null_count() == frame.height - len(
        decomposition.nodes
    )


def test_the_published_score_rises_where_competence_falls(
    decomposition: Decomposition, situations: list[Difficulty]
) -> None:
    """A failed easy run raises the mean score, which is flagged; competence at nine tenths falls."""
    passed: dict[str, float | None] = dict.fromkeys(decomposition.observables, 1.0)
    runs = [run(f"r{i}", situations[2 * (i % 2)], passed, f"p{i}") for i in range(10)]
    bad: dict[str, float | None] = passed | dict.fromkeys(decomposition.observables_under("KA-05"), 0.0)
    worse = [run("r0", situations[0], bad, "p0"), *runs[1:]]
    before, after = (
        whole(decomposition, failed).row(by_predicate=pl.col("node") == "KA-05", named=True)
        for failed in (runs, worse)
    )
    assert after["score_mean"] > before["score_mean"]
    assert (before["raised_by_failure"], after["raised_by_failure"]) == (False, True)
    assert after["competence_90"] <= before["competence_90"]


def test_the_order_of_rows_and_the_type_of_texts_do_not_matter(
    decomposition: Decomposition, situations: list[Difficulty]
) -> None:
    """A table that was shuffled, or whose texts are categories, has the same summary; a null configuration is
    in `all` alone.
    """
    xs = [dict.fromkeys(decomposition.observables, float(i % 4 > 0)) for i in range(24)]
    table = score_table(
        decomposition,
        [run(f"r{i}", situations[i % 3], subset, f"p{i % 6}") for i, subset in enumerate(xs)],  # type: ignore[arg-type]
    )
    texts = [name for name, dtype in table.schema.items() if dtype == pl.String]
    first = summary_frame(table, decomposition)
    assert summary_frame(table.with_columns(pl.col(texts).cast(pl.Categorical)), decomposition).equals(first)
    keys = ["configuration", "node"]
    shuffled = summary_frame(table.sample(fraction=1.0, shuffle=True, seed=6), decomposition)
    numbers = [
        name for name in first.columns if name.startswith(("competence", "score_", "considered", "design"))
    ]
    assert shuffled.sort(keys).select(numbers).equals(first.sort(keys).select(numbers))
    unknown = summary_frame(table.with_columns(pl.lit(None, pl.String).alias("configuration")), decomposition)
    assert unknown.equals(first.filter(configuration="all"))


def test_a_design_point_may_have_several_difficulties(
    decomposition: Decomposition, situations: list[Difficulty]
) -> None:
    """As in a table from elsewhere: each difficulty is a cell of its own, and the numbers are those of
    `competence_of`.
    """
    rng = np.random.default_rng(7)
    hard, ok = [situations[i % 3] for i in range(60)], rng.random(60) < 0.9
    points = [f"p{i // 6}" for i in range(60)]
    runs = [
        run(f"r{i}", hard[i], dict.fromkeys(decomposition.observables, float(ok[i])), points[i])
        for i in range(60)
    ]
    row = whole(decomposition, runs).row(by_predicate=pl.col("node") == "KA-05", named=True)
    for name, share in (("competence_50", HALF), ("competence_90", NINE_TENTHS)):
        alone = competence_of([rated(difficulty, "KA-05") for difficulty in hard], ok, points, share)
        assert (row[name], row[f"{name}_low"], row[f"{name}_at_least"]) == alone
    assert row["competence_50_low"] > 0
