"""A fault in a user's measure costs its observable and no flight, and is corrected by scoring again."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from installed_packages import DECOMPOSITION, OUTSIDE

from bench.campaign import measure_all, open_journal
from bench.campaign.planning import _measures
from bench.contracts import MeasureRequest, Observation, Tape
from bench.simspec import load_simspec

ROOT = Path(__file__).parents[2]
CAMPAIGN = """
format: rebar.campaign/1
name: outside
base:
  name: outside
  world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 90, north_m: 0}, {east_m: 90, north_m: 90}]}, scene: outside_empty}
  vehicle: {model: outside_still}
agents: [{manifest: outside_agent}]
decomposition: decomposition.yaml
study: [KA-1]
design:
  seed: 1
  method: {kind: full_factorial}
  factors: [{name: height, unit: m, sets: [mission.altitude_m], levels: [20, 60]}]
"""


def prepared(site: Path, folder: Path, change: Callable[[str], str]) -> Path:
    """Installed packages, the source of that from outside changed, beside a campaign that measures with it: their place."""
    own = shutil.copytree(site, folder / "site")
    source = own / "rebar_outside" / "__init__.py"
    source.write_text(change(source.read_text()))
    (folder / "decomposition.yaml").write_text(DECOMPOSITION)
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    return own


def rebar(site: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(site)}
    command = [sys.executable, "-m", "bench.cli", *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_failing_measure_costs_its_observable_alone(site: Path, tmp_path: Path) -> None:
    """Every session is flown once and completes; run and report name the measure, its package and its line."""
    fault = 'raise KeyError("nothing of that name")'

    def spoil(source: str) -> str:
        head, body = source.split("@measure\ndef outside_height(")
        return f"{head}def outside_height(*arguments):\n    {fault}\n\n\n@measure\ndef unused({body}"

    own, out = prepared(site, tmp_path, spoil), tmp_path / "out"
    flown = rebar(own, "run", tmp_path / "campaign.yaml", "--out", out, "--workers", "1")
    assert flown.returncode == 3, flown.stderr
    installed = own / "rebar_outside" / "__init__.py"
    said = " ".join(flown.stdout.split())
    assert "MEASURE FAILED in 2 of 2 runs" in said
    assert f"outside_height of rebar-outside: KeyError: 'nothing of that name' ({installed}:" in said
    results = [json.loads(path.read_text()) for path in (out / "runs").glob("*/result.json")]
    assert {result["outcome"] for result in results} == {"completed"}
    assert {result["observations"][0]["considered"] for result in results} == {False}
    assert "outside_height of rebar-outside: KeyError" in (out / "report.html").read_text()

    installed.write_text((OUTSIDE / "rebar_outside" / "__init__.py").read_text())
    scored = rebar(own, "score", out)
    assert scored.returncode == 0, scored.stdout + scored.stderr
    assert "MEASURE FAILED" not in scored.stdout
    with open_journal(out / "journal.sqlite") as journal:
        assert [entry.attempts for entry in journal.entries()] == [1] * 2


def test_an_answer_that_is_no_observation_is_a_failure_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a measure that works, whose observation stays."""
    right = Observation(observable="OBS-2", considered=True, x=0.5)
    answers = {"wrong": lambda *arguments: 0.5, "right": lambda *arguments: right}
    monkeypatch.setattr(_measures, "load_plugin", lambda group, name: answers[name])
    monkeypatch.setattr(_measures, "package_of", lambda group, name: "my-package")
    none = np.zeros(0)
    tape = Tape((), none, none, none, none, none)
    requests: dict[str, MeasureRequest] = {"OBS-1": ("wrong", {}), "OBS-2": ("right", {})}
    failed, kept = measure_all(requests, tape, load_simspec(ROOT / "examples" / "search.yaml"))
    assert kept == right
    assert not failed.considered
    assert failed.failure.startswith(
        "wrong of my-package: TypeError: the measure returned float, not an Observation"
    )


def test_a_package_that_cannot_be_imported_is_named_before_anything_flies(site: Path, tmp_path: Path) -> None:
    """With the line at which its import ends."""
    own = prepared(site, tmp_path, lambda source: source + "\nimport not_installed_anywhere\n")
    done = rebar(own, "run", tmp_path / "campaign.yaml", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert (
        "of rebar-outside cannot be imported: ModuleNotFoundError: No module named 'not_installed_anywhere'"
        in done.stderr
    )
    assert not (tmp_path / "out" / "runs").exists()
