"""Calls a function in a new process that has a network of its own, as the workers of a campaign have."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pytest

T = TypeVar("T")
SKIPPED = 77
# The network comes before any import that starts a thread.
_BOOT = f"""
import json, pickle, sys
sys.path[:] = json.loads(sys.argv[1])
from bench.network_namespace import enter_network_namespace
if fault := enter_network_namespace():
    print(fault)
    sys.exit({SKIPPED})
import pytest
function, arguments, options = pickle.load(sys.stdin.buffer)
try:
    result = function(*arguments, **options)
except pytest.skip.Exception as reason:
    print(reason)
    sys.exit({SKIPPED})
with open(sys.argv[2], "wb") as file:
    pickle.dump(result, file)
"""


def call_in_own_network(folder: Path, function: Callable[..., T], *arguments: Any, **options: Any) -> T:
    """What the function, one of a module, returns there; all of it can be pickled. `folder` is for the answer.

    Skips the test where this host gives no network namespace, or the function skips it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    answer = folder / "answer.pickle"
    done = subprocess.run(
        [sys.executable, "-P", "-c", _BOOT, json.dumps(sys.path), str(answer)],
        input=pickle.dumps((function, arguments, options)),
        capture_output=True,
        check=False,
        timeout=280,
    )
    if done.returncode == SKIPPED:
        pytest.skip(done.stdout.decode())
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    result: T = pickle.loads(answer.read_bytes())
    answer.unlink()
    return result
