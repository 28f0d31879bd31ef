"""What comes between a mission and its plan, by the clock: orders, outages and failures as spans and moments.

Everything here is known before the flight. What it leads to is the surrogate's business: `_mission.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

from bench.simspec import (
    ENDING_ORDERS,
    MOTION_ORDERS,
    PAUSES,
    SILENCING_ORDERS,
    Failure,
    Order,
    Outage,
    SimSpec,
)

from ...flight._limits import DESCENT_MPS, LAND_MPS

Span = tuple[float, float]

# COM_OF_LOSS_T of PX4.
OFFBOARD_LOST_S = 1.0
"""Without setpoints for so long PX4 flies home by itself."""

# EKF2_NOAID_TOUT of PX4, and a moment; docs/flight-controller.md.
POSITION_LOST_S = 5.1
"""Without satellites for so long PX4 lands where it is, at the speed of landing from any height."""

# From satellites that are back to an aircraft that flies on, and climbs on the way. Two flights of campaign full.
POSITION_BACK_S = 0.8

# MPC_XY_CRUISE of PX4, by which it flies home; docs/vehicle.md.
RETURN_MPS = 5.0


def interruptions(simspec: SimSpec) -> dict[str, Any]:
    """What interrupts the mission of a SimSpec that no fault of `unfit` speaks against, by columns of `Batch`.

    Spans are sorted and apart; moments are inf where nothing comes.
    """
    rules, failures = simspec.rules, simspec.vehicle.failures
    link_down = outage_spans(simspec.outages, "operator_link")
    away = merged((since_s + rules.link_lost_after_s, until_s) for since_s, until_s in link_down)
    away_by_rule = {rules.link_lost: away}
    orders = sorted(
        ((order, delivered_at(order.at_s, link_down)) for order in simspec.orders),
        key=lambda pair: (pair[1], pair[0].at_s),
    )
    lost = _failed_spans(failures, "gps_off")
    silent = [
        (since_s + OFFBOARD_LOST_S, until_s) for since_s, until_s in _failed_spans(failures, "link_loss")
    ]
    drops = _of_kind(failures, "battery_drop")
    height_m = simspec.mission.altitude_m
    return_mps = max(simspec.vehicle.parameters.get("MPC_XY_CRUISE", RETURN_MPS), 0.5)
    fallen = [
        since_s + POSITION_LOST_S
        for since_s, until_s in lost
        if until_s - since_s - POSITION_LOST_S > height_m / LAND_MPS
    ]
    ended = [(order.kind, at_s) for order, at_s in orders if order.kind in ENDING_ORDERS]
    mute_s = min((at_s for kind, at_s in ended if kind in SILENCING_ORDERS), default=math.inf)
    down_s = [at_s for kind, at_s in ended if kind == "deactivate"]
    return {
        "stands_s": merged(
            [
                # Where the operator flies the vehicle meanwhile is left out.
                *_spans_from(orders, tuple(PAUSES), tuple(MOTION_ORDERS - PAUSES.keys())),
                *away_by_rule.get("hold", ()),
                # Without a position PX4 sinks after a while; what it has sunk it climbs on its way.
                *((since_s, until_s + POSITION_BACK_S) for since_s, until_s in lost),
            ]
        ),
        "strays_s": [
            *((*span, height_m / DESCENT_MPS, return_mps) for span in silent),
            *((*span, 0.0, math.inf) for span in away_by_rule.get("return", ())),
        ],
        "blind_s": outage_spans(simspec.outages, "detections"),
        "closed_s": merged(
            [
                *_closed_windows(simspec),
                *_spans_from(orders, ("stop_reporting",), ("resume_reporting",)),
                (mute_s, math.inf),
            ]
        ),
        "delivered": orders,
        "ends_s": min([at_s for _, at_s in ended] + fallen, default=math.inf),
        "landed_from_s": min(down_s + fallen, default=math.inf),
        "ordered_down_s": min(down_s, default=math.inf),
        "charge_s": min((drop.at_s for drop in drops), default=math.inf),
        "charge_left": min((drop.to_fraction or 0.0 for drop in drops), default=1.0),
        "drifts": [*map(_drift, _of_kind(failures, "gps_drift"))],
    }


def delivered_at(at_s: float, link_down: Sequence[Span]) -> float:
    """When something that is due at `at_s` is delivered, with the operator's link down in these spans."""
    return next((until_s for since_s, until_s in link_down if since_s <= at_s < until_s), at_s)


def outage_spans(outages: Iterable[Outage], kind: str) -> tuple[Span, ...]:
    """When something is out: the operator's link, or the detections."""
    return merged((outage.at_s, outage.until_s) for outage in outages if outage.kind == kind)


def _of_kind(failures: Iterable[Failure], kind: str) -> list[Failure]:
    return [failure for failure in failures if failure.kind == kind]


def _failed_spans(failures: Iterable[Failure], kind: str) -> list[Span]:
    return [(failure.at_s, failure.until_s) for failure in _of_kind(failures, kind)]


def merged(spans: Iterable[Span]) -> tuple[Span, ...]:
    """The same moments as sorted spans that neither touch nor overlap; empty ones are gone."""
    spans_apart: list[Span] = []
    for since_s, until_s in sorted(span for span in spans if span[0] < span[1]):
        if spans_apart and since_s <= spans_apart[-1][1]:
            spans_apart[-1] = (spans_apart[-1][0], max(spans_apart[-1][1], until_s))
        else:
            spans_apart.append((since_s, until_s))
    return tuple(spans_apart)


def _spans_from(
    orders: Sequence[tuple[Order, float]], begins: Sequence[str], ends: Sequence[str]
) -> list[Span]:
    """From each order that begins something to the next of those that begin or end it."""
    changes = [(order.kind, at_s) for order, at_s in orders if order.kind in (*begins, *ends)]
    return [
        (at_s, next_s) for (kind, at_s), (_, next_s) in pairwise([*changes, ("", math.inf)]) if kind in begins
    ]


def _closed_windows(simspec: SimSpec) -> list[Span]:
    """Outside the windows in which the rules allow reports."""
    windows = merged((window.from_s, window.until_s) for window in simspec.rules.report_windows)
    if not windows:
        return []
    edges = [-math.inf, *(edge for span in windows for edge in span), math.inf]
    return list(zip(edges[::2], edges[1::2], strict=True))


def _drift(failure: Failure) -> tuple[float, float, float, float]:
    towards_rad, rate_mps = math.radians(failure.towards_deg or 0.0), failure.drift_mps or 0.0
    return failure.at_s, failure.until_s, rate_mps * math.sin(towards_rad), rate_mps * math.cos(towards_rad)
