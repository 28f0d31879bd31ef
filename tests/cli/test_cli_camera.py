"""`rebar camera`: what it draws, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.camera.sheet import asset_sheet
from bench.cli._app import run


def test_a_sheet_shows_each_asset_in_a_cell_of_its_own() -> None:
    """Two assets fill two different cells of a row, the others stay empty."""
    sheet = asset_sheet(("soldier", "ambulance"))
    cells = [sheet[:180, left : left + 240].astype(float) for left in range(0, 1440, 240)]

    assert sheet.shape == (198, 1440, 3)
    assert [cell.std() > 15.0 for cell in cells] == [True, True, False, False, False, False]
    assert np.abs(cells[0] - cells[1]).mean() > 10.0


def test_a_picture_of_an_unknown_kind_is_refused_before_anything_is_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The error names the option, the suffix, and those that there are."""
    assert run(["camera", "sheet", "--out", str(tmp_path / "sheet.gif")]) == 2
    assert "--out: cannot write pictures as .gif (use .png, .jpg, .webp)" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_renderer_that_is_not_installed_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The error names the option and what there is."""
    assert run(["camera", "sheet", "--out", str(tmp_path / "sheet.png"), "--renderer", "crayons"]) == 2
    error = capsys.readouterr().err
    assert "--renderer: there is no renderer 'crayons' (installed: " in error
    assert "opencv" in error
    assert not list(tmp_path.iterdir())
