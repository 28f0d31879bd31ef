"""`rebar compare` on one campaign flown with the imitated autopilot, with the firmware, and on a board."""

from __future__ import annotations

import json
from dataclasses import astuple
from pathlib import Path
from typing import Any

import pytest
from command_line import json_of
from test_cli_compare_sources import MARKING_OBSERVABLE, PERCEPTION_OBSERVABLE, SCENES, flown_with

from bench.cli._app import run
from bench.reporting import compare_campaigns
from bench.simspec import SimSpec


def carried_by(folder: Path, autopilot: Any, failed: dict[str, set[int]], mode: str = "lockstep") -> Path:
    """The made campaign under an autopilot, in a session of which the host may take longer."""
    flown_with(folder, "simulated", failed)
    for path in (folder / "simspecs").glob("*.json"):
        document = json.loads(path.read_text())
        document["vehicle"]["autopilot"] = autopilot
        document["pace"]["mode"] = mode
        document["budgets"]["wall_s"] = 300.0 if autopilot == "px4" else 900.0
        path.write_text(SimSpec.model_validate(document).model_dump_json())
    return folder


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    home = tmp_path_factory.mktemp("autopilots")
    firmware = {"kind": "px4", "firmware": "/opt/px4"}
    board = {"kind": "px4-board", "options": {"device": "/dev/ttyACM0"}}
    return (
        carried_by(home / "imitated", "px4", {PERCEPTION_OBSERVABLE: {1}, MARKING_OBSERVABLE: set()}),
        carried_by(home / "firmware", firmware, {PERCEPTION_OBSERVABLE: {1, 2, 3}, MARKING_OBSERVABLE: {4}}),
        carried_by(
            home / "board", board, {PERCEPTION_OBSERVABLE: set(), MARKING_OBSERVABLE: {4}}, mode="realtime"
        ),
    )


def test_what_the_imitation_changes_is_told_scene_by_scene(flown: tuple[Path, Path, Path]) -> None:
    imitated, firmware, board = flown
    comparison = compare_campaigns((imitated, firmware))
    assert comparison.autopilots == ("px4, lockstep", "px4 (real), lockstep")
    assert comparison.perceptions is None
    assert comparison.scenes == SCENES
    counts = {node.node: node.counts for node in comparison.nodes}
    perception_counts, marking_counts = counts[PERCEPTION_OBSERVABLE], counts[MARKING_OBSERVABLE]
    assert astuple(perception_counts) == (SCENES - 3, 2, 0, 1)
    assert astuple(marking_counts) == (SCENES - 1, 1, 0, 0)
    on_board = compare_campaigns((firmware, board))
    assert on_board.autopilots == ("px4 (real), lockstep", "px4-board (real), realtime")
    counts = {node.node: node.counts for node in on_board.nodes}
    assert (counts[MARKING_OBSERVABLE].neither, counts[PERCEPTION_OBSERVABLE].only_second) == (1, 3)


def test_people_and_machines_read_which_autopilot_passed(
    flown: tuple[Path, Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [str(path) for path in flown[:2]]
    assert run(["compare", *paths]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "scenes passed by autopilot (first: px4, lockstep; second: px4 (real), lockstep):" in text
    assert json_of(["compare", *paths, "--json"], capsys)["autopilots"] == [
        "px4, lockstep",
        "px4 (real), lockstep",
    ]


def test_two_that_differ_in_more_share_no_scene(
    flown: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Perception and autopilot both differ, so nothing is paired: their runs are compared as distributions."""
    other = flown_with(tmp_path / "other", "truth", {})
    for path in (other / "simspecs").glob("*.json"):
        document = json.loads(path.read_text())
        document["vehicle"]["autopilot"] = "ardupilot"
        path.write_text(json.dumps(document))
    assert run(["compare", str(flown[0]), str(other)]) == 0
    assert "not the same scenes, so nothing is paired" in " ".join(capsys.readouterr().out.split())
