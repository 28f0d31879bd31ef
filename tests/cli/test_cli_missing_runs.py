"""A campaign that lacks runs says so in the first line of every output, and by its exit code."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import CAMPAIGN, EXAMPLE, Rebar
from made_campaign import Made, made_simspec, make_campaign

from bench.campaign import open_journal, write_result
from bench.campaign.storage._journal import PlannedRealization
from bench.contracts import Outcome, SessionResult
from bench.realization import RealizationPlan

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


def test_files_that_vanish_leave_a_campaign_open_until_they_return(tmp_path: Path, rebar: Rebar) -> None:
    """The program is gone after its first start: no run is put down to the agent. With it back, the printed command flies."""
    scene = EXAMPLE.read_text().replace("model: x500", "model: still")
    (tmp_path / "scene.yaml").write_text(scene)
    # Unconfined, for a confined agent cannot remove its own program.
    (tmp_path / "agent.yaml").write_text(MANIFEST + "isolation: none\n")
    campaign, out = tmp_path / "small.yaml", tmp_path / "out"
    campaign.write_text(CAMPAIGN.replace("reference-naive", "agent.yaml") + "budgets: {retry_s: 0}\n")
    program = tmp_path / "agent.sh"
    program.write_text('#!/bin/sh\nrm "$0"\nexit 1\n')
    program.chmod(0o755)

    lines = rebar("run", campaign, "--out", out, "--workers", "1", code=3).splitlines()
    assert lines[0].startswith("INCOMPLETE: 2 of 2 runs are missing: 2 setup_invalid (p001-r1-agent: ")
    checked = ["check", out, "--require", "KA-18.passed >= 0"]
    for command in (["report", out], ["score", out], ["score", out, "--explain", "KA-18"], checked):
        assert rebar(*command, code=3).splitlines()[0] == lines[0]
    assert rebar.refused("score", out, "--json", code=3).splitlines()[0] == lines[0]
    wanted = {"folder": str(out), "complete": False, "running": False, "total": 2}
    wanted |= {"missing": {"setup_invalid": 2}, "accepted": []}
    both = [(entry["kind"], entry["completeness"]) for entry in rebar.json("score", out, out, code=3)]
    assert both == [("campaign", wanted)] * 2
    assert "INCOMPLETE: 2 of 2 runs are missing (2 setup invalid)" in (out / "report.html").read_text()

    with writer(out) as pid:
        for name in ("report", "score"):
            assert f"is in use by another run (process {pid})" in rebar.refused(name, out)
        shown = rebar("score", out, "--explain", "KA-18", code=3)
        assert f"; process {pid} is at work in {out}" in shown.splitlines()[0]

    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    again = shlex.split(lines[1].split("`")[1])
    assert again[0] == "rebar"
    flown = rebar(*again[1:], "--workers", "1")
    assert "2 agent_crashed" in flown
    assert "INCOMPLETE" not in flown


def test_all_agents_that_cannot_follow_a_pace_are_told_before_take_off(tmp_path: Path, rebar: Rebar) -> None:
    """Agents that know lockstep alone are named; the null agents of the floor, which follow both paces, are not."""
    (tmp_path / "scene.yaml").write_text(EXAMPLE.read_text().replace("model: x500", "model: still"))
    for name in ("one", "two"):
        (tmp_path / f"{name}.yaml").write_text(
            f"format: rebar.agent/1\nname: {name}\ncommand: ['{{python}}', '-c', '']\npace: [lockstep]\n"
        )
    campaign = tmp_path / "small.yaml"
    agents = "{manifest: one.yaml}, {manifest: two.yaml}"
    campaign.write_text(CAMPAIGN.replace("{manifest: reference-naive}", agents))
    line = ["run", str(campaign), "--out", str(tmp_path / "out"), "--pace", "realtime"]
    faults = rebar.refused(*line, "--floor").splitlines()
    assert len(faults) == 2
    assert all("cannot follow pace 'realtime'" in fault for fault in faults)
    assert rebar.refused(*line, "--floor", "--dry-run").splitlines() == faults
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
def test_commands_that_read_results_say_what_is_missing(command: str, partial: Path, rebar: Rebar) -> None:
    head = "INCOMPLETE: 1 of 17 runs are missing: 1 not finished"
    assert rebar(command, partial, code=3).startswith(head)
    with writer(partial) as pid:
        (completeness,) = rebar.json(command, partial, code=3)["completeness"]
        error = rebar.refused(command, partial, "--json", code=3)
    at_work = f"process {pid} is at work in {partial}, so these numbers will change."
    assert error.splitlines()[0] == f"{head}; {at_work}"
    assert (completeness["complete"], completeness["running"]) == (False, True)
    assert (completeness["total"], completeness["missing"]) == (17, {"not finished": 1})


def test_a_complete_campaign_beside_a_runner_says_running(partial: Path, rebar: Rebar) -> None:
    result = SessionResult(realization=MISSING, outcome=Outcome.COMPLETED)
    (partial / "runs" / MISSING).mkdir()
    write_result(partial / "runs" / MISSING, result)
    with writer(partial) as pid:
        assert rebar("compare", partial).startswith(f"RUNNING: process {pid} is at work in")
    assert rebar("compare", partial).startswith("reference-naive and")
