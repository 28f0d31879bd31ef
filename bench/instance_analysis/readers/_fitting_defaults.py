"""Lets the defaults of a SimSpec give way to what the text states: a ceiling, a floor, and times after the usual end."""

from __future__ import annotations

import math

from bench.simspec import Mission

from .._draft import Draft, FieldPath
from ..language._tokens import Span

ALTITUDE: FieldPath = ("mission", "altitude_m")
LIMIT: FieldPath = ("mission", "time_limit_s")
MOMENTS = frozenset(["at_s", "delivered_s", "depart_s"])
"""Fields at whose time something happens."""
TIME_AFTER_S = 60.0
"""How long the mission goes on after the last thing that the text states. Chosen."""


def fit_defaults(draft: Draft) -> None:
    """Set the mission's height and time limit where the text leaves them open and the usual ones do not fit."""
    _fit_altitude(draft)
    _fit_time_limit(draft)


def _fit_altitude(draft: Draft) -> None:
    usual = Mission().altitude_m
    ceiling, floor = (draft.entries.get(("rules", name)) for name in ("max_altitude_m", "min_altitude_m"))
    if ALTITUDE in draft.entries:
        return
    for rule, fitting in ((ceiling, min), (floor, max)):
        if rule is not None and fitting(rule.value, usual) != usual:
            draft.reading = rule.span
            draft.put(ALTITUDE, rule.value, None, f"the usual {usual:g} m break a rule of the text")


def _fit_time_limit(draft: Draft) -> None:
    usual = Mission().time_limit_s
    if LIMIT in draft.entries:
        return
    ends: list[tuple[float, Span | None]] = []
    for path, entry in draft.entries.items():
        if path[-1] in MOMENTS:
            duration = draft.entries.get((*path[:-1], "duration_s"))
            lasting = float(duration.value) if duration is not None else 0.0
            ends.append((float(entry.value) + lasting, entry.span))
    last_s, span = max(ends, key=lambda end: end[0], default=(0.0, None))
    if last_s >= usual:
        draft.reading = span
        needed = math.ceil((last_s + TIME_AFTER_S) / TIME_AFTER_S) * TIME_AFTER_S
        draft.put(LIMIT, needed, None, f"the usual {usual:g} s end before {last_s:g} s")
