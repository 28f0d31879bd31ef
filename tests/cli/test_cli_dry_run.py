"""What the command line shows before anything is flown: the design, and outcomes, cost and power by surrogates."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import EXAMPLE, Rebar

DEMO = Path(__file__).parents[2] / "campaigns" / "demo.yaml"
CAMPAIGN = f"""
format: rebar.campaign/1
name: small
base_file: {EXAMPLE}
agents: [{{manifest: reference-naive}}, {{manifest: reference-bystander-aware}}]
design:
  factors:
    - {{name: fog, levels: [0, 4], sets: [environment.fog_level]}}
    - {{name: concealment, levels: [0.5, 1.0], sets: ['actors[radar].concealment']}}
    - {{name: haze, formula: fog / 4, sets: [environment.rain_level]}}
"""


def test_dry_run_and_realize_measure_the_design(tmp_path: Path, rebar: Rebar) -> None:
    """For people in sentences, for machines in full; realize writes the SimSpecs beside."""
    campaign = tmp_path / "small.yaml"
    campaign.write_text(CAMPAIGN)
    output = rebar("run", campaign, "--dry-run")
    assert "8 realizations of 4 design points" in output
    assert "largest correlation 0\n" in output
    assert "4 of 4 for t = 2" in output
    assert "in configuration KA-03=" in output
    document = rebar.json("run", campaign, "--dry-run")
    assert (document["realizations"], document["design"]["points"]) == (8, 4)
    realized = rebar.json("realize", campaign, "--out", tmp_path / "scenes")
    assert realized["design"] == document["design"]
    assert len(realized["written"]) == len(list((tmp_path / "scenes" / "simspecs").iterdir())) == 8


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("fog * 10", ["factor 'haze': level 40.0 for environment.rain_level"]),
        ("fgo * 10", ["small.yaml:6", "names 'fgo', which is not a factor"]),
    ],
)
def test_levels_that_do_not_fit(formula: str, words: list[str], tmp_path: Path, rebar: Rebar) -> None:
    """A formula out of a field's bounds names factor, level, path and bounds; an expression names file and line."""
    (tmp_path / "small.yaml").write_text(CAMPAIGN.replace("fog / 4", formula))
    refusal = rebar.refused("run", tmp_path / "small.yaml", "--dry-run")
    assert [part for part in words if part not in refusal] == []


def test_dry_run_estimates_outcome_cost_and_power(tmp_path: Path, rebar: Rebar) -> None:
    campaign = tmp_path / "some.yaml"
    campaign.write_text(DEMO.read_text().replace("take: 12", "take: 5"))
    line = ["run", campaign, "--dry-run", "--workers", "2", "--session-s", "30"]
    output = rebar(*line)
    assert "OVERHEAD FIDELITY (10 realizations): 10 completed" in output
    assert "30.0 s a session, about 2 min on 2 worker(s)" in output
    assert "not computed at this fidelity" not in output
    assert " MB\n" in output
    estimate = rebar.json(*line)["estimate"]
    assert (estimate["realizations"], estimate["flown"], estimate["wall_s"]) == (10, 10, 150.0)
    # 8 kB a simulated second and 60 kB a run; ten sessions of some five minutes.
    assert estimate["disk_mb"] == pytest.approx((estimate["simulated_s"] * 8e3 + 10 * 6e4) / 1e6, abs=0.1)
    assert 10.0 < estimate["disk_mb"] < 40.0
    assert not estimate["records_pictures"]
    marking = {node["agent"]: node["pass_rate"] for node in estimate["nodes"] if node["node"] == "KA-18"}
    assert marking["reference-naive"] < marking["reference-bystander-aware"]
    (pair,) = (pair for pair in estimate["pairs"] if pair["node"] == "KA-18")
    assert pair["only_second"] > pair["only_first"] == 0.0
    assert pair["power"] < 0.8 < 1.0 == pair["only_second"]  # five pairs cannot settle it, however they end
    assert pair["pairs"] == 5 < pair["pairs_needed"]
    assert not (tmp_path / "out").exists()


def test_dry_run_says_why_nothing_can_be_foretold(tmp_path: Path, rebar: Rebar) -> None:
    """An agent of one's own flies, but nobody wrote a surrogate for it."""
    manifest, campaign = tmp_path / "mine.yaml", tmp_path / "campaign.yaml"
    manifest.write_text("name: mine\ncommand: ['{python}', -c, pass]\npace: [lockstep]\n")
    text = DEMO.read_text().replace("manifest: reference-naive", f"manifest: {manifest}")
    campaign.write_text(text.replace("take: 12", "take: 2"))
    assert "no estimate: agents: 'mine' has no surrogate" in rebar("run", campaign, "--dry-run")
