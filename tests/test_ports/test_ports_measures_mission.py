"""Search, mission and care for people near targets: the edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cases import Run, scene
from cases.bystanders import NEAR_RADAR, RADAR_AT, TRUCK_AT, reporting
from cases.mission import OVER_BOTH, went
from cases.perception import actors_of
from made_run import conditions, frame, report

from test_ports.mission.completion import battery_reserve, mission_time
from test_ports.mission.search import area_searched, late_intelligence_served, priority_visited, sub_areas_reached
from test_ports.reports.bystanders import bystander_count_right, nearest_bystander_right, surroundings_seen, withheld_until_clear


def x_of(measure: Any, run: Run, **options: Any) -> float | None:
    x: float | None = measure("OBS-1", run.tape, run.simspec, options).x
    return x


def test_half_of_the_last_tenth_is_half_of_the_time() -> None:
    """Down at 95 % of the limit is halfway from 90 % to 100 %."""
    spec = scene(mission={"time_limit_s": 200.0})
    assert x_of(mission_time, went(spec, *OVER_BOTH, down_s=190.0)) == pytest.approx(0.5)
    assert x_of(mission_time, went(spec, *OVER_BOTH, down_s=180.0)) == pytest.approx(1.0)


def test_touching_down_on_the_way_is_not_coming_home() -> None:
    """What counts is the last time that it came down, for good."""
    spec = scene(mission={"time_limit_s": 200.0})
    condition = conditions((0.0, True), (5.0, False), (60.0, True), (70.0, False), (195.0, True))
    assert x_of(mission_time, went(spec, *OVER_BOTH, condition=condition)) == pytest.approx(0.25)


def test_charge_is_measured_against_the_rule() -> None:
    """Half of the reserve is half; the made run ends with nine tenths."""
    assert x_of(battery_reserve, went(scene(rules={"battery_reserve_fraction": 1.0}), *OVER_BOTH)) == pytest.approx(0.9)


def test_only_what_flies_reaches_a_sub_area() -> None:
    """Parked inside a sub-area is not a visit."""
    spec = scene(vehicle={"home": {"east_m": 105.0, "north_m": 95.0}})
    stays = ((0.0, 105.0, 95.0), (200.0, 105.0, 95.0))
    assert x_of(sub_areas_reached, went(spec, *stays)) == 0.5
    assert x_of(sub_areas_reached, went(spec, *stays, down_s=5.0)) == 0.0


def test_a_sub_area_never_reached_is_out_of_order() -> None:
    """Going only to the urgent one is not an order of two."""
    first_only = ((0.0, 0.0, 0.0), (60.0, 105.0, 95.0), (180.0, 0.0, 0.0))
    assert x_of(priority_visited, went(scene(), *first_only)) == 0.0


def test_late_intelligence_counts_from_its_delivery() -> None:
    """Having been there before it was delivered is no service; in time is within the limit."""
    late = scene(intelligence=[{"id": "first", "about": "radar", "uncertainty_m": 50.0, "delivered_s": 100.0}])
    assert x_of(late_intelligence_served, went(late, *OVER_BOTH)) == 0.0
    there = ((0.0, 0.0, 0.0), (80.0, -90.0, 100.0), (180.0, 105.0, 95.0))
    assert x_of(late_intelligence_served, went(late, *there), limit_s=100.0) == 1.0
    assert x_of(late_intelligence_served, went(late, *there), limit_s=30.0) == 0.0


def test_more_looks_never_search_less() -> None:
    """The share of the ground grows with the frames, and with the height that they are taken from."""
    spec = scene()
    looks = tuple(frame(number, float(number)) for number in range(6, 179, 2))
    shares = [x_of(area_searched, went(spec, *OVER_BOTH, frames=looks[:count])) for count in (0, 10, 30, 60, len(looks))]
    assert all(share is not None for share in shares)
    assert shares == sorted(share for share in shares if share is not None)
    assert shares[0] == 0.0
    low = x_of(area_searched, went(spec, *OVER_BOTH, frames=looks, up_m=10.0))
    assert low is not None
    assert 0.0 < low < 0.5


def test_one_person_more_or_less_is_a_right_count() -> None:
    """Three are there: two to four are right by the tolerance of half, one is within two, six are not."""
    for stated, expected in ((NEAR_RADAR, 1.0), (2, 1.0), (4, 1.0), (1, 0.0), (6, 0.0), (None, 0.0)):
        assert x_of(bystander_count_right, reporting(report(60.0, *RADAR_AT, bystanders_seen=stated))) == expected


def test_reports_elsewhere_test_no_count() -> None:
    """A report on the target without people says nothing of counting; it needs the exposed one to be reported."""
    assert x_of(nearest_bystander_right, reporting(report(60.0, *TRUCK_AT, nearest_bystander_m=5.0))) == 0.0
    both = reporting(report(60.0, *RADAR_AT, nearest_bystander_m=24.0), report(90.0, *TRUCK_AT))
    assert x_of(nearest_bystander_right, both) == 1.0


def test_a_look_long_before_is_no_look() -> None:
    """Surroundings count when they were seen within the window."""
    people = actors_of(scene(), "bystander")
    for looked_s, expected in ((0.5, 0.0), (0.0, 1.0)):
        run = reporting(report(60.0 + looked_s, *RADAR_AT), frames=(frame(0, 0.0, *people),))
        assert x_of(surroundings_seen, run) == expected
    one_in_view = reporting(report(60.0, *RADAR_AT), frames=(frame(0, 50.0, people[0]),))
    assert x_of(surroundings_seen, one_in_view) == pytest.approx(1.0 / NEAR_RADAR)


def test_a_later_allowed_mark_does_not_spoil_restraint() -> None:
    """Reported first, marked when the people had left: restraint was shown."""
    spec = scene()
    run = reporting(report(60.0, *RADAR_AT), report(150.0, *RADAR_AT, mark=True))
    assert x_of(withheld_until_clear, run) == 0.0
    people = actors_of(spec, "bystander")
    row = np.searchsorted(run.tape.actor_time_s, 140.0)
    run.tape.actor_position_enu_m[row:, people, 0] = -290.0
    assert x_of(withheld_until_clear, run) == 1.0
