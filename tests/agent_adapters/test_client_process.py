"""How a Python agent starts and ends: cheaply, because every session pays for it."""

from __future__ import annotations

import subprocess
import sys

import pytest


def run(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=variables)


@pytest.mark.parametrize(("variables", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_numpy_keeps_to_one_thread_where_nobody_has_said_otherwise(
    variables: dict[str, str], threads: str
) -> None:
    """What the user has set stays."""
    code = "import os; from agent_adapters.client import use_one_thread; use_one_thread(); print(os.environ['OPENBLAS_NUM_THREADS'])"
    assert run(code, **variables).stdout.split() == [threads]


@pytest.mark.parametrize("code", [0, 3])
def test_a_process_ends_at_once_with_all_that_it_has_printed(code: int) -> None:
    """Both streams are complete; exit handlers do not run."""
    ended = run(
        "import atexit, sys; from agent_adapters.client import end_process; atexit.register(print, 'handler'); "
        f"sys.stdout.write('out'); sys.stderr.write('err'); end_process({code})"
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "out", "err")


@pytest.mark.parametrize("module", ["reference._agent", "null.__main__"])
def test_an_agent_does_not_import_what_only_the_bench_needs(module: str) -> None:
    """The SimSpec and the documents of the truth cost a fifth of a second in each session."""
    names = ("bench.simspec._document", "bench.contracts._truth_documents")
    ended = run(
        f"import sys, agent_adapters.{module}; before = [name for name in {names} if name in sys.modules]; "
        "import bench.contracts._truth_documents; print(before, [name for name in "
        f"{names} if name in sys.modules])"
    )
    # The second list shows that the modules still have these names.
    assert ended.stdout.strip() == f"[] {list(names)}", ended.stderr
