"""Inside members and between two: what chance does not find, where it ends, and wherever hosts stand."""

from __future__ import annotations

import pytest
from yards import YARDS, corners, faults, group, scene, written

from bench.realization import place
from bench.realization.placement._placement import placement_order, with_places
from bench.realization.placement.search._solver import solve_placement


@pytest.mark.parametrize("name", YARDS["hard"])
def test_the_solver_finds_what_chance_does_not(name: str) -> None:
    """Hosts wait for those to whom their guests relate; guests are tried in rows, turned as required."""
    wanted = scene(*written(YARDS["hard"][name]))
    placed = solve_placement(wanted, placement_order(wanted))
    assert placed is not None
    assert faults(with_places(wanted, placed, "cp-sat")) == []


def test_between_ends_at_the_two() -> None:
    """Behind one of the two is not between them, however near to it."""
    ends = [
        group("a", "crate", at={"east_m": 40, "north_m": 40}),
        group("b", "crate", at={"east_m": 60, "north_m": 40}),
    ]
    wanted = scene(*ends, group("c", "child", 1, between={"first": "a", "second": "b", "within_m": 4}))
    realized = place(wanted).realized
    assert realized is not None
    for east_m, north_m, inside in (
        (57.0, 43.9, True),
        (61.0, 43.0, False),
        (39.0, 43.0, False),
        (50.0, 44.1, False),
    ):
        actors = tuple(
            actor.model_copy(update={"east_m": east_m, "north_m": north_m}) if actor.group == "c" else actor
            for actor in realized.actors
        )
        judged = wanted.model_copy(update={"realized": realized.model_copy(update={"actors": actors})})
        assert ("is not between" not in "\n".join(faults(judged))) is inside


def test_guests_need_no_ground_of_their_own() -> None:
    """A yard that its houses fill has room for those in them: areas of guests are not added."""
    yard = corners(0, 0, 30, 30)
    houses = group("houses", "house", 5, region=yard, separation_m=0.1)
    assert (
        faults(place(scene(houses, group("crates", "crate", 15, inside={"of": "houses"}, region=yard)))) == []
    )
