"""Factors of a design: conditions, formulas, ranges, prohibitions, and what is refused of them."""

from __future__ import annotations

from typing import Any

import pytest
from design_plans import FORBID, TANGLED, design, levels, ranges, refused

from bench.realization import INACTIVE

SOBOL_8: dict[str, Any] = {"kind": "sobol", "points": 8}
LATIN_8 = {"kind": "latin_hypercube", "points": 8}


def formula(name: str, text: str) -> dict[str, Any]:
    return {"name": name, "formula": text, "sets": [name]}


def in_range(**fields: Any) -> dict[str, Any]:
    return {"name": "a", "range": fields, "sets": ["a"]}


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
    points = design([in_range(low=0.1, high=0.5, steps=5)], forbid=["a == 0.3"]).points()
    assert [point.levels["a"] for point in points] == [0.1, 0.2, 0.4, 0.5]


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
        ([levels("a", 1, 2), formula("b", "c + 1")], {}, "names 'c', which is not a factor"),
        ([formula("a", "b"), formula("b", "a")], {}, "in a circle"),
        ([levels("a", 1, 2, when="a > 1")], {}, "in a circle"),
        ([levels("a", 1, 2, formula="3")], {}, "either levels"),
        ([levels("a", INACTIVE, "x", when="b == 1"), levels("b", 1, 2)], {}, "name it otherwise"),
        ([levels("a", 0, 2), formula("b", "1 / a")], {}, "no value at a=0"),
        ([levels("a", 1, 2)], {"forbid": ["a + 1"]}, "neither true nor false"),
        ([levels("a", 1, 2)], {"forbid": ["a > "]}, "is missing"),
        ([levels("a", 1, 2)], {"forbid": ["a > 0"]}, "every point is forbidden"),
        (ranges(2), {"forbid": ["f0 > 0.5"], "method": LATIN_8}, "4 of the 8 points"),
        (ranges(2), {"forbid": ["f0 >= 0"], "method": SOBOL_8}, "leaves 0 of 8000"),
        # Ten thousand points are looked at, not as many times a thousand as were asked for.
        (
            ranges(2),
            {"forbid": ["f0 >= 0"], "method": SOBOL_8 | {"points": 50_000}},
            "leaves 0 of 10000 points",
        ),
        ([formula("a", "1")], {}, "every factor has a formula"),
        ([], {"method": SOBOL_8}, "has no factors"),
        ([levels("a", 1), levels("a", 2)], {}, "two factors are called 'a'"),
        ([levels("a", 1, 1.0)], {}, "stands twice"),
        ([levels("a")], {}, "give either levels"),
        ([levels("a", 1, 2) | {"sets": []}], {}, "changes nothing"),
        ([levels("a", "x", patches={"y": {}})], {}, "must name exactly the levels"),
        (
            [levels("a", 1, 2, 3)],
            {"method": {"kind": "full_factorial", "take": 4}},
            "take 4 exceeds the 3 pairs",
        ),
        ([levels(name, *range(99)) for name in "abc"], {}, "use a latin_hypercube"),
        ([in_range(low=2, high=1)], {}, "high 1.0 must exceed low 2.0"),
        # Levels are counted, so a range needs steps. Half a person is no bound, a step that stands twice is none.
        ([in_range(low=0, high=8)], {}, "give levels or range.steps"),
        ([in_range(low=0.5, high=2.5, integer=True)], {}, "must be whole"),
        ([in_range(low=0, high=3, integer=True, steps=5)], {}, "there are 4 whole numbers"),
        (
            [in_range(low=1, high=5) | {"integer": True}],
            {},
            "inside: range: {low: 1, high: 5, integer: true}",
        ),
        ([levels("a", 1, 2, integer=True)], {}, "leave it out"),
    ],
)
def test_factors_that_cannot_be(factors: list[dict[str, Any]], others: dict[str, Any], message: str) -> None:
    """What contradicts itself is refused with a sentence as the document is read."""
    assert message in refused(factors, **others)


@pytest.mark.parametrize(
    "forbid",
    ["a == 'n' and f0 > 0.5", "night == 'true'", "f0 == 'x'", "'N' != a == 'W'", "not (night != 'no')"],
)
def test_words_that_a_factor_never_is_are_slips(forbid: str) -> None:
    """A prohibition that misspells a level would forbid nothing, silently."""
    factors = [levels("a", "N", "S"), levels("night", True, False), *ranges(1)]

    assert "which it never is" in refused(factors, forbid=[forbid], method=SOBOL_8)
    right = "a == 'N' and night == true and (f0) > 0.5"
    assert design(factors, forbid=[right], method=SOBOL_8).points()
