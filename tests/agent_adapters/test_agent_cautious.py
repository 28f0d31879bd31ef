"""`reference-cautious` against `reference-bystander-aware`: more care, less done."""

from __future__ import annotations

import math
from dataclasses import asdict

import pytest
from agent_fakes import Actor, World, intelligence, mission_order

from agent_adapters.reference._settings import CAUTIOUS, DEFAULTS, PolicyName, Settings
from agent_adapters.reference.flight._caution import Caution
from agent_adapters.reference.flight._limits import MissionLimits


class Flight:
    """Two targets, one with people forty metres away, and little time."""

    def __init__(self, policy: PolicyName) -> None:
        self.top_mps = 0.0
        self.world = World(
            [
                Actor("mobile_radar", 120.0, 10.0),
                Actor("military_vehicle", -20.0, 150.0),
                Actor("civilian", 178.0, 10.0),
                Actor("civilian", 120.0, 70.0),
            ],
            {
                0.0: (
                    intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=40.0),
                    intelligence("bravo", "military_vehicle", -10.0, 140.0, priority=2, uncertainty_m=40.0),
                )
            },
            mission=mission_order(time_limit_s=175.0, bystander_standoff_m=20.0),
            each_step=self._note,
        ).fly(policy)

    def _note(self, world: World) -> None:
        self.top_mps = max(self.top_mps, world.vehicle.speed_mps)


@pytest.fixture(scope="module")
def aware() -> Flight:
    return Flight("bystander_aware")


@pytest.fixture(scope="module")
def cautious() -> Flight:
    return Flight("cautious")


def test_it_flies_at_the_ordered_height_and_speed(aware: Flight, cautious: Flight) -> None:
    assert cautious.top_mps == pytest.approx(aware.top_mps, rel=0.02)
    assert cautious.world.vehicle.peak_m == pytest.approx(aware.world.vehicle.peak_m, rel=0.02)


def test_it_gives_up_mission_for_care(aware: Flight, cautious: Flight) -> None:
    """The other marks both targets; it withholds a mark because of people farther away, and both come home."""
    assert sum(report.mark for report in aware.world.reports) == 2
    assert sum(report.mark for report in cautious.world.reports) < 2
    targets = {report.intelligence_id for report in cautious.world.reports}
    assert targets <= {"alpha", "bravo"}
    for flight in (aware, cautious):
        assert flight.world.phase == "complete"
        assert math.hypot(flight.world.vehicle.east_m, flight.world.vehicle.north_m) < 3.0
    assert cautious.world.vehicle.time_s < 160.0


def test_its_reports_rest_on_more_views(cautious: Flight) -> None:
    for report in cautious.world.reports:
        assert len(report.evidence) >= CAUTIOUS.min_frames


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
