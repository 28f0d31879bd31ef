"""How the vehicle flies beside the real autopilots on the same plant."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import flight_qualities
import pytest
from flight_qualities import QUALITIES

PAGE = Path(__file__).parents[2] / "docs" / "vehicle.md"

# Two flights of each autopilot serve all rows.
figures = cache(flight_qualities.figures)


@pytest.mark.parametrize("autopilot", QUALITIES)
def test_the_figures_are_those_of_the_real_autopilot(autopilot: str) -> None:
    """Within a tenth; near zero within the tolerance that its row states."""
    assert figures(autopilot) == {
        name: pytest.approx(quality.real, abs=quality.tolerance)
        for name, quality in QUALITIES[autopilot].items()
    }


def test_the_page_has_these_figures() -> None:
    """docs/vehicle.md has rows of the table that `flight_qualities.py` prints."""
    header, _, *rows = flight_qualities.table({name: figures(name) for name in QUALITIES}).splitlines()
    _, _, shown = PAGE.read_text().partition(header)
    on_the_page = shown.partition("\n\n")[0].splitlines()[2:]
    assert len(on_the_page) > 5
    assert [row for row in on_the_page if row not in rows] == []
