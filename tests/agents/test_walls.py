"""What each rung holds, by an agent that looks for ways out: exactly what the table says of this host."""

from __future__ import annotations

from pathlib import Path

import pytest
from host_image import image_or_skip
from own_network import call_in_own_network
from rungs import BARE, EVERY
from self_test import gaps_of, planted

from bench.agents.confinement import HOLDINGS, Host, Wall, leaves_open, rungs, walls_table

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("own_network", [False, True])
@pytest.mark.parametrize("rung", [*EVERY, "container"])
def test_a_rung_holds_what_the_table_says_and_no_less(rung: str, own_network: bool, tmp_path: Path) -> None:
    """A wall that the table calls open is open here too: a table that is too modest hides a test that is blind."""
    image = image_or_skip() if rung == "container" else ""
    with planted() as canaries:
        arguments = (rung, canaries, tmp_path / "probe", image)
        gaps, host = (
            call_in_own_network(tmp_path, gaps_of, *arguments) if own_network else gaps_of(*arguments)
        )
    assert host.own_network == own_network
    assert gaps.keys() == {wall.name for wall in Wall}
    expected = {wall.name for wall in leaves_open("landlock" if rung == BARE else rung, host)}
    assert {name for name, is_open in gaps.items() if is_open} == expected, gaps


def test_the_docs_have_the_table() -> None:
    """It is generated: `python -m bench.agents.confinement` prints it."""
    assert walls_table() in (DOCS / "agents-confinement.md").read_text()


def test_every_rung_takes_a_stand_on_every_wall() -> None:
    """By name, and on two hosts that differ in everything."""
    poor = Host(True, 1, False, False, False, False, False)
    rich = Host(True, 7, True, True, True, True, True)
    assert HOLDINGS.keys() == rungs().keys()
    for rung, holdings in HOLDINGS.items():
        assert set(holdings) == set(Wall)
        assert set(leaves_open(rung, rich)) <= set(leaves_open(rung, poor))
    assert leaves_open("landlock", rich) == ()
    assert Wall.TCP in leaves_open("landlock", poor)
