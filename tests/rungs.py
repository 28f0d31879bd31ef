"""The ways in which an agent can be confined, as parameters of tests: each test of walls runs on every one that the host has.

`BARE` is the rung `landlock` as on a host that gives no namespaces.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import pytest

from bench.agents.confinement import _landlock
from bench.agents.confinement import rungs as all_rungs
from bench.simspec import Isolation

BARE = "landlock-bare"
CONFINING = ("landlock", BARE)
EVERY = (*CONFINING, "none")


@contextmanager
def rung_or_skip(name: str) -> Iterator[Isolation]:
    """The rung for a manifest while the block runs, in this process. Skips where it cannot start here."""
    isolation: Isolation = "landlock" if name == BARE else name  # type: ignore[assignment]  # one of the names above
    if name == "landlock" and (fault := _landlock.namespaces_fault()):
        pytest.skip(f"this host gives no namespaces: {fault}")
    fault = "switched off" if name == BARE else _landlock.namespaces_fault()
    with mock.patch.object(_landlock, "namespaces_fault", return_value=fault):
        # A rung keeps what its trial has shown; the trial of `landlock` differs without namespaces.
        if reason := (type(all_rungs()[isolation])() if name == BARE else all_rungs()[isolation]).trial():
            pytest.skip(f"{isolation} cannot start here: {reason}")
        yield isolation
