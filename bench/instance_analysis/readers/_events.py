"""Reads events during the flight: vehicle failures, outages, orders of the operator."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from .._draft import Draft, FieldPath
from ..language._phrases import Part, Phrase, Quantity
from ..language._vocabulary import EventForm
from ._group_references import GroupReferences
from ._intelligence import IntelligenceReader

# Readings that are offered for `for how long?`. Chosen, not measured.
DURATION_CHOICES_S = (10.0, 30.0, 60.0)


_CLOCK = re.compile(r"(?<!\d)\d:\d\d")
_WITHOUT_UNIT = re.compile(r"\bh\s?\+\s?\d+(?!\d|\s?(?:s|sec\w*|min\w*|h|to)\b)", re.IGNORECASE)
_TIME_OF_DAY = re.compile(r"\d\d:\d\d")
_REVOKES = re.compile(
    r"\b(?:revok|lift|withdr|rescind|cancel)\w*\s+(?:this|it|that|the\s+order)\b", re.IGNORECASE
)

VALUES: dict[str, tuple[tuple[str, tuple[str, ...], str, tuple[float, ...]], ...]] = {
    "battery_drop": (("to_fraction", ("PERCENT",), "to which share of the charge?", (0.1, 0.3)),),
    "gps_drift": (("drift_mps", ("SPEED",), "how fast, in m/s?", (0.2, 0.5, 1.0)),),
    "motor_off": (("instance", ("COUNT",), "which motor?", (1.0, 2.0, 3.0, 4.0)),),
    "detections_degraded": (("lost_share", ("PERCENT", "FRACTION"), "which share is lost?", (0.25, 0.5)),),
}
"""Fields of an event beside its times: the kinds of number that they take, and what is asked and offered without one."""


@dataclass(frozen=True, slots=True)
class EventTiming:
    """When an event happens, how long it lasts, and its deadline; None for what the text does not say."""

    at_s: float | None = None
    lasting_s: float | None = None
    within_s: float | None = None
    later_s: float | None = None
    """How long after the event before it."""


class EventReader:
    """Reads events into a draft, in the order of the text."""

    def __init__(self, draft: Draft, references: GroupReferences, reports: IntelligenceReader) -> None:
        self._draft, self._references, self._intelligence = draft, references, reports
        self._groups = references.groups
        self._numbers: dict[str, int] = {}
        self._last = ""
        self._last_order: FieldPath = ()
        self._last_at_s: float | None = None
        self._timeless: list[tuple[EventForm, Phrase]] = []
        self._timed: set[tuple[str, str]] = set()

    def event(self, phrase: Phrase) -> None:
        part = phrase.first("EVENT")
        assert part is not None
        assert isinstance(part.value, EventForm)
        when, quote = _timing_of(phrase), self._draft.quote(phrase.span)
        if phrase.first("UNITLESS") or _WITHOUT_UNIT.search(quote):
            self._draft.remark(phrase.span, "a number without a unit is read as seconds")
        if part.value.part == "consents":
            self._consent(part.value.kind, phrase, when)
            return
        if when.at_s is not None and when.later_s is not None:
            # `after 2 minutes it stops, and one minute later it goes on`: the first time is that of another event.
            self._draft.unread(
                phrase.span, "it has two times, of which one is another event's", expressible=True
            )
            return
        if when.at_s is None and when.later_s is not None and self._last_at_s is not None:
            self._draft.remark(phrase.span, f"read as {when.later_s:g} s after the event before it")
            when = replace(when, at_s=self._last_at_s + when.later_s)
        if _TIME_OF_DAY.search(quote):
            self._draft.unread(phrase.span, "write its time in seconds after the start", expressible=True)
            return
        if _CLOCK.search(quote):
            read_as = "a time without a zone is read as minutes and seconds after the start"
            self._draft.remark(phrase.span, read_as)
        if _REVOKES.search(quote) and self._last not in ("hold", "stop_reporting"):
            self._draft.unread(phrase.span, "only a hold and a silence can be revoked")
        elif when.at_s is None:
            self._timeless.append((part.value, phrase))
        else:
            self._happens(part.value, phrase, when, when.at_s)

    def finish(self) -> None:
        """Ask for the time of every event that has none anywhere in the text. Whoever is asked must consent."""
        rule: FieldPath = ("rules", "mark_consent")
        if "consents" in self._numbers and rule not in self._draft.entries:
            self._draft.put(rule, True, None, "the text tells how requests are answered")
        for event, phrase in self._timeless:
            # A phrase without a time repeats an event of its kind that has one elsewhere in the text.
            if (event.part, event.kind) not in self._timed:
                readings = ["from the start", "60 s after the start"]
                at_s = (0.0, 60.0)[self._draft.ask(phrase.span, "when?", readings)]
                self._happens(event, phrase, _timing_of(phrase), at_s)

    def _happens(self, event: EventForm, phrase: Phrase, when: EventTiming, at_s: float) -> None:
        self._timed.add((event.part, event.kind))
        kind, lasting = event.kind, when.lasting_s
        # `resume` ends the order before it: a hold, or a silence.
        if kind == "resume" and self._last == "stop_reporting":
            kind = "resume_reporting"
        base = self._begin(event.part, kind, at_s, phrase)
        if event.part == "orders":
            self._order(base, kind, phrase, when, at_s)
            return
        if lasting is None and event.part == "outages":
            readings = [f"{choice:g} s" for choice in DURATION_CHOICES_S]
            lasting = DURATION_CHOICES_S[self._draft.ask(phrase.span, "for how long?", readings)]
        if lasting is not None and kind != "battery_drop":
            self._draft.put((*base, "duration_s"), lasting, phrase.span)
        self._values(base, kind, phrase)

    def comply(self, phrase: Phrase) -> None:
        """Set the deadline of the order before it: `the agent shall comply within 4 s`."""
        part = phrase.first("TIME")
        deadline: FieldPath = (*self._last_order, "within_s")
        if (
            part is None
            or not isinstance(part.value, Quantity)
            or not self._last_order
            or deadline in self._draft.entries
        ):
            self._draft.unread(phrase.span, "the text does not say with which order", expressible=True)
            return
        phrase.every("WITHIN")
        self._draft.put(deadline, part.value.low, phrase.span)

    def _consent(self, answer: str, phrase: Phrase, when: EventTiming) -> None:
        """Read how the operator answers requests about one report."""
        number = self._numbers["consents"] = self._numbers.get("consents", -1) + 1
        base: FieldPath = ("consents", number)
        self._draft.put((*base, "answer"), answer, phrase.span)
        if when.at_s is not None:
            self._draft.put((*base, "after_s"), when.at_s, phrase.span)
        self._task(base, phrase)

    def _order(self, base: FieldPath, kind: str, phrase: Phrase, when: EventTiming, at_s: float) -> None:
        # An order has no duration in a SimSpec, so `for 60 s` becomes a second order.
        ends = {"stop_reporting": "resume_reporting", "hold": "resume"}
        if when.lasting_s is not None and kind in ends:
            self._begin("orders", ends[kind], at_s + when.lasting_s, phrase)
        if when.within_s is not None:
            self._draft.put((*base, "within_s"), when.within_s, phrase.span)
        if kind in ("mark", "retask"):
            self._task(base, phrase)

    def _begin(self, part: str, kind: str, at_s: float, phrase: Phrase) -> FieldPath:
        number = self._numbers[part] = self._numbers.get(part, -1) + 1
        # Orders have ids, because an agent answers them by id; failures and outages are plain lists.
        key: str | int = f"{kind.replace('_', '-')}-{number + 1}" if part == "orders" else number
        base: FieldPath = (*part.split("."), key)
        if part == "orders":
            self._last_order = base
        self._last, self._last_at_s = kind, at_s
        if part == "orders":
            self._draft.put((*base, "id"), key, phrase.span)
        self._draft.put((*base, "at_s"), at_s, phrase.span)
        self._draft.put((*base, "kind"), kind, phrase.span)
        return base

    def _values(self, base: FieldPath, kind: str, phrase: Phrase) -> None:
        """Set the numbers that an event has beside its times, and ask for those that it needs."""
        for name, kinds, question, readings in VALUES.get(kind, ()):
            value = next((value for number in kinds if (value := _low(phrase, number)) is not None), None)
            if value is None:
                value = readings[
                    self._draft.ask(phrase.span, question, [f"{choice:g}" for choice in readings])
                ]
            self._draft.put((*base, name), int(value) if name == "instance" else value, phrase.span)
        if direction := phrase.first("DIR"):
            self._draft.put((*base, "towards_deg"), direction.value, phrase.span)

    def _task(self, base: FieldPath, phrase: Phrase) -> None:
        targets = self._groups.targets()
        if not phrase.refs:
            # `an order to mark comes at t=140 s`, where there is one target.
            groups = targets if len(targets) == 1 else []
        elif phrase.refs[0].first("THEM"):
            groups = self._intelligence.last() or self._groups.subject
        else:
            groups = self._references.groups_in(phrase)
        if not groups:
            self._draft.unread(
                phrase.span, "it is about a report on a group, and the text does not say which"
            )
            self._draft.forget(base)
            return
        self._draft.put((*base, "intelligence"), self._intelligence.on(groups[0], phrase.span), phrase.span)


def _low(phrase: Phrase, kind: str) -> float | None:
    part = phrase.first(kind)
    value = part.value if part is not None else None
    return value.low if isinstance(value, Quantity) else value if isinstance(value, float) else None


def _timing_of(phrase: Phrase) -> EventTiming:
    """The times of an event, each of which stands behind a part that names it."""
    times: dict[str, float] = {}
    name = ""
    for part in phrase.parts:
        if isinstance(part, Part) and part.kind == "TIME" and isinstance(part.value, Quantity):
            times[name] = part.value.low
        name = part.kind if isinstance(part, Part) else ""
    if "UNTIL" in times:
        times.setdefault("AT", 0.0)
        times["LASTING"] = times["UNTIL"] - times["AT"]
    at_s = next((times[name] for name in ("AT", "UNITLESS", "ANSWER") if name in times), None)
    return EventTiming(at_s, times.get("LASTING"), times.get("WITHIN"), times.get("LATER"))
