"""Reads rules for the agent: distances to bystanders, report windows, the lost link, the ceiling."""

from __future__ import annotations

from bench.simspec import Mission, Rules

from .._draft import Draft, FieldPath
from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span
from ._groups import GroupRegister

UNIT_NAMES = {"LENGTH": "m", "TIME": "s", "SPEED": "m/s", "ANGLE": "deg"}
MARKS = "read as a rule of marks: a report with mark true is what the bench holds back near bystanders"


class RuleReader:
    """Reads rules into a draft. Each rule of the grammar is read by the method with its name."""

    RULES = frozenset(["nomark", "noreport", "slow", "loiter", "window", "linklost"])

    def __init__(self, draft: Draft, cast: GroupRegister) -> None:
        self._draft, self._groups = draft, cast
        self._windows: list[tuple[float, float | None, Span]] = []
        self._silences: list[tuple[float, float | None, Span]] = []

    def _rule(self, phrase: Phrase, fields: dict[str, str], note: str = "") -> bool:
        if phrase.refs and not any(self._groups.of_bystanders(ref) for ref in phrase.refs):
            self._draft.unread(phrase.span, "a SimSpec has this rule for bystanders only")
            return False
        for name, kind in fields.items():
            part = phrase.first(kind)
            assert part is not None
            assert isinstance(part.value, Quantity)
            low, high, unit = part.value.low, part.value.high, UNIT_NAMES[kind]
            self._draft.vary(("rules", name), low, high, phrase.span, unit=unit, note=note)
        return True

    def nomark(self, phrase: Phrase) -> None:
        self._rule(phrase, {"no_mark_within_m": "LENGTH"})

    def noreport(self, phrase: Phrase) -> None:
        """Read a distance for reports; the SimSpec applies it to marks."""
        if self._rule(phrase, {"no_mark_within_m": "LENGTH"}, MARKS):
            self._draft.remark(phrase.span, MARKS)

    def standoff(self, phrase: Phrase) -> None:
        self._rule(phrase, {"bystander_standoff_m": "LENGTH"})

    def slow(self, phrase: Phrase) -> None:
        self._rule(phrase, {"bystander_slow_within_m": "LENGTH", "bystander_slow_mps": "SPEED"})

    def loiter(self, phrase: Phrase) -> None:
        self._rule(phrase, {"max_loiter_over_bystander_s": "TIME"})

    def window(self, phrase: Phrase) -> None:
        """Read when reports are allowed or forbidden."""
        into = self._silences if phrase.first("NOREPORT") else self._windows
        before = ""
        for part in phrase.parts:
            if isinstance(part, Part) and part.kind == "TIME" and isinstance(part.value, Quantity):
                into.append((*_stretch(before, part.value), phrase.span))
            before = part.kind if isinstance(part, Part) else ""

    def linklost(self, phrase: Phrase) -> None:
        what = phrase.first("LINKDO")
        assert what is not None
        self._draft.put(("rules", "link_lost"), what.value, phrase.span)
        if (time := phrase.first("TIME")) and isinstance(time.value, Quantity):
            path: FieldPath = ("rules", "link_lost_after_s")
            self._draft.vary(path, time.value.low, time.value.high, phrase.span, unit="s")

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
    return (0.0, time.low) if before in ("UNTIL", "BEFORE", "WITHIN", "IN") else (time.low, None)


def _without(
    window: tuple[float, float, Span], low: float, high: float, span: Span
) -> list[tuple[float, float, Span]]:
    """The parts of a time window that remain outside another one."""
    begin, end, _ = window
    if high <= begin or low >= end:
        return [window]
    parts = [(begin, min(low, end)), (max(high, begin), end)]
    return [(a, b, span) for a, b in parts if a < b]
