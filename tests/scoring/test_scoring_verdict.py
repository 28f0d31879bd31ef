"""The verdict of a principle: runs passed of runs considered, by its essential key attributes (docs/rulings.md 27)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_decompositions import explained, leaf, made_decomposition, node, observed

from bench.contracts import Outcome
from bench.scoring import (
    ScoredRun,
    Standing,
    node_floors,
    node_reports,
    score_table,
    stated_difficulty,
    summary_frame,
)
from bench.statistics import clopper_pearson
from decompositions import (
    Decomposition,
    Level,
    load_decomposition,
    shipped_decompositions,
)

LEAVES = ("O1", "O2", "O3", "O4")
# P names its key attribute K2, which shares O2 with K1; Q names none, so that all of its own are essential.
ESSENTIAL = {"P": ("O2", "O3"), "Q": ("O1", "O2", "O4")}
X = st.sampled_from([None, 0.0, 0.4, 0.5, 1.0])
RUN = st.tuples(st.sampled_from([True, True, True, False]), st.tuples(X, X, X, X))


def duties(observables: Iterable[dict[str, Any]] = tuple(map(leaf, LEAVES))) -> Decomposition:
    """Four observables under three key attributes, those under two principles."""
    principles = [
        node("P", ["K1", "K2"], essential=["K2"], essential_reason="Given."),
        node("Q", ["K1", "K3"]),
    ]
    return made_decomposition(
        observables,
        {"V1": ["O1", "O2"], "V2": ["O2", "O3"], "V3": ["O4"]},
        {"K1": ["V1"], "K2": ["V2"], "K3": ["V3"]},
        principles,
        given=True,
    )


DUTIES = duties()


def run(
    number: int, xs: tuple[float | None, ...], agent: str = "agent", *, spoilt: bool = False
) -> ScoredRun:
    observations = observed(dict(zip(LEAVES, xs, strict=True)))
    outcome = Outcome.WORKER_LOST if spoilt else Outcome.COMPLETED
    difficulty = stated_difficulty(DUTIES, dict.fromkeys(LEAVES, 30.0))
    return ScoredRun(f"r{number}-{agent}", f"p{number}", 0, agent, outcome, difficulty, observations)


@settings(max_examples=30, deadline=None)
@given(st.lists(RUN, min_size=1, max_size=12))
def test_a_verdict_agrees_with_a_count_by_hand(
    runs: list[tuple[bool, tuple[float | None, ...]]],
) -> None:
    """Runs that the bench spoilt, and runs that consider nothing essential, have none; other nodes have none at all."""
    made = [run(number, xs, spoilt=not counts) for number, (counts, xs) in enumerate(runs)]
    summary = summary_frame(score_table(DUTIES, made), DUTIES).filter(configuration="all")
    for principle, essential in ESSENTIAL.items():
        asked = [
            [x for leaf, x in zip(LEAVES, xs, strict=True) if leaf in essential and x is not None]
            for counts, xs in runs
            if counts
        ]
        considered = [xs for xs in asked if xs]
        passed = sum(all(x >= 0.5 for x in xs) for xs in considered)
        row = summary.filter(node=principle).row(0, named=True)
        assert (row["verdict_passed"], row["verdict_considered"]) == (passed, len(considered))
        low, high = clopper_pearson(passed, len(considered)) if considered else (0.0, 1.0)
        assert (row["verdict_low"], row["verdict_high"]) == (pytest.approx(low), pytest.approx(high))
    others = summary.filter(~summary["node"].is_in(list(ESSENTIAL)))
    assert others["verdict_considered"].null_count() == others.height


def test_replicates_of_a_design_point_widen_the_interval() -> None:
    """Ten runs of two design points, of which one always fails, say less than ten runs of ten."""
    xs = {True: (1.0,) * 4, False: (0.0,) * 4}
    apart = [run(number, xs[number < 5]) for number in range(10)]
    together = [
        replace(scored, design_point=f"p{number // 5}", replicate=number % 5)
        for number, scored in enumerate(apart)
    ]
    widths = []
    for runs in (apart, together):
        table = score_table(DUTIES, runs)
        rows = {
            row.id: row
            for row in node_reports(table, summary_frame(table, DUTIES).filter(configuration="all"))
        }
        principle, observable = rows["P"], rows["O2"]
        assert (principle.verdict_passed, principle.verdict_considered) == (5, 10)
        # O2 fails where P does, so its confidence has the same counts and the same interval.
        assert (principle.verdict_low, principle.verdict_high) == (
            observable.confidence_low,
            observable.confidence_high,
        )
        widths.append(observable.confidence_high - observable.confidence_low)
    assert widths[0] == pytest.approx(0.626, abs=1e-3)
    assert widths[1] > 0.95


def test_the_configured_sensor_decides_no_verdict() -> None:
    """A detector of the bench that fails is no failure of the agent."""
    perceived = {"O3": "perception"}
    leaves = [
        leaf.model_dump() | {"subject": perceived.get(leaf.id, "agent")}
        for leaf in DUTIES.document.observables
    ]
    decomposition = duties(observables=leaves)
    difficulty = stated_difficulty(decomposition, dict.fromkeys(LEAVES, 30.0))
    rated = difficulty.observables["O3"]
    # Stated difficulties count as the agent's own perception, so the standing is set by hand.
    of_sensor = replace(rated, standing=Standing.CONFIGURED_SENSOR)
    sensor = replace(difficulty, observables={**difficulty.observables, "O3": of_sensor})
    scored = replace(run(0, (1.0, 1.0, 0.0, 1.0)), difficulty=sensor)
    table = score_table(decomposition, [scored])
    assert table.filter(node="P")["verdict"].to_list() == [True]


def test_the_floor_has_the_best_verdict_of_a_null_agent() -> None:
    """By the share of its runs, not by their number, and never that of the oracle."""
    best, worse, oracle = (0.0, 1.0, 1.0, 0.0), (0.0, 0.0, 1.0, 1.0), (1.0,) * 4
    runs = [
        *(run(n, best if n else worse, "null-a") for n in range(3)),
        *(run(n, worse, "null-b") for n in range(3)),
        *(run(n, oracle, "oracle") for n in range(3)),
    ]
    floors = node_floors(score_table(DUTIES, runs), "oracle")
    assert (floors["P"].verdict_passed, floors["P"].verdict_considered) == (2, 3)
    assert (floors["Q"].verdict_passed, floors["Q"].verdict_considered) == (0, 3)
    assert (floors["K1"].verdict_passed, floors["K1"].verdict_considered) == (None, None)


def test_an_explanation_begins_with_what_broke_the_verdict() -> None:
    """A run that fails at something else comes after it, and the essential observable before all others."""
    runs = [run(0, (0.0, 1.0, 1.0, 0.0)), run(1, (0.0, 0.0, 1.0, 1.0)), run(2, (None, None, None, 1.0))]
    explanation = explained(DUTIES, runs, "P")
    assert (explanation.essential, explanation.essential_reason) == (("K2",), "Given.")
    (agent,) = explanation.agents
    assert [(shown.run, shown.verdict) for shown in agent.runs] == [
        ("r1-agent", False),
        ("r0-agent", True),
        ("r2-agent", None),
    ]
    assert [(leaf.id, leaf.essential) for leaf in agent.runs[0].observables][:2] == [
        ("O2", True),
        ("O1", False),
    ]
    of_attribute = explained(DUTIES, runs, "K1")
    assert (of_attribute.essential, of_attribute.essential_reason) == ((), "")


@pytest.mark.parametrize("name", shipped_decompositions())
def test_shipped_principles_name_their_essential_key_attributes(name: str) -> None:
    """A user's document may leave it to the default; ours may not."""
    assert [node.id for node in load_decomposition(name).document.principles if not node.essential] == []


def test_responsible_and_governable_cannot_be_passed_against_their_duty() -> None:
    """Who marks beside people fails *responsible*, and who refuses every order has nothing to pass under *governable*."""
    for name in ("search-and-report", "search-and-report-full"):
        assert "OBS-181" in load_decomposition(name).essential_observables("responsible")
    full = load_decomposition("search-and-report-full")
    for observable in full.essential_observables("governable"):
        # Without such an order in the situation the observable is not exercisable, so the run has no verdict.
        assert any(
            ("order_urgency" in row.factor or row.factor == "handover_s") and row.absent == 0
            for row in full.key_factors(observable)
        ), observable


def test_every_principle_has_children_under_its_essential_key_attributes() -> None:
    """Distinct observables, in the order of the document; without a choice, all."""
    assert {
        name: DUTIES.essential_observables(name) for name in DUTIES.at_level(Level.PRINCIPLE)
    } == ESSENTIAL
