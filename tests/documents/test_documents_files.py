"""Files that a user names: only regular ones are read, and everything else gets a sentence."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from detector_fit import declare

from agent_adapters.mqtt._broker import broker_address
from bench.agents import load_manifest
from bench.campaign import load_campaign
from bench.campaign.storage._manifest import read_manifest
from bench.cli._app import run
from bench.documents import load_document, load_json_document, open_file, read_bytes, read_text
from bench.errors import SetupError
from bench.instance_analysis import load_vocabulary
from bench.laboratory import parse_broker
from bench.perception.adapters import open_onnx_detector
from bench.recording import read_simspec
from bench.reporting._campaign_folder import _floors
from bench.reporting._score_file import load_scores
from bench.simspec import OutsideAir, SimSpec, load_simspec
from bench.simulation._outside_air import read_token
from bench.simulation._parameter_file import ParameterFile
from decompositions import load_decomposition

CORNERS = [{"east_m": x, "north_m": y} for x, y in ((0, 0), (50, 0), (50, 50))]
CAMPAIGN = "name: x\nagents: [{manifest: null-idle}]\n"


KINDS = {
    "folder": "it is a folder (name a file in it)",
    "pipe": "it is a pipe (write what it gives into a file, and name that)",
    "socket": "it is a socket",
    "device": "it is a device",
    "dangling link": "it is a link to gone, which does not exist",
    "link in a circle": "it is a link that leads back to itself",
    "below a file": "there is no such file: a part of its path is no folder",
    "nothing": "there is no such file (check the name)",
}


def made(kind: str, path: Path) -> Path:
    """The path that leads to something of this kind."""
    match kind:
        case "folder":
            path.mkdir()
        case "pipe":
            os.mkfifo(path)
        case "socket":
            # The kernel takes 107 characters, fewer than a folder of the tests may have.
            with socket.socket(socket.AF_UNIX) as server, contextlib.chdir(path.parent):
                server.bind(path.name)
        case "device":
            path.symlink_to("/dev/zero")
        case "dangling link":
            path.symlink_to("gone")
        case "link in a circle":
            path.symlink_to(path.name)
        case "below a file":
            path.write_text("text")
            return path / "file"
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_regular_file_gets_a_sentence(kind: str, tmp_path: Path) -> None:
    path = made(kind, tmp_path / "document.yaml")
    for read in (open_file, read_bytes, read_text):
        with pytest.raises(SetupError) as caught:
            read(path)
        (fault,) = caught.value.faults
        assert fault.where == str(path)
        assert KINDS[kind] in str(fault)
    with pytest.raises(SetupError) as caught:
        open_file(path, "agent.file")
    assert str(caught.value).startswith(f"agent.file: {path}: ")


def test_what_names_no_file_gets_a_sentence(tmp_path: Path) -> None:
    for path in (tmp_path / "nul\0byte", tmp_path / ("x" * 300)):
        with pytest.raises(SetupError, match="cannot be read"):
            read_text(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission(tmp_path: Path) -> None:
    path = tmp_path / "my file"
    path.write_text("text")
    path.chmod(0)
    with pytest.raises(SetupError, match=r"you have no permission \(chmod u\+r '.*my file'\)"):
        read_text(path)


def test_a_link_to_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "target").write_bytes(b"a\r\nb\rc\n")
    link = tmp_path / "link"
    link.symlink_to("target")
    assert (read_bytes(link), read_text(link)) == (b"a\r\nb\rc\n", "a\nb\nc\n")


def test_size_and_encoding(tmp_path: Path) -> None:
    """Both sides of the largest size; the line of what is no UTF-8; a file whose size nobody states."""
    path = tmp_path / "file"
    path.write_bytes(b"abc")
    assert read_bytes(path, 3) == b"abc"
    with pytest.raises(SetupError, match="larger than 2 bytes"):
        read_bytes(path, 2)
    path.write_bytes("a: ü\n".encode() + b"b: \xfc\n")
    with pytest.raises(SetupError, match=r"file:2: cannot be read: 0xfc is no character of UTF-8"):
        read_text(path)
    assert "Name:" in read_text(Path("/proc/self/status"))
    with pytest.raises(SetupError, match="larger than 9 bytes"):
        read_text(Path("/proc/self/status"), 9)


def onnx(path: Path) -> object:
    options = {"weights": str(path), "labels": {"0": "tree"}}
    perception = {"source": "detector", "detector": "onnx", "detector_options": options}
    spec = {"name": "x", "world": {"area": {"corners": CORNERS}}, "perception": perception}
    return open_onnx_detector(SimSpec.model_validate(spec))


def with_base_file(path: Path) -> object:
    (path.parent / "campaign.yaml").write_text(f"{CAMPAIGN}base_file: {path.name}\n")
    return load_campaign(path.parent / "campaign.yaml")


def with_situation(path: Path) -> object:
    situation = f"situations: [{{name: a, base_file: {path.name}}}, {{name: b, base_file: {path.name}}}]\n"
    (path.parent / "campaign.yaml").write_text(CAMPAIGN + situation)
    return load_campaign(path.parent / "campaign.yaml")


READERS: dict[str, Callable[[Path], object]] = {
    "document": lambda path: load_document(path, SimSpec),
    "json document": lambda path: load_json_document(path, SimSpec),
    "simspec": load_simspec,
    "campaign": load_campaign,
    "base file": with_base_file,
    "base file of a situation": with_situation,
    "agent's manifest": load_manifest,
    "decomposition": load_decomposition,
    "vocabulary": load_vocabulary,
    "recording": read_simspec,
    "onnx": onnx,
    "token": lambda path: read_token(OutsideAir(interface="lo", token_file=str(path))),
    "parameters": lambda path: ParameterFile(path).load(),
    "certificates of the laboratory": lambda path: parse_broker("mqtts://broker", authority=path),
    "certificates of a bridge": lambda path: broker_address("mqtts://broker", None, path, {}),
    "password of a bridge": lambda path: broker_address("mqtt://broker", path, None, {}),
}
COMMANDS: dict[str, Callable[[Path], list[str]]] = {
    "table": lambda path: ["score", "--observations", str(path), "--decomposition", "search-and-report"],
    "prose": lambda path: ["prose", "--file", str(path)],
    "vocabulary": lambda path: ["prose", "a truck", "--vocabulary", str(path)],
    "simulate": lambda path: ["simulate", str(path)],
    "difficulty": lambda path: ["difficulty", str(path)],
    "run": lambda path: ["run", str(path)],
    "fit-detector": lambda path: ["fit-detector", str(path)],
}


@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
@pytest.mark.parametrize("reader", READERS)
def test_no_reader_waits_or_reads_without_end(reader: str, kind: str, tmp_path: Path) -> None:
    """Before, a pipe made each of them wait for ever, and /dev/zero took the memory."""
    path = made(kind, tmp_path / "file.yaml")
    with pytest.raises(SetupError, match=f"it is a {kind}") as caught:
        READERS[reader](path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("kind", ["pipe", "device"])
@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_waits(
    command: str,
    kind: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    declare(monkeypatch)
    path = made(kind, tmp_path / "file.yaml")
    assert run(COMMANDS[command](path)) == 2
    assert f"rebar: {path}: cannot be read: it is a {kind}" in capsys.readouterr().err


def test_a_report_notes_a_pipe_in_place_of_a_table(tmp_path: Path) -> None:
    for name in ("scores.parquet", "floor.parquet"):
        made("pipe", tmp_path / name)
    notes: list[str] = []
    assert _floors(tmp_path, {}, notes) == {}
    assert load_scores(tmp_path, notes).is_empty()
    assert [note.split()[0] for note in notes] == ["floor.parquet", "There"]


def test_a_campaign_folder_with_a_pipe_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Folders come from elsewhere too, with what somebody put in the place of a file."""
    for name in ("manifest.json", "evidence.jsonl", "journal.sqlite", ".lock", "campaign.yaml"):
        folder = tmp_path / f"of-{name}"
        folder.mkdir()
        made("pipe", folder / name)
        assert read_manifest(folder / "manifest.json") is None
        for command in ("verify", "report", "score", "status"):
            assert run([command, str(folder)]) == 2
        assert "Traceback" not in capsys.readouterr().err
