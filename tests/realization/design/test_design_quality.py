"""How good a design is: discrepancy, distances, aliases, and what prohibitions tie together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from design_plans import FORBID, TANGLED, design, levels, ranges

from bench.realization import DesignPoint, design_quality


def test_quality_against_what_can_be_counted() -> None:
    """A square's corners: correlation 0, all pairs; a line of points: 1, and what is missing."""
    corners = design([levels("a", 0, 1), levels("b", "x", "y")])
    line = [DesignPoint(f"p{n}", {"f0": n / 4, "f1": 1 - n / 4}) for n in range(5)]

    rated = ["hard", "easy", "easy", "easy"]
    square = design_quality(corners.space, corners.points(), pairs=12, configurations=rated)
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
    """Half of 2^4: pairs alias pairs; a quarter of 2^5: main effects; Plackett-Burman: a third; folded: 0."""

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
    """Names that go with a number, a conditional factor where active, points that carry no effects."""
    factors = [levels("a", "x", "y", "z"), levels("fog", 0, 1, 2), levels("more", 0, 1, 2, when="fog > 0")]
    free = design(factors)
    forbid = [f"a == '{name}' and fog != {level}" for level, name in enumerate("xyz")]
    tied = design(factors, forbid=[*forbid, "fog > 0 and more != fog"])

    loose, tight = (design_quality(point.space, point.points()) for point in (free, tied))
    assert (loose.max_abs_correlation, loose.max_association, loose.estimable) == (0.0, 0.0, True)
    assert (tight.max_abs_correlation, tight.correlated) == (1.0, ("fog", "more"))
    assert (tight.max_association, tight.associated) == (1.0, ("a", "fog"))
    assert tight.estimable is False
    assert any("too few points, or too similar ones" in line for line in tight.lines())


def test_quality_counts_only_what_may_be() -> None:
    """Forbidden combinations are not missed; an array of strength 2 has all pairs, not all triples."""
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
