"""Commands join by pip, from two packages at once: that of examples/detector_fit, and one in tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from detector_fit import PACKAGE, DetectorFit
from test_plugins_outside import OUTSIDE, install_outside

from bench.contracts import document_schema

# What needs SciPy is imported when a command is called, not when it is listed.
CALL = """
import site, sys
site.addsitedir(sys.argv[1])
from bench.cli._app import run
code = run(sys.argv[2:])
print("scipy" in sys.modules, file=sys.stderr)
sys.exit(code)
"""


def call(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", CALL, str(site), *words]
    return subprocess.run(command, check=False, capture_output=True, text=True, cwd=site)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    for package in (PACKAGE, OUTSIDE):
        install_outside(package, folder)
    return folder


def test_installed_commands_are_listed_and_called(site: Path) -> None:
    listed = call(site, "--help")
    assert listed.returncode == 0, listed.stderr
    names = [line.split()[0] for line in listed.stdout.splitlines() if line.strip()]
    assert names[-2:] == ["fit-detector", "outside-greet"]
    assert listed.stderr.splitlines()[-1] == "False"
    assert call(site, "outside-greet", "Ada").stdout == "Hello Ada\n"
    refused = call(site, "fit-detector", "none.mcap")
    assert refused.returncode == 2
    assert refused.stderr.startswith("rebar: none.mcap")
    shown = " ".join(call(site, "fit-detector", "--help").stdout.split())
    assert "Example: rebar fit-detector out/pixels/runs/*/recording.mcap --out fitted.yaml" in shown


def test_an_installed_document_has_its_schema(site: Path) -> None:
    printed = call(site, "schema", "detector-fit")
    assert json.loads(printed.stdout) == json.loads(json.dumps(document_schema(DetectorFit)))
