"""The score table and its summary: means and counts as published, intervals, and bulk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from competence_trials import competence_of
from made_decompositions import (
    WORKED,
    factor_row,
    leaf,
    made_decomposition,
    observed,
    rated,
    worked_decomposition,
)

from bench.contracts import Observation, Outcome
from bench.errors import SetupError
from bench.scoring import (
    SCORE_COLUMNS,
    Difficulty,
    ScoredRun,
    absent_pairs,
    configuration_of,
    difficulty_of_values,
    score_run,
    score_table,
    summary_frame,
)
from bench.scoring._summary import SUMMARY_COLUMNS
from bench.statistics import (
    bounded_mean,
    clopper_pearson,
    mean_bounds,
    pass_rate_bounds,
)
from decompositions import (
    Decomposition,
    load_decomposition,
)


@pytest.fixture(scope="module")
def decomposition() -> Decomposition:
    return load_decomposition("search-and-report")


def hard(decomposition: Decomposition, concealment: float = 0.5, density: float = 390.1) -> Difficulty:
    values = {
        "target_concealment": concealment,
        "bystander_density_per_km2": density,
        "bystander_proximity_m": 259.1,
        "uav_altitude_m": 60.0,
        "intelligence_uncertainty_m": 60.0,
        "time_limit_s": 300.0,
    }
    return difficulty_of_values(decomposition, values)


def run(name: str, summary: Difficulty, xs: dict[str, float | None], **changes: object) -> ScoredRun:
    scored = ScoredRun(name, name, 0, "naive", Outcome.COMPLETED, summary, observed(xs))
    return replace(scored, **changes)  # type: ignore[arg-type]


def everything(decomposition: Decomposition, x: float | None = 1.0) -> dict[str, float | None]:
    return dict.fromkeys(decomposition.observables, x)


def line(
    summary: pl.DataFrame, node: str, configuration: str = "all", agent: str = "naive"
) -> dict[str, Any]:
    rows = summary.filter(node=node, configuration=configuration, agent=agent)
    assert rows.height == 1
    return rows.row(0, named=True)


def summary_of(decomposition: Decomposition, runs: Sequence[ScoredRun]) -> pl.DataFrame:
    return summary_frame(score_table(decomposition, runs), decomposition)


def worked() -> tuple[Decomposition, list[ScoredRun]]:
    """The paper's two runs: observables of 30, 80 and 50 by one table, OBS1 failing in the second."""
    decomposition = worked_decomposition(
        [leaf(name, factor_row("fog_level", [rating, 100], [1, 2])) for name, rating in WORKED.items()],
        given=False,
    )
    summary = difficulty_of_values(decomposition, {"fog_level": 1.0})
    passed = everything(decomposition)
    return decomposition, [run("r1", summary, passed), run("r2", summary, passed | {"OBS1": 0.0})]


def test_the_worked_example_over_both_runs() -> None:
    """Final ARL score 40, confidence 83.3 %; VAB1 rose because something failed, and is flagged for it."""
    decomposition, runs = worked()
    summary = summary_of(decomposition, runs)
    whole = line(summary, "KA1")
    assert whole["score_mean"] == 40.0
    assert whole["confidence_mean"] == pytest.approx(5 / 6, abs=1e-15)
    assert f"{whole['confidence_mean']:.1%}" == "83.3%"
    assert (whole["runs"], whole["considered"], whole["scored"], whole["design_points"]) == (2, 2, 2, 2)
    assert whole["raised_by_failure"] is True  # 40 where both runs would have had 30
    assert whole["passed_score_mean"] == 30.0
    assert line(summary, "OBS3")["raised_by_failure"] is False
    assert line(summary, "OBS1")["confidence_mean"] == 0.5
    assert line(summary, "OBS1")["method"] == line(summary, "VAB2")["method"] == "clopper-pearson"
    assert (line(summary, "OBS1")["scored"], line(summary, "OBS1")["considered"]) == (1, 2)


def test_absent_observations_are_counted(decomposition: Decomposition) -> None:
    """What the bench did not write is not considered, and is known by number, but for runs of the bench's own fault."""
    summary = hard(decomposition)
    runs = [
        run("a", summary, {"OBS-031": 1.0}),
        run("b", summary, everything(decomposition)),
        run("c", summary, {}, outcome=Outcome.PLACEMENT_INFEASIBLE),
    ]
    assert absent_pairs(decomposition, runs) == len(decomposition.observables) - 1


def test_runs_are_grouped_by_configuration_and_agent(decomposition: Decomposition) -> None:
    """Each agent and configuration has its own line beside `all`; difficulty is one number there and null
    where it differs.
    """
    easy, other = hard(decomposition, 0.5), hard(decomposition, 1.0)
    runs = [
        run("a", easy, everything(decomposition)),
        run("b", other, everything(decomposition)),
        run("c", other, everything(decomposition, 0.0), agent="aware"),
    ]
    summary = summary_of(decomposition, runs)
    assert summary.schema == pl.Schema(SUMMARY_COLUMNS)
    keys = (configuration_of(decomposition, easy), configuration_of(decomposition, other))
    assert summary["configuration"].unique(maintain_order=True).to_list() == ["all", *keys]
    assert summary["agent"].unique(maintain_order=True).to_list() == ["naive", "aware"]
    assert summary.filter(agent="aware", configuration=keys[0]).is_empty()
    assert line(summary, "KA-05", keys[0])["difficulty"] == 55.0
    whole = line(summary, "KA-05")
    assert (whole["difficulty"], whole["difficulty_low"], whole["difficulty_high"]) == (None, 55.0, 80.0)
    assert (whole["runs"], line(summary, "KA-05", keys[1])["runs"]) == (2, 1)
    first = summary.filter(agent="naive", configuration="all")
    assert first["node"].to_list() == list(decomposition.nodes)
    assert first["title"].to_list() == [row.title for row in decomposition.nodes.values()]


def test_what_was_never_considered_has_no_mean(decomposition: Decomposition) -> None:
    """Null means, an interval that says nothing, and a method that says why."""
    xs = everything(decomposition) | {"OBS-181": None, "OBS-182": None}
    summary = summary_of(decomposition, [run("a", hard(decomposition), xs)])
    row = line(summary, "KA-18")
    assert (row["score_mean"], row["confidence_mean"], row["considered"], row["runs"]) == (None, None, 0, 1)
    assert (row["confidence_low"], row["confidence_high"], row["method"]) == (0.0, 1.0, "none considered")
    assert row["raised_by_failure"] is False


def test_nothing_flown_is_an_empty_table(decomposition: Decomposition) -> None:
    """No runs: both frames are empty and have their columns."""
    table = score_table(decomposition, [])
    assert table.is_empty()
    assert table.schema == pl.Schema(SCORE_COLUMNS)
    assert summary_frame(table).schema == pl.Schema(SUMMARY_COLUMNS)


def test_a_realization_counts_once(decomposition: Decomposition) -> None:
    """The same realization twice is a bug upstream, not two runs; a study of strangers is the user's to mend."""
    summary = hard(decomposition)
    with pytest.raises(ValueError, match="'a' appears twice"):
        score_table(decomposition, [run("a", summary, {}), run("a", summary, {})])
    with pytest.raises(SetupError, match="KA-77"):
        score_table(decomposition, [run("a", summary, {})], study=["KA-77"])


def test_ratios_have_an_interval_of_their_own(decomposition: Decomposition) -> None:
    """Where runs achieve some of a node's observables, its interval is that of a mean of ratios: narrower than
    counts give, the same in one design point as in as many as there are runs, wider where replicates agree.
    """
    summary = hard(decomposition)
    names = decomposition.observables_under("KA-03")
    ratios = [i % len(names) for i in range(12)]
    apart = [
        run(f"r{i}", summary, {name: float(rank < ratio) for rank, name in enumerate(names)})
        for i, ratio in enumerate(ratios)
    ]
    shared = [replace(row, design_point=f"p{i % len(names)}", replicate=i) for i, row in enumerate(apart)]
    single = [replace(row, design_point="p", replicate=i) for i, row in enumerate(apart)]
    lines = [line(summary_of(decomposition, runs), "KA-03") for runs in (apart, single, shared)]
    assert {row["method"] for row in lines} == {"gaffke"}
    # No run achieves all of them: the share of runs that pass has an interval of counts, of its own.
    none_low, none_high = clopper_pearson(0, 12)
    assert [(row["passed"], row["passed_low"]) for row in lines] == [(0, none_low)] * 3
    assert [row["passed_high"] for row in lines] == pytest.approx(
        [float(none_high), float(none_high), float(clopper_pearson(0, len(names))[1])]
    )
    ends = [(row["confidence_low"], row["confidence_high"]) for row in lines]
    mean = sum(ratios) / len(names) / 12
    assert lines[0]["confidence_mean"] == pytest.approx(mean)
    squared = sum((ratio / len(names) - mean) ** 2 for ratio in ratios)
    low, high = bounded_mean(mean, 12, 12, squared)
    assert ends[0] == ends[1] == (pytest.approx(float(low)), pytest.approx(float(high)))
    count_low, count_high = clopper_pearson(mean * 12, 12)
    assert count_low < low < mean < high < count_high
    assert ends[2][0] < low < high < ends[2][1]


def test_runs_until_settled_have_intervals_that_allow_for_it(decomposition: Decomposition) -> None:
    """The method says so; intervals are wider than exact ones; competence's bound hears each design point's
    first run alone.
    """
    summary = hard(decomposition)
    fixed = [
        run(
            f"p{point}-r{replicate}",
            summary,
            everything(decomposition),
            design_point=f"p{point}",
            replicate=replicate,
        )
        for point in range(6)
        for replicate in range(1, 5)
    ]
    runs = [replace(row, until_settled=True) for row in fixed]
    fixed_count, looked = (summary_of(decomposition, subset) for subset in (fixed, runs))
    alone = summary_of(decomposition, runs[:4])
    assert line(looked, "OBS-031")["method"] == line(looked, "KA-03")["method"] == "anytime-valid (mean)"
    assert (line(alone, "OBS-031")["method"], line(alone, "KA-03")["method"]) == (
        "anytime-valid (pass rate)",
        "anytime-valid (mean)",
    )
    # All 24 runs pass. A fixed number of them would say more about these six design points; about others, six
    # design points say less.
    all_runs, points = (float(clopper_pearson(count, count)[0]) for count in (24, 6))
    assert line(looked, "KA-03")["confidence_low"] < all_runs
    assert line(fixed_count, "KA-03")["confidence_low"] == pytest.approx(points)
    assert line(looked, "KA-03")["confidence_mean"] == line(fixed_count, "KA-03")["confidence_mean"] == 1.0
    for node in ("OBS-031", "KA-03"):
        assert line(looked, node)["passed_low"] == pytest.approx(float(mean_bounds(24, 24)[0]))
        assert line(alone, node)["passed_low"] == pytest.approx(float(pass_rate_bounds(4, 4)[0]))
        assert line(fixed_count, node)["passed_low"] == pytest.approx(points)

    lows = []
    for bad in (1, 4):
        failed = run("x", summary, everything(decomposition, 0.0)).observations
        subset = [replace(row, observations=failed) if row.replicate == bad else row for row in runs]
        lows.append(line(summary_of(decomposition, subset), "KA-03")["competence_50_low"])
    assert lows == [0.0, line(looked, "KA-03")["competence_50_low"]]
    assert lows[1] != 0.0


HALF, NINE_TENTHS = (1, 2), (9, 10)


def test_the_summary_has_it_for_all_runs_together(decomposition: Decomposition) -> None:
    """One row for each node over all configurations; null in a configuration's own row and where never considered."""
    situations = [hard(decomposition, share) for share in (0.5, 0.75, 1.0)]
    xs: dict[str, float | None] = dict.fromkeys(decomposition.observables, 1.0) | {
        "OBS-181": None,
        "OBS-182": None,
    }
    runs = [run(f"r{i}", situations[i % 3], xs, design_point=f"p{i}") for i in range(36)]
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


def test_the_order_of_rows_and_the_type_of_texts_do_not_matter(decomposition: Decomposition) -> None:
    """A table that was shuffled, or whose texts are categories, has the same summary; a null configuration is
    in `all` alone.
    """
    situations = [hard(decomposition, share) for share in (0.5, 0.75, 1.0)]
    xs = [dict.fromkeys(decomposition.observables, float(i % 4 > 0)) for i in range(24)]
    table = score_table(
        decomposition,
        [run(f"r{i}", situations[i % 3], subset, design_point=f"p{i % 6}") for i, subset in enumerate(xs)],  # type: ignore[arg-type]
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


def test_a_design_point_may_have_several_difficulties(decomposition: Decomposition) -> None:
    """As in a table from elsewhere: each difficulty is a cell of its own, and the numbers are those of
    `competence_of`.
    """
    situations = [hard(decomposition, share) for share in (0.5, 0.75, 1.0)]
    rng = np.random.default_rng(7)
    chosen, ok = [situations[i % 3] for i in range(60)], rng.random(60) < 0.9
    points = [f"p{i // 6}" for i in range(60)]
    runs = [
        run(
            f"r{i}", chosen[i], dict.fromkeys(decomposition.observables, float(ok[i])), design_point=points[i]
        )
        for i in range(60)
    ]
    row = line(summary_of(decomposition, runs), "KA-05")
    for name, share in (("competence_50", HALF), ("competence_90", NINE_TENTHS)):
        alone = competence_of([rated(difficulty, "KA-05") for difficulty in chosen], ok, points, share)
        assert (row[name], row[f"{name}_low"], row[f"{name}_at_least"]) == alone
    assert row["competence_50_low"] > 0


@pytest.fixture
def worked_graph() -> Decomposition:
    """The graph of the paper's scoring example."""
    return worked_decomposition()


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (1.0, {"OBS1": (30, 1, 1), "OBS2": (80, 1, 1), "VAB1": (30, 2, 2), "VAB2": (50, 1, 1), "KA1": (30, 3, 3)}),
        (0.0, {"OBS1": (None, 0, 1), "OBS2": (80, 1, 1), "VAB1": (80, 1, 2), "VAB2": (50, 1, 1), "KA1": (50, 2, 3)}),
    ],
)  # fmt: skip
def test_the_worked_example_to_the_digit(
    worked_graph: Decomposition, x: float, expected: dict[str, tuple[int | None, int, int]]
) -> None:
    """Both runs, OBS1 failing in the second: score, and how many observables are achieved of those considered."""
    scores = score_run(worked_graph, WORKED, observed({"OBS1": x, "OBS2": 1.0, "OBS3": 1.0}))
    for node, (score, achieved, considered) in expected.items():
        assert (scores[node].score, scores[node].achieved, scores[node].considered) == (
            score,
            achieved,
            considered,
        )
        assert scores[node].confidence == achieved / considered


@pytest.mark.parametrize(
    ("x", "tau", "near_miss", "score", "achieved"),
    [
        (0.5, 0.5, None, 40.0, 1),  # x >= tau exactly
        (0.9, 0.5, None, 40.0 + 4 * (0.9 - 0.5), 1),
        (0.4999999999999999, 0.5, None, None, 0),  # no slack at the threshold
        (0.45, 0.5, 0.1, 40.0 + 4 * (0.45 - 0.5), 0),  # scores below d; its confidence stays 0
        (0.39, 0.5, 0.1, None, 0),
        (0.7, 0.8, 0.1, 40.0 + 4 * (0.7 - 0.8), 0),  # 0.8 - 0.1 is a hair above 0.7: the slack of 1e-12
    ],
)
def test_credit_and_near_misses(
    x: float, tau: float, near_miss: float | None, score: float | None, achieved: int
) -> None:
    """d + 4 (x - tau) with partial credit; near misses only where asked for."""
    decomposition = made_decomposition(
        [leaf("O", threshold=tau, partial_credit=True, near_miss=near_miss)], {"V": ["O"]}, {"KA": ["V"]}, given=True
    )  # fmt: skip
    scores = score_run(decomposition, {"O": 40.0}, observed({"O": x}))
    assert scores["O"].score == scores["KA"].score == score
    assert scores["O"].achieved == scores["O"].confidence == achieved


def test_what_cannot_be_scored_is_refused(worked_graph: Decomposition) -> None:
    """Unknown and repeated observables, considered ones without a value, and missing difficulties are bugs upstream."""
    with pytest.raises(ValueError, match="OBS9"):
        score_run(worked_graph, WORKED, observed({"OBS9": 1.0}))
    with pytest.raises(ValueError, match="two observations of OBS1"):
        score_run(worked_graph, WORKED, observed({"OBS1": 1.0}) * 2)
    with pytest.raises(ValueError, match="has no value"):
        score_run(worked_graph, WORKED, [Observation(observable="OBS1", considered=True)])
    with pytest.raises(ValueError, match="no difficulty of OBS3"):
        score_run(worked_graph, {"OBS1": 30.0, "OBS2": 80.0}, ())
