"""What a dry run estimates: outcomes, cost and power by surrogates, or why it cannot."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import json_of

from bench.cli._app import run

DEMO = Path(__file__).parents[2] / "campaigns" / "demo.yaml"


def test_dry_run_estimates_outcome_cost_and_power(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = tmp_path / "some.yaml"
    campaign.write_text(DEMO.read_text().replace("take: 12", "take: 5"))

    assert run(["run", str(campaign), "--dry-run", "--workers", "2", "--session-s", "30"]) == 0
    output = capsys.readouterr().out
    assert "OVERHEAD FIDELITY (10 realizations): 10 completed" in output
    assert "30.0 s a session, about 2 min on 2 worker(s)" in output
    assert "not computed at this fidelity" not in output
    assert " MB\n" in output
    estimate = json_of(
        ["run", str(campaign), "--dry-run", "--workers", "2", "--session-s", "30", "--json"], capsys
    )["estimate"]
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


def test_dry_run_says_why_nothing_can_be_foretold(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An agent of one's own flies, but nobody wrote a surrogate for it."""
    manifest = tmp_path / "agents" / "mine.yaml"
    manifest.parent.mkdir()
    manifest.write_text("name: mine\ncommand: ['{python}', -c, pass]\npace: [lockstep]\n")
    campaign = tmp_path / "mine.yaml"
    text = DEMO.read_text().replace("manifest: reference-naive", f"manifest: {manifest}")
    campaign.write_text(text.replace("take: 12", "take: 2"))

    assert run(["run", str(campaign), "--dry-run"]) == 0

    assert "no estimate: agents: 'mine' has no surrogate" in capsys.readouterr().out
