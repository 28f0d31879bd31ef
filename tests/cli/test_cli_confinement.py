"""`rebar simulate` says in one line how the agent was confined."""

from __future__ import annotations

import pytest

from bench.agents.confinement import Wall
from bench.cli._sessions import _confinement_line


@pytest.mark.parametrize(
    ("isolation", "network", "words"),
    [
        ("bwrap", "own", "isolation: bwrap, a network of its own"),
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
    line = _confinement_line({"isolation": isolation, "network": network})
    assert words in line
    assert "\n" not in line


def test_open_walls_are_named() -> None:
    """In the words of the table; nothing is said of a box that leaves nothing open."""
    details: dict[str, object] = {"isolation": "bwrap", "network": "own"}
    held = _confinement_line(details | {"leaves_open": []})
    assert held == _confinement_line(details) == "isolation: bwrap, a network of its own"
    line = _confinement_line(details | {"leaves_open": ["udp", "host_name"]})
    assert line == f"{held}; leaves open: {Wall.UDP}; {Wall.HOST_NAME}"
