"""`rebar simulate` says in one line how the agent was confined."""

from __future__ import annotations

import pytest

from bench.agents.confinement import Wall
from bench.cli._sessions import _fact_lines
from bench.contracts import Confinement, Outcome, SessionResult, facts_of


def confinement_line(isolation: str, network: str = "own", open_walls: tuple[str, ...] | None = None) -> str:
    confinement = Confinement(isolation=isolation, network=network, open_walls=open_walls)
    result = SessionResult(realization="a", outcome=Outcome.COMPLETED, facts=facts_of(confinement))
    (line,) = _fact_lines(result)
    return line


HELD = "isolation: landlock, a network of its own"


@pytest.mark.parametrize(
    ("isolation", "network", "words"),
    [
        ("landlock", "own", HELD),
        ("landlock", "the host's: no room", "isolation: landlock, the network is the host's: no room"),
        ("none", "own", "NOT CONFINED"),
        ("none", "the host's: no room", "NOT CONFINED"),
    ],
)
def test_rung_and_network_are_named(isolation: str, network: str, words: str) -> None:
    line = confinement_line(isolation, network)
    assert words in line
    assert "\n" not in line


def test_open_walls_are_named() -> None:
    """In the words of the table; nothing is said of a box that leaves nothing open."""
    assert confinement_line("landlock", open_walls=()) == confinement_line("landlock") == HELD
    line = confinement_line("landlock", open_walls=("udp", "host_name"))
    assert line == f"{HELD}; leaves open: {Wall.UDP}; {Wall.HOST_NAME}"
