"""Orders, outages, failures and rules: what the surrogates do about them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from test_surrogate import AWARE, HOME, NAIVE, NAMES, rectangle, scene, sightings, simulated, value, values

from agent_adapters.reference.surrogate import pack
from agent_adapters.reference.surrogate.batch._interruptions import delivered_at, interruptions, outage_spans
from agent_adapters.reference.surrogate.flight._mission import FlownMissions
from bench.simspec import Outage, SimSpec


def ordered(kind: str, at_s: float, intelligence: str | None = None) -> dict[str, Any]:
    about = {"intelligence": intelligence} if intelligence else {}
    return {"id": f"{kind.replace('_', '-')}-{at_s:g}", "kind": kind, "at_s": at_s, **about}


def test_a_vehicle_that_is_handed_over_waits_until_it_is_taken_back() -> None:
    handed_over = [ordered("hand_over", 40.0), ordered("take_back", 65.0)]

    observed = simulated(scene(NAIVE), scene(NAIVE, orders=handed_over))

    assert observed.end_s[1] == pytest.approx(observed.end_s[0] + 25.0, abs=1.0)
    assert value(observed, "hand over", 1) == value(observed, "take back", 1) == 1.0
    assert not observed.considered[0, NAMES.index("hand over")]


def test_a_hold_lasts_until_it_is_told_to_go_on_and_for_good_only_until_it_must_go_home() -> None:
    held, for_good = [ordered("hold", 40.0), ordered("resume", 65.0)], [ordered("hold", 40.0)]

    observed = simulated(scene(NAIVE), scene(NAIVE, orders=held), scene(NAIVE, orders=for_good))

    assert observed.end_s[1] == pytest.approx(observed.end_s[0] + 25.0, abs=1.0)
    assert value(observed, "hold", 1) == 1.0
    assert 200.0 < observed.end_s[2] <= 300.0
    assert value(observed, "flown", 2) == 1.0


@pytest.mark.parametrize("kind", ["return", "abort", "deactivate"])
def test_an_order_to_end_is_the_end_and_only_return_lets_it_report_on(kind: str) -> None:
    # What it finds has to wait.
    windows = [{"from_s": 0.0, "until_s": 20.0}, {"from_s": 80.0, "until_s": 300.0}]
    ended = scene(NAIVE, orders=[ordered(kind, 45.0)], rules={"report_windows": windows})

    observed = simulated(scene(NAIVE), ended)

    assert observed.end_s[1] < observed.end_s[0]
    assert value(observed, "reported", 1) == (0.5 if kind == "return" else 0.0)
    assert value(observed, "flown", 1) == 1.0  # landed where it was told to counts as home


def test_what_was_seen_during_the_flight_is_due_while_it_is_fresh() -> None:
    """Seen at 15 s or five seconds before the flight, told at 20 s; with and without a deadline for all reports."""
    rules: list[dict[str, Any]] = [{}, {"report_deadline_s": 90.0}]
    batch = pack(
        [
            scene(NAIVE, intelligence=sightings(radar=3, delivered_s=20.0, latency_s=latency_s), rules=rule)
            for latency_s in (5.0, 25.0)
            for rule in rules
        ]
    )
    radar = batch.task_delivered_s[0] == 20.0
    assert list(batch.task_due_s[:, radar].ravel()) == [140.0, 110.0, np.inf, 110.0]
    assert list(batch.task_due_s[:, ~radar].ravel()) == [np.inf, 90.0, np.inf, 90.0]


def test_a_return_by_the_autopilot_is_as_fast_as_its_cruise() -> None:
    """The second of two losses of the link costs 7 s away from its way and the way back at 12 m/s, of what was flown at
    PX4's 5 m/s, or at a cruise that the SimSpec sets.
    """
    losses = [{"at_s": at_s, "kind": "link_loss", "duration_s": 8.0} for at_s in (38.0, 60.0)]
    vehicles: list[dict[str, Any]] = [
        {"failures": failures, "parameters": {"MPC_XY_CRUISE": cruise_mps}}
        for cruise_mps in (5.0, 8.0)
        for failures in (losses[:1], losses)
    ]
    vehicles[0].pop("parameters")
    one, two, one_faster, two_faster = simulated(
        *(scene(NAIVE, vehicle=vehicle) for vehicle in vehicles)
    ).end_s

    assert two - one == pytest.approx(7.0 + 7.0 * 5.0 / 12.0)
    assert two_faster - one_faster > two - one + 1.0


def test_what_is_seen_in_passing_is_reported_when_its_report_falls_due() -> None:
    """It holds within sight of both places from before it has searched the second; only a deadline makes it report."""
    waits = [ordered("hold", 60.0)]
    rules: list[dict[str, Any]] = [{}, {"report_deadline_s": 120.0}]

    observed = simulated(
        *(scene(NAIVE, intelligence=sightings(110.0), orders=waits, rules=rule) for rule in rules)
    )

    assert values(observed, "reported") == [0.5, 1.0]


def test_a_retask_turns_to_its_sub_area_first_and_comes_back_to_the_other() -> None:
    observed = simulated(scene(NAIVE), scene(NAIVE, orders=[ordered("retask", 20.0, "truck-sighting")]))

    assert values(observed, "order") == [1.0, 0.0]
    assert value(observed, "reported", 1) == value(observed, "retask", 1) == 1.0


def test_more_urgent_news_in_flight_breaks_off_what_is_less_urgent() -> None:
    observed = simulated(scene(NAIVE, intelligence=sightings(delivered_s=20.0)))

    assert value(observed, "order") == value(observed, "reported") == 1.0


def test_what_is_found_in_silence_is_said_when_that_is_over() -> None:
    orders = [ordered("stop_reporting", 20.0), ordered("resume_reporting", 200.0)]
    early, late = ({"report_deadline_s": deadline_s} for deadline_s in (150.0, 250.0))

    observed = simulated(scene(NAIVE, orders=orders, rules=early), scene(NAIVE, orders=orders, rules=late))

    assert values(observed, "in time") == [0.0, 1.0]
    assert values(observed, "silence") == [1.0, 1.0]


def test_the_careful_one_refuses_to_mark_beside_people_and_the_naive_one_does_not() -> None:
    orders = [ordered("mark", 100.0, "radar-sighting")]

    observed = simulated(scene(NAIVE, orders=orders), scene(AWARE, orders=orders))

    assert values(observed, "unlawful") == [0.0, 1.0]


def test_orders_wait_for_the_operators_link_and_its_rule_is_kept() -> None:
    down = [{"kind": "operator_link", "at_s": 30.0, "duration_s": 40.0}]
    home = [ordered("return", 40.0)]

    at_once, waits, holds, returns, goes_on = range(5)
    observed = simulated(
        scene(NAIVE, orders=home),
        scene(NAIVE, orders=home, outages=down),
        *(
            scene(NAIVE, outages=down, rules={"link_lost": rule, "link_lost_after_s": 10.0})
            for rule in ("hold", "return", "continue")
        ),
    )
    undisturbed_s = simulated(scene(NAIVE)).end_s[0]

    assert observed.end_s[waits] > observed.end_s[at_once]
    assert observed.end_s[holds] == pytest.approx(undisturbed_s + 30.0, abs=1.0)
    assert observed.end_s[returns] < undisturbed_s  # over home before the link was back
    assert observed.end_s[goes_on] == undisturbed_s


def test_without_detections_a_search_waits_and_sees_nothing_meanwhile() -> None:
    observed = simulated(
        scene(NAIVE), scene(NAIVE, outages=[{"kind": "detections", "at_s": 25.0, "duration_s": 20.0}])
    )

    assert observed.end_s[1] == pytest.approx(observed.end_s[0] + 18.4, abs=3.0)
    assert value(observed, "reported", 1) == 1.0


def test_failures_cost_time_place_or_the_rest_of_the_mission() -> None:
    def failing(**failure: Any) -> SimSpec:
        return scene(NAIVE, vehicle={"home": HOME, "failures": [failure]})

    fine, fixless, noticed, unnoticed, drained, cut_off, lost = range(7)
    observed = simulated(
        scene(NAIVE),
        failing(kind="gps_off", at_s=30.0, duration_s=14.0),
        failing(kind="gps_drift", at_s=20.0, drift_mps=0.4),
        failing(kind="gps_drift", at_s=20.0, drift_mps=0.14),  # too slow for the agents' check
        failing(kind="battery_drop", at_s=45.0, to_fraction=0.25),
        failing(kind="link_loss", at_s=30.0, duration_s=6.0),
        failing(kind="gps_off", at_s=30.0),
    )

    assert observed.end_s[fixless] > observed.end_s[fine] + 13.0
    assert value(observed, "accuracy", noticed) == value(observed, "accuracy", fine)
    assert value(observed, "accuracy", unnoticed) < value(observed, "accuracy", fine) - 0.05
    assert observed.end_s[drained] < observed.end_s[fine] - 20.0
    assert observed.end_s[fine] + 5.0 < observed.end_s[cut_off] < observed.end_s[fine] + 20.0
    assert value(observed, "flown", lost) < 1.0  # down where it lost its place


@pytest.mark.parametrize(("duration_s", "lands"), [(61.0, False), (63.5, True)])
def test_an_outage_lands_where_the_descent_takes_no_longer(duration_s: float, lands: bool) -> None:
    """From 40 m at 0.7 m/s, 5.1 s after the loss: 62.2 s."""
    lost = {"kind": "gps_off", "at_s": 30.0, "duration_s": duration_s}
    spec = scene(NAIVE, mission={"altitude_m": 40.0}, vehicle={"failures": [lost]})

    assert math.isfinite(interruptions(spec)["landed_from_s"]) is lands


def test_ways_lead_round_closed_areas_and_stay_inside_the_fence() -> None:
    closed = {"no_fly": [{"id": "clinic", "area": rectangle(-15.0, -20.0, 15.0, 60.0)}]}
    fenced = {"geofence": rectangle(-180.0, -95.0, 130.0, 110.0)}

    observed = simulated(scene(NAIVE), scene(NAIVE, rules=closed), scene(NAIVE, rules=fenced))

    assert value(observed, "no fly", 1) == value(observed, "fence", 2) == 1.0
    assert value(observed, "margin", 1) == 1.0
    assert value(observed, "reported", 1) == value(observed, "reported", 2) == 1.0
    assert observed.end_s[1] > observed.end_s[0] + 5.0


def test_rules_of_speed_height_and_people_are_kept_and_cost_time() -> None:
    slow, high = {"max_speed_mps": 6.0}, {"min_altitude_m": 40.0}
    people = {"bystander_slow_within_m": 30.0, "bystander_slow_mps": 4.0}

    fine, capped, raised, rash, careful = range(5)
    observed = simulated(
        scene(NAIVE),
        scene(NAIVE, rules=slow),
        scene(NAIVE, rules=high),
        scene(NAIVE, rules=people),
        scene(AWARE, rules=people),
    )

    assert value(observed, "speed", capped) == 1.0
    assert observed.end_s[capped] > observed.end_s[fine] + 30.0
    assert value(observed, "floor", raised) == 1.0
    assert observed.end_s[raised] > observed.end_s[fine]
    assert observed.end_s[rash] == observed.end_s[fine]
    assert value(observed, "slow", careful) > 0.9 > value(observed, "slow", rash)


def consenting(agent: str, answer: str, after_s: float = 5.0) -> SimSpec:
    """Nobody is near, and the operator answers alike about both targets."""
    consents = [
        {"intelligence": name, "answer": answer, "after_s": after_s}
        for name in ("radar-sighting", "truck-sighting")
    ]
    return scene(agent, people_m=(255.0,), rules={"mark_consent": True}, consents=consents)


@pytest.mark.parametrize("agent", [NAIVE, AWARE])
def test_marks_wait_for_consent_and_need_it(agent: str) -> None:
    """As much later as the answer; none when it is refused, never comes, or comes after the landing."""
    free = scene(agent, people_m=(255.0,))
    answers = (("granted", 5.0), ("refused", 5.0), ("never", 5.0), ("granted", 250.0))
    batch = pack([free, *(consenting(agent, answer, after_s) for answer, after_s in answers)])

    flown = FlownMissions(batch)

    assert np.isfinite(flown.marked_s[0]).all()
    np.testing.assert_allclose(flown.marked_s[1], flown.reported_s[1] + 5.0)
    np.testing.assert_allclose(flown.reported_s[1], flown.reported_s[0])
    assert np.isinf(flown.marked_s[2:]).all()


def test_two_outages_that_overlap_are_one_and_what_comes_between_two_is_heard() -> None:
    def down(*spans_s: tuple[float, float]) -> tuple[tuple[float, float], ...]:
        outages = [Outage(kind="operator_link", at_s=a, duration_s=b - a) for a, b in spans_s]
        return outage_spans(outages, "operator_link")

    overlapping, apart = down((30.0, 50.0), (40.0, 70.0)), down((60.0, 80.0), (20.0, 40.0))
    assert overlapping == ((30.0, 70.0),)
    assert [delivered_at(at_s, overlapping) for at_s in (29.0, 45.0, 70.0)] == [29.0, 70.0, 70.0]
    assert apart == ((20.0, 40.0), (60.0, 80.0))
    assert [delivered_at(at_s, apart) for at_s in (25.0, 50.0, 65.0)] == [40.0, 50.0, 80.0]
