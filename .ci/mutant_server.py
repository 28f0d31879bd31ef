"""Run chosen tests on one mutant after another, each in a fork of an interpreter that has collected all tests.

Most of the time of a mutant would go into imports. A fork has them done; it gives the functions of the changed
module their changed code and runs the tests. Orders come as lines of JSON on standard input, and each is
answered on standard output: `survived`, `killed`, `timeout`, or `fresh` where the change lies outside
functions, so that only a fresh interpreter can show what it does.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType
from typing import IO

import pytest
from _pytest.main import pytest_runtestloop

# Exit statuses of a fork.
_SURVIVED, _KILLED, _FRESH = 0, 1, 2
_ANSWERS = {_SURVIVED: "survived", _KILLED: "killed", _FRESH: "fresh"}
_POLL_S = 0.02


class MutantServer:
    """A pytest plugin whose test loop serves orders instead of running what was collected."""

    def __init__(self, orders: IO[str], answers: IO[str]) -> None:
        self._orders = orders
        self._answers = answers

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        items = {item.nodeid: item for item in session.items}
        for line in self._orders:
            order = json.loads(line)
            chosen = [items[name] for name in order["tests"]]
            fork = os.fork()
            if not fork:
                # A session of its own, so that a mutant that loops is ended with everything that it started.
                os.setsid()
                # Nothing of pytest's ending is wanted in a fork.
                os._exit(_run(session, chosen, order["path"], order["sound"]))
            self._answers.write(_answer(fork, order["timeout_s"]) + "\n")
            self._answers.flush()
        return True


def _answer(fork: int, timeout_s: float) -> str:
    """What became of a fork."""
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        done, status = os.waitpid(fork, os.WNOHANG)
        if done:
            return _ANSWERS.get(os.waitstatus_to_exitcode(status), "killed")
        time.sleep(_POLL_S)
    os.killpg(fork, signal.SIGKILL)
    os.waitpid(fork, 0)
    return "timeout"


def _run(session: pytest.Session, items: list[pytest.Item], path: str, sound: str) -> int:
    try:
        if not change_functions(path, sound):
            return _FRESH
        session.items = items
        session.config.option.maxfail = 1
        pytest_runtestloop(session)
    except BaseException:
        return _KILLED
    return _KILLED if session.testsfailed else _SURVIVED


def change_functions(path: str, sound: str) -> bool:
    """Give the functions of an imported module the code that its file has now; `sound` is its source as
    imported.

    False where the module is not imported, or where more than its functions has changed.
    """
    changed = compile(Path(path).read_text(encoding="utf-8"), path, "exec")
    if list(_outside_functions(compile(sound, path, "exec"))) != list(_outside_functions(changed)):
        return False
    codes = dict(_functions(changed))
    functions = [
        function
        for function in gc.get_objects()
        if isinstance(function, FunctionType) and function.__code__.co_filename == path
    ]
    for function in functions:
        code = codes.get(_name(function.__code__))
        if code is not None:
            function.__code__ = code
    return bool(functions)


def _name(code: CodeType) -> tuple[str, int]:
    return code.co_qualname, code.co_firstlineno


def _is_class(code: CodeType) -> bool:
    """Whether a code object is the body of a class: those name their module first."""
    return "__module__" in code.co_names and "__qualname__" in code.co_names


def _functions(code: CodeType) -> Iterator[tuple[tuple[str, int], CodeType]]:
    """Functions of a module and methods of its classes; what is nested in a function comes with it."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            if _is_class(constant):
                yield from _functions(constant)
            else:
                yield _name(constant), constant


def _outside_functions(code: CodeType) -> Iterator[object]:
    """What a module and its classes execute when they are imported."""
    yield code.co_code
    yield code.co_names
    for constant in code.co_consts:
        if not isinstance(constant, CodeType):
            yield constant
        elif _is_class(constant):
            yield from _outside_functions(constant)


def main() -> None:
    # pytest closes the standard streams to its tests.
    orders, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    pytest.main(sys.argv[1:], plugins=[MutantServer(orders, answers)])


if __name__ == "__main__":
    main()
