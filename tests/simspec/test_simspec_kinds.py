"""Kinds of orders, failures and outages: what every room reads of them in one place."""

from __future__ import annotations

from typing import get_args, get_type_hints

import pytest
from pydantic import ValidationError

from bench.simspec import (
    ENDING_ORDERS,
    FAILURES,
    MOTION_ORDERS,
    OUTAGES,
    PAUSES,
    REPORT_ORDERS,
    SILENCING_ORDERS,
    Failure,
    FailureKind,
    Order,
    OrderKind,
    OutageKind,
)
from test_ports.operator.orders import PHASES_AFTER_ORDER, phase_announced, silence_kept

KINDS = get_args(OrderKind)


def test_the_sets_hold_kinds_of_orders_alone() -> None:
    assert {*PAUSES, *PAUSES.values(), *ENDING_ORDERS, *SILENCING_ORDERS, *REPORT_ORDERS} <= {*KINDS}


def test_every_order_but_those_about_reports_alone_is_about_where_to_go() -> None:
    """Written out, because a kind that slips out of a set would change scores without a word."""
    assert {*KINDS} - MOTION_ORDERS == {"stop_reporting", "resume_reporting", "mark"}


def test_options_of_measures_name_the_kinds_of_these_sets() -> None:
    assert set(get_args(get_type_hints(phase_announced.find)["kind"])) == MOTION_ORDERS
    assert {*PHASES_AFTER_ORDER} == MOTION_ORDERS
    assert set(get_args(get_type_hints(silence_kept.find)["kind"])) == {*SILENCING_ORDERS}


@pytest.mark.parametrize("kind", KINDS)
def test_an_order_names_a_report_if_and_only_if_it_is_about_one(kind: str) -> None:
    absent = {"id": "a", "at_s": 5.0, "kind": kind}
    stated = absent | {"intelligence": "radar-sighting"}
    right, wrong = (stated, absent) if kind in REPORT_ORDERS else (absent, stated)
    assert Order.model_validate(right).kind == kind
    with pytest.raises(ValidationError, match=r"needs intelligence|only retask and mark refer to a report"):
        Order.model_validate(wrong)


VALUES = {
    "duration_s": 7.5,
    "instance": 3,
    "link": "onboard",
    "to_fraction": 0.35,
    "drift_mps": 0.5,
    "towards_deg": 45.0,
}


def whole(kind: str) -> dict[str, object]:
    """A failure of this kind with all its fields."""
    return {"at_s": 10.0, "kind": kind} | {name: VALUES[name] for name in FAILURES[kind].takes}


def test_every_kind_is_declared_and_none_beside() -> None:
    assert tuple(FAILURES) == get_args(FailureKind)
    assert tuple(OUTAGES) == get_args(OutageKind)


@pytest.mark.parametrize("kind", FAILURES)
def test_a_failure_takes_the_fields_of_its_kind_and_no_others(kind: str) -> None:
    declared = FAILURES[kind]
    full = whole(kind)
    failure = Failure.model_validate(full)
    assert failure.until_s == (17.5 if "duration_s" in declared.takes else float("inf"))
    for name in VALUES.keys() - {*declared.takes}:
        with pytest.raises(ValidationError, match=f"{kind} takes no {name}; it takes "):
            Failure.model_validate(full | {name: VALUES[name]})
    for name in declared.takes:
        left = {key: value for key, value in full.items() if key != name}
        if name == declared.needs:
            with pytest.raises(ValidationError, match=f"{kind} needs {name}"):
                Failure.model_validate(left)
        else:
            Failure.model_validate(left)


def test_a_story_tells_each_failure_with_its_numbers() -> None:
    told = {kind: FAILURES[kind].tell(Failure.model_validate(whole(kind))) for kind in FAILURES}
    assert told == {
        "gps_off": "no GPS fixes",
        "gps_drift": "fixes drift by 0.5 m/s towards 45°",
        "battery_drop": "the battery falls to 35 %",
        "motor_off": "rotor 3 stops",
        "link_loss": "MAVLink link onboard is cut",
    }
    assert FAILURES["link_loss"].tell(Failure(at_s=1.0, kind="link_loss")) == "every MAVLink link is cut"
