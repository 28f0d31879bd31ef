"""The command line as a user meets it: exit codes, sentences instead of tracebacks, JSON where a machine reads."""

from __future__ import annotations

import errno
import hashlib
import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import CAMPAIGN, EXAMPLE, Rebar, short_campaign
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
def test_every_command_has_help_with_an_example(words: tuple[str, ...], rebar: Rebar) -> None:
    text = rebar.words(*words, "--help")
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
def test_mistakes_are_answered_with_code_2_and_a_sentence(line: list[str], words: str, rebar: Rebar) -> None:
    assert words in rebar.refused(*line)


@pytest.mark.parametrize(
    "name",
    [
        *("simspec", "campaign", "agent", "decomposition", "target-report", "decision", "session-result"),
        *("campaign-message", "campaign-status", "stand-message"),
        *("score-report", "score-explanation", "assurance-case"),
    ],
)
def test_schemas_are_printed(name: str, rebar: Rebar) -> None:
    assert json.loads(rebar("schema", name))["type"] == "object"


def test_the_doctor_finds_this_machine_fit(rebar: Rebar) -> None:
    assert all(check["fine"] for check in rebar.json("doctor"))


def test_homes_and_links_are_parsed() -> None:
    assert parse_home("47.4,8.5,488,90") == (47.4, 8.5, 488.0, 90.0)
    link = parse_link("tcpin:127.0.0.1:5760", 0)
    assert (link.kind, link.host, link.port) == ("tcp_in", "127.0.0.1", 5760)
    serial = parse_serial("/dev/serial/by-path/pci-0:1.0:115200", 3)
    assert (serial.name, serial.kind, serial.baud) == ("serial3", "serial", 115200)
    assert serial.path == "/dev/serial/by-path/pci-0:1.0"
    plain = parse_serial("/dev/ttyACM0", 0)
    assert (plain.path, plain.baud) == ("/dev/ttyACM0", 921600)


NO_PLUGINS = ("px4-board:/dev/ttyACM0", "px4-board:", "px4-board:device=x,", "px4-board:=x", "No Kind:a=b")
NO_IPV6 = r"links have no IPv6 \(give an IPv4 address or a name\)"


@pytest.mark.parametrize(
    ("parse", "texts", "words"),
    [
        (parse_link, ("udpout:1.2.3.4", "udpout:h:0", "udpout:h:99999", "serial:"), "is not a link"),
        (parse_link, ("udpout:::1:14540", "tcpin:[::1]:5760"), NO_IPV6),
        (lambda text, _: parse_home(text), ("95,0,0,0",), "--home"),
        (parse_serial, ("", ":57600", "/dev/ttyUSB0:0"), "--serial"),
        (lambda text, _: parse_firmware(text), NO_PLUGINS, "--firmware"),
    ],
)
def test_what_names_no_home_link_or_firmware_is_refused(
    parse: Callable[[str, int], object], texts: tuple[str, ...], words: str
) -> None:
    for text in texts:
        with pytest.raises(SetupError, match=words):
            parse(text, 0)


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


def test_companions_on_devices_and_interfaces_are_told_where_to_connect(tmp_path: Path, rebar: Rebar) -> None:
    """Two devices in real time, at whose end lateness and losses are told; what cannot be is refused."""
    with closing(Cable(tmp_path / "ttyUSB0")), closing(Cable(tmp_path / "ttyUSB1")):
        devices = ["--serial", str(tmp_path / "ttyUSB0"), "--serial", f"{tmp_path / 'ttyUSB1'}:57600"]
        lines = rebar("fly", *devices, "--duration", "0.1").splitlines()
        assert lines[0] == f"px4 on serial0: connect to {tmp_path / 'ttyUSB0'}:921600"
        assert lines[1] == f"px4 on serial1: connect to {tmp_path / 'ttyUSB1'}:57600"
        assert re.match(r"real time: \d of 5 steps", lines[2])
        refusal = rebar.refused("fly", *devices, "--speed", "2")
        assert "--speed: another computer, or the firmware of a plug-in, keeps real time" in refusal
    assert "link serial0: there is no device" in rebar.refused("fly", "--serial", tmp_path / "ttyUSB0")
    assert "--interface: no interface 'nothing0'" in rebar.refused("fly", "--interface", "nothing0")
    for autopilot, address in (("px4", "udpout:127.0.0.1:14540"), ("ardupilot", "tcp:127.0.0.1:5762")):
        assert address.rpartition(":")[2] in {str(link.port) for link in interface_links(autopilot, "lo")}
        assert {link.host for link in interface_links(autopilot, "lo")} == {"127.0.0.1"}


def test_a_campaign_to_its_report_and_back(tmp_path: Path, rebar: Rebar) -> None:
    """Run, verify, lose a result, score again: the same numbers, and a manifest that notices what was changed."""
    campaign, out = short_campaign(tmp_path), tmp_path / "out"
    first = rebar.json("run", campaign, "--out", out, "--workers", "1")
    assert {row["agent"] for row in first["nodes"]} == {"reference-naive"}
    assert first["fidelity"] == "full"
    # The folder and the file that it was flown from ask the same.
    assert question_sha256(load_campaign(campaign)) in rebar("verify", out)
    digest = hashlib.sha256((out / "manifest.json").read_bytes()).hexdigest()
    assert f"manifest SHA-256: {digest}" in rebar("verify", out, "--digest", digest)
    rebar("verify", out, "--digest", digest[::-1], code=1)
    assert 50_000 < (out / "report.html").stat().st_size < 500_000

    result = next((out / "runs").glob("*/result.json"))
    first_result = json.loads(result.read_text())
    result.unlink()
    rebar("verify", out, code=1)
    assert rebar.json("score", out) == first
    again = json.loads(result.read_text())
    for name in ("observations", "recording_sha256"):
        assert again[name] == first_result[name]
    rebar("verify", out)

    before = (out / "report.html").read_bytes()
    rebar("report", out)
    assert (out / "report.html").read_bytes() == before


def test_an_agent_that_does_not_exist_is_a_matter_of_input(tmp_path: Path, rebar: Rebar) -> None:
    simspec = tmp_path / "search.yaml"
    simspec.write_text(EXAMPLE.read_text().replace("reference-naive", "no-such-agent"))
    text = rebar("simulate", simspec, "--out", tmp_path / "out", code=2)
    assert "no-such-agent" in text
    assert "recording:" not in text


def test_a_session_ends_with_what_was_achieved_and_what_to_ask_next(tmp_path: Path, rebar: Rebar) -> None:
    """Ten seconds are too short for a mission: what was not achieved is told by title, with its value and reason."""
    short_campaign(tmp_path)
    shown = rebar("simulate", tmp_path / "scene.yaml", "--out", tmp_path / "out")
    assert shown.startswith("REPORTED NOTHING: ")
    assert f"what the agent printed: {tmp_path / 'out' / 'agent.log'}\n" in shown
    rows = [line.split() for line in shown.splitlines()[-6:]]
    nodes = [row[0] for row in rows if row and row[0].startswith("KA-")]
    assert nodes == [f"KA-{number:02}" for number in (3, 5, 9, 18, 20)]
    failed, considered = map(int, re.search(r"not achieved: (\d+) of (\d+)", shown).groups())  # type: ignore[union-attr]
    achieved = re.search(rf"\nachieved: (\d+) of {considered}\n", shown)
    assert failed + (int(achieved[1]) if achieved else 0) == considered
    # The mission was not flown to its end, so what it asks for was measured as 0.
    assert re.search(r"OBS-201 .*: 0, asked", shown)
    explained = re.search(r"why: (rebar score .* --explain (OBS-\d+))", shown)
    assert explained
    assert explained[2] in rebar(*explained[1].split()[1:])


def test_a_disk_that_refuses_is_told(monkeypatch: pytest.MonkeyPatch, rebar: Rebar) -> None:
    """That of the journal is in test_cli_paths.py."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left", "out/recording.mcap")

    monkeypatch.setattr("bench.campaign.finish_campaign", refuse)
    assert "out/recording.mcap: No space left" in rebar.refused("report", "out", code=1)


@pytest.mark.parametrize("command", [["run"], ["run", "--dry-run"], ["realize"]])
def test_faults_of_one_campaign_file_come_at_once(command: list[str], tmp_path: Path, rebar: Rebar) -> None:
    """Two fields of the campaign and two of its design are wrong: four lines, each with the file and its own line."""
    campaign = short_campaign(tmp_path)
    broken = CAMPAIGN.replace("base_file", "base_fiel").replace("seed: 3", "seed: -3")
    campaign.write_text(broken.replace("factors:", "faktors:") + "budgets: {workers: 0}\n")

    faults = rebar.refused(*command, campaign, "--out", tmp_path / "out").splitlines()
    fields = ((4, "base_fiel"), (7, "design.seed"), (9, "design.faktors"), (11, "budgets.workers"))
    wanted = [(f"{campaign}:{line}", field) for line, field in fields]
    assert sorted(tuple(fault.split(": ")[1:3]) for fault in faults) == sorted(wanted)
    assert not (tmp_path / "out").exists()


YARD = """
name: yard
world: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 20, north_m: 0}, {east_m: 20, north_m: 20}, {east_m: 0, north_m: 20}]}}
vehicle: {home: {east_m: -30, north_m: -30}}
"""
BOWTIE = YARD.replace("east_m: 20, north_m: 20", "east_m: 0, north_m: 19")


def people(fields: str) -> str:
    return f"{YARD}actors: [{{id: people, asset: civilian, role: bystander, {fields}}}]"


BAD = {
    "contradictory range": (people("count: {low: 10, high: 5}"), "count.range: high 5 must exceed low 10"),
    "zero area": (
        people("count: 3, placement: {region: {corners: [" + "{east_m: 1, north_m: 1}, " * 4 + "]}}"),
        "encloses less than",
    ),
    "a thousand in a yard": (
        people("count: 1000"),
        "lower the counts, lower separation_m or widen the region",
    ),
    "no such unit": (
        people("count: 3, placement: {spread_cm: 5}"),
        "unknown field 'spread_cm' (did you mean",
    ),
    "no such asset": (
        people("count: 3").replace("civilian", "tank"),
        "there is no asset 'tank' (the catalogue has",
    ),
    # Names in brackets are fields, and no markup of the terminal.
    "far away": (
        people("count: 2, placement: {distances: [{of: home, min_m: 900}]}"),
        "(actors[people].placement.distances[0])",
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
    """As a SimSpec to fly and as the base of a campaign: refused without a long search."""
    document, expected = BAD[name]
    simspec, campaign = tmp_path / "yard.yaml", tmp_path / "camp.yaml"
    simspec.write_text(document)
    base = "".join(f"  {line}\n" for line in document.strip().splitlines())
    campaign.write_text(f"name: camp\nagents: [{{manifest: reference-naive}}]\nbase:\n{base}")
    out = str(tmp_path / "out")

    for line in (["simulate", str(simspec), "--out", out], ["realize", str(campaign), "--out", out]):
        began = time.process_time()
        assert run(line) in (1, 2)
        # CPU seconds, ten times what a refusal takes: an exhaustive search reaches it, a busy host does not.
        assert time.process_time() - began < 20.0
        output = "".join(capsys.readouterr())
        assert line[1] in output
        assert expected in output
        assert "Traceback" not in output
