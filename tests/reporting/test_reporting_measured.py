"""Competence on the measured scale: given where the scale of a key attribute predicts, and failures rise with it here."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from made_campaign import made_simspec, make_campaign

from bench.difficulty import DifficultyScale, Feature
from bench.reporting import ReportData, load_report_data, render_report, requirements_table, scores_table
from bench.reporting.statistics import _measured
from bench.simspec import AgentSpec, SimSpec

SCENES, LIMIT = 60, {"KA-18": 40, "KA-03": 20}
ABILITIES = {"able": -2.0, "poor": 1.0}


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ReportData:
    """Scenes that become harder: one agent fails beyond a limit of each node, the other in every second scene. The
    published rating is the same everywhere.
    """
    made = load_report_data(make_campaign(tmp_path / "campaign"))
    assert made.document is not None
    rows = [
        {"realization": f"s{scene}", "design_point": f"p{scene}", "agent": agent, "node": node}
        | {"difficulty": 50.0, "considered": 1, "achieved": int(passed)}
        for node, limit in LIMIT.items()
        for scene in range(SCENES)
        for agent, passed in (("steady", scene <= limit), ("erratic", scene % 2 == 0))
    ]
    template = made.scores.filter(level="ka").head(1).drop(list(rows[0]))
    scores = pl.DataFrame(rows).join(template, how="cross").select(made.scores.columns)
    node = {"trials": 90, "failures": 40, "abilities": ABILITIES, "weights": {"a": 1.0}}
    scale = {
        "decomposition": made.document.name,
        "decomposition_sha256": made.document.digest,
        "fitted_to": [],
        "features": {"a": {"mean": 30.0, "deviation": 10.0, "low": 0.0, "high": 60.0}},
        "nodes": {"KA-18": {**node, "unproved": ""}, "KA-03": {**node, "unproved": "31 failures in 40 runs"}},
    }
    monkeypatch.setattr(_measured, "shipped_scale", lambda _: DifficultyScale.model_validate(scale))
    monkeypatch.setattr(
        _measured, "features_of", lambda simspec: {"a": Feature(float(simspec.seeds.root), "a place")}
    )
    situation = made_simspec(0, "steady")
    seeds = [situation.seeds.model_copy(update={"root": scene}) for scene in range(SCENES)]
    situations = {f"s{seed.root}": situation.model_copy(update={"seeds": seed}) for seed in seeds}
    return replace(
        made,
        agents=("steady", "erratic"),
        scores=scores.cast({"achieved": pl.Int64, "considered": pl.Int64}),
        simspecs=situations,
    )


def measured(scene: int) -> float:
    """The logit of the panel's mean failure share, anew."""
    share = float(np.mean([1.0 / (1.0 + math.exp(-(a + (scene - 30) / 10.0))) for a in ABILITIES.values()]))
    return 50.0 + 10.0 * math.log(share / (1.0 - share))


def test_competence_ends_at_the_measured_difficulty_of_the_last_scene_that_passed(data: ReportData) -> None:
    result = _measured.measured_competence(data)
    steady, erratic = (result.tallies[agent, "all", "KA-18"] for agent in ("steady", "erratic"))
    assert (steady.passed, steady.considered) == (41, SCENES)
    ends = (steady.difficulty_low, steady.difficulty_high)
    assert ends == pytest.approx((measured(0), measured(59)), abs=1e-4)
    for rate in ("50", "90"):
        assert steady.competence[rate].value == pytest.approx(measured(40), abs=1e-4)
        assert measured(0) < steady.competence[rate].low <= steady.competence[rate].value
    # His failures do not rise, on whatever scale.
    assert erratic.competence == {}


def test_a_node_whose_scale_was_not_shown_to_predict_has_a_reason_in_its_place(data: ReportData) -> None:
    assert data.document is not None
    result = _measured.measured_competence(data)
    assert result.tally("steady", "KA-03") is None
    assert result.doubts["KA-03"] == "31 failures in 40 runs"
    assert result.doubts.keys() == set(data.document.key_attributes) - {"KA-18"}


def test_a_run_without_its_situation_is_left_out(data: ReportData) -> None:
    missing = {name: simspec for name, simspec in data.simspecs.items() if name not in ("s3", "s50")}
    tally = _measured.measured_competence(replace(data, simspecs=missing)).tally("steady", "KA-18")
    assert tally is not None
    assert (tally.passed, tally.considered) == (40, SCENES - 2)


def test_numbers_of_the_scale_stand_in_table_requirement_and_page(data: ReportData, tmp_path: Path) -> None:
    value = _measured.measured_competence(data).tallies["steady", "all", "KA-18"].competence["90"].value
    shown = load_report_data(tmp_path / "campaign")
    tallies = {
        (agent, "all", node): replace(tally, agent=agent, competence={})
        for (_, where, node), tally in shown.tallies.items()
        if where == "all"
        for agent in data.agents
    }
    data = replace(data, tallies=tallies)
    wanted: dict[str, Any] = {"steady": pytest.approx(value), "erratic": None}
    by_agent = {row["agent"]: row for row in requirements_table(data).to_dicts()}
    assert {agent: row["KA-18.measured_90"] for agent, row in by_agent.items()} == wanted
    rows = scores_table(data).filter(node="KA-18")
    assert dict(rows.select("agent", "measured_90").iter_rows()) == wanted
    page = render_report(data)
    assert "31 failures in 40 runs: KA-03" in page
    assert f"{value:.1f}" in page[page.index('id="measured"') :]


def test_a_scene_is_measured_once_for_all_its_runs(data: ReportData, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two agents in each scene: walks are as many as scenes, and every run has its difficulty."""
    calls: list[int] = []

    def counted(simspec: SimSpec) -> dict[str, Feature]:
        calls.append(simspec.seeds.root)
        return {"a": Feature(float(simspec.seeds.root), "a place")}

    monkeypatch.setattr(_measured, "features_of", counted)
    other = {
        f"{name}-again": simspec.model_copy(update={"agent": AgentSpec(manifest="null-idle")})
        for name, simspec in data.simspecs.items()
    }
    result = _measured.measured_competence(replace(data, simspecs={**data.simspecs, **other}))
    assert sorted(calls) == list(range(SCENES))
    assert result == _measured.measured_competence(data)


def test_a_decomposition_without_a_scale_says_nothing_of_it(tmp_path: Path) -> None:
    data = load_report_data(make_campaign(tmp_path / "campaign"))
    result = _measured.measured_competence(data)
    assert not result.tallies
    assert not result.doubts
    assert "measured scale" not in render_report(data)
