"""A campaign that lacks runs says so in the first line of every output, and by its exit code."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import CAMPAIGN, EXAMPLE, json_of

from bench.campaign import open_journal, write_result
from bench.campaign.storage._journal import PlannedRealization
from bench.cli._app import run
from bench.contracts import Outcome, SessionResult
from bench.realization import RealizationPlan

sys.path.insert(0, str(Path(__file__).parents[1] / "reporting"))
from made_campaign import Made, made_simspec, make_campaign

MISSING = "p008-r0-reference-naive"
MANIFEST = """
format: rebar.agent/1
name: brittle
command: ["{folder}/agent.sh"]
pace: [lockstep]
zenoh: false
"""


@contextmanager
def writer(folder: Path) -> Iterator[int]:
    """Another process that holds a campaign folder, as a runner does."""
    code = (
        "import sys\nfrom pathlib import Path\nfrom bench.campaign.storage._folder import open_lock\n"
        "with open_lock(Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process.pid
        process.communicate()


def first_line(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().out.splitlines()[0]


def test_files_that_vanish_in_mid_campaign_leave_it_incomplete_until_they_are_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The agent's program is gone after its first start: no run is put down to the agent. Run, report and
    score all say what is missing and end with code 3. With the program back, the printed command flies it.
    """
    scene = EXAMPLE.read_text().replace("model: x500", "model: still")
    (tmp_path / "scene.yaml").write_text(scene)
    # Unconfined, for a confined agent cannot remove its own program.
    (tmp_path / "agent.yaml").write_text(MANIFEST + "isolation: none\n")
    campaign, out = tmp_path / "small.yaml", tmp_path / "out"
    campaign.write_text(CAMPAIGN.replace("reference-naive", "agent.yaml") + "budgets: {retry_s: 0}\n")
    program = tmp_path / "agent.sh"
    program.write_text('#!/bin/sh\nrm "$0"\nexit 1\n')
    program.chmod(0o755)

    assert run(["run", str(campaign), "--out", str(out), "--workers", "1"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("INCOMPLETE: 2 of 2 runs are missing: 2 setup_invalid (p001-r1-agent: ")
    checked = ["check", str(out), "--require", "KA-18.passed >= 0"]
    for command in (
        ["report", str(out)],
        ["score", str(out)],
        ["score", str(out), "--explain", "KA-18"],
        checked,
    ):
        assert run(command) == 3
        assert first_line(capsys) == lines[0]
    assert run(["score", str(out), "--json"]) == 3
    shown = capsys.readouterr()
    assert shown.err.splitlines()[0] == lines[0]
    document = json.loads(shown.out)
    assert document["kind"] == "campaign"
    wanted = {"folder": str(out), "complete": False, "running": False, "total": 2}
    assert document["completeness"] == wanted | {"missing": {"setup_invalid": 2}, "accepted": []}
    assert [
        entry["completeness"] for entry in json_of(["score", str(out), str(out), "--json"], capsys, 3)
    ] == [document["completeness"]] * 2
    assert "INCOMPLETE: 2 of 2 runs are missing (2 setup invalid)" in (out / "report.html").read_text()

    with writer(out) as pid:
        for command in (["report", str(out)], ["score", str(out)]):
            assert run(command) == 2
            assert f"is in use by another run (process {pid})" in capsys.readouterr().err
        assert run(["score", str(out), "--explain", "KA-18"]) == 3
        assert f"; process {pid} is at work in {out}" in first_line(capsys)

    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    again = shlex.split(lines[1].split("`")[1])
    assert again[0] == "rebar"
    assert run([*again[1:], "--workers", "1"]) == 0
    assert "2 agent_crashed" in capsys.readouterr().out
    assert run(["report", str(out)]) == 0
    assert "INCOMPLETE" not in first_line(capsys)


def test_a_pace_that_agents_cannot_follow_is_told_for_all_of_them_before_take_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two agents that know lockstep alone: with --pace realtime each is named, at once, and the null agents of the
    floor, which follow both paces, are not.
    """
    (tmp_path / "scene.yaml").write_text(EXAMPLE.read_text().replace("model: x500", "model: still"))
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(
            f"format: rebar.agent/1\nname: {name}\ncommand: ['{{python}}', '-c', '']\npace: [lockstep]\n"
        )
    campaign = tmp_path / "small.yaml"
    agents = "{manifest: one.yaml}, {manifest: two.yaml}"
    campaign.write_text(CAMPAIGN.replace("{manifest: reference-naive}", agents))
    line = ["run", str(campaign), "--out", str(tmp_path / "out"), "--pace", "realtime"]
    assert run([*line, "--floor"]) == 2
    faults = capsys.readouterr().err.splitlines()
    assert len(faults) == 2
    assert all("cannot follow pace 'realtime'" in fault for fault in faults)
    assert run([*line, "--floor", "--dry-run"]) == 2
    assert capsys.readouterr().err.splitlines() == faults
    assert not (tmp_path / "out" / "simspecs").exists()


@pytest.fixture
def partial(tmp_path: Path) -> Path:
    """A made campaign of eight scenes by two agents, whose journal knows of a run that has no result yet."""
    folder = make_campaign(tmp_path / "partial", Made(scenes=8))
    simspec = made_simspec(0, "reference-naive")
    finished = sorted(path.parent for path in (folder / "runs").glob("*/result.json"))
    names = [*(run_folder.name for run_folder in finished), MISSING]
    plans = [RealizationPlan(name, name[:4], 0, {}, simspec, simspec.agent, 0) for name in names]
    with open_journal(folder / "journal.sqlite") as journal:
        journal.add(PlannedRealization(plan, "", "") for plan in plans)
        for run_folder in finished:
            # Made campaigns hold no recordings, and a result without its recording is none.
            result = SessionResult.model_validate_json((run_folder / "result.json").read_text())
            result = result.model_copy(update={"recording_sha256": None})
            journal.finish(result, write_result(run_folder, result))
    return folder


@pytest.mark.parametrize("command", ["compare", "calibrate"])
def test_commands_that_read_results_say_what_is_missing(
    command: str, partial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the first line, by the exit code, and in the JSON document; beside a runner that as well."""
    assert run([command, str(partial)]) == 3
    head = "INCOMPLETE: 1 of 17 runs are missing: 1 not finished"
    assert first_line(capsys).startswith(head)
    with writer(partial) as pid:
        assert run([command, str(partial), "--json"]) == 3
        shown = capsys.readouterr()
    assert shown.err.splitlines()[0] == (
        f"{head}; process {pid} is at work in {partial}, so these numbers will change."
    )
    (completeness,) = json.loads(shown.out)["completeness"]
    assert (completeness["complete"], completeness["running"]) == (False, True)
    assert (completeness["total"], completeness["missing"]) == (17, {"not finished": 1})


def test_a_complete_campaign_beside_a_runner_says_running(
    partial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is missing, but somebody is at work: a line, no exit code."""
    result = SessionResult(realization=MISSING, outcome=Outcome.COMPLETED)
    (partial / "runs" / MISSING).mkdir()
    write_result(partial / "runs" / MISSING, result)
    with writer(partial) as pid:
        assert run(["compare", str(partial)]) == 0
        assert first_line(capsys).startswith(f"RUNNING: process {pid} is at work in")
    assert run(["compare", str(partial)]) == 0
    assert first_line(capsys).startswith("reference-naive and")
