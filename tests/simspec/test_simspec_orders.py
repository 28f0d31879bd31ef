"""Kinds of orders: what every room reads of them in one place."""

from __future__ import annotations

from typing import get_args, get_type_hints

import pytest
from pydantic import ValidationError

from bench.simspec import (
    ENDING_ORDERS,
    MOTION_ORDERS,
    PAUSES,
    REPORT_ORDERS,
    SILENCING_ORDERS,
    Order,
    OrderKind,
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
