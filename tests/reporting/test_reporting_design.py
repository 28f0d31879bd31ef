"""What the report says of a campaign's design."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from made_campaign import Made, make_campaign

from bench.campaign import Campaign, campaign_quality, realizations
from bench.difficulty import features_of, shipped_scale
from bench.errors import SetupError
from bench.realization import place
from bench.reporting import ReportData, load_report_data, render_report
from bench.reporting.statistics._design_quality import campaign_design_points, campaign_design_quality
from bench.simspec import load_simspec
from decompositions import load_decomposition

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    return load_report_data(make_campaign(tmp_path_factory.mktemp("made"), Made()))


def test_report_measures_the_design(data: ReportData) -> None:
    """Six combinations of two balanced factors: no correlation, every pair of levels covered."""
    quality = campaign_design_quality(data)
    assert quality is not None
    assert (quality.points, quality.max_abs_correlation) == (6, 0.0)
    assert [(pair.covered, pair.possible) for pair in quality.coverage] == [(6, 6)]
    flown = {run.design_point for run in data.runs}
    assert sum(quality.configurations.values()) == len(flown)
    assert set(quality.configurations) == {configuration.label for configuration in data.configurations}
    page = render_report(data)
    assert "Quality of the design" in page
    assert "6 of 6 that may occur" in page


def test_unreadable_design_is_omitted(data: ReportData) -> None:
    rated = {**data.campaign["design"], "method": {"kind": "stratified", "points": 6}}
    for design in ({"factors": 3}, {}, rated):
        damaged = replace(data, campaign={**data.campaign, "design": design})
        assert campaign_design_quality(damaged) is None
        assert "Quality of the design" not in render_report(damaged)
    assert campaign_design_points(replace(data, campaign={**data.campaign, "design": rated})) is None


def test_design_points_of_a_stratified_design_are_reconstructed(data: ReportData) -> None:
    """The report draws the points that the campaign flew, from the base and decomposition of the campaign."""
    design = {
        "seed": 3,
        "method": {"kind": "stratified", "points": 8, "candidates": 40, "band": 20},
        "factors": [
            {"name": "fog", "range": {"low": 0, "high": 9}, "sets": ["environment.fog_level"]},
            {"name": "rain", "range": {"low": 0, "high": 9}, "sets": ["environment.rain_level"]},
        ],
    }
    base = load_simspec(ROOT / "examples" / "search.yaml")
    campaign = Campaign.model_validate({"name": "even", "base": base, "agents": [{}], "design": design})
    decomposition = load_decomposition("search-and-report")
    data = replace(data, document=decomposition, study=decomposition.study)
    points = campaign_design_points(replace(data, campaign=campaign.model_dump(mode="json")))
    assert points is not None
    flown = [(plan.design_point, dict(plan.levels)) for plan in realizations(campaign)]
    assert [(point.id, dict(point.levels)) for point in points] == flown


def measured_campaign(study: str, **method: object) -> dict[str, Any]:
    factors = {
        "time": ("mission.time_limit_s", 190, 420),
        "height": ("mission.altitude_m", 41, 75),
        "fog": ("environment.fog_level", 0, 5),
    }
    return {
        "name": "spread",
        "base": load_simspec(ROOT / "campaigns" / "panel" / "situation.yaml"),
        "agents": [{}],
        "decomposition": "search-and-report-full",
        "study": [study],
        "design": {
            "method": {"kind": "stratified", "scale": "measured", "points": 6, "candidates": 18, **method},
            "factors": [
                {"name": name, "range": {"low": low, "high": high}, "sets": [path]}
                for name, (path, low, high) in factors.items()
            ],
        },
    }


def test_a_design_is_spread_over_measured_difficulty() -> None:
    """Bands take turns, and every point lies in the range: measured anew from each situation with its own places."""
    scale = shipped_scale(load_decomposition("search-and-report-full"))
    assert scale is not None
    # The one that the time limit moves most.
    proved = {
        name: model.weights.get("time", 0.0) for name, model in scale.nodes.items() if not model.unproved
    }
    node = max(proved, key=lambda name: abs(proved[name]))
    campaign = Campaign.model_validate(measured_campaign(node, band=10.0, above=20.0, up_to=70.0))
    difficulties = [
        scale.measure(node, features_of(place(plan.situation))).difficulty for plan in realizations(campaign)
    ]
    assert len(difficulties) == 6
    assert all(20.0 < difficulty <= 70.0 for difficulty in difficulties)
    counts = Counter(math.ceil(difficulty / 10.0) for difficulty in difficulties)
    assert len(counts) >= 3
    assert max(counts.values()) - min(counts.values()) <= 1
    quality = campaign_quality(campaign)
    tensions = {max(1, math.ceil(difficulty / 20.0)) for difficulty in difficulties}
    assert set(quality.configurations) == {f"{node}={tension} (tensions, measured)" for tension in tensions}


def test_a_design_cannot_be_spread_over_what_was_not_shown_to_predict() -> None:
    scale = shipped_scale(load_decomposition("search-and-report-full"))
    assert scale is not None
    doubtful = next(name for name, model in scale.nodes.items() if model.unproved)
    with pytest.raises(SetupError, match=f"not shown to predict {doubtful}, which is under study"):
        realizations(Campaign.model_validate(measured_campaign(doubtful)))
    without = {**measured_campaign("KA-18"), "decomposition": "search-and-report"}
    with pytest.raises(SetupError, match=r"no scale ships for search-and-report \("):
        realizations(Campaign.model_validate(without))


def test_formulas_and_conditions_are_listed_with_the_factors(data: ReportData) -> None:
    factors = [
        *data.campaign["design"]["factors"],
        {"name": "haze", "formula": "fog / 2", "sets": ["environment.rain_level"]},
        {"name": "wind", "levels": [1, 2], "when": "fog > 1", "sets": ["environment.wind.speed_mps"]},
    ]
    campaign = {**data.campaign, "design": {**data.campaign["design"], "factors": factors}}
    page = render_report(replace(data, campaign=campaign))
    assert "fog / 2" in page
    assert "1, 2 when fog &gt; 1" in page
