"""Packages from outside, installed by pip into a folder of their own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import boards
import detector_fit
import pytest

OUTSIDE = Path(__file__).parent / "outside"

DECOMPOSITION = """
format: rebar.decomposition/1
name: outside
title: One measure from outside
principles: [{id: reliable, title: Reliable, asks: It works., children: [KA-1]}]
key_attributes: [{id: KA-1, title: Climbs, asks: It climbs., children: [VAB-1]}]
vabs: [{id: VAB-1, title: Climbs, asks: It climbs., children: [OBS-1]}]
observables:
  - id: OBS-1
    title: Height
    asks: How high did it come?
    measure: outside_height
    options: {of_share: 0.5}
    threshold: 0.5
    threshold_reason: Half of the way is a climb.
    partial_credit: false
    considered: Always.
    always_considered: true
    key_factors:
      - {factor: uav_altitude_m, unit: m, ratings: [10, 100], values: [10, 100], reason: Higher is harder.}
"""


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of all packages; to change one of them, copy it."""
    folder = tmp_path_factory.mktemp("site")
    options = "--quiet --disable-pip-version-check --no-build-isolation --no-deps --no-index --target"
    command = [sys.executable, "-m", "pip", "install", *options.split(), str(folder)]
    # Together, because the start of pip takes as long as a package.
    packages = (OUTSIDE, detector_fit.PACKAGE, boards.PACKAGE)
    subprocess.run([*command, *map(str, packages)], check=True, capture_output=True)
    return folder
