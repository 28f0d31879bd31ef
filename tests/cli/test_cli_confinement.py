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


@pytest.mark.parametrize(
    ("isolation", "network", "words"),
    [
        ("landlock", "own", "isolation: landlock, a network of its own"),
        (
            "landlock",
            "the host's: no permission",
            "isolation: landlock, the network is the host's: no permission",
        ),
        ("none", "own", "NOT CONFINED"),
        ("none", "the host's: no permission", "NOT CONFINED"),
    ],
)
def test_rung_and_network_are_named(isolation: str, network: str, words: str) -> None:
    line = confinement_line(isolation, network)
    assert words in line
    assert "\n" not in line


def test_open_walls_are_named() -> None:
    """In the words of the table; nothing is said of a box that leaves nothing open."""
    held = confinement_line("landlock", open_walls=())
    assert held == confinement_line("landlock") == "isolation: landlock, a network of its own"
    line = confinement_line("landlock", open_walls=("udp", "host_name"))
    assert line == f"{held}; leaves open: {Wall.UDP}; {Wall.HOST_NAME}"
