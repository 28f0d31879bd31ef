"""A run of the tests has a folder of its own for temporary files, and fails if anything is left in it at the end.

Each worker of pytest-xdist has its own part of it, so that what is left can be put down to a test. The folders of `tmp_path`
lie there too and are no leftovers; `--basetemp` keeps them.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bench.temporary_folders import temporary_folder

RUN_FOLDER = "REBAR_TESTS_FOLDER"
PYTEST_FOLDERS = "pytest-of-"
Names = dict[str, str]


class Leftovers:
    """What each worker, or the only process, has left: names of files and the test after which they were first there."""

    def __init__(self, config: pytest.Config) -> None:
        self._names: Names = {}
        self._stack = ExitStack()
        workerinput: dict[str, str] | None = getattr(config, "workerinput", None)
        self._is_worker = workerinput is not None
        if workerinput is None:
            os.environ[RUN_FOLDER] = str(self._stack.enter_context(temporary_folder("tests")))
        self._run = Path(os.environ[RUN_FOLDER])
        self._folder = self._run / ("main" if workerinput is None else workerinput["workerid"])
        self._folder.mkdir()
        # Other users may pass, but not list: a test starts what it has installed there as another user.
        for folder in (self._run, self._folder):
            folder.chmod(0o711)
        # Whatever this process starts has them too.
        os.environ["TMPDIR"] = tempfile.tempdir = str(self._folder)
        config.add_cleanup(self._stack.close)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        result = yield
        self._look(item.nodeid)
        return result

    def _look(self, test: str) -> None:
        names = (name for name in os.listdir(self._folder) if not name.startswith(PYTEST_FOLDERS))
        self._names = {name: self._names.get(name, test) for name in names}

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: object) -> None:
        output: dict[str, Names] = getattr(node, "workeroutput", {})
        for name, test in output.get("leftovers", {}).items():
            self._names[name] = test

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._is_worker or not self._names:
            self._look("the last test")
        if self._is_worker:
            session.config.workeroutput["leftovers"] = self._names  # type: ignore[attr-defined]  # pytest-xdist's
        elif self._names and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._names:
            terminalreporter.section("left among the temporary files", red=True)
        for name, test in self._names.items():
            terminalreporter.line(f"{name}: since {test}")
