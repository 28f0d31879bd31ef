"""Methods of design: each has what its literature promises, judged by counting and in whole numbers."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from collections import Counter
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.documents import validate_document
from bench.errors import SetupError
from bench.realization import INACTIVE, Design, DesignPoint, Method, design_quality
from bench.realization.design._fractional_factorial import fraction
from bench.realization.design._hadamard import conference_matrix
from bench.realization.design._nested_hypercubes import nested_latin_hypercube
from bench.realization.design._orthogonal_hypercubes import (
    largest_correlation,
    nearly_orthogonal_latin_hypercube,
    orthogonal_latin_hypercube,
)
from bench.realization.design._screening import definitive_screening, plackett_burman


def ranges(count: int, **fields: Any) -> list[dict[str, Any]]:
    return [
        {"name": f"f{place}", "range": {"low": 0.0, "high": 1.0, **fields}, "sets": [f"x{place}"]}
        for place in range(count)
    ]


def levels(name: str, *values: object, **fields: Any) -> dict[str, Any]:
    return {"name": name, "levels": list(values), "sets": [name], **fields}


def design(factors: list[dict[str, Any]], **fields: Any) -> Design:
    return validate_document({"factors": factors, **fields}, Design)


def refused(factors: list[dict[str, Any]], **fields: Any) -> str:
    with pytest.raises(SetupError) as refusal:
        design(factors, **fields)
    return str(refusal.value)


def matrix(plan: Design) -> NDArray[np.float64]:
    return np.array([[float(level) for level in point.levels.values()] for point in plan.points()])


@pytest.mark.parametrize(
    ("points", "columns"),
    [
        (5, 2),
        (9, 4),
        (17, 8),
        (33, 16),
        (65, 32),
        (129, 64),
        (257, 128),
        (16, 8),
        (32, 16),
        (48, 8),
        (49, 8),
        (25, 4),
        (24, 4),
    ],
)
def test_orthogonal_latin_hypercubes_are_exactly_that(points: int, columns: int) -> None:
    """In whole numbers: every column a permutation about 0, every product of two 0, and of one with another's
    square too.
    """
    square = orthogonal_latin_hypercube(points, columns)

    assert square.shape == (points, columns)
    assert square.dtype == np.int64
    marks = np.arange(points) - points // 2 if points % 2 else 2 * np.arange(points) - (points - 1)
    assert (np.sort(square, axis=0) == marks[:, None]).all()
    products = square.T @ square
    assert not (products - np.diag(np.diag(products))).any()
    assert not (square.T @ square**2).any()


def test_orthogonal_latin_hypercube_of_eight_factors() -> None:
    """17 runs of 8 factors: the upper half is the T of Sun, Liu and Lin (2009) for c = 3, signs and order
    aside.
    """
    square = np.abs(orthogonal_latin_hypercube(17, 8))

    assert square[:8].tolist() == [
        [1, 2, 3, 4, 5, 6, 7, 8],
        [2, 1, 4, 3, 6, 5, 8, 7],
        [3, 4, 1, 2, 7, 8, 5, 6],
        [4, 3, 2, 1, 8, 7, 6, 5],
        [5, 6, 7, 8, 1, 2, 3, 4],
        [6, 5, 8, 7, 2, 1, 4, 3],
        [7, 8, 5, 6, 3, 4, 1, 2],
        [8, 7, 6, 5, 4, 3, 2, 1],
    ]
    assert not square[8].any()


def test_orthogonal_design_over_factors() -> None:
    """Whichever columns the seed picks: ends of the ranges reached, correlation 0, the least points where
    none are given.
    """
    plan = design(ranges(5), method={"kind": "orthogonal_latin_hypercube"}, seed=4)

    values = np.rint(matrix(plan) * 16 - 8).astype(np.int64)
    assert values.shape == (17, 5)
    assert (np.sort(values, axis=0) == np.arange(-8, 9)[:, None]).all()
    assert largest_correlation(values) == 0.0
    quality = design_quality(plan.space, plan.points())
    assert quality.max_abs_correlation == 0.0
    other = design(ranges(5), method={"kind": "orthogonal_latin_hypercube"}, seed=5)
    assert matrix(other).tolist() != matrix(plan).tolist()
    assert "16 and 17 points do" in refused(
        ranges(8), method={"kind": "orthogonal_latin_hypercube", "points": 20}
    )


@pytest.mark.parametrize(("points", "factors"), [(11, 3), (20, 6), (41, 8), (100, 12)])
def test_nearly_orthogonal_latin_hypercubes(points: int, factors: int) -> None:
    """Every column is a permutation, and no correlation reaches the 0.03 by which such designs are known."""
    square = nearly_orthogonal_latin_hypercube(points, factors, seed=1)

    assert (np.sort(square, axis=0) == (2 * np.arange(points) - (points - 1))[:, None]).all()
    assert largest_correlation(square) < 0.03
    assert np.array_equal(square, nearly_orthogonal_latin_hypercube(points, factors, seed=1))
    values = matrix(
        design(ranges(factors), method={"kind": "nearly_orthogonal_latin_hypercube", "points": points})
    )
    assert len({round(point, 9) for point in values[:, 0]}) == points


def test_plackett_burman_of_twelve_runs_as_printed() -> None:
    """The first row that Plackett and Burman (1946) print for 12 runs, turned, and a last row of low
    levels.
    """
    printed = [1, 1, -1, 1, 1, 1, -1, -1, -1, 1, -1]
    rows = plackett_burman(11).tolist()

    assert rows == [printed[-turn:] + printed[:-turn] if turn else printed for turn in range(11)] + [
        [-1] * 11
    ]


@pytest.mark.parametrize(
    ("runs", "printed"),
    [(8, "+++-+--"), (20, "++--++++-+-+----++-"), (24, "+++++-+-++--++--+-+----")],
)
def test_plackett_burman_rows_as_printed(runs: int, printed: str) -> None:
    """As for 12, in 8, 20 and 24 runs."""
    assert "".join("+" if sign > 0 else "-" for sign in plackett_burman(runs - 1)[0]) == printed


@pytest.mark.parametrize(
    "factors", [3, 7, 11, 15, 19, 23, 27, 31, 35, 39, 43, 47, 51, 55, 59, 63, 71, 75, 83, 99]
)
def test_plackett_burman_is_balanced_and_orthogonal(factors: int) -> None:
    """Every factor is high in half the runs, and every two are high together in a quarter."""
    signs = plackett_burman(factors)

    assert len(signs) == factors + 1
    assert not signs.sum(axis=0).any()
    assert np.array_equal(signs.T @ signs, len(signs) * np.eye(factors, dtype=np.int64))


def test_foldover_frees_main_effects_of_pairs() -> None:
    """Folded over, no main effect goes with any product of two factors; as it is, some do."""
    plain, folded = (
        2 * matrix(design(ranges(5), method={"kind": "plackett_burman", "foldover": foldover})) - 1
        for foldover in (False, True)
    )

    def blurred(signs: NDArray[np.float64]) -> float:
        pairs = np.stack([signs[:, a] * signs[:, b] for a, b in itertools.combinations(range(5), 2)], axis=1)
        return float(np.abs(signs.T @ pairs).max())

    assert len(folded) == 2 * len(plain) == 16
    assert blurred(plain) > 0.0
    assert blurred(folded) == 0.0


def test_conference_matrix_of_six_as_printed() -> None:
    """That of Xiao, Lin and Bai (2012) for 6 factors."""
    assert np.array_equal(
        conference_matrix(6),  # type: ignore[arg-type]
        [
            [0, 1, 1, 1, 1, 1],
            [1, 0, 1, -1, -1, 1],
            [1, 1, 0, 1, -1, -1],
            [1, -1, 1, 0, 1, -1],
            [1, -1, -1, 1, 0, 1],
            [1, 1, -1, -1, 1, 0],
        ],
    )
    for order in (4, 6, 8, 10, 12, 14, 16, 18, 20, 24, 26, 30, 32, 38, 50):
        values = conference_matrix(order)
        assert values is not None
        assert np.array_equal(values.T @ values, (order - 1) * np.eye(order, dtype=np.int64))
    assert conference_matrix(22) is None  # 21 is no sum of two squares, so there is none


@pytest.mark.parametrize(
    ("factors", "runs"), [(3, 9), (4, 9), (5, 13), (6, 13), (7, 17), (10, 21), (11, 25), (21, 49)]
)
def test_definitive_screening_separates_what_it_says(factors: int, runs: int) -> None:
    """Main effects are orthogonal to each other, to every square and to every product of two, exactly."""
    rows = definitive_screening(factors)

    assert rows.shape == (runs, factors)
    products = rows.T @ rows
    assert not (products - np.diag(np.diag(products))).any()
    second = np.stack(
        [rows[:, a] * rows[:, b] for a, b in itertools.combinations_with_replacement(range(factors), 2)],
        axis=1,
    )
    assert not (rows.T @ second).any()
    assert not rows[-1].any()


def test_definitive_screening_over_factors() -> None:
    """Low, middle and high of ranges, and three numbers in their order."""
    plan = design([*ranges(2), levels("fog", 4, 0, 1)], method={"kind": "definitive_screening"})
    points = [tuple(point.levels.values()) for point in plan.points()]

    assert {value for point in points for value in point[:2]} == {0.0, 0.5, 1.0}
    assert points[-1] == (0.5, 0.5, 1)
    assert "three numbers" in refused(
        [*ranges(2), levels("approach", "N", "S")], method={"kind": "definitive_screening"}
    )


@pytest.mark.parametrize(
    ("factors", "resolution", "runs"),
    [
        # Box, Hunter and Hunter (2005), table 6.22: the least runs of a regular fraction.
        *[(3, 3, 4), (5, 3, 8), (7, 3, 8), (15, 3, 16), (31, 3, 32)],
        *[
            (4, 4, 8),
            (6, 4, 16),
            (7, 4, 16),
            (8, 4, 16),
            (9, 4, 32),
            (11, 4, 32),
            (16, 4, 32),
            (17, 4, 64),
            (32, 4, 64),
        ],
        *[(5, 5, 16), (8, 5, 64), (10, 5, 128), (11, 5, 128), (6, 6, 32), (9, 6, 128), (7, 7, 64)],
    ],
)
def test_fractions_have_their_resolution_in_the_least_runs(factors: int, resolution: int, runs: int) -> None:
    """No product of fewer columns is a constant, found by multiplying them all; and no more runs than the
    tables give.
    """
    columns = fraction(factors, resolution)

    assert 2 ** max(columns).bit_length() == runs
    for count in range(1, resolution if factors < 12 else min(resolution, 4)):
        for chosen in itertools.combinations(columns, count):
            product = 0
            for column in chosen:
                product ^= column
            assert product
    plan = (
        matrix(design(ranges(factors), method={"kind": "fractional_factorial", "resolution": resolution})) * 2
        - 1
    )
    assert plan.shape == (runs, factors)
    assert np.array_equal(plan.T @ plan, runs * np.eye(factors))


def test_fraction_by_generators_and_by_runs() -> None:
    """Half of 2^4 by d = a b c has every level of d the product of the others'; by runs it is found by
    itself.
    """
    four = [{**point, "name": name} for point, name in zip(ranges(4), "abcd", strict=True)]
    by_hand = (
        2
        * matrix(design(four, method={"kind": "fractional_factorial", "generators": {"d": ["a", "b", "c"]}}))
        - 1
    )
    values = 2 * matrix(design(four, method={"kind": "fractional_factorial", "runs": 8})) - 1

    assert (by_hand[:, 3] == by_hand[:, 0] * by_hand[:, 1] * by_hand[:, 2]).all()
    assert by_hand[:, :3].tolist() == [list(point) for point in itertools.product([-1, 1], repeat=3)]
    assert np.array_equal(values, by_hand)
    kind = {"kind": "fractional_factorial"}
    assert "no base factor" in refused(
        four, method={**kind, "generators": {"d": ["a", "c"], "c": ["a", "b"]}}
    )
    assert "same column" in refused(four, method={**kind, "generators": {"d": ["a", "b"], "c": ["a", "b"]}})
    assert "give one of" in refused(four, method={**kind, "runs": 8, "resolution": 4})
    assert "no power of two" in refused(four, method={**kind, "runs": 12})
    assert "use full_factorial" in refused(four, method={**kind, "runs": 16})
    assert "at most 3 factors" in refused(four, method={**kind, "runs": 4})
    assert "takes two" in refused([*four[:3], levels("d", 1, 2, 3)], method={**kind, "resolution": 4})


def occurring(points: list[DesignPoint], names: tuple[str, ...]) -> set[tuple[object, ...]]:
    return {tuple(point.levels[name] for name in names) for point in points}


@pytest.mark.parametrize(
    ("sizes", "strength", "max_runs"),
    [
        ([3] * 4, 2, 11),
        ([2] * 10, 2, 10),
        ([3] * 13, 2, 23),
        ([5, 4, 3, 2, 2], 2, 22),
        ([3] * 6, 3, 52),
        ([2] * 8, 4, 40),
        ([4, 3], 4, 12),
        ([4, 3, 2], 1, 4),
    ],
)
def test_covering_arrays_cover_everything(sizes: list[int], strength: int, max_runs: int) -> None:
    """Every combination of levels of any t factors, by going through them all; in a number of points near to
    what is known.
    """
    factors = [levels(f"f{place}", *range(size)) for place, size in enumerate(sizes)]
    points = design(factors, method={"kind": "covering_array", "strength": strength}).points()

    t = min(strength, len(sizes))
    for chosen in itertools.combinations(range(len(sizes)), t):
        combinations = set(itertools.product(*(range(sizes[at]) for at in chosen)))
        assert occurring(points, tuple(f"f{at}" for at in chosen)) == combinations
    assert len(points) <= max_runs


TANGLED = [
    levels("gps", "good", "degraded", "none"),
    levels("noise", 1, 2, 3, when="gps == 'degraded'"),
    levels("approach", "N", "E", "S", "W"),
    levels("fog", 0, 2, 4),
    levels("night", True, False),
    {"name": "load", "formula": "fog * 2 + (1 if night else 0)", "sets": ["load"]},
]
FORBID = ["approach == 'N' and fog > 1", "load > 8", "noise == 3 and approach == 'S'"]


@pytest.mark.parametrize("strength", [2, 3])
def test_covering_arrays_keep_what_is_forbidden_out(strength: int) -> None:
    """With conditional factors, formulas and prohibitions: all that can be, judged by every point there is,
    and nothing else.
    """
    full = design(TANGLED, forbid=FORBID).points()
    points = design(TANGLED, forbid=FORBID, method={"kind": "covering_array", "strength": strength}).points()

    names = ("gps", "noise", "approach", "fog", "night")
    for chosen in itertools.combinations(names, strength):
        assert occurring(points, chosen) == occurring(full, chosen)
    assert len(points) < len(full)


def test_covering_array_that_cannot_be() -> None:
    """Everything forbidden, and too much to cover, are message."""
    assert "everything is forbidden" in refused(
        [levels("a", 1, 2)], forbid=["a < 5"], method={"kind": "covering_array"}
    )
    factors = [levels(f"f{place}", *range(30)) for place in range(6)]
    assert "lower strength" in refused(factors, method={"kind": "covering_array", "strength": 4})


def test_conditional_factors_and_formulas() -> None:
    """A conditional factor is inactive where its condition fails, one point then stands for all its levels,
    and formulas follow.
    """
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


@pytest.mark.parametrize("kind", ["halton", "sobol"])
def test_sequences_grow_without_reshuffling(kind: str) -> None:
    """More points begin with the earlier ones, forbidden ones among them or not, over the block that is drawn
    at once too.
    """
    shorter, longer = (
        design(
            [*ranges(2), levels("a", "x", "y")],
            forbid=["f0 > 0.9 and a == 'x'"],
            method={"kind": kind, "points": count},
        ).points()
        for count in (5, 600)
    )

    assert longer[:5] == shorter
    assert len(longer) == 600


def test_every_method_that_says_so_grows() -> None:
    """Which methods claim to take more points later; the test above and that of stratified designs hold them
    to it.
    """
    kinds = {point.model_fields["kind"].default: point.grows for point in get_args(get_args(Method)[0])}

    assert {kind for kind, grows in kinds.items() if grows} == {"halton", "sobol", "stratified"}
    assert len(kinds) == 13


def test_further_points_follow_those_that_are_there() -> None:
    """`then` numbers on, whatever the methods are, and leaves points, draws and scenes of the first as they
    were.
    """
    factors = [levels("a", 1, 2, 3), levels("b", 1, 2, 3)]
    first = design(factors, replicates=2, method={"kind": "full_factorial", "take": 7}, seed=3)
    grown = design(
        factors,
        replicates=2,
        method={"kind": "full_factorial", "take": 7},
        seed=3,
        then=[{"kind": "sobol", "points": 4}] * 2,
    )

    assert grown.pairs()[:7] == first.pairs()
    assert [point.id for point, _ in grown.pairs()[7:]] == [
        f"p{9 + n:03d}" for n in range(1, 9) for _ in "12"
    ]
    blocks = [[point.levels for point in grown.points()[at : at + 4]] for at in (9, 13)]
    assert blocks[0] != blocks[1]


def test_nested_designs_are_latin_twice() -> None:
    """All points fill their strata once each, and the high ones theirs; pairs share levels and scene."""
    rows = nested_latin_hypercube(24, 6, 3, seed=2)

    assert (np.sort((rows * 24).astype(int), axis=0) == np.arange(24)[:, None]).all()
    assert (np.sort((rows[:6] * 6).astype(int), axis=0) == np.arange(6)[:, None]).all()
    plan = design(
        [levels("rate", 10, 50), *ranges(3)],
        method={"kind": "nested", "points": 24, "high": 6, "fidelity": "rate"},
    ).points()
    low = {tuple(point.levels.values())[1:]: point for point in plan if point.levels["rate"] == 10}
    high = [point for point in plan if point.levels["rate"] == 50]
    assert (len(low), len(high)) == (24, 6)
    assert all(low[tuple(point.levels.values())[1:]].scene == point.scene != point.id for point in high)
    assert len({point.scene for point in plan}) == 24
    assert "multiple of high" in refused(
        ranges(2), method={"kind": "nested", "points": 9, "high": 4, "fidelity": "f0"}
    )


def rated(chosen: Any) -> dict[str, float]:
    """A difficulty in which most of the range is easy."""
    return {"KA-1": 20.0 if chosen["f0"] < 0.8 else 60.0, "KA-2": 20.0 if chosen["a"] == "x" else 90.0}


def test_every_flight_of_a_nested_design_has_a_scene_of_its_own_but_for_twins() -> None:
    """Points that happen to have the same levels are no twins: flown in one scene they would be one run
    counted twice.
    """
    factors = [levels("rate", 10, 50), levels("a", 1, 2), {"name": "b", "formula": "a * rate", "sets": ["b"]}]
    points = design(factors, method={"kind": "nested", "points": 8, "high": 2, "fidelity": "rate"}).points()

    low = [point for point in points if point.levels["rate"] == 10]
    high = [point for point in points if point.levels["rate"] == 50]
    assert [point.scene for point in low] == [point.id for point in low]
    assert (
        [point.scene for point in high]
        == [points[points.index(point) - 1].id for point in high]
        == ["p001", "p003"]
    )


WHOLE = {"name": "whole", "range": {"low": 3, "high": 6, "integer": True}, "sets": ["whole"]}


@pytest.mark.parametrize("kind", ["sobol", "halton", "latin_hypercube", "nearly_orthogonal_latin_hypercube"])
def test_whole_numbers_and_levels_are_even(kind: str) -> None:
    """The ends of whole numbers come as often as those between, and so does every level, the order of levels
    no matter.
    """
    plan = design(
        [*ranges(1), WHOLE, levels("a", "x", "y", "z", "w")], method={"kind": kind, "points": 64}
    ).points()

    for name, allowed in (("whole", {3, 4, 5, 6}), ("a", set("xyzw"))):
        values = Counter(point.levels[name] for point in plan)
        assert set(values) == allowed
        assert max(values.values()) - min(values.values()) <= 2


def test_whole_numbers_of_an_orthogonal_design_are_even_and_mirrored() -> None:
    """65 points on 4 numbers: 16 each and the centre, and each point's mirror image has the mirrored
    number.
    """
    points = design([*ranges(1), WHOLE], method={"kind": "orthogonal_latin_hypercube", "points": 65}).points()

    assert sorted(Counter(point.levels["whole"] for point in points).values()) == [16, 16, 16, 17]
    of = {round(float(point.levels["f0"]), 9): int(point.levels["whole"]) for point in points}
    assert all(of[round(1 - share, 9)] == 9 - whole for share, whole in of.items() if share != 0.5)


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


def test_definitive_screening_needs_a_middle() -> None:
    """Between 3 and 6 no whole number is in the middle, and without it main effects would go with squares."""
    assert "in the middle" in refused([*ranges(2), WHOLE], method={"kind": "definitive_screening"})


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


def test_stratified_designs_are_even_and_grow() -> None:
    """Configurations that are rare among the factors' levels get as many points as common ones, and more
    points keep the first.
    """

    def points(count: int) -> list[DesignPoint]:
        method = {"kind": "stratified", "points": count, "candidates": 300}
        return design([*ranges(2), levels("a", "x", "y")], method=method, seed=1).points(rated)

    values = Counter(tuple(rated(point.levels).values()) for point in points(22))
    assert sorted(values.values()) == [5, 5, 6, 6]
    assert points(22)[:9] == points(9)


def test_stratified_designs_that_cannot_be() -> None:
    """More configurations than points, and too few candidates, are message; bands make few of many."""
    method = {"kind": "stratified", "points": 6, "candidates": 100}

    def smooth(chosen: Any) -> dict[str, float]:
        return {"KA-1": 100.0 * chosen["f0"]}

    with pytest.raises(ValueError, match="100 difficulty configurations, more than points 6"):
        design(ranges(1), method=method).points(smooth)
    banded = design(ranges(1), method={**method, "band": 20.0}).points(smooth)
    assert sorted(Counter(int(float(point.levels["f0"]) * 5) for point in banded).values()) == [1, 1, 1, 1, 2]
    with pytest.raises(ValueError, match="only 2 different points"):
        design([levels("a", 1, 2)], method=method).points(lambda _: {"KA-1": 1.0})


def test_quality_against_what_can_be_counted() -> None:
    """A square's corners: correlation 0, all pairs, the side over the diagonal; a line of points: correlation
    1 and what is missing.
    """
    corners = design([levels("a", 0, 1), levels("b", "x", "y")])
    line = [DesignPoint(f"p{n}", {"f0": n / 4, "f1": 1 - n / 4}) for n in range(5)]

    square = design_quality(
        corners.space, corners.points(), pairs=12, configurations=["hard", "easy", "easy", "easy"]
    )
    assert (square.points, square.pairs, square.max_abs_correlation) == (4, 12, 0.0)
    assert square.min_distance == pytest.approx(1 / 2**0.5)
    assert [(point.t, point.covered, point.possible) for point in square.coverage] == [(2, 4, 4)]
    assert square.configurations == {"easy": 3, "hard": 1}
    quality = design_quality(design(ranges(2), method={"kind": "sobol", "points": 2}).space, line)
    assert quality.max_abs_correlation == 1.0
    assert quality.correlated == ("f0", "f1")
    assert [(point.covered, point.possible) for point in quality.coverage] == [(3, 9)]
    assert any("largest correlation 1 (f0 and f1)" in text for text in quality.lines())


def test_quality_tells_aliases() -> None:
    """Half of 2^4: pairs are aliased with pairs; a quarter of 2^5: main effects too; Plackett-Burman: a
    third; folded over: none.
    """

    def measured(count: int, **method: Any) -> Any:
        named = [{**point, "name": name} for point, name in zip(ranges(count), "abcdefghijk", strict=False)]
        plan = design(named, method=method)
        return design_quality(plan.space, plan.points())

    half = measured(4, kind="fractional_factorial", runs=8)
    assert (half.max_interaction, half.interacting) == (0.0, ())
    assert half.aliased == ("a x b = c x d", "a x c = b x d", "a x d = b x c")
    quarter = measured(5, kind="fractional_factorial", generators={"d": ["a", "b"], "e": ["a", "c"]})
    assert quarter.max_interaction == 1.0
    # From I = abd = ace = bcde, by hand.
    assert set(quarter.aliased) == {
        *("a = b x d = c x e", "b = a x d", "c = a x e", "d = a x b", "e = a x c"),
        *("b x c = d x e", "b x e = c x d"),
    }
    assert measured(11, kind="plackett_burman").max_interaction == pytest.approx(1 / 3)
    assert measured(11, kind="plackett_burman", foldover=True).max_interaction == 0.0
    assert measured(6, kind="definitive_screening").aliased == ()
    assert measured(5, kind="fractional_factorial", resolution=5).aliased == ()
    assert any("cannot be separated: a x b = c x d" in line for line in half.lines())


def test_quality_tells_what_prohibitions_tie_together() -> None:
    """Names that go with a number, and a conditional factor where it is active: both are told, and points
    that carry no effects.
    """
    factors = [levels("a", "x", "y", "z"), levels("fog", 0, 1, 2), levels("more", 0, 1, 2, when="fog > 0")]
    free = design(factors)
    tied = design(
        factors,
        forbid=[
            "a == 'x' and fog != 0",
            "a == 'y' and fog != 1",
            "a == 'z' and fog != 2",
            "fog > 0 and more != fog",
        ],
    )

    loose, tight = (design_quality(point.space, point.points()) for point in (free, tied))
    assert (loose.max_abs_correlation, loose.max_association, loose.estimable) == (0.0, 0.0, True)
    assert (tight.max_abs_correlation, tight.correlated) == (1.0, ("fog", "more"))
    assert (tight.max_association, tight.associated) == (1.0, ("a", "fog"))
    assert tight.estimable is False
    assert any("too few points, or too similar ones" in line for line in tight.lines())


def test_quality_counts_only_what_may_be() -> None:
    """Forbidden combinations are not missed, and a covering array of strength 2 has all pairs and not all
    triples.
    """
    plan = design(TANGLED, forbid=FORBID, method={"kind": "covering_array"})
    pairs, triples = design_quality(plan.space, plan.points()).coverage

    assert pairs.covered == pairs.possible
    assert triples.covered < triples.possible
    everything = design_quality(plan.space, design(TANGLED, forbid=FORBID).points()).coverage
    assert all(point.covered == point.possible for point in everything)


def test_centred_discrepancy_by_its_formula() -> None:
    """One factor, three points: Hickernell's sum worked out by hand."""
    plan = design(ranges(1, steps=3))
    u = np.array([0.0, 0.5, 1.0])
    d = np.abs(u - 0.5)
    pairs = 1 + 0.5 * d[:, None] + 0.5 * d[None, :] - 0.5 * np.abs(u[:, None] - u[None, :])
    by_hand = 13 / 12 - 2 / 3 * (1 + 0.5 * d - 0.5 * d**2).sum() + pairs.sum() / 9

    assert design_quality(plan.space, plan.points()).discrepancy == pytest.approx(by_hand)


_SCRIPT = """
import json, sys
from bench.realization import Design
print([Design.model_validate(one).points() for one in json.load(sys.stdin)])
"""


def test_designs_are_the_same_in_another_process() -> None:
    """With another hash seed the same points are drawn, for every method that draws or searches."""
    methods: list[dict[str, Any]] = [
        {"kind": "latin_hypercube", "points": 12},
        {"kind": "nearly_orthogonal_latin_hypercube", "points": 12},
        {"kind": "orthogonal_latin_hypercube"},
        {"kind": "sobol", "points": 12},
        {"kind": "nested", "points": 12, "high": 4, "fidelity": "rate"},
    ]
    documents = [
        {"factors": [levels("rate", 1, 2), *ranges(3)], "method": method, "seed": 9} for method in methods
    ]
    documents.append(
        {"factors": TANGLED, "forbid": FORBID, "method": {"kind": "covering_array", "strength": 3}}
    )
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    digests = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        input=json.dumps(documents),
        env={"PYTHONHASHSEED": seed},
        capture_output=True,
        text=True,
        check=True,
    )

    assert digests.stdout.strip() == str([validate_document(point, Design).points() for point in documents])
