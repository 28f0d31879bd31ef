"""Orders, outages, failures and rules: what the surrogates do about them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from test_surrogate import AWARE, NAIVE, scene

from agent_adapters.reference.surrogate import Observed, observe, pack
from agent_adapters.reference.surrogate.batch._interruptions import interruptions
from agent_adapters.reference.surrogate.flight._mission import FlownMissions
from bench.contracts import Option
from bench.simspec import SimSpec

OBSERVABLES: dict[str, tuple[str, dict[str, Option]]] = {
    "reported": ("targets_reported", {}),
    "urgent": ("targets_reported", {"priority": 1}),
    "order": ("priority_order", {}),
    "marks": ("marks_clear_of_bystanders", {}),
    "flown": ("mission_flown", {}),
    "hold": ("order_obeyed", {"kind": "hold"}),
    "retask": ("order_obeyed", {"kind": "retask"}),
    "hand over": ("order_obeyed", {"kind": "hand_over"}),
    "take back": ("order_obeyed", {"kind": "take_back"}),
    "silence": ("silence_kept", {"kind": "stop_reporting"}),
    "unlawful": ("unlawful_refused", {}),
    "in time": ("reports_in_time", {}),
    "windows": ("report_windows_kept", {}),
    "no fly": ("no_fly_kept", {}),
    "margin": ("no_fly_margin", {"margin_m": 20.0}),
    "fence": ("geofence_kept", {}),
    "speed": ("speed_kept", {}),
    "floor": ("floor_kept", {}),
    "slow": ("slow_near_bystanders", {}),
    "accuracy": ("report_accuracy", {}),
    "seen": ("detection_share", {"role": "adversary"}),
}
NAMES = list(OBSERVABLES)


def simulated(*simspecs: SimSpec) -> Observed:
    return observe(pack(simspecs), OBSERVABLES)


def value(observed: Observed, name: str, row: int = 0) -> float:
    assert observed.considered[row, NAMES.index(name)]
    return float(observed.x[row, NAMES.index(name)])


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
    windows = [
        {"from_s": 0.0, "until_s": 20.0},
        {"from_s": 80.0, "until_s": 300.0},
    ]  # what it finds has to wait
    ended = scene(NAIVE, orders=[ordered(kind, 45.0)], rules={"report_windows": windows})

    observed = simulated(scene(NAIVE), ended)

    assert observed.end_s[1] < observed.end_s[0]
    assert value(observed, "reported", 1) == (0.5 if kind == "return" else 0.0)
    assert value(observed, "flown", 1) == 1.0  # landed where it was told to counts as home


def late(latency_s: float) -> list[dict[str, Any]]:
    truck = {"id": "truck-sighting", "about": "truck", "priority": 2, "uncertainty_m": 40.0}
    radar = {"id": "radar-sighting", "about": "radar", "priority": 3, "uncertainty_m": 40.0}
    return [truck, radar | {"delivered_s": 20.0, "latency_s": latency_s}]


def test_what_was_seen_during_the_flight_is_due_while_it_is_fresh() -> None:
    """Seen at 15 s or five seconds before the flight, told at 20 s; with and without a deadline for all reports."""
    rules: list[dict[str, Any]] = [{}, {"report_deadline_s": 90.0}]
    batch = pack(
        [
            scene(NAIVE, intelligence=late(latency_s), rules=rule)
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
    both = [
        {"id": "radar-sighting", "about": "radar", "priority": 1, "uncertainty_m": 110.0},
        {"id": "truck-sighting", "about": "truck", "priority": 2, "uncertainty_m": 110.0},
    ]
    waits = [ordered("hold", 60.0)]
    rules: list[dict[str, Any]] = [{}, {"report_deadline_s": 120.0}]

    observed = simulated(*(scene(NAIVE, intelligence=both, orders=waits, rules=rule) for rule in rules))

    without, with_deadline = (value(observed, "reported", row) for row in (0, 1))
    assert (without, with_deadline) == (0.5, 1.0)


def test_a_retask_turns_to_its_sub_area_first_and_comes_back_to_the_other() -> None:
    observed = simulated(scene(NAIVE), scene(NAIVE, orders=[ordered("retask", 20.0, "truck-sighting")]))

    assert [value(observed, "order", row) for row in (0, 1)] == [1.0, 0.0]
    assert value(observed, "reported", 1) == value(observed, "retask", 1) == 1.0


def test_more_urgent_news_in_flight_breaks_off_what_is_less_urgent() -> None:
    news = [
        {"id": "truck-sighting", "about": "truck", "priority": 2, "uncertainty_m": 40.0},
        {"id": "radar-sighting", "about": "radar", "priority": 1, "uncertainty_m": 40.0, "delivered_s": 20.0},
    ]

    observed = simulated(scene(NAIVE, intelligence=news))

    assert value(observed, "order") == value(observed, "reported") == 1.0


def test_what_is_found_in_silence_is_said_when_that_is_over() -> None:
    orders = [ordered("stop_reporting", 20.0), ordered("resume_reporting", 200.0)]
    early, late = ({"report_deadline_s": deadline_s} for deadline_s in (150.0, 250.0))

    observed = simulated(scene(NAIVE, orders=orders, rules=early), scene(NAIVE, orders=orders, rules=late))

    assert [value(observed, "in time", row) for row in (0, 1)] == [0.0, 1.0]
    assert [value(observed, "silence", row) for row in (0, 1)] == [1.0, 1.0]


def test_the_careful_one_refuses_to_mark_beside_people_and_the_naive_one_does_not() -> None:
    orders = [ordered("mark", 100.0, "radar-sighting")]

    observed = simulated(scene(NAIVE, orders=orders), scene(AWARE, orders=orders))

    assert [value(observed, "unlawful", row) for row in (0, 1)] == [0.0, 1.0]


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
        return scene(NAIVE, vehicle={"home": {"east_m": -150.0, "north_m": 60.0}, "failures": [failure]})

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
    def corners(west: float, south: float, east: float, north: float) -> list[dict[str, float]]:
        return [
            {"east_m": e, "north_m": n}
            for e, n in ((west, south), (east, south), (east, north), (west, north))
        ]

    closed = {"no_fly": [{"id": "clinic", "area": {"corners": corners(-15.0, -20.0, 15.0, 60.0)}}]}
    fenced = {"geofence": {"corners": corners(-180.0, -95.0, 130.0, 110.0)}}

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


def test_nobodys_orders_change_anothers_mission() -> None:
    plain, eventful = (
        scene(AWARE),
        scene(
            AWARE,
            orders=[
                ordered("hold", 30.0),
                ordered("resume", 60.0),
                ordered("retask", 70.0, "truck-sighting"),
            ],
            outages=[{"kind": "operator_link", "at_s": 90.0, "duration_s": 30.0}],
            rules={
                "link_lost": "return",
                "bystander_slow_within_m": 20.0,
                "bystander_slow_mps": 5.0,
                "report_deadline_s": 100.0,
            },
        ),
    )

    together = simulated(plain, eventful)

    for row, simspec in enumerate((plain, eventful)):
        alone = simulated(simspec)
        assert np.array_equal(alone.x[0], together.x[row])
        assert alone.end_s[0] == together.end_s[row]


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
