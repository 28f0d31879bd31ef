"""`rebar runs` lists runs by a condition; `rebar check` tells a pipeline by its exit code whether requirements hold."""

from __future__ import annotations

import shutil
from io import StringIO
from pathlib import Path

import polars as pl
import pytest
from command_line import FOG, Rebar, fly_surrogates

from bench.cli._app import run
from bench.reporting import load_report_data, requirements_table


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly_surrogates(tmp_path_factory.mktemp("asked"), design={"seed": 3, "factors": [FOG]})


def test_runs_are_listed_by_a_condition(flown: Path, rebar: Rebar) -> None:
    text = rebar("runs", flown, "--where", "fog >= 1 and agent == 'reference-naive'")
    assert "2 of 6 runs" in text
    assert "fog_level" in text
    table = pl.read_csv(StringIO(rebar("runs", flown, "--where", "fog > 1", "--csv")))
    assert table["fog_level"].to_list() == [2.0, 2.0]
    assert table.columns == pl.read_csv(flown / "runs.csv").columns
    assert len(rebar.json("runs", flown)) == 6
    assert "0 of 6 runs" in rebar("runs", flown, "--where", "fog > 9")
    refusal = rebar.refused("runs", flown, "--where", "fog >")
    assert "--where 'fog >': has its end where a value should be" in refusal
    assert run(["runs", str(flown), "--csv", "--json"]) == 2


def test_check_tells_by_its_exit_code(flown: Path, rebar: Rebar) -> None:
    low = min(requirements_table(load_report_data(flown))["responsible.passed.low"])
    below, above = f"responsible.passed.low >= {low}", f"responsible.passed.low > {low}"
    assert rebar("check", flown, "--require", below).count("holds: ") == 2
    assert f"NOT MET: {above} for " in rebar("check", flown, "--require", above, code=1)
    assert run(["check", str(flown), "--require", below, "--require", above]) == 1
    assert run(["check", str(flown), "--require", "agent == 'x'"]) == 1
    # Never given over three scenes: nothing shown meets no requirement.
    assert run(["check", str(flown), "--require", "responsible.competence_90 >= 0"]) == 1


def test_check_refuses_what_it_cannot_answer(flown: Path, tmp_path: Path, rebar: Rebar) -> None:
    assert "no column" in rebar.refused("check", flown, "--require", "KA-99.passed >= 1")
    assert run(["check", str(tmp_path), "--require", "KA-18.passed >= 1"]) == 2
    shutil.copytree(flown, tmp_path / "copy")
    with (tmp_path / "copy" / "scores.csv").open("a") as file:
        file.write("x")
    refusal = rebar.refused("check", tmp_path / "copy", "--require", "responsible.passed >= 0")
    assert "scores.csv: has changed" in refusal
