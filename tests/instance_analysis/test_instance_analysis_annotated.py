"""A SimSpec from prose as a file for people: what was said, with its words beside it."""

from __future__ import annotations

import pytest

from bench.documents import read_document
from bench.instance_analysis import annotated_yaml, load_vocabulary, read_prose
from bench.simspec import SimSpec

TEXTS = [
    "A radar vehicle. 1 to 2 military trucks 20 to 40 m from the radar, between 5 and 10 civilians within 60 m of the radar, light rain, fly at 60 m.",
    "Two soldiers walking in the northern part; no-fly from nowhere. GPS jammed at 100 s for 20 s. Do not return home.",
    "Children: 4. A house. Three soldiers, half concealed. Intelligence on the soldiers, priority 2. Time limit 10 minutes, wind 5 m/s from the west.",
    "A truck # not a comment: 'quoted', at 14:30Z on 3 March 2026\nacross\ttwo lines, fog level 2-5",
]


@pytest.mark.parametrize("text", TEXTS)
def test_the_file_is_the_same_simspec(text: str) -> None:
    """Whatever is left out of the file is a default, and comments change nothing."""
    result = read_prose(text, load_vocabulary())
    assert read_document(annotated_yaml(result), SimSpec) == result.simspec


def test_every_line_that_was_said_quotes_it() -> None:
    """What the prose says stands in the file even where it is a default; what it does not say stands there as
    a default or not at all.
    """
    result = read_prose(TEXTS[0], load_vocabulary())
    lines = [line.strip() for line in annotated_yaml(result).splitlines()]

    assert "altitude_m: 60.0  # 'fly at 60 m'" in lines
    assert "count: 5  # 'between 5 and 10 civilians'" in lines
    assert "- east_m: -300.0  # default" in lines
    assert not [line for line in lines if line.startswith(("perception", "budgets", "seeds", "fog_level"))]


def test_what_is_open_stands_above_the_document() -> None:
    """A choice with its readings, and a passage that is left out, are comments at the top."""
    result = read_prose("Five vehicles near home.\nFly at about 70 m.\nIf it rains, hold.", load_vocabulary())
    choice, free, passage, *_ = annotated_yaml(result).splitlines()
    assert choice == (
        "# choice: 'Five vehicles' what is meant by 'vehicles'? -> civilian-car (clutter) (or: military-truck (adversary))"
    )
    assert free == "# check: 'Fly at about 70 m'"
    assert passage.startswith("# not read: 'If it rains, hold'")
