"""The command line as a user meets it: exit codes, sentences instead of tracebacks, JSON where a machine reads."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import CAMPAIGN, EXAMPLE, json_of, short_campaign
from serial_cable import Cable

from bench.campaign import load_campaign, question_sha256
from bench.cli._app import app, run
from bench.cli._fly import parse_firmware, parse_home, parse_link, parse_serial
from bench.errors import SetupError
from bench.simulation import interface_links

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "campaigns" / "demo.yaml"


def commands(group: Any, *words: str) -> Iterator[tuple[str, ...]]:
    """The words of every command in a group."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, *words, name)
        else:
            yield *words, name


@pytest.mark.parametrize("words", [(), *commands(typer.main.get_command(app))])
def test_every_command_has_help_with_an_example(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """--help works everywhere and shows how the command is called."""
    assert run([*words, "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "Usage: " in text
    assert not words or f"Example: rebar {' '.join(words)}" in text


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["simulate", "nowhere.yaml"], "there is no such file"),
        (["run", "nowhere.yaml"], "there is no such file"),
        (["run", str(EXAMPLE)], "is a rebar.simspec/1 (name a rebar.campaign/1 here)"),
        (["run", str(DEMO), "--stand-ready", "rig/ready"], "--mqtt"),
        (["run", str(DEMO), "--mqtt", "broker.lab"], "no address of a broker"),
        (["run", str(DEMO), "--mqtt", "mqtt://broker.lab", "--stand-ready", "rig/+"], "no topic to send to"),
        (["score", "/"], "there is no recording.mcap"),
        (["report", "/"], "is not the folder of a campaign"),
        (["verify", "/"], "cannot be read"),
        (["schema", "unicorn"], "there is no document 'unicorn'"),
        (["difficulty", str(EXAMPLE), "--decomposition", "nothing"], "nothing"),
        (["fly", "--autopilot", "inav"], "is not one of 'px4', 'ardupilot'"),
        (["fly", "--home", "here"], "LAT,LON,ALT,HDG"),
        (["fly", "--mavlink", "smoke"], "is not a link"),
        (["fly", "--firmware", "px4", "--params", "kept.json"], "leave out --params"),
        (["prose", "..."], ""),
        (["prose", str(EXAMPLE)], "is a file"),
        (["no-such-command"], ""),
    ],
)
def test_mistakes_are_answered_with_code_2_and_a_sentence(
    line: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A user's mistake is never a traceback."""
    assert run(line) == 2
    shown = capsys.readouterr()
    assert words in shown.err + shown.out
    assert "Traceback" not in shown.err


@pytest.mark.parametrize(
    "name",
    [
        *("simspec", "campaign", "agent", "decomposition", "target-report", "decision", "session-result"),
        *("campaign-message", "campaign-status", "stand-message"),
    ],
)
def test_schemas_are_printed(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The JSON Schema of every document can be had."""
    assert json_of(["schema", name], capsys)["type"] == "object"


def test_difficulty_is_shown_before_anything_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """Difficulty follows from the file alone, with the factor that rules."""
    document = json_of(["difficulty", str(EXAMPLE), "--json"], capsys)
    nodes = {node["node"]: node for node in document["nodes"]}
    assert 0.0 < nodes["KA-18"]["difficulty"] <= 100.0
    assert nodes["KA-18"]["ruled_by"]


def test_the_doctor_finds_this_machine_fit(capsys: pytest.CaptureFixture[str]) -> None:
    """Everything that a session needs works here."""
    assert all(check["fine"] for check in json_of(["doctor", "--json"], capsys))


def test_homes_and_links_are_parsed_or_refused() -> None:
    """What `rebar fly` takes is what it says that it takes."""
    assert parse_home("47.4,8.5,488,90") == (47.4, 8.5, 488.0, 90.0)
    link = parse_link("tcpin:127.0.0.1:5760", 0)
    assert (link.kind, link.host, link.port) == ("tcp_in", "127.0.0.1", 5760)
    for wrong in ("udpout:1.2.3.4", "udpout:h:0", "udpout:h:99999", "serial:"):
        with pytest.raises(SetupError):
            parse_link(wrong, 0)
    for ipv6 in ("udpout:::1:14540", "tcpin:[::1]:5760"):
        with pytest.raises(SetupError, match=r"links have no IPv6 \(give an IPv4 address or a name\)"):
            parse_link(ipv6, 0)
    with pytest.raises(SetupError):
        parse_home("95,0,0,0")
    serial = parse_serial("/dev/serial/by-path/pci-0:1.0:115200", 3)
    assert (serial.name, serial.kind, serial.path, serial.baud) == (
        "serial3",
        "serial",
        "/dev/serial/by-path/pci-0:1.0",
        115200,
    )
    assert (parse_serial("/dev/ttyACM0", 0).path, parse_serial("/dev/ttyACM0", 0).baud) == (
        "/dev/ttyACM0",
        921600,
    )
    for wrong in ("", ":57600", "/dev/ttyUSB0:0"):
        with pytest.raises(SetupError, match="--serial"):
            parse_serial(wrong, 0)


def test_a_firmware_is_a_path_or_a_plugin_with_options(tmp_path: Path) -> None:
    """Names under /dev/serial/by-path hold colons, and folders may hold any sign."""
    device = "/dev/serial/by-path/pci-0:1.0"
    for options in ({"device": device, "baud": "460800"}, {"anything": "a=b"}):
        text = ",".join(f"{name}={value}" for name, value in options.items())
        plugin = parse_firmware(f"px4-board:{text}")
        assert plugin is not None
        assert (plugin.kind, plugin.options) == ("px4-board", options)
    odd = tmp_path / "px4:a=b"
    odd.touch()
    for path in ("", "build/px4_sitl", "/opt/px4:1.16/bin", str(odd)):
        assert parse_firmware(path) is None
    for wrong in (
        "px4-board:/dev/ttyACM0",
        "px4-board:",
        "px4-board:device=x,",
        "px4-board:=x",
        "No Kind:a=b",
    ):
        with pytest.raises(SetupError, match="--firmware"):
            parse_firmware(wrong)


def test_companions_on_serial_devices_and_interfaces_are_told_where_to_connect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two devices in real time, at whose end lateness and losses are told; what cannot be is refused."""
    with closing(Cable(tmp_path / "ttyUSB0")), closing(Cable(tmp_path / "ttyUSB1")):
        devices = ["--serial", str(tmp_path / "ttyUSB0"), "--serial", f"{tmp_path / 'ttyUSB1'}:57600"]
        assert run(["fly", *devices, "--duration", "0.1"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0] == f"px4 on serial0: connect to {tmp_path / 'ttyUSB0'}:921600"
        assert lines[1] == f"px4 on serial1: connect to {tmp_path / 'ttyUSB1'}:57600"
        assert re.match(r"real time: \d of 5 steps", lines[2])
        assert run(["fly", *devices, "--speed", "2"]) == 2
        assert (
            "--speed: another computer, or the firmware of a plug-in, keeps real time"
            in capsys.readouterr().err
        )
    assert run(["fly", "--serial", str(tmp_path / "ttyUSB0")]) == 2
    assert "link serial0: there is no device" in capsys.readouterr().err
    assert run(["fly", "--interface", "nothing0"]) == 2
    assert "--interface: no interface 'nothing0'" in capsys.readouterr().err
    for autopilot, address in (("px4", "udpout:127.0.0.1:14540"), ("ardupilot", "tcp:127.0.0.1:5762")):
        assert address.rpartition(":")[2] in {str(link.port) for link in interface_links(autopilot, "lo")}
        assert {link.host for link in interface_links(autopilot, "lo")} == {"127.0.0.1"}


def test_a_campaign_to_its_report_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run, verify, lose a result, score again: the same numbers, and a manifest that notices what was changed."""
    campaign, out = short_campaign(tmp_path), tmp_path / "out"
    first = json_of(["run", str(campaign), "--out", str(out), "--workers", "1", "--json"], capsys)
    assert {row["agent"] for row in first["nodes"]} == {"reference-naive"}
    assert first["fidelity"] == "full"
    assert run(["verify", str(out)]) == 0
    # The folder and the file that it was flown from ask the same.
    assert question_sha256(load_campaign(campaign)) in capsys.readouterr().out
    digest = hashlib.sha256((out / "manifest.json").read_bytes()).hexdigest()
    assert run(["verify", str(out), "--digest", digest]) == 0
    assert f"manifest SHA-256: {digest}" in capsys.readouterr().out
    assert run(["verify", str(out), "--digest", digest[::-1]]) == 1
    assert 50_000 < (out / "report.html").stat().st_size < 500_000

    result = next((out / "runs").glob("*/result.json"))
    first_result = json.loads(result.read_text())
    result.unlink()
    assert run(["verify", str(out)]) == 1
    capsys.readouterr()
    assert json_of(["score", str(out), "--json"], capsys) == first
    again = json.loads(result.read_text())
    assert again["observations"] == first_result["observations"]
    assert again["recording_sha256"] == first_result["recording_sha256"]
    assert run(["verify", str(out)]) == 0

    before = (out / "report.html").read_bytes()
    assert run(["report", str(out)]) == 0
    assert (out / "report.html").read_bytes() == before


def test_killing_the_runner_and_running_again_gives_the_full_set(tmp_path: Path) -> None:
    """kill -9 in mid-flight.

    The same command then flies what is missing, and every realization has one result.
    """
    campaign, out = short_campaign(tmp_path), tmp_path / "out"
    command = [sys.executable, "-m", "bench.cli", "run", str(campaign), "--out", str(out), "--workers", "1"]
    runner = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60.0
    while not list(out.glob("runs/*/recording.mcap")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(runner.pid, signal.SIGKILL)
    runner.wait()
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert len(list(out.glob("runs/*/result.json"))) == 2
    assert "2 completed" in again.stdout


def test_an_agent_that_does_not_exist_is_a_matter_of_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing was flown: exit 2, the name that is wrong, and no mention of a recording."""
    simspec = tmp_path / "search.yaml"
    simspec.write_text(EXAMPLE.read_text().replace("reference-naive", "no-such-agent"))
    assert run(["simulate", str(simspec), "--out", str(tmp_path / "out")]) == 2
    text = capsys.readouterr().out
    assert "no-such-agent" in text
    assert "recording:" not in text


def test_a_session_ends_with_what_was_achieved_and_what_to_ask_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ten seconds are too short for a mission: what was not achieved is told by title, with its value and reason."""
    simspec, text = tmp_path / "search.yaml", EXAMPLE.read_text()
    assert "time_limit_s: 300.0" in text
    simspec.write_text(text.replace("time_limit_s: 300.0", "time_limit_s: 10.0"))
    assert run(["simulate", str(simspec), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("REPORTED NOTHING: ")
    assert f"what the agent printed: {tmp_path / 'out' / 'agent.log'}\n" in shown
    rows = [line.split() for line in shown.splitlines()[-6:]]
    assert [row[0] for row in rows if row and row[0].startswith("KA-")] == [
        f"KA-{n:02}" for n in (3, 5, 9, 18, 20)
    ]
    failed, considered = map(int, re.search(r"not achieved: (\d+) of (\d+)", shown).groups())  # type: ignore[union-attr]
    achieved = re.search(rf"\nachieved: (\d+) of {considered}\n", shown)
    assert failed + (int(achieved[1]) if achieved else 0) == considered
    # The mission was not flown to its end, so what it asks for was measured as 0.
    assert re.search(r"OBS-201 .*: 0, asked", shown)
    explained = re.search(r"why: (rebar score .* --explain (OBS-\d+))", shown)
    assert explained
    assert run(explained[1].split()[1:]) == 0
    assert explained[2] in capsys.readouterr().out


def test_a_scene_that_cannot_be_names_the_fields_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names in brackets are fields, and no markup of the terminal."""
    simspec = tmp_path / "yard.yaml"
    corners = "[{east_m: 0, north_m: 0}, {east_m: 60, north_m: 0}, {east_m: 60, north_m: 60}]"
    simspec.write_text(
        f"name: yard\nworld: {{area: {{corners: {corners}}}}}\nactors:\n"
        "- {id: people, asset: civilian, role: bystander, count: 2, placement: {distances: [{of: home, min_m: 90}]}}\n"
    )
    assert run(["simulate", str(simspec), "--out", str(tmp_path / "out")]) == 1
    assert "(actors[people].placement.distances[0])" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device", "out/recording.mcap"),
            "out/recording.mcap: No space left on device",
        ),
        (
            sqlite3.OperationalError("database or disk is full"),
            "cannot write the journal: database or disk is full",
        ),
    ],
)
def test_a_disk_that_refuses_is_answered_with_a_sentence(
    trouble: Exception, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No room, no rights: exit 1, what could not be written and what to do; never a traceback."""

    def refuse(*_: object, **__: object) -> None:
        raise trouble

    monkeypatch.setattr("bench.campaign.finish_campaign", refuse)
    assert run(["report", "out"]) == 1
    assert words in capsys.readouterr().err


def test_a_folder_that_cannot_be_is_answered_with_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An output path through a file, or that is one."""
    (tmp_path / "file").touch()
    campaign = short_campaign(tmp_path)
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert run(["run", str(campaign), "--out", str(out)]) == 2
        assert f"rebar: {tmp_path / 'file'}: is no folder" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["run"], ["run", "--dry-run"], ["realize"]])
def test_two_faults_in_one_campaign_file_come_at_once(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two fields of the campaign and two of its design are wrong: four lines, each with the file and its own line."""
    campaign = short_campaign(tmp_path)
    broken = (
        CAMPAIGN.replace("base_file", "base_fiel")
        .replace("seed: 3", "seed: -3")
        .replace("factors:", "faktors:")
    )
    campaign.write_text(broken + "budgets: {workers: 0}\n")

    assert run([*command, str(campaign), *(["--out", str(tmp_path / "out")])]) == 2

    faults = capsys.readouterr().err.splitlines()
    fields = {(4, "base_fiel"), (7, "design.seed"), (9, "design.faktors"), (11, "budgets.workers")}
    assert {tuple(fault.split(": ")[1:3]) for fault in faults} == {
        (f"{campaign}:{line}", field) for line, field in fields
    }
    assert len(faults) == len(fields)
    assert not (tmp_path / "out").exists()


YARD = """
name: yard
world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 20, north_m: 0}, {east_m: 20, north_m: 20}, {east_m: 0, north_m: 20}]}}
vehicle: {home: {east_m: -30, north_m: -30}}
"""
BOWTIE = YARD.replace("east_m: 20, north_m: 20", "east_m: 0, north_m: 19")


def actors(**fields: str) -> str:
    return (
        YARD
        + "actors: [{id: people, asset: civilian, role: bystander, "
        + ", ".join(f"{k}: {v}" for k, v in fields.items())
        + "}]"
    )


BAD = {
    "contradictory range": (actors(count="{low: 10, high: 5}"), "count.range: high 5 must exceed low 10"),
    "zero area": (
        actors(count="3", placement="{region: {corners: [" + "{east_m: 1, north_m: 1}, " * 4 + "]}}"),
        "encloses less than",
    ),
    "a thousand in a small yard": (
        actors(count="1000"),
        "lower the counts, lower separation_m or widen the region",
    ),
    "a unit that does not fit": (
        actors(count="3", placement="{spread_cm: 5}"),
        "unknown field 'spread_cm' (did you mean spread_m?)",
    ),
    "unknown asset": (
        actors(count="3", asset="tank").replace("asset: civilian, ", ""),
        "there is no asset 'tank' (the catalogue has",
    ),
    "crossed": (
        BOWTIE.replace("{east_m: 20, north_m: 0}", "{east_m: 20, north_m: 22}"),
        "the polygon crosses itself",
    ),
    "circle": (
        YARD
        + "actors: [{id: a, asset: tree, role: clutter, count: 1, placement: {near: {of: b, max_m: 9}}},"
        + " {id: b, asset: tree, role: clutter, count: 1, placement: {near: {of: a, max_m: 9}}}]",
        "relate to each other in a circle (drop one of the relations)",
    ),
    "two distances": (
        YARD
        + "actors: [{id: a, asset: tree, role: clutter, count: 1}, {id: b, asset: crate, role: clutter, count: 2,"
        + " placement: {near: {of: a, max_m: 4}, away: {of: a, min_m: 5, max_m: 9}}}]",
        "(actors[b].placement.near)",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_situations_are_answered_with_file_field_and_remedy(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a SimSpec to fly and as the base of a campaign: refused without a long search, with file, field and remedy."""
    document, expected = BAD[name]
    simspec, campaign = tmp_path / "yard.yaml", tmp_path / "camp.yaml"
    simspec.write_text(document)
    base = "".join(f"  {line}\n" for line in document.strip().splitlines())
    campaign.write_text(f"name: camp\nagents: [{{manifest: reference-naive}}]\nbase:\n{base}")
    out = str(tmp_path / "out")

    for line in (["simulate", str(simspec), "--out", out], ["realize", str(campaign), "--out", out]):
        began = time.process_time()
        assert run(line) in (1, 2)
        # CPU seconds, and ten times what a refusal takes: a busy host does not reach it, an exhaustive search
        # does.
        assert time.process_time() - began < 20.0
        output = "".join(capsys.readouterr())
        assert line[1] in output
        assert expected in output
        assert "Traceback" not in output
