"""What the command line shows about a design before anything is flown."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import json_of

from bench.cli._app import run

EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"
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


def test_dry_run_and_realize_measure_the_design(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """For people in sentences, for machines in full; realize writes the SimSpecs beside."""
    campaign = tmp_path / "small.yaml"
    campaign.write_text(CAMPAIGN)

    assert run(["run", str(campaign), "--dry-run"]) == 0
    output = capsys.readouterr().out
    assert "8 realizations of 4 design points" in output
    assert "largest correlation 0\n" in output
    assert "4 of 4 for t = 2" in output
    assert "in configuration KA-03=" in output
    document = json_of(["run", str(campaign), "--dry-run", "--json"], capsys)
    assert (document["realizations"], document["design"]["points"]) == (8, 4)
    realized = json_of(["realize", str(campaign), "--out", str(tmp_path / "scenes"), "--json"], capsys)
    assert realized["design"] == document["design"]
    assert len(realized["written"]) == len(list((tmp_path / "scenes" / "simspecs").iterdir())) == 8


def test_levels_that_do_not_fit_are_faults(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A formula out of a field's bounds names factor, level, path and bounds; an expression names file and line."""
    campaign = tmp_path / "small.yaml"
    campaign.write_text(CAMPAIGN.replace("fog / 4", "fog * 10"))
    assert run(["run", str(campaign), "--dry-run"]) == 2
    assert "factor 'haze': level 40.0 for environment.rain_level" in capsys.readouterr().err
    campaign.write_text(CAMPAIGN.replace("fog / 4", "fgo * 10"))
    assert run(["run", str(campaign), "--dry-run"]) == 2
    output = capsys.readouterr().err
    assert "small.yaml:6" in output
    assert "names 'fgo', which is not a factor" in output
