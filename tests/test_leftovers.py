"""A run of the tests that leaves temporary files fails, and says after which test they were first there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = """
import pytest
from leftovers import Leftovers


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Leftovers(config))
"""
TIDY = """
import os, tempfile


def test_tidy(tmp_path):
    (tmp_path / "own").touch()
    with tempfile.NamedTemporaryFile() as file:
        assert file.name.startswith(os.environ["TMPDIR"])


def test_tidy_as_well():
    with tempfile.TemporaryDirectory():
        pass
"""
UNTIDY = """
import os, subprocess, tempfile


def test_untidy():
    tempfile.mkdtemp(prefix="left-")


def test_untidy_child():
    subprocess.run(["mktemp", "-d", "-t", "child-XXXXXX"], check=True)
"""


def run_tests(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run what lies in a folder, with temporary files in its `temporary`."""
    (folder / "conftest.py").write_text(CONFTEST)
    temporary = folder / "temporary"
    temporary.mkdir(exist_ok=True)
    environment = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    environment |= {"TMPDIR": str(temporary), "PYTHONPATH": str(Path(__file__).parent)}
    # Most of the time would go into plug-ins of pytest that have no part in this.
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    command = [
        sys.executable,
        *["-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", ".", "."],
        *options,
    ]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert list(temporary.iterdir()) == [], done.stdout
    return done


@pytest.mark.parametrize("options", [(), ("-p", "xdist", "-n", "2")])
def test_what_is_left_fails_the_run(tmp_path: Path, options: tuple[str, ...]) -> None:
    (tmp_path / "test_tidy.py").write_text(TIDY)
    (tmp_path / "test_untidy.py").write_text(UNTIDY)
    done = run_tests(tmp_path, *options)
    assert done.returncode == 1, done.stdout
    left = sorted(line for line in done.stdout.splitlines() if ": since " in line)
    told = [(line.split("-")[0], line.partition("::")[2]) for line in left]
    assert told == [("child", "test_untidy_child"), ("left", "test_untidy")]
    # Without those, the run passes.
    (tmp_path / "test_untidy.py").unlink()
    done = run_tests(tmp_path, *options)
    assert done.returncode == 0, done.stdout
    assert "left among" not in done.stdout
