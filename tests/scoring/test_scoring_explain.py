# mypy: disable-error-code=comparison-overlap
# pytest.approx stands for a number, which its type does not say.
"""Why a node has its score: states, the way down, order and bounds, on runs made by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from made_decompositions import WORKED, explained, factor_row, leaf, made_decomposition, worked_decomposition

from bench.contracts import Evidence, Observation, Outcome
from bench.scoring import (
    Explanation,
    ScoredRun,
    difficulty_of_values,
    run_reports,
    score_table,
    stated_difficulty,
    summary_frame,
)
from bench.statistics import clopper_pearson, effective_size
from decompositions import Decomposition

STATED = WORKED | {"O1": 30.0, "O2": 60.0, "O3": 90.0}


def made(partial: bool = False, **more: Any) -> Decomposition:
    """The paper's worked graph."""
    leaves = [
        leaf(name, title=f"Title of {name}", considered="Somebody is there.", partial_credit=partial)
        for name in WORKED
    ]
    return worked_decomposition(leaves, **more)


def flown(decomposition: Decomposition, name: str, *xs: float | None, **changes: Any) -> ScoredRun:
    """A run with x of the first observables, each with two moments of evidence."""
    observations = tuple(
        Observation(
            observable=observable,
            considered=x is not None,
            x=x,
            evidence=tuple(Evidence(time_s=at_s, text=f"{name} {observable} {at_s}") for at_s in (1.0, 2.0)),
        )
        for observable, x in zip(decomposition.observables, xs, strict=False)
    )
    difficulty = stated_difficulty(decomposition, STATED)
    run = ScoredRun(name, name, 0, "agent", Outcome.COMPLETED, difficulty, observations)
    return replace(run, **changes)


def of_one(decomposition: Decomposition, *xs: float | None, node: str = "KA1") -> Explanation:
    return explained(decomposition, [flown(decomposition, "a", *xs)], node)


def test_failures_come_first_and_what_says_nothing_last() -> None:
    """The worst failure, the others, passes from the lowest score up, runs not considered, runs of the
    bench's own fault.
    """
    decomposition = made()
    runs = [
        flown(decomposition, "spoilt", 0.0, 0.0, 0.0, outcome=Outcome.BENCH_ERROR),
        flown(decomposition, "idle", None, None, None),
        flown(decomposition, "high", None, 1.0, None),
        flown(decomposition, "low", 1.0, 1.0, 1.0),
        flown(decomposition, "half", 0.0, 1.0, 1.0),
        flown(decomposition, "worst", 0.0, 0.0, 0.0),
    ]
    reasons, recordings = {"spoilt": "no room"}, {"low": "low.mcap"}
    (agent,) = explained(decomposition, runs, "KA1", reasons=reasons, recordings=recordings).agents
    assert [(shown.run, shown.state, shown.ruled_by) for shown in agent.runs] == [
        ("worst", "failed", ()),
        ("half", "failed", ("KA1", "VAB2", "OBS3")),
        ("low", "passed", ("KA1", "VAB1", "OBS1")),
        ("high", "passed", ("KA1", "VAB1", "OBS2")),
        ("idle", "not considered", ()),
        ("spoilt", "excluded", ()),
    ]
    assert agent.scored_runs == ("high", "low", "half")
    assert agent.runs[2].recording == "low.mcap"
    assert (agent.runs[5].reason, agent.runs[5].observables) == ("no room", ())
    summary = agent.summary
    assert summary.score == pytest.approx((50.0 + 30.0 + 80.0) / 3)
    assert (summary.passed, summary.considered, summary.runs, summary.excluded) == (2, 4, 5, 1)


def test_credit_near_misses_and_reasons_are_told() -> None:
    """Score is difficulty plus credit; a near miss scores and is no pass; what was not considered says when
    it would be.
    """
    decomposition = made(partial=True, policies={"near_miss": 0.1})
    (agent,) = of_one(decomposition, 0.75, 0.45, None).agents
    (run,) = agent.runs
    leaves = {leaf.id: leaf for leaf in run.observables}
    assert [leaf.id for leaf in run.observables] == ["OBS2", "OBS1", "OBS3"]
    assert (leaves["OBS1"].state, leaves["OBS1"].credit, leaves["OBS1"].score) == ("achieved", 1.0, 31.0)
    assert (leaves["OBS2"].state, leaves["OBS2"].credit) == ("near miss", pytest.approx(-0.2))
    assert (leaves["OBS3"].state, leaves["OBS3"].x, leaves["OBS3"].score) == ("not considered", None, None)
    assert leaves["OBS3"].credit == 0.0
    assert leaves["OBS3"].reason == "considered when: Somebody is there."
    assert (run.state, run.achieved, run.considered, run.ruled_by[-1]) == ("failed", 1, 2, "OBS1")
    absent = explained(decomposition, [flown(decomposition, "a")], "KA1").agents[0].runs[0]
    assert absent.observables[0].reason.startswith("there is no observation of it")


def test_the_output_is_bounded_and_says_what_it_leaves_out() -> None:
    """A limit holds for runs, observables and moments; the ruling observable is shown whatever the limit."""
    decomposition = made()
    runs = [flown(decomposition, f"r{i}", 0.0, 0.0, 1.0) for i in range(4)] + [
        flown(decomposition, "good", 1.0, 1.0, 1.0)
    ]
    (agent,) = explained(decomposition, runs, "KA1", limit=1).agents
    assert (len(agent.runs), agent.runs_left_out) == (1, {"failed": 3, "passed": 1})
    (run,) = agent.runs
    assert [(leaf.id, leaf.ruling) for leaf in run.observables] == [("OBS1", False), ("OBS3", True)]
    assert run.observables_left_out == 1
    assert (len(run.observables[0].evidence), run.observables[0].evidence_left_out) == (1, 1)
    assert agent.scored_runs == ("r0",)


def test_each_agent_is_told_by_itself() -> None:
    """Two agents, two means."""
    decomposition = made()
    runs = [
        flown(decomposition, "a", 1.0, 1.0, 1.0, agent="one"),
        flown(decomposition, "b", 0.0, 0.0, 0.0, agent="two"),
    ]
    first, second = explained(decomposition, runs, "VAB1").agents
    told = [(a.summary.agent, a.summary.score, [run.run for run in a.runs]) for a in (first, second)]
    assert told == [("one", 30.0, ["a"]), ("two", None, ["b"])]


def test_no_child_rules_a_mean() -> None:
    """Under `inner_score: mean` there is no way down to one observable."""
    decomposition = made(policies={"inner_score": "mean"})
    (agent,) = of_one(decomposition, 1.0, 1.0, 1.0).agents
    assert agent.runs[0].ruled_by == ()
    assert agent.runs[0].score == 52.5


def test_an_observable_explains_itself() -> None:
    """The lowest node is its own way."""
    decomposition = made()
    (agent,) = of_one(decomposition, 1.0, 1.0, 1.0, node="OBS2").agents
    assert agent.runs[0].ruled_by == ("OBS2",)
    assert [leaf.id for leaf in agent.runs[0].observables] == ["OBS2"]
    with pytest.raises(KeyError):
        explained(decomposition, [], "OBS9")


def test_runs_are_reported_in_the_order_of_the_table() -> None:
    """Every node of every run, x at observables alone."""
    decomposition = made()
    first, second = run_reports(
        score_table(
            decomposition,
            [flown(decomposition, "b", 1.0, 0.0, None), flown(decomposition, "a", 1.0, 1.0, 1.0)],
        )
    )
    assert (first.run, second.run) == ("b", "a")
    nodes = {node.id: node for node in first.nodes}
    assert list(nodes) == list(decomposition.nodes)
    assert (nodes["OBS2"].x, nodes["OBS3"].x, nodes["KA1"].x) == (0.0, None, None)
    assert (nodes["KA1"].achieved, nodes["KA1"].considered, nodes["KA1"].score) == (1, 2, 30.0)


FOG = factor_row("fog_level", [20, 80], [0, 3])
RAIN = factor_row("rain_level", [20, 80], [0, 6])


def built(*, principles: bool = True, tables: dict[str, list[dict[str, Any]]] | None = None) -> Decomposition:
    """Two principles over two key attributes over two VABs; O2 stands under both VABs, KA2 under both principles."""
    return made_decomposition(
        [leaf(name, *(tables or {}).get(name, ())) for name in ("O1", "O2", "O3")],
        {"V1": ["O1", "O2"], "V2": ["O2", "O3"]},
        {"KA1": ["V1", "V2"], "KA2": ["V2"]},
        {"P1": ["KA1", "KA2"], "P2": ["KA2"]} if principles else {},
        given=not tables,
    )


def test_two_factors_that_tie_rule_together() -> None:
    """Fog and rain both rate 50: both rule, the margin skips both, and only raising both helps."""
    decomposition = built(
        tables={"O1": [FOG, RAIN], "O2": [FOG, factor_row("clouds", [70, 90], [0, 1])], "O3": [RAIN]}
    )
    values = {"fog_level": 1.5, "rain_level": 3.0, "clouds": 0.0}
    difficulty = difficulty_of_values(decomposition, values)
    assert {name: difficulty.of(name) for name in ("O1", "O2", "O3", "KA1", "P2")} == dict.fromkeys(
        ("O1", "O2", "O3", "KA1", "P2"), 50.0
    )
    assert difficulty.observables["O1"].ruled_by == ("fog_level", "rain_level")
    assert difficulty.observables["O1"].margin is None
    assert difficulty.observables["O2"].margin == 20.0
    assert difficulty.nodes["KA1"].ruled_by == ("O1", "O2", "O3")
    for raised, expected in (
        ({"fog_level"}, 50.0),
        ({"rain_level"}, 50.0),
        ({"fog_level", "rain_level"}, 70.0),
    ):
        changed = values | {factor: {"fog_level": 2.5, "rain_level": 5.0}[factor] for factor in raised}
        assert difficulty_of_values(decomposition, changed).of("KA1") == pytest.approx(expected)


@pytest.mark.parametrize("failing", [0, 1])
def test_the_run_that_fails_is_explained_whichever_it_is(failing: int) -> None:
    """Of two runs one fails at one of two observables: it comes first, with its own evidence, reason and recording."""
    runs = [
        flown(built(), f"r{number}", 1.0, float(number != failing), 1.0, design_point="p", replicate=number)
        for number in (0, 1)
    ]
    (agent,) = explained(
        built(),
        runs,
        "KA1",
        recordings={"r0": "0.mcap", "r1": "1.mcap"},
        reasons={"r0": "zero", "r1": "one"},
        rows={("r0", "O2"): "t:1", ("r1", "O2"): "t:2"},
    ).agents
    first, second = agent.runs
    assert (first.run, first.state, second.state) == (f"r{failing}", "failed", "passed")
    assert (first.recording, first.reason) == (f"{failing}.mcap", ("zero", "one")[failing])
    assert [leaf.id for leaf in first.observables] == ["O2", "O1", "O3"]
    assert (first.observables[0].row, first.observables[0].evidence[0].text) == (
        f"t:{failing + 1}",
        f"r{failing} O2 1.0",
    )
    assert first.ruled_by == ("KA1", "V1", "O1")
    assert (agent.summary.passed, agent.summary.considered, agent.summary.design_points) == (1, 2, 1)


def test_of_two_children_that_tie_the_first_rules() -> None:
    """V1 and V2 both have the score of O2: the path goes down by V1, and O2 is marked as ruling once."""
    (agent,) = explained(built(), [flown(built(), "r", 0.0, 1.0, 1.0)], "KA1").agents
    assert agent.runs[0].ruled_by == ("KA1", "V1", "O2")
    assert [leaf.id for leaf in agent.runs[0].observables if leaf.ruling] == ["O2"]


def test_design_points_of_unequal_size_weigh_by_their_runs() -> None:
    """Five runs of one design point and one of another, for two agents: means over runs, intervals over design points."""
    shares = {"a": [1.0, 1.0, 1.0, 1.0, 0.0, 0.0], "b": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}
    points = ["big"] * 5 + ["small"]
    runs = [
        flown(built(), f"{agent}{number}", x, design_point=point, agent=agent, replicate=number)
        for agent, xs in shares.items()
        for number, (x, point) in enumerate(zip(xs, points, strict=True))
    ]
    frame = summary_frame(score_table(built(), runs), built()).filter(node="O1", configuration="all")
    for summary in frame.iter_rows(named=True):
        xs = shares[summary["agent"]]
        mean = sum(xs) / 6
        squared = sum(
            sum(x - mean for x, name in zip(xs, points, strict=True) if name == point) ** 2
            for point in ("big", "small")
        )
        size = float(effective_size(mean, 6, 2, squared))
        low, high = clopper_pearson(mean * size, size)
        assert (summary["considered"], summary["design_points"]) == (6, 2)
        assert summary["method"] == "korn-graubard"
        assert summary["confidence_mean"] == pytest.approx(mean)
        assert (summary["confidence_low"], summary["confidence_high"]) == (
            pytest.approx(float(low)),
            pytest.approx(float(high)),
        )
    assert frame["competence_50"].to_list() == [30.0, 0.0]


def test_difficulties_that_tie_are_one_cell_of_competence() -> None:
    """Two design points of one difficulty, one passing and one failing, and a harder one that passes: half of
    each counts.
    """

    def run(name: str, x: float, difficulty: float) -> ScoredRun:
        return flown(built(), name, x, difficulty=stated_difficulty(built(), STATED | {"O1": difficulty}))

    def competence(*runs: ScoredRun) -> tuple[float, float]:
        frame = summary_frame(score_table(built(), runs), built()).filter(node="O1", configuration="all")
        return frame["competence_50"][0], frame["competence_90"][0]

    tied = [run("a", 1.0, 40.0), run("b", 0.0, 40.0 + 1e-8)]
    assert competence(*tied) == competence(*reversed(tied)) == (40.0, 0.0)
    assert competence(*tied, run("c", 1.0, 70.0)) == (70.0, 0.0)
    assert competence(*tied, run("c", 0.0, 70.0)) == (40.0, 0.0)
    assert competence(*tied, run("c", 0.0, 70.0), run("d", 0.0, 40.0)) == (0.0, 0.0)
