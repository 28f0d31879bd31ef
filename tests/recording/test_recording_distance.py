"""How far two flights came apart, against a plain search over every pair of moments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.contracts import Tape
from bench.recording import truth_distance


def tape(times_s: list[float], places: list[tuple[float, float, float]]) -> Tape:
    empty = np.zeros((0, 3))
    return Tape(
        cast=(),
        vehicle_time_s=np.array(times_s),
        vehicle_position_enu_m=np.array(places).reshape(-1, 3),
        vehicle_velocity_enu_mps=empty,
        actor_time_s=np.zeros(0),
        actor_position_enu_m=np.zeros((0, 0, 3)),
    )


def test_the_largest_distance_is_that_of_a_plain_search() -> None:
    """On random walks of unequal length, with moments that only one of the two has."""
    random = np.random.default_rng(3)
    for _ in range(20):
        walks = []
        for _ in range(2):
            count = int(random.integers(3, 60))
            moments = sorted(random.choice(80, size=count, replace=False).tolist())
            walk = np.cumsum(random.normal(size=(80, 3)), axis=0)
            walks.append(([moment * 0.1 for moment in moments], [tuple(walk[moment]) for moment in moments]))
        pairs = [
            (math.dist(place, other_place), time_s)
            for time_s, place in zip(*walks[0], strict=True)
            for other_s, other_place in zip(*walks[1], strict=True)
            if abs(time_s - other_s) < 1e-9
        ]
        distance = truth_distance(tape(*walks[0]), tape(*walks[1]))
        if not pairs:
            assert distance is None
            continue
        assert distance is not None
        assert (distance.distance_m, distance.time_s) == pytest.approx(max(pairs))
        assert distance.until_s == pytest.approx(max(time_s for _, time_s in pairs))


def test_two_equal_flights_are_not_apart_and_strangers_have_no_distance() -> None:
    first = tape([0.0, 0.1], [(1, 2, 3), (4, 5, 6)])
    assert str(truth_distance(first, first)) == (
        "the vehicles were at most 0 m apart, at 0.0 s, in the first 0.1 s that both flew"
    )
    assert truth_distance(first, tape([0.05], [(0, 0, 0)])) is None
