"""What the report says of a campaign's design."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from made_campaign import Made, make_campaign

from bench.reporting import ReportData, load_report_data, render_report
from bench.reporting.statistics._design_quality import campaign_design_points, campaign_design_quality


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    return load_report_data(make_campaign(tmp_path_factory.mktemp("made"), Made()))


def test_report_measures_the_design(data: ReportData) -> None:
    """Six combinations of two balanced factors: no correlation, every pair of levels covered, points counted
    by configuration.
    """
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
    """A damaged design, one without factors and one that cannot be drawn again lose their section and nothing else."""
    rated = {**data.campaign["design"], "method": {"kind": "stratified", "points": 6}}

    for design in ({"factors": 3}, {}, rated):
        damaged = replace(data, campaign={**data.campaign, "design": design})
        assert campaign_design_quality(damaged) is None
        assert "Quality of the design" not in render_report(damaged)
    assert campaign_design_points(replace(data, campaign={**data.campaign, "design": rated})) is None


def test_design_points_of_a_stratified_design_are_reconstructed(tmp_path: Path) -> None:
    """The report draws the points that the campaign flew, from the base and decomposition of the campaign."""
    from bench.campaign import Campaign, realizations
    from bench.simspec import load_simspec

    root = Path(__file__).parents[2]
    design = {
        "seed": 3,
        "method": {"kind": "stratified", "points": 8, "candidates": 40, "band": 20},
        "factors": [
            {"name": "fog", "range": {"low": 0, "high": 9}, "sets": ["environment.fog_level"]},
            {"name": "rain", "range": {"low": 0, "high": 9}, "sets": ["environment.rain_level"]},
        ],
    }
    campaign = Campaign.model_validate(
        {
            "name": "even",
            "base": load_simspec(root / "examples" / "search.yaml"),
            "agents": [{}],
            "design": design,
        }
    )
    plans = realizations(campaign)
    folder = make_campaign(tmp_path, Made())
    from decompositions import load_decomposition

    decomposition = load_decomposition("search-and-report")
    points = campaign_design_points(
        replace(
            load_report_data(folder),
            campaign=campaign.model_dump(mode="json"),
            document=decomposition,
            study=decomposition.study,
        )
    )

    assert points is not None
    assert [(point.id, dict(point.levels)) for point in points] == [
        (plan.design_point, dict(plan.levels)) for plan in plans
    ]


def test_formulas_and_conditions_are_listed_with_the_factors(data: ReportData) -> None:
    """A derived factor is listed with its formula, a conditional one with its condition."""
    factors = [
        *data.campaign["design"]["factors"],
        {"name": "haze", "formula": "fog / 2", "sets": ["environment.rain_level"]},
        {"name": "wind", "levels": [1, 2], "when": "fog > 1", "sets": ["environment.wind.speed_mps"]},
    ]
    page = render_report(
        replace(data, campaign={**data.campaign, "design": {**data.campaign["design"], "factors": factors}})
    )

    assert "fog / 2" in page
    assert "1, 2 when fog &gt; 1" in page
