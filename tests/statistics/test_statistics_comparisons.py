# mypy: disable-error-code="call-overload, index, operator"
# Pairs of the reference hold a place and two booleans, whose common type is object.
"""Two agents on the same scenes: sizes, tests, divergence and power against published tables and made truths."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from known_values import known
from scipy import stats
from scipy.spatial.distance import jensenshannon

from bench.scoring import EXCLUDED_OUTCOMES, SCORE_COLUMNS
from bench.statistics import (
    NodeComparison,
    compare_nodes,
    mcnemar_power,
    pairs_for_difference,
    runs_for_half_width,
)
from bench.statistics._divergence import (
    NodeOutcome,
    _outcome_class,
    _shuffled_pairs,
    distributions,
    divergence,
    js_divergence,
)
from bench.statistics._effect_sizes import PairedCounts


def test_a_published_paired_table_comes_out() -> None:
    """Fagerland, Lydersen and Laake (2014), airway hyper-responsiveness: Tango -0.517 to -0.026, exact McNemar 0.070."""
    counts = PairedCounts(both=1, only_first=7, only_second=1, neither=12)
    result = known(counts.difference())
    assert (result.estimate, result.low, result.high) == pytest.approx((-6 / 21, -0.517, -0.026), abs=5e-4)
    assert counts.mcnemar_p == pytest.approx(0.0703, abs=1e-4)


@pytest.mark.parametrize(
    "counts", [(24, 0, 0, 0), (0, 0, 10, 0), (0, 10, 0, 0), (0, 0, 0, 7), (3, 4, 4, 3), (0, 1, 0, 0)]
)
def test_intervals_of_extreme_tables_are_intervals(counts: tuple[int, int, int, int]) -> None:
    """The estimate lies inside, nothing leaves [-1, 1], and exchanging the agents mirrors it."""
    both, first, second, neither = counts
    result = PairedCounts(both, first, second, neither).difference()
    other = PairedCounts(both, second, first, neither).difference()
    assert result is not None
    assert other is not None
    assert -1.0 <= result.low <= result.estimate <= result.high <= 1.0
    assert result.low < result.high
    assert (other.low, other.high) == pytest.approx((-result.high, -result.low), abs=1e-9)


def test_no_differing_pair_still_leaves_doubt() -> None:
    """24 scenes alike: the interval is Tango's z2 / (n + z2) on either side, and there is no test."""
    counts = PairedCounts(24, 0, 0, 0)
    result = known(counts.difference())
    assert result.high == pytest.approx(1.959964**2 / (24 + 1.959964**2), rel=1e-5)
    assert counts.mcnemar_p is None
    assert PairedCounts(0, 0, 0, 0).difference() is None


def test_tangos_interval_covers() -> None:
    """Over every outcome of 30 pairs, exactly: at least 93.5 % of them are covered."""
    for first, second in ((0.1, 0.1), (0.05, 0.3), (0.4, 0.1), (0.02, 0.02)):
        covered = 0.0
        for b in range(31):
            for c in range(31 - b):
                result = known(PairedCounts(30 - b - c, c, b, 0).difference())
                if result.low <= second - first <= result.high:
                    covered += float(
                        stats.multinomial.pmf([c, b, 30 - b - c], 30, [first, second, 1 - first - second])
                    )
        assert covered > 0.935


@pytest.mark.parametrize("shuffles", [1, 200, 201, 650])
def test_as_many_shuffles_are_drawn_as_are_asked_for(shuffles: int) -> None:
    """Each swaps some pairs: the first rows summed, with either row of each pair."""
    first, second = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([[0.0, 1.0], [0.0, 1.0]])
    sums = _shuffled_pairs(first, second, np.random.default_rng(1), shuffles)
    assert sums.shape == (shuffles, 2)
    assert {tuple(row) for row in sums} <= {(1.0, 1.0), (0.0, 2.0)}


def test_divergence_is_scipys_squared_distance_in_bits() -> None:
    """0 for the same, 1 for what has nothing in common."""
    p, q = np.array([3.0, 5.0, 0.0, 2.0]), np.array([1.0, 1.0, 4.0, 4.0])
    assert js_divergence(p, q) == pytest.approx(jensenshannon(p, q, 2) ** 2)
    assert js_divergence(p, 2 * p) == pytest.approx(0.0)
    assert js_divergence(np.array([1.0, 0.0]), np.array([0.0, 7.0])) == pytest.approx(1.0)


def test_runs_fall_into_the_tensions_bands() -> None:
    """A band ends where a tension does; failed and not considered are classes of their own."""
    ended = [
        NodeOutcome(None, False),
        NodeOutcome(None, True),
        *(NodeOutcome(s, True) for s in (-1.0, 0.0, 20.0, 20.1, 40.0, 99.0, 100.0, 100.2)),
    ]
    assert [_outcome_class(outcome, 20.0) for outcome in ended] == [0, 1, 3, 3, 3, 4, 4, 7, 7, 8]


@pytest.mark.parametrize("paired", [True, False])
def test_permutation_is_fair_and_sees_what_is_there(paired: bool) -> None:
    """With the same agent twice p is spread evenly; with an agent that fails half its runs it is small.

    The seed decides alone.
    """

    def runs(draw: np.random.Generator, failing: float) -> list[NodeOutcome]:
        return [
            NodeOutcome(None if draw.random() < failing else float(draw.uniform(20, 70)), True)
            for _ in range(25)
        ]

    same: list[float] = []
    other: list[float] = []
    for seed in range(60):
        draw = np.random.default_rng(seed)
        first = runs(draw, 0.1)
        for result, failing in ((same, 0.1), (other, 0.6)):
            found = known(divergence(first, runs(draw, failing), paired=paired, seed=seed, shuffles=199))
            assert 0.0 <= found.value <= 1.0
            result.append(found.p)
    assert np.mean(np.array(same) < 0.05) < 0.1
    assert 0.4 < np.mean(same) < 0.65
    assert np.mean(np.array(other) < 0.05) > 0.8
    reversed_pairs = divergence(first, first[::-1], paired=paired, seed=4)
    assert reversed_pairs == divergence(first, first[::-1], paired=paired, seed=4)


def test_a_shuffle_keeps_replicates_together() -> None:
    """Replicates that are copies of each other: with clusters p is spread evenly, and small for another agent; run by
    run the same agent would be found different.
    """

    def side(draw: np.random.Generator, failing: float) -> tuple[list[NodeOutcome], list[str]]:
        of_points = [NodeOutcome(None if draw.random() < failing else 30.0, True) for _ in range(12)]
        return [outcome for outcome in of_points for _ in range(4)], [f"p{k // 4}" for k in range(48)]

    p: dict[str, list[float]] = {"same": [], "other": [], "run by run": []}
    for seed in range(60):
        draw = np.random.default_rng(seed)
        first, first_points = side(draw, 0.4)
        for kind, failing in (("same", 0.4), ("other", 1.0), ("run by run", 0.4)):
            second, second_points = side(draw, failing)
            clusters = None if kind == "run by run" else (first_points, second_points)
            result = divergence(first, second, paired=False, clusters=clusters, seed=seed, shuffles=199)
            assert result is not None
            assert (result.first, result.second) == (48, 48)
            p[kind].append(result.p)
    rejected = {kind: np.mean(np.array(values) < 0.05) for kind, values in p.items()}
    assert rejected["same"] < 0.1
    assert rejected["other"] > 0.8
    assert rejected["run by run"] > 0.2


def test_distributions_count_what_the_divergence_compares() -> None:
    """Both sides by class in the order of the scale; the band is that of the smaller side."""
    first = [
        NodeOutcome(None, False),
        NodeOutcome(None, True),
        NodeOutcome(20.0, True),
        NodeOutcome(20.1, True),
    ]
    second = [NodeOutcome(104.0, True), NodeOutcome(100.0, True), NodeOutcome(-1.0, True)] * 20
    assert distributions(first, second) == {
        "not considered": (1, 0),
        "failed": (1, 0),
        "score up to 20": (1, 20),
        "score above 20 to 40": (1, 0),
        "score above 80 to 100": (0, 20),
        "score above 100": (0, 20),
    }
    assert distributions(second, second[:50])["score above 90 to 100"] == (20, 17)


@pytest.mark.parametrize(("runs", "band", "value"), [(49, 20.0, 0.0), (50, 10.0, 0.0), (200, 5.0, 1.0)])
def test_bands_grow_finer_with_runs(runs: int, band: float, value: float) -> None:
    first, second = ([NodeOutcome(score, True)] * runs for score in (1.0, 9.0))
    result = known(divergence(first, second, paired=True, shuffles=10))
    assert (result.band, result.value) == (band, value)
    assert divergence([], second, paired=False) is None


def test_power_is_what_simulation_gives() -> None:
    """The share of simulated experiments in which McNemar's exact test rejects."""
    draw = np.random.default_rng(0)
    tables = draw.multinomial(60, [0.05, 0.25, 0.7], size=4000)
    kinds, times = np.unique(tables, axis=0, return_counts=True)
    p = [PairedCounts(both, first, second, 0).mcnemar_p for first, second, both in kinds]
    simulated = times[[value is not None and value <= 0.05 for value in p]].sum() / 4000
    assert mcnemar_power(60, 0.05, 0.25) == pytest.approx(simulated, abs=0.02)
    assert mcnemar_power(60, 0.25, 0.05) == pytest.approx(mcnemar_power(60, 0.05, 0.25))


def test_the_number_of_pairs_has_its_power_and_no_more_than_needed() -> None:
    """The edge of 80 %; a harder question needs more; no difference is never found."""
    needed = known(pairs_for_difference(0.05, 0.25))
    assert mcnemar_power(needed, 0.05, 0.25) >= 0.8 > mcnemar_power(needed - 1, 0.05, 0.25)
    stricter, smaller = pairs_for_difference(0.05, 0.25, alpha=0.01), pairs_for_difference(0.05, 0.15)
    assert stricter is not None
    assert smaller is not None
    assert needed < stricter
    assert needed < smaller
    assert pairs_for_difference(0.1, 0.1) is None
    assert pairs_for_difference(0.0, 1.0) == 6  # 2 / 2**6 is the first below 0.05
    with pytest.raises(ValueError, match="not shares"):
        pairs_for_difference(0.7, 0.7)


def test_runs_for_a_width() -> None:
    """0.1 around a half takes 104 (exact binomial tables)."""
    assert runs_for_half_width(0.5, 0.1) == 104
    assert runs_for_half_width(1.0, 0.05) == 36


def scores(passes: list[bool], node: str = "KA-18", *, per_point: int = 1) -> pl.DataFrame:
    """A score table of one agent and node."""
    of_all: dict[str, object] = {
        "agent": "a",
        "configuration": "",
        "node": node,
        "level": "ka",
        "difficulty": 50.0,
    }
    of_all |= {"considered": 1, "x": None, "outcome": "completed", "passed_score": 50.0}
    rows = [
        {
            **of_all,
            "realization": f"r{run}",
            "design_point": f"p{run // per_point}",
            "replicate": run % per_point + 1,
            "score": 52.0 if won else None,
            "confidence": float(won),
            "achieved": int(won),
        }
        for run, won in enumerate(passes)
    ]
    return pl.DataFrame(rows, schema=SCORE_COLUMNS)


def compared(first: list[bool], second: list[bool], per_point: int = 1) -> NodeComparison:
    """The one comparison of two agents at one node."""
    (result,) = compare_nodes(
        scores(first, per_point=per_point),
        scores(second, per_point=per_point),
        ["KA-18"],
        excluded_outcomes=EXCLUDED_OUTCOMES,
    )
    return result


@pytest.mark.parametrize(
    ("first", "second", "rates", "verdict"),
    [
        (0, 12, None, "B passes KA-18 in 100 more of 100 scenes; 12 pairs; settled"),
        # Three scenes are a hint: the number of pairs is that of the rates seen.
        (
            3,
            0,
            (3 / 12, 0.0),
            "A passes KA-18 in 25 more of 100 scenes; 12 pairs; not settled: about {} pairs would",
        ),
        (
            0,
            3,
            (3 / 12, 0.0),
            "B passes KA-18 in 25 more of 100 scenes; 12 pairs; not settled: about {} pairs would",
        ),
        # Nothing told them apart; that is no proof that nothing could.
        (12, 12, (0.0, 0.1), "not settled: about {} pairs would show one of 10 in 100"),
    ],
)
def test_a_verdict_is_settled_or_says_what_would_settle_it(
    first: int, second: int, rates: tuple[float, float] | None, verdict: str
) -> None:
    """Of twelve scenes, so many are passed by each agent."""
    result = compared([number < first for number in range(12)], [number < second for number in range(12)])
    assert result.settled is (rates is None)
    assert result.pairs_needed == (rates and pairs_for_difference(*rates))
    assert result.verdict("A", "B").endswith(verdict.format(result.pairs_needed))
    assert result.mcnemar_p == (None if first == second else pytest.approx(2 / 2 ** max(first, second)))
    assert known(result.divergence).value == pytest.approx(1.0) or not result.settled


def test_replicates_that_agree_settle_less() -> None:
    """Ten scenes of two design points are not ten independent scenes."""
    apart, shared = compared([False] * 10, [True] * 10), compared([False] * 10, [True] * 10, per_point=5)
    assert apart.clustered_p is None
    assert apart.settled
    assert shared.points == 2
    assert shared.clustered_p == pytest.approx(stats.chi2.sf(100 / 50, 1))
    assert not shared.settled


@pytest.mark.parametrize("seed", range(6))
def test_two_nodes_over_unequal_design_points_are_those_of_the_reference(seed: int) -> None:
    """Two nodes, design points of one to five runs, runs that one side never considered or that the bench spoilt."""
    rng = np.random.default_rng(seed)
    places = [
        (f"p{point}", replicate) for point, size in enumerate((5, 1, 3, 2)) for replicate in range(size)
    ]
    nodes = ["KA-03", "KA-18"]
    tables, results = [], []
    for _ in range(2):
        confidence = {
            (node, place): (None, 0.0, 0.5, 1.0)[rng.integers(4)] for node in nodes for place in places
        }
        spoilt = {place for place in places if rng.random() < 0.15}
        tables.append(
            pl.concat([scores([True] * len(places), node) for node in nodes]).with_columns(
                pl.Series("design_point", [point for point, _ in places] * 2),
                pl.Series("replicate", [replicate for _, replicate in places] * 2),
                pl.Series(
                    "confidence",
                    [confidence[node, place] for node in nodes for place in places],
                    dtype=pl.Float64,
                ),
                pl.Series(
                    "outcome", ["bench_error" if place in spoilt else "completed" for place in places] * 2
                ),
            )
        )
        results.append(
            {key: value for key, value in confidence.items() if key[1] not in spoilt and value is not None}
        )
    p_values = []
    comparisons = compare_nodes(tables[0], tables[1], nodes, excluded_outcomes=EXCLUDED_OUTCOMES)
    for node, comparison in zip(nodes, comparisons, strict=True):
        pairs = [
            (place, *(side[node, place] == 1.0 for side in results))
            for place in places
            if all((node, place) in side for side in results)
        ]
        gains = [int(second) - int(first) for _, first, second in pairs]
        lost, won = gains.count(-1), gains.count(1)
        assert (comparison.counts.pairs, comparison.counts.only_first, comparison.counts.only_second) == (
            len(pairs),
            lost,
            won,
        )
        points = sorted({place[0] for place, *_ in pairs})
        surplus = [
            sum(gain for (place, *_), gain in zip(pairs, gains, strict=True) if place[0] == point)
            for point in points
        ]
        assert comparison.points == len(points)
        mcnemar = stats.binomtest(lost, lost + won).pvalue if lost + won else None
        assert comparison.mcnemar_p == (None if mcnemar is None else pytest.approx(mcnemar))
        clustered = None
        if len(points) < len(pairs) and lost + won:
            spread = sum(value**2 for value in surplus)
            clustered = stats.chi2.sf(sum(surplus) ** 2 / spread, 1) if spread else 1.0
        assert comparison.clustered_p == (None if clustered is None else pytest.approx(clustered))
        p_values.append(max((p for p in (mcnemar, clustered) if p is not None), default=None))
    numbers = sorted(p for p in p_values if p is not None)
    for p, comparison in zip(p_values, comparisons, strict=True):
        if p is None:
            assert (comparison.p_adjusted, comparison.settled) == (None, False)
        else:
            assert comparison.p_adjusted == pytest.approx(
                min(
                    1.0, *(value * len(numbers) / rank for rank, value in enumerate(numbers, 1) if value >= p)
                )
            )
            assert comparison.settled == (comparison.p_adjusted < 0.05)
    (empty,) = compare_nodes(tables[0], tables[1], ["KA-99"], excluded_outcomes=EXCLUDED_OUTCOMES)
    assert empty.verdict("A", "B").startswith("nothing to compare")
