"""The score table and its summary: means and counts as published, intervals, and bulk."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from made_decompositions import WORKED, factor_row, leaf, observed, worked_decomposition

from bench.contracts import Outcome
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
    effective_size,
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
) -> dict[str, object]:
    rows = summary.filter(node=node, configuration=configuration, agent=agent)
    assert rows.height == 1
    return rows.row(0, named=True)


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
    table = score_table(decomposition, runs)
    summary = summary_frame(table, decomposition)
    whole = line(summary, "KA1")
    assert whole["score_mean"] == 40.0
    assert whole["confidence_mean"] == pytest.approx(5 / 6, abs=1e-15)
    assert f"{whole['confidence_mean']:.1%}" == "83.3%"
    assert (whole["runs"], whole["considered"], whole["scored"], whole["design_points"]) == (2, 2, 2, 2)
    assert whole["raised_by_failure"] is True  # 40 where both runs would have had 30
    assert whole["passed_score_mean"] == 30.0
    assert line(summary, "OBS3")["raised_by_failure"] is False
    assert line(summary, "OBS1")["confidence_mean"] == 0.5
    assert (line(summary, "OBS1")["scored"], line(summary, "OBS1")["considered"]) == (1, 2)


def test_a_table_holds_what_each_run_scored(decomposition: Decomposition) -> None:
    """Every row of the table equals the run scored alone, with null for what there is not; x stands at observables."""
    summary = hard(decomposition)
    xs = everything(decomposition) | {"OBS-181": 0.0, "OBS-182": None, "OBS-031": 0.75}
    table = score_table(decomposition, [run("a", summary, everything(decomposition)), run("b", summary, xs)])
    assert table.schema == pl.Schema(SCORE_COLUMNS)
    assert table.height == 2 * len(decomposition.nodes)
    alone = score_run(decomposition, summary, run("b", summary, xs).observations)
    for row in table.filter(realization="b").iter_rows(named=True):
        expected = alone[row["node"]]
        assert (row["score"], row["confidence"]) == (expected.score, expected.confidence)
        assert (row["achieved"], row["considered"]) == (expected.achieved, expected.considered)
        assert row["difficulty"] == summary.of(row["node"])
        assert row["x"] == xs.get(row["node"])
        assert row["configuration"] == configuration_of(decomposition, summary)
    assert not any(
        table[name].is_nan().any() for name in ("score", "confidence", "x", "difficulty", "passed_score")
    )


def test_faults_of_the_bench_are_shown_and_not_counted(decomposition: Decomposition) -> None:
    """A run lost by the bench is a row and an `excluded`, never a failure of the agent; a crash of the agent counts."""
    summary = hard(decomposition)
    runs = [
        run("a", summary, everything(decomposition)),
        run("b", summary, everything(decomposition, 0.0), outcome=Outcome.BENCH_ERROR),
        run("c", summary, everything(decomposition, 0.0), outcome=Outcome.AGENT_CRASHED),
        run("d", summary, {}, outcome=Outcome.PLACEMENT_INFEASIBLE),
    ]
    table = score_table(decomposition, runs)
    assert table["realization"].n_unique() == 4
    whole = line(summary_frame(table, decomposition), "KA-20")
    assert (whole["runs"], whole["excluded"], whole["considered"], whole["scored"]) == (2, 2, 2, 1)
    assert whole["confidence_mean"] == 0.5
    assert absent_pairs(decomposition, runs) == 0


def test_absent_observations_are_counted(decomposition: Decomposition) -> None:
    """What the bench did not write is not considered, and is known by number."""
    summary = hard(decomposition)
    runs = [run("a", summary, {"OBS-031": 1.0}), run("b", summary, everything(decomposition))]
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
    summary = summary_frame(score_table(decomposition, runs), decomposition)
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
    table = hard(decomposition)
    summary = summary_frame(
        score_table(
            decomposition, [run("a", table, everything(decomposition) | {"OBS-181": None, "OBS-182": None})]
        ),
        decomposition,
    )
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


def test_a_table_survives_parquet(decomposition: Decomposition) -> None:
    """What a campaign writes to disk and reads back is the same table, and sums up the same without the decomposition."""
    from io import BytesIO

    table = score_table(
        decomposition,
        [
            run("a", hard(decomposition), everything(decomposition)),
            run("b", hard(decomposition, 1.0), everything(decomposition, 0.2)),
        ],
    )
    file = BytesIO()
    table.write_parquet(file)
    file.seek(0)
    reread = pl.read_parquet(file)
    assert reread.equals(table)
    assert summary_frame(reread).drop("title").equals(summary_frame(table, decomposition).drop("title"))


def test_runs_that_hang_together_are_worth_fewer() -> None:
    """Replicates that agree within their design point count about as one each; independent ones nearly all."""
    alike = effective_size(
        0.5, 30, 10, 10 * 1.5**2
    )  # ten points of three equal runs, half of them all passes
    apart = effective_size(0.5, 30, 30, 30 * 0.25)
    assert 5.0 < alike < 10.0
    assert apart == pytest.approx(30.0)
    assert effective_size(1.0, 30, 10, 0.0) == 10.0  # no variance to see: replicates may be copies
    assert effective_size(0.5, 30, 1, 9.0) == 30.0  # one situation, whose replicates are independent


def test_the_interval_knows_about_design_points(decomposition: Decomposition) -> None:
    """The same passes give a wider interval where replicates of one design point agree, and the column says
    which it is.
    """
    summary = hard(decomposition)
    passed = [everything(decomposition, 1.0 if i < 6 else 0.0) for i in range(12)]
    apart = [run(f"r{i}", summary, xs) for i, xs in enumerate(passed)]
    shared = [replace(row, design_point=f"p{i // 3}") for i, row in enumerate(apart)]
    single = line(summary_frame(score_table(decomposition, apart), decomposition), "OBS-031")
    clustered = line(summary_frame(score_table(decomposition, shared), decomposition), "OBS-031")
    inner = line(summary_frame(score_table(decomposition, apart), decomposition), "KA-03")
    assert (single["method"], clustered["method"], inner["method"]) == (
        "clopper-pearson",
        "korn-graubard",
        "clopper-pearson",  # in each run all of its observables pass, or none: a count of runs
    )
    assert single["confidence_low"] == pytest.approx(float(clopper_pearson(6, 12)[0]))
    assert (
        clustered["confidence_low"]  # type: ignore[operator]
        < single["confidence_low"]
        < 0.5
        < single["confidence_high"]  # type: ignore[operator]
        < clustered["confidence_high"]
    )


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
    lines = [
        line(summary_frame(score_table(decomposition, runs), decomposition), "KA-03")
        for runs in (apart, single, shared)
    ]
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
    assert ends[2][0] < low < high < ends[2][1]  # type: ignore[operator]


def test_three_hundred_runs_take_well_under_a_second(decomposition: Decomposition) -> None:
    """Scoring and summing a campaign is nothing beside flying it (CPU time; measured 0.04 s)."""
    rng = np.random.default_rng(4)
    situations = [hard(decomposition, c, d) for c in (0.5, 1.0) for d in (313.3, 390.1, 453.3)]
    runs = [
        run(
            f"r{i}",
            situations[i % 6],
            dict(zip(decomposition.observables, map(float, rng.random(14)), strict=True)),
        )
        for i in range(300)
    ]
    began = time.process_time()
    summary_frame(score_table(decomposition, runs), decomposition)
    assert time.process_time() - began < 1.0


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
    fixed_count, looked = (
        summary_frame(score_table(decomposition, subset), decomposition) for subset in (fixed, runs)
    )
    alone = summary_frame(score_table(decomposition, runs[:4]), decomposition)
    assert line(looked, "OBS-031")["method"] == line(looked, "KA-03")["method"] == "anytime-valid (mean)"
    assert (line(alone, "OBS-031")["method"], line(alone, "KA-03")["method"]) == (
        "anytime-valid (pass rate)",
        "anytime-valid (mean)",
    )
    # All 24 runs pass. A fixed number of them would say more about these six design points; about others, six
    # design points say less.
    all_runs, points = (float(clopper_pearson(count, count)[0]) for count in (24, 6))
    assert line(looked, "KA-03")["confidence_low"] < all_runs  # type: ignore[operator]
    assert line(fixed_count, "KA-03")["confidence_low"] == pytest.approx(points)
    assert line(looked, "KA-03")["confidence_mean"] == line(fixed_count, "KA-03")["confidence_mean"] == 1.0
    for node in ("OBS-031", "KA-03"):
        assert line(looked, node)["passed_low"] == pytest.approx(float(mean_bounds(24, 24)[0]))
        assert line(alone, node)["passed_low"] == pytest.approx(float(pass_rate_bounds(4, 4)[0]))
        assert line(fixed_count, node)["passed_low"] == pytest.approx(points)

    bad_first = [
        replace(row, observations=run("x", summary, everything(decomposition, 0.0)).observations)
        if row.replicate == 1
        else row
        for row in runs
    ]
    bad_last = [
        replace(row, observations=run("x", summary, everything(decomposition, 0.0)).observations)
        if row.replicate == 4
        else row
        for row in runs
    ]
    lows = [
        line(summary_frame(score_table(decomposition, subset), decomposition), "KA-03")["competence_50_low"]
        for subset in (bad_first, bad_last)
    ]
    assert lows == [0.0, line(looked, "KA-03")["competence_50_low"]]
    assert lows[1] != 0.0
