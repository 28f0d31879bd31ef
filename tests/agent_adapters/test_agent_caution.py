"""Speed, height and distance near people; `reference-cautious`, which takes more care and does less."""

from __future__ import annotations

import math
from dataclasses import asdict
from itertools import pairwise

import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference._settings import CAUTIOUS, DEFAULTS, PolicyName, Settings
from agent_adapters.reference.flight._caution import CREEP_MPS, Caution, pushed
from agent_adapters.reference.flight._limits import MissionLimits
from agent_adapters.reference.perception._tracks import PlacedDetection, Tracks

SLOW = Caution(
    ("civilian", "aid_worker"), standoff_m=30.0, slow_within_m=20.0, slow_mps=5.0, max_loiter_s=10.0
)


def test_people_are_those_seen_lately_of_the_classes_told() -> None:
    """Aid workers and civilians count, vehicles do not, and who was not seen for long does not any more."""
    table = Tracks()
    for time_s in (0.0, 0.2, 0.4, 0.6, 0.8):
        for label, east_m in (("civilian", 0.0), ("aid_worker", 30.0), ("civilian_vehicle", 60.0)):
            table.take(time_s, [PlacedDetection(time_s, east_m, 0.0, label, 0.9, 0.0, 60.0)])
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


def test_between_two_people_the_nearer_one_decides_how_fast_it_flies() -> None:
    nearer, farther = (40.0, 0.0), (0.0, 90.0)
    alone, *both = (
        SLOW.speed_mps(12.0, (0.0, 0.0), people)
        for people in ([nearer], [nearer, farther], [farther, nearer])
    )
    assert both == [alone, alone]
    assert alone < SLOW.speed_mps(12.0, (0.0, 0.0), [farther])


def test_height_keeps_the_stand_off_as_far_as_the_ceiling_allows() -> None:
    """Higher than asked where the distance in space asks for it, never over the ceiling."""
    assert SLOW.height_m(20.0, 100.0) > 30.0
    assert SLOW.height_m(60.0, 100.0) == 60.0
    assert SLOW.height_m(20.0, 25.0) == 25.0
    assert Caution().height_m(20.0, 100.0) == 20.0


def test_an_aim_is_moved_aside_when_the_height_does_not_keep_the_stand_off() -> None:
    """Flown low, an aim over somebody is moved until the distance in space is kept; others stay."""
    aim = SLOW.aside((3.0, 0.0), 20.0, [(0.0, 0.0)])
    assert math.hypot(*aim, 20.0) > 30.0
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


@pytest.mark.parametrize("place", [(0.0, 0.0), (4.0, 1.0)])
def test_a_place_is_moved_out_of_both_circles(place: tuple[float, float]) -> None:
    """Right above somebody too, where no direction is better than another."""
    people = [(0.0, 0.0), (10.0, 0.0)]
    assert all(math.dist(pushed(place, people, 12.0), person) >= 12.0 - 1e-3 for person in people)


def test_only_bystander_aware_is_slow_near_people() -> None:
    """People around the target: `bystander_aware` passes them slowly, `naive` at full speed."""
    people = [Actor("civilian", 100.0 + 12.0 * k, 20.0 * (-1) ** k) for k in range(5)]
    top_mps = {}
    policies: tuple[PolicyName, ...] = ("naive", "bystander_aware")
    for policy in policies:
        flown = World(
            [Actor("mobile_radar", 130.0, 0.0), *people],
            {0.0: intelligence("alpha", "mobile_radar", 125.0, 0.0)},
            mission=mission_order(bystander_slow_within_m=20.0, bystander_slow_mps=5.0),
        ).fly(policy, until_s=70.0)
        top_mps[policy] = max(
            flown.speed_mps[time_s]
            for time_s, (*place, height_m) in flown.at.items()
            if height_m > 55.0 and any(math.dist(place, (p.east_m, p.north_m)) < 20.0 for p in people)
        )
    assert top_mps["naive"] > 8.0
    assert top_mps["bystander_aware"] < 5.5


def test_the_cautious_one_gives_up_mission_for_care() -> None:
    """Two targets, one with people forty metres away, and little time: the other agent marks both; the cautious one
    withholds a mark, rests its reports on more views, and flies at the same height and speed. Both come home.
    """

    def flown(policy: PolicyName) -> World:
        places = (("mobile_radar", 120.0, 10.0), ("military_vehicle", -20.0, 150.0))
        people = (("civilian", 178.0, 10.0), ("civilian", 120.0, 70.0))
        told = (
            intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=40.0),
            intelligence("bravo", "military_vehicle", -10.0, 140.0, priority=2, uncertainty_m=40.0),
        )
        order = mission_order(time_limit_s=175.0, bystander_standoff_m=20.0)
        return World([Actor(*at) for at in (*places, *people)], {0.0: told}, mission=order).fly(policy)

    aware, cautious = flown("bystander_aware"), flown("cautious")
    assert sum(report.mark for report in aware.reports) == 2
    assert sum(report.mark for report in cautious.reports) < 2
    assert set(cautious.reported) <= {"alpha", "bravo"}
    assert all(len(report.evidence) >= CAUTIOUS.min_frames for report in cautious.reports)
    assert max(cautious.speed_mps.values()) == pytest.approx(max(aware.speed_mps.values()), rel=0.02)
    assert cautious.vehicle.peak_m == pytest.approx(aware.vehicle.peak_m, rel=0.02)
    for flight in (aware, cautious):
        assert flight.phase == "complete"
        assert flight.home_m < 3.0
    assert cautious.vehicle.time_s < 160.0


def test_an_option_changes_one_setting_of_its_own() -> None:
    changed = asdict(Settings.of({"min_frames": 20, "mount": "level"}, "cautious"))
    assert changed == asdict(CAUTIOUS) | {"min_frames": 20, "mount": "level"}
    assert Settings.of({}, "naive") == DEFAULTS


def test_distances_have_a_margin_where_the_rules_state_them() -> None:
    order = mission_order(bystander_standoff_m=20.0, bystander_slow_within_m=15.0, bystander_slow_mps=5.0)
    caution = Caution.of(order, 10.0)
    assert (caution.standoff_m, caution.slow_within_m) == (30.0, 25.0)
    assert Caution.of(mission_order(), 10.0) == Caution.of(mission_order())
    limits = MissionLimits.of(*(mission_order(max_speed_mps=10.0),) * 2, Caution(), 0.7)
    assert limits.speed_mps == pytest.approx(8.4)
    assert limits.height_m == 60.0
