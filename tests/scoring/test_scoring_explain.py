# mypy: disable-error-code=comparison-overlap
# pytest.approx stands for a number, which its type does not say.
"""Why a node has its score: states, the way down, order and bounds, on runs made by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from made_decompositions import WORKED, leaf, worked_decomposition

from bench.contracts import Evidence, Observation, Outcome
from bench.scoring import (
    Explanation,
    ScoredRun,
    Sources,
    explain,
    node_reports,
    run_reports,
    score_table,
    stated_difficulty,
    summary_frame,
)
from decompositions import Decomposition


def made(partial: bool = False, **more: Any) -> Decomposition:
    """The paper's worked graph."""
    leaves = [
        leaf(name, title=f"Title of {name}", considered="Somebody is there.", partial_credit=partial)
        for name in WORKED
    ]
    return worked_decomposition(leaves, **more)


def flown(decomposition: Decomposition, name: str, *xs: float | None, **changes: Any) -> ScoredRun:
    """A run with x of the three observables, each with two moments of evidence."""
    observations = tuple(
        Observation(
            observable=observable,
            considered=x is not None,
            x=x,
            evidence=(
                Evidence(time_s=1.0, text=f"{observable} first"),
                Evidence(time_s=2.0, text=f"{observable} then"),
            ),
        )
        for observable, x in zip(WORKED, xs, strict=True)
    )
    run = ScoredRun(
        name,
        name,
        0,
        "agent",
        Outcome.COMPLETED,
        stated_difficulty(decomposition, WORKED),
        observations,
    )
    return replace(run, **changes)


def explained(
    decomposition: Decomposition, runs: list[ScoredRun], node: str = "KA1", limit: int = 0, **sources: Any
) -> Explanation:
    scores = score_table(decomposition, runs)
    summaries = node_reports(
        scores, summary_frame(scores, decomposition).filter(node=node, configuration="all")
    )
    return explain(decomposition, node, runs, scores, summaries, Sources(**sources), limit=limit)


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
    (agent,) = explained(
        decomposition, runs, reasons={"spoilt": "no room"}, recordings={"low": "low.mcap"}
    ).agents
    assert [explained_run.run for explained_run in agent.runs] == [
        "worst",
        "half",
        "low",
        "high",
        "idle",
        "spoilt",
    ]
    states = ["failed", "failed", "passed", "passed", "not considered", "excluded"]
    assert [explained_run.state for explained_run in agent.runs] == states
    assert [explained_run.ruled_by for explained_run in agent.runs] == [
        (),
        ("KA1", "VAB2", "OBS3"),
        ("KA1", "VAB1", "OBS1"),
        ("KA1", "VAB1", "OBS2"),
        (),
        (),
    ]
    assert agent.scored_runs == ("high", "low", "half")
    assert agent.runs[2].recording == "low.mcap"
    assert (agent.runs[5].reason, agent.runs[5].observables) == ("no room", ())
    assert agent.summary.score == pytest.approx(
        sum(explained_run.score for explained_run in agent.runs if explained_run.score is not None) / 3
    )
    assert (agent.summary.passed, agent.summary.considered, agent.summary.runs, agent.summary.excluded) == (
        2,
        4,
        5,
        1,
    )


def test_credit_near_misses_and_reasons_are_told() -> None:
    """Score is difficulty plus credit; a near miss scores and is no pass; what was not considered says when
    it would be.
    """
    decomposition = made(partial=True, policies={"near_miss": 0.1})
    (agent,) = explained(decomposition, [flown(decomposition, "a", 0.75, 0.45, None)]).agents
    (run,) = agent.runs
    leaves = {leaf.id: leaf for leaf in run.observables}
    assert [leaf.id for leaf in run.observables] == ["OBS2", "OBS1", "OBS3"]
    assert (leaves["OBS1"].state, leaves["OBS1"].credit, leaves["OBS1"].score) == ("achieved", 1.0, 31.0)
    assert (leaves["OBS2"].state, leaves["OBS2"].credit) == ("near miss", pytest.approx(-0.2))
    assert (leaves["OBS3"].state, leaves["OBS3"].x, leaves["OBS3"].score) == ("not considered", None, None)
    assert leaves["OBS3"].credit == 0.0
    assert leaves["OBS3"].reason == "considered when: Somebody is there."
    assert (run.state, run.achieved, run.considered, run.ruled_by[-1]) == ("failed", 1, 2, "OBS1")
    absent = (
        explained(decomposition, [flown(decomposition, "a", 1.0, 1.0, 1.0, observations=())])
        .agents[0]
        .runs[0]
    )
    assert absent.observables[0].reason.startswith("there is no observation of it")


def test_the_output_is_bounded_and_says_what_it_leaves_out() -> None:
    """A limit holds for runs, observables and moments; the ruling observable is shown whatever the limit."""
    decomposition = made()
    runs = [flown(decomposition, f"r{i}", 0.0, 0.0, 1.0) for i in range(4)] + [
        flown(decomposition, "good", 1.0, 1.0, 1.0)
    ]
    (agent,) = explained(decomposition, runs, limit=1).agents
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
    assert (first.summary.agent, first.summary.score, [run.run for run in first.runs]) == ("one", 30.0, ["a"])
    assert (second.summary.agent, second.summary.score, [run.run for run in second.runs]) == (
        "two",
        None,
        ["b"],
    )


def test_no_child_rules_a_mean() -> None:
    """Under `inner_score: mean` there is no way down to one observable."""
    decomposition = made(policies={"inner_score": "mean"})
    (agent,) = explained(decomposition, [flown(decomposition, "a", 1.0, 1.0, 1.0)]).agents
    assert agent.runs[0].ruled_by == ()
    assert agent.runs[0].score == 52.5


def test_an_observable_explains_itself() -> None:
    """The lowest node is its own way."""
    decomposition = made()
    (agent,) = explained(decomposition, [flown(decomposition, "a", 1.0, 1.0, 1.0)], "OBS2").agents
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
