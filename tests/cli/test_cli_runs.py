"""`rebar runs` lists runs by a condition; `rebar check` tells a pipeline by its exit code whether requirements hold."""

from __future__ import annotations

import shutil
from io import StringIO
from pathlib import Path

import polars as pl
import pytest
import yaml
from command_line import FOG, SURROGATES, json_of

from bench.cli._app import run
from bench.reporting import load_report_data, requirements_table


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("asked")
    (folder / "campaign.yaml").write_text(
        yaml.safe_dump(SURROGATES | {"design": {"seed": 3, "factors": [FOG]}})
    )
    assert run(["run", str(folder / "campaign.yaml"), "--out", str(folder / "out"), "--workers", "1"]) == 0
    return folder / "out"


def test_runs_are_listed_by_a_condition(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As a table with the words that were asked, as CSV and as JSON with all of them."""
    capsys.readouterr()
    assert run(["runs", str(flown), "--where", "fog >= 1 and agent == 'reference-naive'"]) == 0
    text = capsys.readouterr().out
    assert "2 of 6 runs" in text
    assert "fog_level" in text
    assert run(["runs", str(flown), "--where", "fog > 1", "--csv"]) == 0
    table = pl.read_csv(StringIO(capsys.readouterr().out))
    assert table["fog_level"].to_list() == [2.0, 2.0]
    assert table.columns == pl.read_csv(flown / "runs.csv").columns
    assert len(json_of(["runs", str(flown), "--json"], capsys)) == 6
    assert run(["runs", str(flown), "--where", "fog > 9"]) == 0
    assert "0 of 6 runs" in capsys.readouterr().out
    assert run(["runs", str(flown), "--where", "fog >"]) == 2
    assert "--where 'fog >': has its end where a value should be" in capsys.readouterr().err
    assert run(["runs", str(flown), "--csv", "--json"]) == 2


@pytest.mark.parametrize("word", ["or", "and"])
def test_a_condition_of_thousands_of_comparisons_is_answered(
    flown: Path, capsys: pytest.CaptureFixture[str], word: str
) -> None:
    """A script may name each run by itself; two thousand comparisons in one expression took minutes."""
    condition = f" {word} ".join(["(fog > 1)"] * 3000)
    assert run(["runs", str(flown), "--where", condition]) == 0
    assert "2 of 6 runs" in capsys.readouterr().out


@pytest.mark.parametrize("part", ["(", "not "])
def test_a_condition_with_thousands_of_brackets_is_refused(
    flown: Path, capsys: pytest.CaptureFixture[str], part: str
) -> None:
    """In one line of moderate length, with what to do."""
    assert run(["runs", str(flown), "--where", part * 5000 + "fog > 1" + ")" * 5000 * (part == "(")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "is nested deeper than 40 (leave out brackets)" in line
    assert len(line) < 300


def test_check_tells_by_its_exit_code(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0 where all requirements hold for every agent, 1 where one does not, both sides of the boundary."""
    low = min(requirements_table(load_report_data(flown))["responsible.passed.low"])
    below, above = f"responsible.passed.low >= {low}", f"responsible.passed.low > {low}"
    assert run(["check", str(flown), "--require", below]) == 0
    assert capsys.readouterr().out.count("holds: ") == 2
    assert run(["check", str(flown), "--require", above]) == 1
    assert f"NOT MET: {above} for " in capsys.readouterr().out
    assert run(["check", str(flown), "--require", below, "--require", above]) == 1
    assert run(["check", str(flown), "--require", "agent == 'x'"]) == 1
    # Never given over three scenes: nothing shown meets no requirement.
    assert run(["check", str(flown), "--require", "responsible.competence_90 >= 0"]) == 1


def test_check_refuses_what_it_cannot_answer(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unknown word, no campaign, and a folder that was changed; test_cli_missing_runs.py has what is incomplete."""
    assert run(["check", str(flown), "--require", "KA-99.passed >= 1"]) == 2
    assert "no column" in capsys.readouterr().err
    assert run(["check", str(tmp_path), "--require", "KA-18.passed >= 1"]) == 2
    shutil.copytree(flown, tmp_path / "copy")
    with (tmp_path / "copy" / "scores.csv").open("a") as file:
        file.write("x")
    assert run(["check", str(tmp_path / "copy"), "--require", "responsible.passed >= 0"]) == 2
    assert "scores.csv: has changed" in capsys.readouterr().err
