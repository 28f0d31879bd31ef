"""What each rung holds, by an agent that looks for ways out: exactly what the table says of this host."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from host_image import image_or_skip

from bench.agents.confinement import HOLDINGS, Host, Wall, leaves_open, rungs, walls_table

FOLDER = Path(__file__).parent
DOCS = FOLDER.parents[1] / "docs"
RUNGS = [(rung, own_network) for rung in ("landlock", "bwrap", "container") for own_network in (False, True)]


FORKED = "+fork"


@cache
def self_test(rung: str, own_network: bool) -> tuple[dict[str, list[str]], Host]:
    """The gaps that the probe found by wall, and the host that it ran on."""
    if reason := rungs()[rung.removesuffix(FORKED)].trial():
        pytest.skip(f"{rung} cannot start here: {reason}")
    image = [image_or_skip()] if rung == "container" else []
    finished = subprocess.run(
        [sys.executable, str(FOLDER / "self_test.py"), rung, str(int(own_network)), *image],
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )
    assert finished.returncode == 0, finished.stderr
    gaps = json.loads(finished.stdout)
    return gaps["gaps"], Host(**gaps["host"])


@pytest.mark.parametrize(("rung", "own_network"), [("none", False), *RUNGS, ("landlock" + FORKED, False)])
def test_a_rung_holds_what_the_table_says_and_no_less(rung: str, own_network: bool) -> None:
    """A wall that the table calls open is open here too: a table that is too modest hides a test that is blind.

    The walls round a fork of a warm interpreter are those round a fresh process.
    """
    gaps, host = self_test(rung, own_network)
    if own_network and not host.own_network:
        pytest.skip("this host gives no network namespace")
    assert gaps.keys() == {wall.name for wall in Wall}
    expected = {wall.name for wall in leaves_open(rung.removesuffix(FORKED), host)}
    assert {name for name, is_open in gaps.items() if is_open} == expected, gaps


def test_the_docs_have_the_table() -> None:
    """It is generated: `python -m bench.agents.confinement` prints it."""
    assert walls_table() in (DOCS / "agents.md").read_text()


def test_every_rung_takes_a_stand_on_every_wall() -> None:
    """By name, and on two hosts that differ in everything."""
    poor = Host(False, 1, False, False, False, False)
    rich = Host(True, 7, True, True, True, True)
    assert HOLDINGS.keys() == rungs().keys()
    for rung, holdings in HOLDINGS.items():
        assert set(holdings) == set(Wall)
        assert set(leaves_open(rung, rich)) <= set(leaves_open(rung, poor))
    assert leaves_open("bwrap", rich) == ()
    assert Wall.TCP in leaves_open("landlock", poor)
