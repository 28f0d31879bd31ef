"""Key factor tables read backwards are the inverse of `rate`."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_decompositions import factor_row

from bench.scoring import (
    hardest_value,
    rate,
    value_for_rating,
)
from decompositions import (
    KeyFactor,
    Policies,
)


def table(ratings: list[float], values: list[float], **changes: Any) -> KeyFactor:
    return KeyFactor.model_validate(factor_row("fog_level", ratings, values, **changes))


RAIN = table([10, 20, 30, 40, 50, 60], [0, 1, 2, 4, 4, 5])


@pytest.mark.parametrize(
    ("row", "rating", "exceeded", "expected"),
    [
        (RAIN, 25.0, False, (1.5, False)),
        (RAIN, 20.0, False, (1.0, False)),
        (RAIN, 20.0, True, (1.0, True)),
        (RAIN, 5.0, False, (0.0, False)),  # below the first column everything is 0
        (RAIN, 40.0, False, (4.0, False)),
        (RAIN, 40.0, True, (4.0, True)),
        (RAIN, 50.0, False, (4.0, True)),  # 4 stands twice and has the lower rating
        (RAIN, 60.0, True, None),
        (table([10, 50, 100], [300, 200, 50]), 30.0, False, (250.0, False)),
        (table([10, 50, 100], [300, 200, 50], mapping="step"), 30.0, False, (200.0, False)),
    ],
)
def test_a_table_is_read_backwards(
    row: KeyFactor, rating: float, exceeded: bool, expected: tuple[float, bool] | None
) -> None:
    """The easiest value with a rating, and whether it must be passed."""
    assert value_for_rating(row, rating, exceeded=exceeded) == expected


@settings(deadline=None)
@given(
    values=st.lists(st.integers(-50, 50), min_size=2, max_size=8).filter(lambda v: len(set(v)) > 1),
    falling=st.booleans(),
    mapping=st.sampled_from(["linear", "step"]),
    shared=st.sampled_from(["lower", "higher"]),
    rating=st.floats(0.5, 100),
    exceeded=st.booleans(),
)
def test_reading_backwards_is_the_inverse(
    values: list[int], falling: bool, mapping: str, shared: Any, rating: float, exceeded: bool
) -> None:
    """There, or just past it, the rating is reached; a little easier, it is not."""
    ordered = [float(v) for v in sorted(values, reverse=falling)]
    row = table([100.0 * (i + 1) / len(ordered) for i in range(len(ordered))], ordered, mapping=mapping)
    policies, sign = Policies(shared_value=shared), -1.0 if falling else 1.0
    target = value_for_rating(row, rating, policies, exceeded=exceeded)
    if target is None:
        assert rating > 100.0 or exceeded
        assert rate(row, ordered[-1] + sign, policies) <= rating
        return
    value, past = target
    reached = rate(row, value + (sign * 1e-6 if past else 0.0), policies)
    assert reached >= rating - 1e-9
    assert rate(row, value - sign * 1e-6, policies) <= rating + 1e-9
    if exceeded:
        assert past or reached > rating


@settings(deadline=None)
@given(
    values=st.lists(st.integers(-50, 50), min_size=2, max_size=8).filter(lambda v: len(set(v)) > 1),
    falling=st.booleans(),
    mapping=st.sampled_from(["linear", "step"]),
    shared=st.sampled_from(["lower", "higher"]),
    rating=st.floats(0.5, 100),
)
def test_the_hardest_value_is_the_last_one_rated_so_low(
    values: list[int], falling: bool, mapping: str, shared: Any, rating: float
) -> None:
    """There, or just short of it, the rating is not exceeded; a little harder, it is."""
    ordered = [float(v) for v in sorted(values, reverse=falling)]
    row = table([100.0 * (i + 1) / len(ordered) for i in range(len(ordered))], ordered, mapping=mapping)
    policies, sign = Policies(shared_value=shared), -1.0 if falling else 1.0
    target = hardest_value(row, rating, policies)
    if target is None:
        assert row.ratings[0] > rating
        return
    value, short = target
    if math.isinf(value):
        assert sign * value > 0.0
        assert rate(row, ordered[-1] + sign, policies) <= rating
        return
    assert rate(row, value - (sign * 1e-6 if short else 0.0), policies) <= rating + 1e-9
    assert rate(row, value + sign * 1e-6, policies) >= rating - 1e-9
    if short:
        assert rate(row, value, policies) > rating
