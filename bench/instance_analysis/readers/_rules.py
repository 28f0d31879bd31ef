"""Reads rules for the agent: distances to bystanders, report windows, the lost link, the ceiling."""

from __future__ import annotations

import re

from bench.simspec import Mission, Rules

from .._draft import Draft
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ..language._vocabulary import RuleForm
from ._group_references import GroupReferences

UNIT_NAMES = {"LENGTH": "m", "TIME": "s", "SPEED": "m/s", "ANGLE": "deg"}
_UP_TO = re.compile(r"\b(?:until|till|before|within|in|first)\s*(?:the\s+|first\s+)*$", re.IGNORECASE)
"""What makes a single time the end of a window."""


class RuleReader:
    """Reads rules into a draft."""

    def __init__(self, draft: Draft, references: GroupReferences) -> None:
        self._draft, self._references, self._groups = draft, references, references.groups
        self._windows: list[tuple[float, float | None, Span]] = []
        self._silences: list[tuple[float, float | None, Span]] = []

    def rule(self, phrase: Phrase) -> None:
        """Set the fields of a rule or limit to its numbers, in the order of the text."""
        part = phrase.first("RULE") or phrase.first("WINDOW")
        assert part is not None
        assert isinstance(part.value, RuleForm)
        if part.value.window:
            self._window(phrase, closed=part.value.window == "closed")
            return
        if part.value.remark:
            self._draft.remark(phrase.span, part.value.remark)
        numbers = [
            item for item in phrase.parts if isinstance(item, Part) and isinstance(item.value, Quantity)
        ]
        for path, value in part.value.sets.items():
            kind = value.rstrip("?") if isinstance(value, str) else ""
            if not kind.isupper():
                self._draft.put(tuple(path.split(".")), value, phrase.span)
                continue
            number = next((item for item in numbers if item.kind == kind), None)
            if number is not None and isinstance(number.value, Quantity):
                numbers.remove(number)
                unit = UNIT_NAMES.get(kind)
                self._draft.vary(
                    tuple(path.split(".")),
                    number.value.low,
                    number.value.high,
                    phrase.span,
                    unit=unit,
                    note=part.value.remark,
                )

    def standoff(self, phrase: Phrase) -> None:
        if phrase.refs and not any(self._references.of_bystanders(ref) for ref in phrase.refs):
            self._draft.unread(phrase.span, "a SimSpec has this rule for bystanders only")
            return
        part = phrase.first("LENGTH")
        assert part is not None
        assert isinstance(part.value, Quantity)
        self._draft.vary(
            ("rules", "bystander_standoff_m"), part.value.low, part.value.high, phrase.span, unit="m"
        )

    def _window(self, phrase: Phrase, *, closed: bool) -> None:
        """Read when reports are allowed or forbidden."""
        into = self._silences if closed else self._windows
        count = next((part for part in phrase.parts if isinstance(part, Part) and part.kind == "COUNT"), None)
        if count is not None and count.value != Quantity(
            "COUNT", len(phrase.every("TIME")), len(phrase.every("TIME"))
        ):
            # `in two windows`, of which there are three, is left unread.
            count.disown()
        for part in phrase.every("TIME"):
            assert isinstance(part.value, Quantity)
            before = self._draft.text[phrase.span.start : part.span.start]
            into.append((*_stretch(before, part.value), phrase.span))

    def finish(self) -> None:
        self._put_windows()
        self._ceiling()

    def _put_windows(self) -> None:
        end = self._draft.entries.get(("mission", "time_limit_s"))
        # A window without an end lasts until the mission does.
        limit = float(end.value) if end else Mission().time_limit_s
        open_s = (
            sorted((low, limit if high is None else high, span) for low, high, span in self._windows) or None
        )
        for low, high, span in self._silences:
            top = limit if high is None else high
            # Without stated windows reports are allowed all the time, so a silence cuts a hole into the whole
            # mission.
            windows = open_s if open_s is not None else [(0.0, limit, span)]
            open_s = [part for window in windows for part in _without(window, low, top, span)]
        for number, (low, high, span) in enumerate(open_s or []):
            self._draft.put(("rules", "report_windows", number, "from_s"), low, span)
            self._draft.put(("rules", "report_windows", number, "until_s"), high, span)

    def _ceiling(self) -> None:
        height = self._draft.entries.get(("mission", "altitude_m"))
        if height is None or height.span is None or ("rules", "max_altitude_m") in self._draft.entries:
            return
        highs = [varied.high for varied in self._draft.ranges if "mission.altitude_m" in varied.paths]
        # A range of heights must stay below the ceiling at its upper end too.
        top = max([height.value, *(varied for varied in highs if varied is not None)])
        usual = Rules().max_altitude_m
        if top > usual:
            readings = [
                f"rules.max_altitude_m = {top:g}",
                f"keep the ceiling of {usual:g} m, and the mission at it",
            ]
            if (
                self._draft.ask(
                    height.span,
                    f"it is above the ceiling of {usual:g} m that rules have by default",
                    readings,
                )
                == 0
            ):
                self._draft.put(("rules", "max_altitude_m"), top, height.span)
            else:
                self._draft.forget(("mission", "altitude_m"))
                self._draft.put(("mission", "altitude_m"), usual, height.span)


def _stretch(before: str, time: Quantity) -> tuple[float, float | None]:
    if not time.single:
        return time.low, time.high
    return (0.0, time.low) if _UP_TO.search(before) else (time.low, None)


def _without(
    window: tuple[float, float, Span], low: float, high: float, span: Span
) -> list[tuple[float, float, Span]]:
    """The parts of a time window that remain outside another one."""
    begin, end, _ = window
    if high <= begin or low >= end:
        return [window]
    parts = [(begin, min(low, end)), (max(high, begin), end)]
    return [(a, b, span) for a, b in parts if a < b]
