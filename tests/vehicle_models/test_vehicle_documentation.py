"""The tables of commands and parameters in docs/ are what the code gives."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from vehicle_client import Client, mavlink, simspec

from vehicle_models import documentation
from vehicle_models.controller.links._enums import MAV_CMD
from vehicle_models.documentation import (
    COMMANDS_PAGE,
    CONFORMANCE,
    PARAMETERS_PAGE,
    VERDICTS,
    command_table,
    main,
    with_parameters,
)

Make = Callable[..., Client]
CELLS_BY_COMMAND = {
    MAV_CMD[name.strip("`")]: (px4, ardupilot)
    for name, px4, ardupilot in (row.strip("| ").split(" | ")[1:] for row in command_table().splitlines()[2:])
}


def test_the_pages_are_up_to_date(capsys: pytest.CaptureFixture[str]) -> None:
    """`python -m vehicle_models.documentation` would change nothing."""
    assert main(["--check"]) == 0, capsys.readouterr().err


def test_every_parameter_with_an_effect_is_described() -> None:
    """The references list no descriptions, so each of those is written by hand in `parameters.csv`."""
    rows = re.findall(
        r"^\| `(\w+)` \| [^|]+ \|([^|]*)\| [^|]+ \|$", PARAMETERS_PAGE.read_text("utf-8"), re.MULTILINE
    )
    assert len(rows) > 100
    assert [name for name, description in rows if not description.strip()] == []


def test_out_of_date_pages_are_found_and_updated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A cell that changed on the page only comes back; the words around the tables stay."""
    changes = {
        "COMMANDS_PAGE": ("`DO_ORBIT` | carried out", "`DO_ORBIT` | ACCEPTED"),
        "PARAMETERS_PAGE": ("| 4.05 |", "| 4.2 |"),
    }
    originals = {
        "COMMANDS_PAGE": COMMANDS_PAGE.read_text("utf-8"),
        "PARAMETERS_PAGE": PARAMETERS_PAGE.read_text("utf-8"),
    }
    for name, (old, new) in changes.items():
        assert originals[name].count(old) == 1
        (tmp_path / name).write_text(originals[name].replace(old, new) + "Last words.\n", encoding="utf-8")
        monkeypatch.setattr(documentation, name, tmp_path / name)
    assert main(["--check"]) == 1
    assert capsys.readouterr().err.count("python -m vehicle_models.documentation") == 2
    assert main([]) == 0
    assert {name: (tmp_path / name).read_text("utf-8") for name in changes} == {
        name: page + "Last words.\n" for name, page in originals.items()
    }


def test_every_observation_has_a_verdict_and_what_differs_a_note() -> None:
    """Each observation stands once; a verdict other than `same` says what is so instead."""
    with CONFORMANCE.open(newline="", encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    assert {row["verdict"] for row in rows} == set(VERDICTS)
    assert {row["autopilot"] for row in rows} == {"px4", "ardupilot"}
    assert len({(row["autopilot"], row["observation"]) for row in rows}) == len(rows)
    assert all(row["note"] for row in rows if row["verdict"] != "same")


def test_a_page_without_its_markers_is_refused() -> None:
    with pytest.raises(ValueError, match="<!-- parameters of px4 -->"):
        with_parameters("# Parameters\n")


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_autopilot_answers_as_the_table_says(make: Make, autopilot: str) -> None:
    """Each command that is not carried out, sent to a vehicle that stands disarmed."""
    client = make(simspec(autopilot))
    for number, cells in CELLS_BY_COMMAND.items():
        cell = cells[autopilot == "ardupilot"].removeprefix("carried out with a gimbal, else ")
        if cell == "carried out":
            continue
        results = client.command(number)
        # A second result comes a second later.
        expected = {"not known": "UNSUPPORTED", "IN_PROGRESS then ACCEPTED": "IN_PROGRESS"}.get(cell, cell)
        if expected == "no answer":
            assert results == [], number.name
        else:
            assert mavlink.enums["MAV_RESULT"][results[0]].name.removeprefix("MAV_RESULT_") in expected, (
                number.name
            )
            assert len(results) == 1, number.name
