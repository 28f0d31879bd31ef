"""The tables that `rebar tables` prints, and that the autopilots do what they say."""

from __future__ import annotations

import csv

import pytest
from vehicle_client import Make, mavlink, simspec

from bench.cli._app import run
from bench.contracts import load_plugin
from vehicle_models.controller.policies._tables import COMMAND_NAMES, SENDING_ORDER
from vehicle_models.tables import CONFORMANCE, VERDICTS, command_table, parameter_table, parameters_read

CELLS_BY_COMMAND = {int(number): (px4, ardupilot) for number, _, px4, ardupilot in command_table()[1:]}


def test_the_autopilots_tables_name_what_mavlink_has() -> None:
    """Numbers and names of commands, and the names of messages, each once."""
    commands = mavlink.enums["MAV_CMD"]
    assert {
        number: commands[number].name.removeprefix("MAV_CMD_") for number in COMMAND_NAMES
    } == COMMAND_NAMES
    assert set(SENDING_ORDER) <= {kind.msgname for kind in mavlink.mavlink_map.values()}
    assert len(set(SENDING_ORDER)) == len(SENDING_ORDER)


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert run(["tables", *words]) == 0
    return capsys.readouterr().out


def test_the_command_prints_each_parameter_with_its_explanation(capsys: pytest.CaptureFixture[str]) -> None:
    """A row for each that the code reads; words choose among them, in any case."""
    rows = parameter_table()[1:]
    assert len(rows) > 100
    assert [name for _, name, _, meaning in rows if not meaning.strip()] == []
    assert {(section, name) for section, name, _, _ in rows} == {
        (section, name) for section, names in parameters_read().items() for name in names
    }
    text = printed(capsys, "parameters")
    assert text.endswith(f"{len(rows)} of {len(rows)} rows\n")
    words = text.split()
    assert [name for _, name, default, _ in rows if not {name, default} <= {*words}] == []
    chosen = printed(capsys, "parameters", "px4", "rtl_return")
    assert (
        " ".join(chosen.splitlines()[-3].split()) == "px4 RTL_RETURN_ALT 30 Height of a return above home, m"
    )
    assert chosen.endswith(f"1 of {len(rows)} rows\n")


@pytest.mark.parametrize("name", ["commands", "mission-items", "simulation", "conformance"])
def test_the_command_prints_each_table(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """All rows have a cell for each column, and the list of tables says what is in it."""
    rows = load_plugin("rebar.tables", name)()
    assert {len(row) for row in rows} == {len(rows[0])}
    assert printed(capsys, name).endswith(f"{len(rows) - 1} of {len(rows) - 1} rows\n")
    assert f"{name}: " in printed(capsys)


def test_an_unknown_table_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tables", "messages"]) == 2
    assert "commands, conformance, mission-items, parameters, simulation" in capsys.readouterr().err


def test_every_observation_has_a_verdict_and_what_differs_a_note() -> None:
    """Each observation stands once; a verdict other than `same` says what is so instead."""
    with CONFORMANCE.open(newline="", encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    assert {row["verdict"] for row in rows} == set(VERDICTS)
    assert {row["autopilot"] for row in rows} == {"px4", "ardupilot"}
    assert len({(row["autopilot"], row["observation"]) for row in rows}) == len(rows)
    assert all(row["note"] for row in rows if row["verdict"] != "same")


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
            assert results == [], number
        else:
            assert mavlink.enums["MAV_RESULT"][results[0]].name.removeprefix("MAV_RESULT_") in expected, (
                number
            )
            assert len(results) == 1, number
