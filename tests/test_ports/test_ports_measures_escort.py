"""Measures of an escort, with everything twice: two cars, two adversaries, two orders."""

from __future__ import annotations

from typing import Any

import pytest
from cases import Run, scene, x_of
from cases.escort import ALONG, RADAR_AT, TRUCK_AT, driven, escorting, reports_at
from cases.mission import went
from made_run import order, report


def accompanied(run: Run) -> float | None:
    return x_of("convoy_accompanied", run)


def warned(run: Run) -> float | None:
    return x_of("convoy_warned", run)


def test_accompanying_is_a_share_of_the_time_in_which_the_convoy_moves() -> None:
    """It moves from 60 to 160 s: with it all the time, and for the first half of it."""
    spec = escorting()
    assert accompanied(driven(spec, *ALONG)) == pytest.approx(1.0)
    half = (*ALONG[:3], (110.0, -50.0, 60.0), (115.0, -50.0, -100.0), (180.0, 0.0, 0.0))
    # It is 50 m aside 1.6 s after it turns away.
    assert accompanied(driven(spec, *half)) == pytest.approx(0.515, abs=0.015)


def test_coming_home_early_does_not_shorten_the_escort() -> None:
    """Down at 110 s, the 50 s after it count as time without the vehicle; out late, the time before does not."""
    spec = escorting()
    assert accompanied(driven(spec, *ALONG, down_s=110.0)) == pytest.approx(0.5, abs=0.01)
    late = ((0.0, 0.0, 0.0), (99.0, 0.0, 0.0), (110.0, -50.0, 60.0), (160.0, 150.0, 60.0), (180.0, 0.0, 0.0))
    x = accompanied(driven(spec, *late))
    assert x is not None
    assert x > 0.85


@pytest.mark.parametrize(
    "stops", [((0.0, 0.0, 0.0), (200.0, 0.0, 0.0)), ((0.0, 30.0, 0.0), (200.0, 30.0, 0.0))]
)
def test_hovering_at_home_by_the_road_accompanies_nobody(
    stops: tuple[tuple[float, float, float], ...],
) -> None:
    """The null agent that is tempted most: the convoy drives past its landing place."""
    spec = escorting(escort={"within_m": 100.0})
    assert accompanied(driven(spec, *stops)) == 0.0
    assert accompanied(driven(spec, *stops, down_s=5.0)) == 0.0


def test_what_an_order_takes_away_is_left_out() -> None:
    """Held from 80 to 110 s, ordered home at 130 s: 20 and 20 s of escort are left, and the second half is missed."""
    spec = escorting()
    away = (*ALONG[:3], (80.0, -170.0, 60.0), (85.0, -170.0, -150.0), (180.0, 0.0, 0.0))
    called = {"orders": (order(80.0, "hold"), order(110.0, "resume"), order(130.0, "return"))}
    assert accompanied(driven(spec, *away, **called)) == pytest.approx(0.5, abs=0.03)
    early = {"orders": (order(40.0, "abort"),)}
    assert accompanied(driven(spec, *away, **early)) is None


def test_a_lost_link_with_a_rule_calls_away() -> None:
    """With `continue` the escort goes on without the operator; with `return` it is left out after the ten seconds."""
    outages = [{"kind": "operator_link", "at_s": 80.0, "duration_s": 60.0}]
    away = (*ALONG[:3], (90.0, -130.0, 60.0), (95.0, -130.0, -150.0), (180.0, 0.0, 0.0))
    goes_on = escorting(outages=outages)
    returns = escorting(outages=outages, rules={"link_lost": "return"})
    assert accompanied(driven(goes_on, *away)) == pytest.approx(0.31, abs=0.02)
    assert accompanied(driven(returns, *away)) == pytest.approx(0.61, abs=0.03)


def test_a_warning_comes_before_the_convoy() -> None:
    """The head is within 80 m of the truck at 80.2 s and of the radar vehicle at 130.2 s."""
    spec = escorting()
    for truck_s, radar_s, expected in ((80.0, 130.0, 1.0), (80.0, 131.0, 0.5), (81.0, 131.0, 0.0)):
        assert warned(driven(spec, *ALONG, **reports_at(truck_s, radar_s))) == expected


def test_who_is_far_from_the_road_or_beside_its_beginning_needs_no_warning() -> None:
    """The road is 40 m away, so 30 m leaves nobody to warn of; 200 m reach the truck from where the first car starts."""
    reports = reports_at(70.0, 75.0)
    assert warned(driven(escorting(escort={"warn_before_m": 30.0}), *ALONG, **reports)) is None
    only_radar = {"reports": (report(70.0, *RADAR_AT),)}
    assert warned(driven(escorting(escort={"warn_before_m": 200.0}), *ALONG, **only_radar)) == 1.0


def test_a_warning_that_nobody_hears_warns_nobody() -> None:
    """With the operator's link down, the report comes too late if it is not made again in time."""
    spec = escorting(outages=[{"kind": "operator_link", "at_s": 65.0, "duration_s": 10.0}])
    reports = reports_at(70.0, 76.0)["reports"]
    assert warned(driven(spec, *ALONG, reports=reports)) == 0.5
    repeated = report(78.0, *TRUCK_AT, id="again")
    assert warned(driven(spec, *ALONG, reports=(*reports, repeated))) == 1.0


def test_repeated_intelligence_warns_nobody() -> None:
    """The null agent that is tempted most: it repeats both places at once, and one of them beside a false one."""
    fields: dict[str, Any] = {
        "reports": (
            report(5.0, "mobile_radar", 105.0, 95.0),
            report(6.0, "military_vehicle", -90.0, 100.0),
        )
    }
    spec = escorting()
    assert warned(driven(spec, *ALONG, **fields)) == 0.0
    unseen = {**reports_at(70.0, 75.0), "frames": ()}
    assert warned(driven(spec, *ALONG, **unseen)) == 0.0
    assert warned(driven(spec, *ALONG)) == 0.0


def test_without_an_escort_nothing_is_considered() -> None:
    """Nor where the convoy moves for less than the ten seconds that the options ask for."""
    assert accompanied(driven(escorting(), *ALONG)) is not None
    plain = scene()
    assert accompanied(went(plain, *ALONG)) is None
    assert warned(went(plain, *ALONG)) is None
    assert x_of("convoy_accompanied", driven(escorting(), *ALONG), min_moving_s=101.0) is None
