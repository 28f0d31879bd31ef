"""Commands join by pip, from two packages at once: that of examples/detector_fit, and one in tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from detector_fit import DetectorFit

from bench.contracts import document_schema

CALLS = """
import contextlib, io, json, site, sys
site.addsitedir(sys.argv[1])
from bench.cli._app import run
answers = []
for words in json.loads(sys.argv[2]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(words)
    answers.append([code, out.getvalue(), err.getvalue(), "scipy" in sys.modules])
print(json.dumps(answers))
"""


def test_installed_commands_are_listed_and_called(site: Path) -> None:
    lines = [
        ["--help"],
        ["outside-greet", "Ada"],
        ["schema", "detector-fit"],
        ["fit-detector", "none.mcap"],
        ["fit-detector", "--help"],
    ]
    command = [sys.executable, "-c", CALLS, str(site), json.dumps(lines)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=site)
    listed, greeted, schema, refused, helped = json.loads(done.stdout)
    assert listed[0] == 0, listed
    names = [line.split()[0] for line in listed[1].splitlines() if line.strip()]
    assert names[-2:] == ["fit-detector", "outside-greet"]
    # What needs SciPy is imported when a command is called, not when it is listed.
    assert listed[3] is False
    assert greeted[1] == "Hello Ada\n"
    assert json.loads(schema[1]) == json.loads(json.dumps(document_schema(DetectorFit)))
    assert refused[0] == 2
    assert refused[2].startswith("rebar: none.mcap")
    assert "Example: rebar fit-detector out/pixels/runs/*/recording.mcap --out fitted.yaml" in " ".join(
        helped[1].split()
    )
