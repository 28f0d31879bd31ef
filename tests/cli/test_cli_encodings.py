"""Commands in surroundings that are not UTF-8: everything is printed, nothing ends in a traceback, files are UTF-8."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from command_line import EXAMPLE, SURROGATES

from bench.cli import main

WORDS = "Größe – 日本"
CAMPAIGN = SURROGATES | {"description": WORDS}
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
"""The locale of a bare machine, which Python would otherwise take for UTF-8."""


def rebar(line: list[str], **surroundings: str) -> subprocess.CompletedProcess[bytes]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONIOENCODING"}
    command = [sys.executable, "-m", "bench.cli", *line]
    return subprocess.run(command, capture_output=True, check=False, env=environment | surroundings)


def printed(line: list[str], encoding: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """What a command prints where the streams have an encoding."""
    written = io.BytesIO()
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, io.TextIOWrapper(written, encoding=encoding, write_through=True))
    monkeypatch.setattr(sys, "argv", ["rebar", *line])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0, written.getvalue()
    return written.getvalue().decode(encoding)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of surrogates, flown in the C locale in a folder whose name has no place in it."""
    folder = tmp_path_factory.mktemp("encodings") / "Größe"
    folder.mkdir()
    (folder / "käse.yaml").write_text(yaml.safe_dump(CAMPAIGN, allow_unicode=True), encoding="utf-8")
    line = ["run", str(folder / "käse.yaml"), "--out", str(folder / "out"), "--workers", "1"]
    ended = rebar(line, **C_LOCALE)
    assert (ended.returncode, ended.stderr.count(b"\n")) == (0, 13), ended.stderr.decode()
    assert b"reference-naive - OVERHEAD FIDELITY" in ended.stdout
    assert b"Gr\\u00f6\\u00dfe" in ended.stdout
    ended.stdout.decode("ascii")
    return folder


def test_files_are_utf8_whatever_the_locale_is(flown: Path) -> None:
    campaign = yaml.safe_load((flown / "out" / "campaign.yaml").read_text(encoding="utf-8"))
    assert campaign["description"] == WORDS
    assert "–" in (flown / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
@pytest.mark.parametrize(
    "line",
    [
        ["run", "{0}/käse.yaml", "--out", "{0}/out"],
        ["score", "{0}/out", "--per-run"],
        ["compare", "{0}/out"],
        ["report", "{0}/out"],
        ["difficulty", str(EXAMPLE)],
        ["prose", f"A radar vehicle in {WORDS}, 5–10 civilians within 50 m of it"],
        ["run", "--help"],
    ],
    ids=" ".join,
)
def test_every_table_is_printed(
    flown: Path, line: list[str], encoding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert printed([word.format(flown) for word in line], encoding, monkeypatch)


@pytest.mark.parametrize("line", [["score", "{0}/out"], ["compare", "{0}/out"], ["status", "{0}/out"]])
def test_json_is_one_in_every_encoding(flown: Path, line: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    words = [*(word.format(flown) for word in line), "--json"]
    plain, narrow = (json.loads(printed(words, encoding, monkeypatch)) for encoding in ("utf-8", "ascii"))
    assert plain == narrow
    assert str(flown) in json.dumps(narrow, ensure_ascii=False)


@pytest.mark.parametrize("surroundings", [{}, C_LOCALE])
def test_a_name_not_in_utf8_is_refused_before_a_flight(flown: Path, surroundings: dict[str, str]) -> None:
    out = os.fsdecode(os.fsencode(flown) + b"/n\xe9")
    ended = rebar(["run", str(flown / "käse.yaml"), "--out", out], **surroundings)
    assert (ended.returncode, ended.stdout) == (2, b"")
    assert ended.stderr.decode().endswith("/n\\udce9: is not UTF-8 (rename it)\n")
    assert not Path(out).exists()
