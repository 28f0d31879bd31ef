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
from test_cli_commands import CAMPAIGN, EXAMPLE

from bench.cli._app import run

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
    (tmp_path / "agent.yaml").write_text(MANIFEST)
    campaign, out = tmp_path / "small.yaml", tmp_path / "out"
    campaign.write_text(CAMPAIGN.replace("reference-naive", "agent.yaml") + "budgets: {retry_s: 0}\n")
    program = tmp_path / "agent.sh"
    program.write_text('#!/bin/sh\nrm "$0"\nexit 1\n')
    program.chmod(0o755)

    assert run(["run", str(campaign), "--out", str(out), "--workers", "1"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("INCOMPLETE: 2 of 2 runs are missing: 2 setup_invalid (p001-r1-agent: ")
    for command in (["report", str(out)], ["score", str(out)], ["score", str(out), "--explain", "KA-18"]):
        assert run(command) == 3
        assert first_line(capsys) == lines[0]
    assert run(["score", str(out), "--json"]) == 3
    shown = capsys.readouterr()
    assert shown.err.splitlines()[0] == lines[0]
    assert json.loads(shown.out)["kind"] == "campaign"
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
