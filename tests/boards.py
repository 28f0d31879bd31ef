"""The outside package of examples/boards, imported where it lies, with a board in the place of a device."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench.contracts import plugins

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "boards"))

from rebar_boards import LineClock as LineClock
from rebar_boards import Px4BoardKind as Px4BoardKind
from rebar_boards._agent_parameters import MAX_PARAMETERS as MAX_PARAMETERS
from rebar_boards._line_budget import frame_bytes as frame_bytes
from rebar_boards._line_budget import plan_line as plan_line

PACKAGE = Path(__file__).parents[1] / "examples" / "boards"
DECLARED = Px4BoardKind()


def declare(monkeypatch: pytest.MonkeyPatch, clock: LineClock | None = None) -> None:
    """For one test, `px4-board` is a firmware as if the package were installed, in the time of `clock`."""
    monkeypatch.setattr(sys.modules[__name__], "DECLARED", Px4BoardKind(clock))
    entry = EntryPoint("px4-board", f"{__name__}:DECLARED", "rebar.firmware")
    monkeypatch.setitem(plugins("rebar.firmware"), "px4-board", entry)
