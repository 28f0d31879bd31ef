"""Satellite navigation that drifts: noticed, said, stated in reports, and flown with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference.perception._drift import WINDOW_S, DriftCheck
from bench.simspec import Gps
from vehicle_models._navigation import Navigation

STEP_S = 0.1
EAST, SOUTH_WEST = (1.0, 0.0), (-math.sqrt(0.5), -math.sqrt(0.5))


def feed(check: DriftCheck, index: int, error_en_m: tuple[float, float]) -> None:
    """One position of a vehicle that flies curves, stated with an error, and its exact velocity."""
    time_s = index * STEP_S
    place = (40.0 * math.sin(0.2 * time_s) + error_en_m[0], 25.0 * math.cos(0.3 * time_s) + error_en_m[1])
    velocity = (8.0 * math.cos(0.2 * time_s), -7.5 * math.sin(0.3 * time_s))
    check.take(time_s, place, velocity)


@pytest.mark.parametrize("direction", [EAST, SOUTH_WEST])
def test_drift_is_noticed_measured_and_over(direction: tuple[float, float]) -> None:
    """0.25 m/s for 30 s: noticed within ten seconds, followed within a metre, over when the fixes jump back."""
    check, noticed_s, worst_m = DriftCheck(), math.inf, 0.0
    for index in range(900):
        time_s = index * STEP_S
        drifted_m = 0.25 * (time_s - 30.0) if 30.0 <= time_s < 60.0 else 0.0
        feed(check, index, (drifted_m * direction[0], drifted_m * direction[1]))
        if check.since_s is not None and time_s < 60.0:
            noticed_s = min(noticed_s, time_s)
            error_m = math.dist(check.offset_en_m, (drifted_m * direction[0], drifted_m * direction[1]))
            worst_m = max(worst_m, error_m)
            assert error_m <= check.doubt_m * 3.0
    assert 30.0 < noticed_s < 40.0
    assert worst_m < 1.0
    assert check.since_s is None
    assert check.offset_en_m == (0.0, 0.0)


@pytest.mark.parametrize("wander_m", [0.3, 0.8])
def test_no_drift_is_seen_in_the_ordinary_error(wander_m: float) -> None:
    """The error of the simulated receiver, twenty flights of 200 s: no false alarm."""
    for seed in range(20):
        navigation = Navigation(Gps(wander_m=wander_m), STEP_S, np.random.default_rng(seed))
        check = DriftCheck()
        for index in range(2000):
            navigation.step()
            feed(check, index, navigation.error_enu_m[:2])
            assert check.since_s is None, (seed, index)


def test_a_jump_when_fixes_return_is_no_drift() -> None:
    check = DriftCheck()
    for index in range(1000):
        time_s = index * STEP_S
        if 20.0 <= time_s < 32.0:
            check.suspend(time_s)
        feed(check, index, (6.0, -3.0) if time_s >= 33.0 else (0.0, 0.0))
        assert check.since_s is None
    assert WINDOW_S < 12.0


def drifting_world(direction: tuple[float, float], drift_mps: float = 0.6, until_s: float = 75.0) -> World:
    """Two targets; the position drifts from 35 s on."""

    def drift(world: World) -> None:
        time_s = world.vehicle.time_s
        away_m = drift_mps * (time_s - 35.0) if 35.0 <= time_s < until_s else 0.0
        world.vehicle.position_error_m = (away_m * direction[0], away_m * direction[1])

    return World(
        [Actor("mobile_radar", 120.0, 10.0), Actor("military_vehicle", -20.0, 150.0)],
        {
            0.0: (
                intelligence("alpha", "mobile_radar", 115.0, 0.0),
                intelligence("bravo", "military_vehicle", -10.0, 140.0, priority=2),
            )
        },
        mission=mission_order(time_limit_s=280.0),
        each_step=drift,
    )


@pytest.mark.parametrize("direction", [EAST, SOUTH_WEST])
def test_reports_under_drift_are_right_and_say_how_sure(direction: tuple[float, float]) -> None:
    """Drift to the end of the session: told, both targets within three of the stated sigmas, down at home."""
    world = drifting_world(direction, until_s=math.inf).fly("bystander_aware")
    notices = [d for d in world.decisions_to("notice") if d.subject == "gps"]
    assert [36.0 < notice.time_s < 45.0 for notice in notices] == [True]
    places = {"alpha": (120.0, 10.0), "bravo": (-20.0, 150.0)}
    assert {report.intelligence_id for report in world.reports} == set(places)
    for report in world.reports:
        error_m = math.dist((report.east_m, report.north_m), places[report.intelligence_id or ""])
        assert report.position_sigma_m is not None
        assert error_m <= 3.0 * report.position_sigma_m
        assert report.position_sigma_m < 12.0
    late = max(world.reports, key=lambda report: report.time_s)
    assert late.time_s > 60.0
    assert late.position_sigma_m is not None
    assert late.position_sigma_m > 3.0
    assert world.phase == "complete"
    assert math.hypot(world.vehicle.east_m, world.vehicle.north_m) < 6.0


def test_the_end_of_a_drift_is_told_too() -> None:
    world = drifting_world(EAST).fly("naive")
    notices = [d for d in world.decisions_to("notice") if d.subject == "gps"]
    assert len(notices) == 2
    assert 75.0 < notices[1].time_s < 80.0
    assert world.phase == "complete"
    assert math.hypot(world.vehicle.east_m, world.vehicle.north_m) < 4.0
