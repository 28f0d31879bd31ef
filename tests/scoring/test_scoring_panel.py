"""What a panel of agents shows: against numpy and scipy on random input, and on tables made by hand."""

from __future__ import annotations

from itertools import product

import numpy as np
import polars as pl
import pytest
from scipy import stats

from bench.scoring import Panel, PanelNode, panel_of
from bench.scoring._panel import (
    LEAST_SEPARATING_KEY_ATTRIBUTES,
    LEAST_SESSIONS,
    _bounds,
    pairwise_correlations,
    participation_ratio,
)

AGENTS = ("good", "poor")
NULLS = ("null-a", "oracle")

Row = dict[str, object]


def score_row(agent: str, point: str, replicate: int, node: str, x: float | None) -> Row:
    """A row of a score table; nodes named K are key attributes, P principles, the others observables with threshold 0.5."""
    level = {"K": "ka", "P": "principle"}.get(node[0], "observable")
    return {
        "realization": f"{point}-r{replicate}-{agent}",
        "design_point": point,
        "replicate": replicate,
        "agent": agent,
        "node": node,
        "level": level,
        "confidence": x if level != "observable" or x is None else float(x >= 0.5),
        "achieved": int(x is not None and x >= 0.5),
        "x": x if level == "observable" else None,
        "outcome": "completed",
        "standing": "counted" if level == "observable" else None,
        "verdict": None,
    }


def score_frame(rows: list[Row]) -> pl.DataFrame:
    types = {"confidence": pl.Float64, "x": pl.Float64, "standing": pl.String, "verdict": pl.Boolean}
    return pl.DataFrame(rows, schema_overrides=types, infer_schema_length=None)


def panel_from(
    rows: list[Row], floor: list[Row] | None = None, order: tuple[str, str] | None = None
) -> Panel:
    tested = score_frame(rows)
    return panel_of(
        tested, score_frame(floor) if floor else tested.clear(), "oracle" if floor else None, order
    )


def panel_of_observables(columns: dict[str, list[float | None]]) -> Panel:
    """A panel in which one agent flies a session for each value of these columns."""
    return panel_from(
        [score_row("good", f"p{n}", 0, node, x) for node, xs in columns.items() for n, x in enumerate(xs)]
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_participation_ratio_is_that_of_the_eigenvalues(seed: int) -> None:
    rng = np.random.default_rng(seed)
    correlations = pairwise_correlations(rng.normal(size=(30, 4)) @ rng.normal(size=(4, 7)))
    eigenvalues = np.linalg.eigvalsh(correlations)
    ratio = eigenvalues.sum() ** 2 / (eigenvalues**2).sum()
    assert participation_ratio(correlations) == pytest.approx(ratio)


@pytest.mark.parametrize("seed", range(5))
def test_correlations_are_over_the_common_sessions_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(40, 6)) @ rng.normal(size=(6, 6)) + 100.0
    x[rng.random(x.shape) < 0.5] = np.nan

    correlations = pairwise_correlations(x)

    for first, second in product(range(6), repeat=2):
        common = ~np.isnan(x[:, first]) & ~np.isnan(x[:, second])
        expected = np.corrcoef(x[common, first], x[common, second])[0, 1]
        if first != second and common.sum() < LEAST_SESSIONS:
            expected = np.nan
        assert correlations[first, second] == pytest.approx(expected, abs=1e-9, nan_ok=True)


def test_the_ratio_counts_independent_quantities() -> None:
    """One where all are one, as many as there are where none depends on another; unknown pairs take the mean square."""
    assert participation_ratio(np.ones((5, 5))) == pytest.approx(1.0)
    assert participation_ratio(np.eye(5)) == pytest.approx(5.0)
    assert participation_ratio(np.eye(0)) is None
    correlations = np.array([[1.0, 0.6, np.nan], [0.6, 1.0, 0.2], [np.nan, 0.2, 1.0]])
    assert participation_ratio(correlations) == pytest.approx(9.0 / (3.0 + 2 * (0.36 + 0.04 + 0.2)))


def test_equal_observables() -> None:
    """Equal wherever both are considered, over enough sessions, and not constant there."""
    many = [float(n % 3) / 2 for n in range(LEAST_SESSIONS)]
    few: list[float | None] = [None, *many[1:]]
    result = panel_of_observables(
        {
            "O1": [*many, 0.0],
            "O2": [*many, None],
            "O3": [1.0 - x for x in many] + [None],
            "O4": [*few, None],  # one common session fewer
            "C1": [1.0] * (LEAST_SESSIONS + 1),
            "C2": [1.0] * (LEAST_SESSIONS + 1),
        }
    )

    assert result.equal == (("O1", "O2", LEAST_SESSIONS),)
    assert result.constant == ("C1", "C2")
    assert not result.bounds["pairs of equal observables: 1, at most 0"]
    # O4 with each of the three others: too few common sessions.
    assert result.unknown_correlations == 3


def test_what_always_passes() -> None:
    """By the verdict and not by x: a value that varies above its threshold tells nothing either."""
    result = panel_of_observables(
        {"O1": [0.5, 0.9, None], "O2": [0.5, 0.4, 1.0], "O3": [0.0, 0.1, 0.2], "O4": [1.0] * 3}
    )

    assert result.always_passed == {"O1": 2, "O4": 3}
    assert result.observables == 4
    assert result.constant == ("O4",)


def test_what_is_not_about_the_agent_is_left_out() -> None:
    rows = [score_row("good", "p0", 0, "O1", 1.0), score_row("good", "p0", 0, "O2", 1.0)]
    rows[1]["standing"] = "configured sensor"

    assert panel_from(rows).always_passed == {"O1": 1}


def panel_node(result: Panel, name: str) -> PanelNode:
    return next(rated for rated in result.nodes if rated.id == name)


@pytest.mark.parametrize("seed", range(6))
def test_noise_is_students_interval_over_replicates(seed: int) -> None:
    """Against an analysis of variance: residuals round the mean of each design point, of paired differences."""
    rng = np.random.default_rng(seed)
    confidence = {
        (agent, point, replicate): float(rng.uniform(0.1 * point, 0.1 * point + 0.5))
        for agent, point, replicate in product(AGENTS, range(4), range(3))
    }
    rows = [score_row(agent, f"p{point}", r, "K1", x) for (agent, point, r), x in confidence.items()]

    result = panel_node(panel_from(rows), "K1")

    apart = np.array(
        [[confidence["poor", p, r] - confidence["good", p, r] for r in range(3)] for p in range(4)]
    )
    within = ((apart - apart.mean(axis=1, keepdims=True)) ** 2).sum() / 8
    low, high = stats.t.interval(0.95, 8, apart.mean(), np.sqrt(within / 12))
    assert result.difference == pytest.approx(abs(apart.mean()))
    assert result.noise == pytest.approx((high - low) / 2)
    assert result.separated is not bool(low <= 0.0 <= high)
    assert (result.lower, result.higher) == (AGENTS if apart.mean() >= 0 else AGENTS[::-1])


def test_the_scene_is_no_noise() -> None:
    """Scenes differ by far, and one agent is a little better in each: that separates. Without replicates nothing does."""
    rows = [
        score_row(agent, f"p{point}", replicate, "K1", point / 10 + (0.01 if agent == "good" else 0.0))
        for agent, point, replicate in product(AGENTS, range(5), range(2))
    ]
    assert panel_node(panel_from(rows), "K1").separated
    once = panel_node(panel_from([made for made in rows if made["replicate"] == 0]), "K1")
    assert once.difference == pytest.approx(0.01)
    assert once.noise is None
    assert not once.separated
    # Beside design points flown twice, one flown once does not count.
    single = [score_row("good", "p9", 0, "K1", 0.0), score_row("poor", "p9", 0, "K1", 1.0)]
    with_single, without = (panel_node(panel_from(made), "K1") for made in ([*rows, *single], rows))
    assert (with_single.difference, with_single.noise) == (without.difference, without.noise)


def test_more_agents_need_a_clearer_difference() -> None:
    """The rate of error is shared among the pairs, of which the third agent, alone in its scene, makes three."""
    rng = np.random.default_rng(1)
    rows = [
        score_row(agent, f"p{point}", replicate, "K1", float(rng.random()))
        for agent, point, replicate in product(AGENTS, range(3), range(3))
    ]
    pair, three = (
        panel_node(panel_from(made), "K1") for made in (rows, [*rows, score_row("third", "p9", 0, "K1", 0.5)])
    )
    assert pair.noise is not None
    assert three.noise == pytest.approx(pair.noise * stats.t.ppf(1 - 0.025 / 3, 6) / stats.t.ppf(0.975, 6))


def test_worse_is_better() -> None:
    """Only where the worse agent has more, beyond noise; on key attributes, principles and observables."""
    rows = []
    for point, replicate in product(range(3), range(2)):
        for agent, values in {"good": (0.2, 0.9, 0.0), "poor": (0.6, 0.1, 1.0)}.items():
            names = ("K1", "K2", "O1")
            rows += [
                score_row(agent, f"p{point}", replicate, n, x) for n, x in zip(names, values, strict=True)
            ]

    assert [flag.id for flag in panel_from(rows, order=("poor", "good")).worse_is_better] == ["K1", "O1"]
    assert [flag.id for flag in panel_from(rows, order=("good", "poor")).worse_is_better] == ["K2"]
    assert panel_from(rows).worse_is_better == ()
    with pytest.raises(ValueError, match="good, poor"):
        panel_from(rows, order=("good", "absent"))


def test_the_floor_stands_beside_the_best_tested_agent() -> None:
    """Over the scenes that all have flown: what the tested agents reach elsewhere does not count."""
    rows = [
        score_row("good", "p0", 0, "K1", 0.7),
        score_row("poor", "p0", 0, "K1", 0.4),
        score_row("poor", "p1", 0, "K1", 1.0),
    ]
    rows.append(score_row("good", "p1", 0, "K1", 1.0))
    floor = [score_row("null-a", "p0", 0, "K1", 0.6), score_row("oracle", "p0", 0, "K1", 1.0)]

    result = panel_node(panel_from(rows, floor), "K1")

    assert (result.floor, result.floor_agents) == (0.6, ("null-a",))
    assert (result.best, result.best_agents) == (0.7, ("good",))
    assert panel_node(panel_from(rows), "K1").floor is None


def made_node(name: str, level: str, separated: bool) -> PanelNode:
    return PanelNode(
        id=name, level=level, lower="poor", higher="good", difference=0.1, noise=0.0, separated=separated
    )


@pytest.mark.parametrize(
    ("equal", "always", "ratio", "key_attributes", "principle", "met"),
    [
        (0, 0, 12.0, LEAST_SEPARATING_KEY_ATTRIBUTES, True, [True] * 5),
        (1, 1, 11.99, LEAST_SEPARATING_KEY_ATTRIBUTES - 1, False, [False] * 5),
    ],
)
def test_both_sides_of_each_bound(
    equal: int, always: int, ratio: float, key_attributes: int, principle: bool, met: list[bool]
) -> None:
    nodes = [made_node(f"K{n}", "ka", n < key_attributes) for n in range(43)]
    nodes += [made_node("P1", "principle", True), made_node("P2", "principle", principle)]

    assert list(_bounds(equal, always, ratio, nodes).values()) == met
