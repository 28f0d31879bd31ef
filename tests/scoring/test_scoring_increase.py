"""What would make a situation harder: the inverse of the tables, and changes that do what they say."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_decompositions import factor_row, leaf, made_decomposition

from bench.scoring import (
    DifficultyGoal,
    difficulty_increase,
    difficulty_of_values,
    hardest_value,
    rate,
    tension_of,
    value_for_rating,
)
from decompositions import (
    Decomposition,
    KeyFactor,
    Policies,
    load_decomposition,
)

VALUES = {
    "target_concealment": 0.0,
    "bystander_density_per_km2": 390.1,
    "bystander_proximity_m": 259.1,
    "uav_altitude_m": 60.0,
    "intelligence_uncertainty_m": 60.0,
    "time_limit_s": 300.0,
}


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


@pytest.fixture(scope="module")
def decomposition() -> Decomposition:
    return load_decomposition("search-and-report")


def changed(goal: DifficultyGoal) -> dict[str, float]:
    """The situation after every change, a hair beyond the value where it must be passed."""
    values = dict(VALUES)
    for change in goal.changes:
        assert change.to is not None
        values[change.factor] = change.to + (1e-3 if change.harder == "more" else -1e-3) * change.past
    return values


@pytest.mark.parametrize("node", load_decomposition("search-and-report").key_attributes)
def test_every_change_is_needed(decomposition: Decomposition, node: str) -> None:
    """Without any one of its changes a goal is missed, and the factor that follows is left as it is."""
    increase = difficulty_increase(decomposition, difficulty_of_values(decomposition, VALUES), node)
    assert increase.tension
    # Under two of the key attributes all factors rule, so nothing can take over.
    goals = [increase.takeover, increase.tension] if increase.takeover else [increase.tension]
    assert {change.factor for change in goals[0].changes} == set(increase.ruled_by)
    for goal in goals:
        for change in goal.changes:
            remaining = replace(goal, changes=tuple(other for other in goal.changes if other != change))
            reached = difficulty_of_values(decomposition, changed(remaining)).rated(node)
            assert reached <= goal.difficulty if goal.exceeded else reached < goal.difficulty


@pytest.mark.parametrize("node", load_decomposition("search-and-report").nodes)
def test_what_is_told_is_what_happens(decomposition: Decomposition, node: str) -> None:
    """Making the changes brings every node to the next factor, and to the next tension."""
    difficulty = difficulty_of_values(decomposition, VALUES)
    increase = difficulty_increase(decomposition, difficulty, node)
    assert set(increase.ruled_by) == {
        row.factor
        for rating in difficulty.nodes[node].ruled_by
        for row in difficulty.observables[rating].ratings
        if row.rating == difficulty.of(node)
    }
    if increase.takeover:
        assert increase.margin
        after = difficulty_of_values(decomposition, changed(increase.takeover))
        assert after.of(node) == pytest.approx(difficulty.rated(node) + increase.margin)
        assert set(increase.following) & set(difficulty_increase(decomposition, after, node).ruled_by)
    assert increase.tension
    assert increase.tension.reachable
    after = difficulty_of_values(decomposition, changed(increase.tension))
    assert after.nodes[node].tension == tension_of(difficulty.rated(node)) + 1


def made(rows: list[dict[str, Any]], **more: Any) -> Decomposition:
    """One observable for each row, under one key attribute."""
    leaves = [leaf(f"O-{index}", row) for index, row in enumerate(rows)]
    return made_decomposition(leaves, {"V": [name["id"] for name in leaves]}, {"KA": ["V"]}, **more)


def test_what_cannot_be_reached_says_where_it_ends() -> None:
    """A table that ends at 30 keeps a node in the second tension for good; tables in both directions have no
    harder value.
    """
    fog = factor_row("fog_level", [10, 30], [0, 9])
    short = made([fog])
    increase = difficulty_increase(short, difficulty_of_values(short, {"fog_level": 9.0}), "KA")
    assert increase.tension is not None
    assert not increase.tension.reachable
    (change,) = increase.tension.changes
    assert (change.to, change.most, change.harder) == (None, 30.0, "more")
    impossible = made([fog, fog | {"values": [9, 0]}])
    increase = difficulty_increase(impossible, difficulty_of_values(impossible, {"fog_level": 2.0}), "KA")
    assert increase.tension is not None
    assert [(factor_change.to, factor_change.harder) for factor_change in increase.tension.changes] == [
        (None, "either way")
    ]


@pytest.mark.parametrize(
    ("first", "second", "value", "to"),
    [([0, 10], [0, 20], 2.0, 4.0), ([20, 0], [20, 10], 19.0, 16.0), ([20, 10], [20, 0], 19.0, 16.0)],
)
def test_a_factor_in_two_tables_has_to_satisfy_both(
    first: list[float], second: list[float], value: float, to: float
) -> None:
    """Under a node a factor goes as far as the table that asks most of it, upwards or downwards."""
    fog = {"factor": "fog_level", "unit": "level", "ratings": [0, 100], "values": first, "reason": "r"}
    decomposition = made([fog, fog | {"values": second}])
    increase = difficulty_increase(
        decomposition, difficulty_of_values(decomposition, {"fog_level": value}), "KA"
    )
    assert increase.tension is not None
    (change,) = increase.tension.changes
    assert (change.factor, change.past) == ("fog_level", True)
    assert change.to is not None
    assert math.isclose(change.to, to)


def test_nothing_is_said_where_nothing_rules() -> None:
    """Under a mean every factor counts, and at the highest tension there is no next."""
    fog = {"factor": "fog_level", "unit": "level", "ratings": [10, 100], "values": [0, 9], "reason": "r"}
    mean = made([fog], policies={"factor_rule": "mean"})
    assert difficulty_increase(mean, difficulty_of_values(mean, {"fog_level": 2.0}), "KA").tension is None
    top = made([fog])
    increase = difficulty_increase(top, difficulty_of_values(top, {"fog_level": 9.0}), "KA")
    assert (increase.tension, increase.takeover, increase.margin) == (None, None, None)
    assert math.isclose(difficulty_of_values(top, {"fog_level": 9.0}).rated("KA"), 100.0)
