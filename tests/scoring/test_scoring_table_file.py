"""Score tables made batch by batch: the same file as one made at once, and nothing kept of the runs but their rows."""

from __future__ import annotations

import io
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from polars import selectors as cs

from bench.contracts import Evidence, Observation, Outcome
from bench.scoring import (
    SCORE_COLUMNS,
    ScoredRun,
    ScoreTableWriter,
    read_score_table,
    score_table,
    stated_difficulty,
    summary_frame,
)
from decompositions import Decomposition, Policies, decomposition_of, load_decomposition


@pytest.fixture(scope="module")
def decomposition() -> Decomposition:
    return load_decomposition("search-and-report")


def drawn_runs(decomposition: Decomposition, count: int) -> Iterator[ScoredRun]:
    """Runs of two agents at two difficulties: some observables are not considered, and some runs do not count."""
    situations = [
        stated_difficulty(
            decomposition,
            {name: (number * step) % 97 + 0.1 for number, name in enumerate(decomposition.observables)},
        )
        for step in (7, 11)
    ]
    rng = np.random.default_rng(8)
    for number in range(count):
        xs = rng.random(len(decomposition.observables))
        observations = tuple(
            Observation(
                observable=observable,
                considered=x > 0.2,
                x=x if x > 0.2 else None,
                evidence=(Evidence(time_s=float(number), text=f"draw {x:.9f}"),),
            )
            for observable, x in zip(decomposition.observables, xs.tolist(), strict=True)
        )
        outcome = Outcome.WORKER_LOST if number % 7 == 3 else Outcome.COMPLETED
        yield ScoredRun(
            realization=f"p{number % 2 + 1:03d}-r{number // 2 + 1}-{'ab'[number % 2]}",
            design_point=f"p{number % 2 + 1:03d}",
            replicate=number // 2 + 1,
            agent="ab"[number % 2],
            outcome=outcome,
            difficulty=situations[number % 2],
            observations=observations,
        )


def whole(decomposition: Decomposition, runs: list[ScoredRun]) -> bytes:
    buffer = io.BytesIO()
    score_table(decomposition, runs).write_parquet(buffer)
    return buffer.getvalue()


@pytest.mark.parametrize("policy", ["minimum", "mean"])
def test_batches_make_the_file_of_the_whole_table(policy: str) -> None:
    """Batches of one run too: numpy adds up the single column of one run in another order, and here a node has 21
    children.
    """
    document = load_decomposition("search-and-report-full").document
    policies = Policies.model_validate({"inner_score": policy})
    scored_by = decomposition_of(document.model_copy(update={"policies": policies}))
    runs = list(drawn_runs(scored_by, 31))
    expected = whole(scored_by, runs)
    for at_once in (1, 2, 30, 31, 500):
        writer = ScoreTableWriter(scored_by, at_once=at_once)
        for run in runs:
            writer.add(run)
        assert writer.content() == expected, at_once


def test_a_table_of_several_groups_of_rows_has_the_same_bytes(decomposition: Decomposition) -> None:
    """More rows than Polars puts into one group of a file."""
    template = list(drawn_runs(decomposition, 2))
    runs = [
        ScoredRun(f"r{number}", "p001", number, "a", run.outcome, run.difficulty, run.observations)
        for number in range(5000)
        for run in [template[number % 2]]
    ]
    writer = ScoreTableWriter(decomposition)
    for run in runs:
        writer.add(run)
    assert len(runs) * len(decomposition.nodes) > 150_000
    assert writer.content() == whole(decomposition, runs)


def test_a_table_read_back_is_the_same_with_categories(decomposition: Decomposition, tmp_path: Path) -> None:
    """From a file and from its content, also of a table without rows; a summary is the same for both."""
    runs = list(drawn_runs(decomposition, 12))
    for count in (0, 12):
        writer = ScoreTableWriter(decomposition)
        for run in runs[:count]:
            writer.add(run)
        (tmp_path / "scores.parquet").write_bytes(writer.content())
        table = score_table(decomposition, runs[:count])
        for source in (tmp_path / "scores.parquet", writer.content()):
            read = read_score_table(source)
            assert read.with_columns(cs.categorical().cast(pl.String)).equals(table)
            summary = summary_frame(table, decomposition)
            assert summary_frame(read, decomposition).equals(summary)
            assert summary_frame(read).drop("title").equals(summary.drop("title"))
        assert [name for name, dtype in read.schema.items() if dtype == pl.Categorical] == [
            name for name, dtype in SCORE_COLUMNS.items() if dtype == pl.String
        ]


def test_a_realization_cannot_come_twice(decomposition: Decomposition) -> None:
    """Also not in another batch."""
    first, second = drawn_runs(decomposition, 2)
    writer = ScoreTableWriter(decomposition, at_once=1)
    writer.add(first)
    writer.add(second)
    with pytest.raises(ValueError, match="appears twice"):
        writer.add(first)


def test_what_is_kept_of_a_run_is_small(decomposition: Decomposition) -> None:
    """Its observations, with their evidence, take more than ten times as much."""

    def kept(count: int) -> int:
        writer = ScoreTableWriter(decomposition, at_once=50)
        tracemalloc.start()
        try:
            for run in drawn_runs(decomposition, count):
                writer.add(run)
            return tracemalloc.get_traced_memory()[0]
        finally:
            tracemalloc.stop()

    kept(100)
    assert (kept(400) - kept(200)) / 200 < 1000
