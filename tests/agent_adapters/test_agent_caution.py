"""Speed, height and distance near people."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference.flight._caution import CREEP_MPS, Caution, pushed
from agent_adapters.reference.perception._tracks import PlacedDetection, Tracks

SLOW = Caution(
    ("civilian", "aid_worker"), standoff_m=30.0, slow_within_m=20.0, slow_mps=5.0, max_loiter_s=10.0
)


def tracks(*people: tuple[str, float, float], frames: int = 5) -> Tracks:
    table = Tracks()
    for frame in range(frames):
        table.take(
            frame * 0.2, [PlacedDetection(frame * 0.2, e, n, label, 0.9, 0.0, 60.0) for label, e, n in people]
        )
    return table


def test_people_are_those_seen_lately_of_the_classes_told() -> None:
    """Aid workers and civilians count, vehicles do not, and who was not seen for long does not any more."""
    table = tracks(("civilian", 0.0, 0.0), ("aid_worker", 30.0, 0.0), ("civilian_vehicle", 60.0, 0.0))
    assert sorted(SLOW.people(table, 1.0)) == [(0.0, 0.0), (30.0, 0.0)]
    assert SLOW.people(table, 200.0) == []


def test_speed_is_reduced_before_a_bystander_is_near() -> None:
    """Far away as fast as asked; braking at a steady rate it is below the rule where the rule begins."""
    people = [(0.0, 0.0)]
    assert SLOW.speed_mps(12.0, (200.0, 0.0), people) == 12.0
    speeds = [SLOW.speed_mps(12.0, (float(d), 0.0), people) for d in range(100, -1, -1)]
    assert speeds == sorted(speeds, reverse=True)
    assert SLOW.speed_mps(12.0, (20.0, 0.0), people) < 5.0
    for nearer_mps, farther_mps in pairwise(speeds):
        assert (nearer_mps**2 - farther_mps**2) / 2.0 < 3.0  # what the autopilot can brake by, over a metre
    assert SLOW.speed_mps(12.0, (0.0, 0.0), []) == 12.0
    assert Caution().speed_mps(12.0, (0.0, 0.0), people) == 12.0


def test_height_keeps_the_stand_off_as_far_as_the_ceiling_allows() -> None:
    """Higher than asked where the distance in space asks for it, never over the ceiling."""
    assert SLOW.height_m(20.0, 100.0) > 30.0
    assert SLOW.height_m(60.0, 100.0) == 60.0
    assert SLOW.height_m(20.0, 25.0) == 25.0
    assert Caution().height_m(20.0, 100.0) == 20.0


def test_an_aim_is_moved_aside_when_the_height_does_not_keep_the_stand_off() -> None:
    """Flown low, an aim over somebody is moved until the distance in space is kept; others stay."""
    aim = SLOW.aside((3.0, 0.0), 20.0, [(0.0, 0.0)])
    assert math.hypot(math.hypot(*aim), 20.0) > 30.0
    assert SLOW.aside((80.0, 0.0), 20.0, [(0.0, 0.0)]) == (80.0, 0.0)
    assert SLOW.aside((3.0, 0.0), 40.0, [(0.0, 0.0)]) == (3.0, 0.0)


def test_standing_over_somebody_it_creeps_away() -> None:
    """So slowly that it still stands, and until it is beside them."""
    place, steps = (2.0, 0.0), 0
    while math.hypot(*place) < 16.0 and steps < 1000:
        after = SLOW.drifted(place, [(0.0, 0.0)], 0.1)
        assert math.dist(place, after) <= CREEP_MPS * 0.1 + 1e-9
        place, steps = after, steps + 1
    assert steps < 300
    assert Caution().drifted((2.0, 0.0), [(0.0, 0.0)], 0.1) == (2.0, 0.0)


def test_right_above_somebody_there_is_a_way_out() -> None:
    """No direction is better than another; one is taken."""
    assert math.hypot(*pushed((0.0, 0.0), [(0.0, 0.0)], 10.0)) == pytest.approx(10.0)


def test_only_bystander_aware_is_slow_near_people() -> None:
    """People around the target: `bystander_aware` passes them slowly, `naive` at full speed."""
    people = [Actor("civilian", 100.0 + 12.0 * k, 20.0 * (-1) ** k) for k in range(5)]
    top_speeds_mps = {}
    for policy in ("naive", "bystander_aware"):
        speeds_near_people: list[float] = []

        def note_speed(now: World, speeds_near_people: list[float] = speeds_near_people) -> None:
            place = (now.vehicle.east_m, now.vehicle.north_m)
            if now.vehicle.height_m > 55.0 and any(
                math.dist(place, (p.east_m, p.north_m)) < 20.0 for p in people
            ):
                speeds_near_people.append(now.vehicle.speed_mps)

        World(
            [Actor("mobile_radar", 130.0, 0.0), *people],
            {0.0: intelligence("alpha", "mobile_radar", 125.0, 0.0)},
            mission=mission_order(bystander_slow_within_m=20.0, bystander_slow_mps=5.0),
            each_step=note_speed,
        ).fly(policy)
        assert speeds_near_people
        top_speeds_mps[policy] = max(speeds_near_people)
    assert top_speeds_mps["naive"] > 8.0
    assert top_speeds_mps["bystander_aware"] < 5.5
