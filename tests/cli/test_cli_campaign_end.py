"""What the end of a campaign needs is loaded while the last sessions fly."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import polars as pl
import pytest

from bench.campaign import (
    Campaign,
    CampaignPlanned,
    CampaignSummary,
    FinishedCampaign,
    RealizationFinished,
    RealizationStarted,
)
from bench.cli._campaign_end import CampaignEnd, show_finding, show_scores
from bench.contracts import Observation, Outcome
from bench.scoring import SCORE_COLUMNS, NodeFloor, ScoredRun, score_table, stated_difficulty, summary_frame
from decompositions import load_decomposition


def started(name: str) -> RealizationStarted:
    return RealizationStarted(name, "w1", 1)


def finished(done: int, total: int) -> RealizationFinished:
    return RealizationFinished(f"run {done}", Outcome.COMPLETED, "", 1.0, done, total)


@pytest.mark.parametrize(
    ("cores", "done", "loads"),
    [(2, 0, [3]), (3, 0, [2, 3]), (1, 0, []), (8, 0, [0, 1, 2, 3]), (2, 3, [0]), (2, 4, [])],
)
def test_loading_begins_when_a_core_is_free(cores: int, done: int, loads: list[int]) -> None:
    """With 4 sessions, `done` of them earlier: after which of its sessions the campaign has loaded."""
    loaded_after: list[int] = []
    number = 0
    end = CampaignEnd(cores, lambda: loaded_after.append(number))
    end.observe(CampaignPlanned(4, done))
    assert not loaded_after
    if done < 4:
        end.observe(started("first"))
    for number in range(1, 4 - done + 1):
        end.observe(finished(done + number, 4))

    assert loaded_after == loads


@pytest.mark.parametrize("marks", [3, 0])
def test_the_demo_ends_with_what_the_agents_differ_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], marks: int
) -> None:
    """Failed runs of both agents, and the command that shows why; nothing of the kind where they passed alike."""
    decomposition = load_decomposition("search-and-report")
    difficulty = stated_difficulty(decomposition, dict.fromkeys(decomposition.observables, 30.0))
    runs = []
    for number in range(4):
        for agent in ("careless", "careful"):
            failed = "OBS-181" if agent == "careless" and number < marks else ""
            observations = tuple(
                Observation(observable=name, considered=True, x=float(name != failed))
                for name in decomposition.observables
            )
            point = f"p{number}"
            flown = ScoredRun(
                f"{point}-{agent}", point, 0, agent, Outcome.COMPLETED, difficulty, observations
            )
            runs.append(flown)
    summary: pl.DataFrame = summary_frame(score_table(decomposition, runs), decomposition)
    finished_campaign = cast(FinishedCampaign, SimpleNamespace(summary=summary, study=decomposition.study))
    show_finding(tmp_path, finished_campaign)
    finding = "the agents passed alike."
    if marks:
        finding = (
            "careless failed suppression of target marking near bystanders (KA-18) in 3 of 4 runs, careful in 0 of 4. "
            f"See why: rebar score {tmp_path} --explain KA-18 --limit 1"
        )
    printed = " ".join(capsys.readouterr().out.split())
    assert printed == f"Finding: {finding} Look at its runs: rebar view {tmp_path}"


@pytest.mark.parametrize("count", [1, 2])
def test_counts_of_one_are_singular(tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int) -> None:
    (tmp_path / "manifest.json").touch()
    flat = {"level": "observable", "floor": 0.9, "floor_agents": ("null",), "ceiling": 1.0, "scenes": 5}
    floors = {name: NodeFloor(id=name, **flat) for name in map("OBS-{}".format, range(count))}
    scores = SimpleNamespace(
        saw_truth=(),
        silent=(),
        summary=summary_frame(pl.DataFrame(schema=SCORE_COLUMNS)),
        study=(),
        floors=floors,
        outcomes={"completed": count},
        report="report.html",
    )
    show_scores(
        cast(Campaign, SimpleNamespace(fidelity="full", decomposition="search-and-report")),
        tmp_path,
        cast(CampaignSummary, SimpleNamespace(total=count, flown=count, wall_s=2.0)),
        cast(FinishedCampaign, scores),
        (),
    )
    printed = capsys.readouterr().out
    assert f"{count} session{'s' * (count > 1)} (" in printed
    assert ("1 observable does not" if count == 1 else "2 observables do not") in printed
