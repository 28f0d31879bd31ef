"""The outside package of examples/detector_fit, imported where it lies."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench.contracts import plugins

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "detector_fit"))

from rebar_detector_fit import DetectorFit as DetectorFit
from rebar_detector_fit import fit_detector as fit_detector
from rebar_detector_fit._curves import joint_probability as joint_probability
from rebar_detector_fit._curves import solve_rate as solve_rate
from rebar_detector_fit._fit import shares_of as shares_of
from rebar_detector_fit._matching import match_runs as match_runs

PACKAGE = Path(__file__).parents[1] / "examples" / "detector_fit"


def declare(monkeypatch: pytest.MonkeyPatch) -> None:
    """For one test, `rebar fit-detector` and its document are there as if the package were installed."""
    command = EntryPoint("fit-detector", "rebar_detector_fit._command:fit_detector", "rebar.commands")
    document = EntryPoint("detector-fit", "rebar_detector_fit:DetectorFit", "rebar.documents")
    monkeypatch.setitem(plugins("rebar.commands"), command.name, command)
    monkeypatch.setitem(plugins("rebar.documents"), document.name, document)
