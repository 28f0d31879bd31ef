"""Two of everything: shared observables, tied key factors, a second run that fails, design points of unequal size.

Rules that pick one of several, or that count each once, look right as long as there is only one. Every test
here has two.
"""

from __future__ import annotations

from typing import Any

import pytest
from made_decompositions import factor_row, leaf, made_decomposition

from bench.contracts import Evidence, Observation, Outcome
from bench.errors import SetupError
from bench.scoring import (
    ScoredRun,
    Sources,
    difficulty_of_values,
    explain,
    node_reports,
    read_table,
    score_table,
    stated_difficulty,
    summary_frame,
)
from bench.statistics import clopper_pearson, effective_size
from decompositions import Decomposition

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


STATED = {"O1": 30.0, "O2": 60.0, "O3": 90.0}


def flown(
    name: str, xs: dict[str, float | None], *, point: str = "", agent: str = "a", replicate: int = 0
) -> ScoredRun:
    observations = tuple(
        Observation(
            observable=observable,
            considered=x is not None,
            x=x,
            evidence=(Evidence(time_s=1.0, text=f"{name} {observable}"),),
        )
        for observable, x in xs.items()
    )
    difficulty = stated_difficulty(built(), STATED)
    return ScoredRun(name, point or name, replicate, agent, Outcome.COMPLETED, difficulty, observations)


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
        flown(
            f"r{number}",
            {"O1": 1.0, "O2": 0.0 if number == failing else 1.0, "O3": 1.0},
            point="p",
            replicate=number,
        )
        for number in (0, 1)
    ]
    decomposition = built()
    scores = score_table(decomposition, runs)
    summary = node_reports(
        scores, summary_frame(scores, decomposition).filter(node="KA1", configuration="all")
    )
    sources = Sources(
        {"r0": "0.mcap", "r1": "1.mcap"},
        {"r0": "zero", "r1": "one"},
        {("r0", "O2"): "t:1", ("r1", "O2"): "t:2"},
    )
    (agent,) = explain(decomposition, "KA1", runs, scores, summary, sources).agents
    first, second = agent.runs
    assert (first.run, first.state, second.state) == (f"r{failing}", "failed", "passed")
    assert (first.recording, first.reason) == (f"{failing}.mcap", ("zero", "one")[failing])
    assert [leaf.id for leaf in first.observables] == ["O2", "O1", "O3"]
    assert (first.observables[0].row, first.observables[0].evidence[0].text) == (
        f"t:{failing + 1}",
        f"r{failing} O2",
    )
    assert first.ruled_by == ("KA1", "V1", "O1")
    assert (agent.summary.passed, agent.summary.considered, agent.summary.design_points) == (1, 2, 1)


def test_of_two_children_that_tie_the_first_rules() -> None:
    """V1 and V2 both have the score of O2: the path goes down by V1, and O2 is marked as ruling once."""
    decomposition, run = built(), flown("r", {"O1": 0.0, "O2": 1.0, "O3": 1.0})
    scores = score_table(decomposition, [run])
    summary = node_reports(
        scores, summary_frame(scores, decomposition).filter(node="KA1", configuration="all")
    )
    (agent,) = explain(decomposition, "KA1", [run], scores, summary, Sources()).agents
    assert agent.runs[0].ruled_by == ("KA1", "V1", "O2")
    assert [leaf.id for leaf in agent.runs[0].observables if leaf.ruling] == ["O2"]


def test_design_points_of_unequal_size_weigh_by_their_runs() -> None:
    """Five runs of one design point and one of another, for two agents: means over runs, intervals over design points."""
    shares = {"a": [1.0, 1.0, 1.0, 1.0, 0.0, 0.0], "b": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}
    points = ["big"] * 5 + ["small"]
    runs = [
        flown(f"{agent}{number}", {"O1": x}, point=point, agent=agent, replicate=number)
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
        rated = stated_difficulty(built(), STATED | {"O1": difficulty})
        observations = (Observation(observable="O1", considered=True, x=x),)
        return ScoredRun(name, name, 0, "a", Outcome.COMPLETED, rated, observations)

    def competence(*runs: ScoredRun) -> tuple[float, float]:
        frame = summary_frame(score_table(built(), runs), built()).filter(node="O1", configuration="all")
        return frame["competence_50"][0], frame["competence_90"][0]

    tied = [run("a", 1.0, 40.0), run("b", 0.0, 40.0 + 1e-8)]
    assert competence(*tied) == competence(*reversed(tied)) == (40.0, 0.0)
    assert competence(*tied, run("c", 1.0, 70.0)) == (70.0, 0.0)
    assert competence(*tied, run("c", 0.0, 70.0)) == (40.0, 0.0)
    assert competence(*tied, run("c", 0.0, 70.0), run("d", 0.0, 40.0)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("r,O1,30,2,\nr,O2,130,1,\n", {(2, "x 2 lies outside"), (3, "difficulty 130 lies outside")}),
        ("r,O1,130,2,\n", {(2, "x 2 lies outside"), (2, "difficulty 130 lies outside")}),
        ("r,O1,30,1,\nr,O1,30,1,\nr,O1,30,1,\n", {(3, "already on line 2"), (4, "already on line 2")}),
        (
            "r,O7,30,1,maybe\ns,O8,30,1,\n",
            {(2, "no observable 'O7'"), (2, "considered is 'maybe'"), (3, "no observable 'O8'")},
        ),
    ],
)
def test_two_faults_of_a_table_are_both_reported(text: str, expected: set[tuple[int, str]]) -> None:
    """In one row, in two rows, of one kind and of two kinds: each with its own line, none hides another."""
    with pytest.raises(SetupError) as caught:
        read_table("run,observable,difficulty,x,considered\n" + text, built(), "t.csv")
    faults = [(fault.where, fault.what) for fault in caught.value.faults]
    assert len(faults) == len(expected)
    for line, what in expected:
        assert [where for where, message in faults if what in message and where == f"t.csv:{line}"]
