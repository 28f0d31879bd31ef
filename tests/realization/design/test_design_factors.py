"""Factors of a design: conditions, formulas, ranges, prohibitions, and what is refused of them."""

from __future__ import annotations

from typing import Any

import pytest
from design_plans import FORBID, TANGLED, design, levels, ranges, refused

from bench.realization import INACTIVE


def test_conditional_factors_and_formulas() -> None:
    """Inactive where its condition fails, one point then stands for all its levels; formulas follow."""
    points = [point.levels for point in design(TANGLED).points()]

    assert len(points) == (2 + 3) * 4 * 3 * 2
    assert {levels["noise"] for levels in points if levels["gps"] == "degraded"} == {1, 2, 3}
    assert {levels["noise"] for levels in points if levels["gps"] != "degraded"} == {INACTIVE}
    assert all(
        levels["load"] == float(levels["fog"]) * 2 + (1 if levels["night"] else 0) for levels in points
    )
    assert list(points[0]) == ["gps", "noise", "approach", "fog", "night", "load"]


def test_steps_of_a_range_are_the_numbers_that_one_writes() -> None:
    """The third of five steps from 0.1 to 0.5 is 0.3, so that what is forbidden at 0.3 is."""
    stepped = {"name": "a", "range": {"low": 0.1, "high": 0.5, "steps": 5}, "sets": ["a"]}

    assert [point.levels["a"] for point in design([stepped], forbid=["a == 0.3"]).points()] == [
        0.1,
        0.2,
        0.4,
        0.5,
    ]


def test_forbidden_points_are_left_out() -> None:
    """Of a full factorial just the forbidden ones are missing."""
    combinations = [point.levels for point in design(TANGLED).points()]
    remaining = [point.levels for point in design(TANGLED, forbid=FORBID).points()]

    def wrong(combination: Any) -> bool:
        return bool(
            (combination["approach"] == "N" and combination["fog"] > 1)
            or combination["load"] > 8
            or (combination["noise"] == 3 and combination["approach"] == "S")
        )

    assert remaining == [combination for combination in combinations if not wrong(combination)]


@pytest.mark.parametrize(
    ("factors", "others", "message"),
    [
        (
            [levels("a", 1, 2), {"name": "b", "formula": "c + 1", "sets": ["b"]}],
            {},
            "names 'c', which is not a factor",
        ),
        (
            [{"name": "a", "formula": "b", "sets": ["a"]}, {"name": "b", "formula": "a", "sets": ["b"]}],
            {},
            "in a circle",
        ),
        ([levels("a", 1, 2, when="a > 1")], {}, "in a circle"),
        ([levels("a", 1, 2, formula="3")], {}, "either levels"),
        ([levels("a", INACTIVE, "x", when="b == 1"), levels("b", 1, 2)], {}, "name it otherwise"),
        ([levels("a", 0, 2), {"name": "b", "formula": "1 / a", "sets": ["b"]}], {}, "no value at a=0"),
        ([levels("a", 1, 2)], {"forbid": ["a + 1"]}, "neither true nor false"),
        ([levels("a", 1, 2)], {"forbid": ["a > "]}, "is missing"),
        ([levels("a", 1, 2)], {"forbid": ["a > 0"]}, "every point is forbidden"),
        (
            ranges(2),
            {"forbid": ["f0 > 0.5"], "method": {"kind": "latin_hypercube", "points": 8}},
            "4 of the 8 points",
        ),
        (ranges(2), {"forbid": ["f0 >= 0"], "method": {"kind": "sobol", "points": 8}}, "leaves 0 of 8000"),
        ([{"name": "a", "formula": "1", "sets": ["a"]}], {}, "every factor has a formula"),
        ([], {"method": {"kind": "sobol", "points": 8}}, "has no factors"),
    ],
)
def test_factors_that_cannot_be(factors: list[dict[str, Any]], others: dict[str, Any], message: str) -> None:
    """What contradicts itself is refused with a sentence as the document is read."""
    assert message in refused(factors, **others)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"low": 0.5, "high": 2.5, "integer": True}, "must be whole"),
        ({"low": 0, "high": 3, "integer": True, "steps": 5}, "there are 4 whole numbers"),
    ],
)
def test_ranges_of_whole_numbers_that_are_none(wrong: dict[str, Any], message: str) -> None:
    """Half a person is no bound, and a step that would stand twice is none."""
    assert message in refused([{"name": "a", "range": wrong, "sets": ["a"]}])


def test_integer_beside_a_range_or_levels_is_told_where_it_belongs() -> None:
    """A range has its own; levels are what they are."""
    range_ = {"low": 1, "high": 5}
    message = refused([{"name": "a", "range": range_, "integer": True, "sets": ["a"]}])
    assert "write it inside: range: {low: 1, high: 5, integer: true}" in message
    assert "leave it out" in refused([{"name": "a", "levels": [1, 2], "integer": True, "sets": ["a"]}])
    assert design(
        [{"name": "a", "range": range_ | {"integer": True}, "sets": ["a"]}, *ranges(1)],
        method={"kind": "sobol", "points": 8},
    )


@pytest.mark.parametrize(
    "forbid",
    ["a == 'n' and f0 > 0.5", "night == 'true'", "f0 == 'x'", "'N' != a == 'W'", "not (night != 'no')"],
)
def test_words_that_a_factor_never_is_are_slips(forbid: str) -> None:
    """A prohibition that misspells a level would forbid nothing, silently."""
    factors = [levels("a", "N", "S"), levels("night", True, False), *ranges(1)]

    assert "which it never is" in refused(factors, forbid=[forbid], method={"kind": "sobol", "points": 8})
    assert design(
        factors, forbid=["a == 'N' and night == true and (f0) > 0.5"], method={"kind": "sobol", "points": 8}
    ).points()


def test_a_prohibition_that_leaves_hardly_anything_is_said_soon() -> None:
    """Ten thousand points are looked at, not as many times a thousand as were required for."""
    assert "leaves 0 of 10000 points" in refused(
        ranges(2), forbid=["f0 >= 0"], method={"kind": "sobol", "points": 50_000}
    )
