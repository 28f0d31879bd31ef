"""What follows a finished campaign. The runs are made up, so that what matters in them is known."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign_fakes import known

from bench.campaign import (
    Campaign,
    CampaignProposal,
    load_campaign,
    load_measurable_decomposition,
    open_journal,
    propose_next,
    realizations,
)
from bench.cli._app import run
from bench.contracts import Observation, Outcome, SessionResult
from bench.documents import dump_json, dump_yaml, read_document
from bench.errors import SetupError
from bench.scoring import ScoredRun, difficulty_of, score_table
from bench.simspec import load_simspec

BASE = load_simspec(Path(__file__).parents[2] / "examples" / "search.yaml")
DECOMPOSITION = load_measurable_decomposition("search-and-report")
FOG = {"name": "fog", "unit": "level", "range": {"low": 0, "high": 8}, "sets": ["environment.fog_level"]}
RAIN = {"name": "rain", "levels": [0, 1, 2, 3], "sets": ["environment.rain_level"]}
WIND = {"name": "wind", "range": {"low": 0, "high": 6, "steps": 2}, "sets": ["environment.wind.speed_mps"]}
SPEED = {"name": "speed", "levels": [8.0, 12.0], "sets": ["mission.speed_mps"]}

Chance = Callable[[Mapping[str, Any]], float]


def finished(folder: Path, chance: Chance, **design: Any) -> Path:
    """A campaign's folder in which each run passes everything or nothing, with a chance that its levels decide."""
    campaign = Campaign.model_validate(
        {
            "name": "made-up",
            "base": BASE,
            "agents": [{"manifest": "reference-naive"}],
            "design": design,
            "study": ["KA-03", "KA-20"],
        }
    )
    draws = np.random.default_rng(11)
    difficulty = difficulty_of(DECOMPOSITION, BASE)
    runs = []
    for plan in realizations(campaign):
        x = 1.0 if draws.random() < chance(plan.levels) else 0.0
        observations = tuple(
            Observation(observable=observable, considered=True, x=x)
            for observable in DECOMPOSITION.observables
        )
        result = SessionResult(realization=plan.id, outcome=Outcome.COMPLETED, observations=observations)
        (folder / "runs" / plan.id).mkdir(parents=True)
        (folder / "runs" / plan.id / "result.json").write_text(dump_json(result))
        of_plan = (plan.id, plan.design_point, plan.replicate, plan.agent)
        runs.append(ScoredRun(*of_plan, result.outcome, difficulty, observations))
    (folder / "campaign.yaml").write_text(dump_yaml(campaign))
    with open_journal(folder / "journal.sqlite"):
        pass
    (folder / "decomposition.yaml").write_text(dump_yaml(DECOMPOSITION.document))
    score_table(DECOMPOSITION, runs, campaign.study).write_parquet(folder / "scores.parquet")
    return folder


def proposed(folder: Path, chance: Chance, **design: Any) -> CampaignProposal:
    """What is proposed after such a campaign."""
    return propose_next(finished(folder, chance, **design))


def reasons(proposal: CampaignProposal) -> str:
    """The file of a proposal in one line; its comments wrap anywhere."""
    return " ".join(proposal.text.replace("#", "").split())


def names(proposal: CampaignProposal) -> list[str]:
    return [factor.name for factor in proposal.campaign.design.factors]


def turning(factor: str, at: float, steepness: float) -> Chance:
    """Passing turns to failing where one factor passes a value; below a steepness of 0, failing to passing."""
    return lambda levels: 1.0 / (1.0 + math.exp(steepness * (float(levels[factor]) - at)))


STEEP = turning("fog", 3.0, 3.0)


@pytest.fixture(scope="module")
def foggy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    method = {"kind": "sobol", "points": 128}
    return finished(
        tmp_path_factory.mktemp("foggy"), STEEP, factors=[FOG, WIND, SPEED], method=method, seed=11
    )


def test_what_matters_stays_and_narrows_and_what_does_not_goes(foggy: Path) -> None:
    """The boundary is in the proposed range, most of what is plainly passed or failed is not, and both idle
    factors are gone. Reasons are comments; the rest of the text is the proposal, to the last number.
    """
    proposal = propose_next(foggy)
    (fog,) = proposal.campaign.design.factors

    assert fog.name == "fog"
    assert fog.range is not None
    assert 0.5 < fog.range.low < 3.0 < fog.range.high < 5.5
    assert {change.split(":")[0] for change in proposal.changes} == {"fog", "wind", "speed"}
    assert proposal.campaign.design.seed == 12
    assert proposal.campaign.name == "made-up-next"
    assert proposal.campaign.base == BASE
    assert read_document(proposal.text, Campaign) == proposal.campaign
    for reason in (
        "wind: removed: no test shows an effect",
        "environment.wind.speed_mps keeps the value of the base",
        "fog: confidence of KA-03 of reference-naive may follow fog (anova, adjusted p < 0.001)",
    ):
        assert reason in reasons(proposal)
    assert propose_next(foggy).text == proposal.text


def test_whole_numbers_stay_whole_in_a_narrower_range(tmp_path: Path) -> None:
    """Levels with which passing rises keep their number; steps become as many as there are whole numbers left."""
    rain = {"name": "rain", "sets": ["environment.rain_level"]}
    listed = {**rain, "levels": [0, 1, 2, 3, 4, 5, 6, 7, 8]}
    stepped = {**rain, "range": {"low": 0, "high": 8, "steps": 9, "integer": True}}
    (levels,), (steps,) = (
        proposed(tmp_path / name, chance, factors=[factor], replicates=12).campaign.design.factors
        for name, chance, factor in (
            ("listed", turning("rain", 6.0, -4.0), listed),
            ("stepped", turning("rain", 4.0, 4.0), stepped),
        )
    )

    assert all(isinstance(level, int) for level in levels.levels)
    assert 3 <= min(map(int, levels.levels)) < 6 < max(map(int, levels.levels)) <= 8
    assert steps.range is not None
    assert 8 > steps.range.high - steps.range.low + 1 == steps.range.steps


def test_little_known_asks_for_replicates_and_screening_is_left(tmp_path: Path) -> None:
    """Twelve runs say little: more of them, at most fourfold; and after a screening the whole of what remains."""
    proposal = proposed(
        tmp_path,
        lambda levels: 0.9 if levels["speed"] == 8.0 else 0.1,
        factors=[SPEED, WIND],
        method={"kind": "plackett_burman"},
        replicates=3,
    )

    assert proposal.campaign.design.method.kind == "full_factorial"
    assert 3 < proposal.campaign.design.replicates <= 12
    assert any("screening is done" in change for change in proposal.changes)
    assert "points wide over" in reasons(proposal)


def test_nothing_tells_factors_apart_where_all_pass(tmp_path: Path) -> None:
    """That no run failed is no evidence that factors are idle: they stay, and it is said why."""
    proposal = proposed(tmp_path, lambda _: 1.0, factors=[RAIN, WIND], replicates=8)

    assert names(proposal) == ["rain", "wind"]
    assert "could not be tested" in reasons(proposal)


def test_what_few_runs_cannot_rule_out_stays(tmp_path: Path) -> None:
    """That no test finds an idle factor in 24 runs is no evidence that it is idle; in 256 it can be."""
    factors = [{**FOG, "range": {"low": 0, "high": 8, "steps": 2}}, WIND, SPEED]
    few, many = (
        proposed(
            tmp_path / str(runs),
            lambda levels: 0.8 if float(levels["fog"]) < 4 else 0.2,
            factors=factors,
            replicates=runs,
        )
        for runs in (3, 32)
    )

    assert names(few) == ["fog", "wind", "speed"]
    assert re.search(
        r"24 runs do not rule out a difference of \d+ points in KA-\d\d of reference-naive .* would rule out 25",
        reasons(few),
    )
    assert {"fog"} <= set(names(many)) <= {"fog", "wind"}
    assert "the least certain one, is ruled out between its levels (95 %)" in reasons(many)


def test_what_follows_by_a_formula_is_part_of_its_factor(tmp_path: Path) -> None:
    """Gusts that follow wind leave wind's own effect to be had, and ruled out."""
    gusts = {"name": "gusts", "formula": "wind / 3", "sets": ["environment.wind.turbulence_mps"]}
    method = {"kind": "sobol", "points": 32}
    text = reasons(proposed(tmp_path, STEEP, factors=[FOG, WIND, gusts], method=method, seed=11))

    assert "gusts: follows from other factors" in text
    assert re.search(r"wind: stays: .* 32 runs do not rule out a difference of [2-9]\d points in", text)


def test_a_boundary_that_few_runs_show_is_told_and_not_cut_to(tmp_path: Path) -> None:
    """The curve through 20 runs turns within the range, its band does not rule the rest out."""
    method = {"kind": "sobol", "points": 20}
    proposal = proposed(tmp_path, turning("fog", 3.0, 2.0), factors=[FOG], method=method, seed=11)

    fog = known(proposal.campaign.design.factors[0].range)
    assert (fog.low, fog.high) == (0.0, 8.0)
    assert re.search(
        r"fog: stays 0 \.\.\. 8: a logistic curve puts .* but its 95 % band is wider", reasons(proposal)
    )


def test_two_values_show_no_boundary_and_aliases_are_told(tmp_path: Path) -> None:
    """Between two values flown only the curve's own shape says where passing turns; a quarter of 2^5 blurs
    main effects.
    """
    rain = {"name": "rain", "range": {"low": 0, "high": 8}, "sets": ["environment.rain_level"]}
    height = {"name": "height", "levels": [60.0, 90.0], "sets": ["mission.altitude_m"]}
    proposal = proposed(
        tmp_path,
        lambda levels: 0.9 - 0.1 * levels["fog"],
        factors=[FOG, rain, WIND, SPEED, height],
        method={"kind": "fractional_factorial", "runs": 8},
        replicates=8,
    )

    fog = known(proposal.campaign.design.factors[0].range)
    assert (fog.low, fog.high) == (0.0, 8.0)
    assert "passes of KA-03 of reference-naive may follow fog" in reasons(proposal)
    assert "fog: these design points cannot separate it from rain x height" in proposal.text
    assert "null" not in proposal.text.split("base:")[0]


def test_a_factor_that_others_need_stays(tmp_path: Path) -> None:
    """Nothing follows wind, but what is forbidden names it."""
    forbid = ["wind > 5 and fog > 7.5"]
    method = {"kind": "sobol", "points": 128}
    proposal = proposed(tmp_path, STEEP, factors=[FOG, WIND, SPEED], forbid=forbid, method=method)

    assert "wind" in names(proposal)
    assert proposal.campaign.design.forbid == tuple(forbid)


def test_command_writes_a_file_that_runs_and_never_another_s(
    foggy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file loads as a campaign from where it lies; one that is there already is left alone; without --out
    it is printed.
    """
    out = tmp_path / "deep" / "next.yaml"
    out.parent.mkdir()

    assert run(["next", str(foggy), "--out", str(out)]) == 0
    assert "wind: removed" in capsys.readouterr().out
    campaign = load_campaign(out)
    assert load_measurable_decomposition(campaign.decomposition).digest == DECOMPOSITION.digest
    assert realizations(campaign)
    written = out.read_bytes()
    assert run(["next", str(foggy), "--out", str(out)]) == 2
    assert "already exists and is not overwritten" in capsys.readouterr().err
    assert out.read_bytes() == written
    assert run(["next", str(foggy)]) == 0
    assert read_document(capsys.readouterr().out, Campaign).name == "made-up-next"


def test_campaigns_from_which_nothing_follows(tmp_path: Path) -> None:
    """Not finished, no factors, no campaign: refused with what to do."""
    with pytest.raises(SetupError, match="is not the folder of a campaign"):
        propose_next(tmp_path)
    whole = finished(tmp_path / "a", lambda _: 1.0, factors=[SPEED])
    next((whole / "runs").rglob("result.json")).unlink()
    with pytest.raises(SetupError, match="1 realizations without a result"):
        propose_next(whole)
    with pytest.raises(SetupError, match="varies no factor"):
        proposed(tmp_path / "b", lambda _: 1.0)


def test_a_conditional_range_that_matters_narrows_by_the_runs_in_which_it_is_active(tmp_path: Path) -> None:
    """Fog where it is switched on decides; the switch by itself does not, and inactive runs do not move the boundary."""
    switch = {"name": "weather", "levels": [8.0, 12.0], "sets": ["mission.speed_mps"]}
    fog = {**FOG, "when": "weather == 12.0"}
    proposal = proposed(
        tmp_path,
        lambda levels: 0.5 if levels["fog"] == "inactive" else STEEP(levels),
        factors=[switch, fog, WIND],
        method={"kind": "sobol", "points": 128},
        seed=5,
    )
    factors = {factor.name: factor for factor in proposal.campaign.design.factors}

    assert factors["fog"].range is not None
    assert 0.1 < factors["fog"].range.low < 3.0 < factors["fog"].range.high < 6.0
    assert factors["fog"].when == "weather == 12.0"
    assert "weather" in factors
