"""Reads events during the flight: vehicle failures, outages, orders of the operator."""

from __future__ import annotations

from dataclasses import dataclass

from .._draft import Draft, FieldPath
from ..language._phrases import Part, Phrase, Quantity
from ..language._vocabulary import EventWords
from ._groups import GroupRegister
from ._intelligence import IntelligenceReader

TIMES = {
    "AT": "at",
    "AFTER": "at",
    "FROM": "at",
    "FOR": "lasting",
    "OF": "lasting",
    "WITHIN": "within",
    "UNTIL": "until",
}
"""What a time is by the word before it."""
# Readings that are offered for `for how long?`. Chosen, not measured.
DURATION_CHOICES_S = (10.0, 30.0, 60.0)


@dataclass(frozen=True, slots=True)
class EventTiming:
    """When an event happens, how long it lasts, and its deadline; None for what the text does not say."""

    at_s: float | None = None
    lasting_s: float | None = None
    within_s: float | None = None


class EventReader:
    """Reads events into a draft, in the order of the text."""

    def __init__(self, draft: Draft, cast: GroupRegister, reports: IntelligenceReader) -> None:
        self._draft, self._groups, self._intelligence = draft, cast, reports
        self._numbers: dict[str, int] = {}
        self._last = ""
        self._timeless: list[tuple[EventWords, Phrase]] = []
        self._timed: set[tuple[str, str]] = set()

    def event(self, phrase: Phrase) -> None:
        part = phrase.first("EVENT") or phrase.first("TASK") or phrase.first("ORDER")
        event = (
            part.value
            if part is not None
            else EventWords(part="vehicle.failures", kind="motor_off", words=())
        )
        assert isinstance(event, EventWords)
        when = _timing_of(phrase)
        if part is not None and part.kind == "ORDER" and when.at_s is None:
            when = EventTiming(_low(phrase, "COUNT"))
            self._draft.remark(phrase.span, "a number without a unit is read as seconds")
        if when.at_s is None:
            self._timeless.append((event, phrase))
            return
        self._happens(event, phrase, when)

    def finish(self) -> None:
        """Ask for the time of every event that has none anywhere in the text."""
        for event, phrase in self._timeless:
            # A phrase without a time repeats an event of its kind that has one elsewhere in the text.
            if (event.part, event.kind) not in self._timed:
                self._happens(event, phrase, _timing_of(phrase))

    def _happens(self, event: EventWords, phrase: Phrase, when: EventTiming) -> None:
        at_s = when.at_s
        part = phrase.first("TASK")
        if at_s is None:
            at_s = [0.0, 60.0][
                self._draft.ask(phrase.span, "when?", ["from the start", "60 s after the start"])
            ]
        self._timed.add((event.part, event.kind))
        kind = event.kind
        # `resume` ends the order before it: a hold, or a silence.
        if phrase.first("ORDER") and kind == "resume" and self._last == "stop_reporting":
            kind = "resume_reporting"
        base = self._begin(event.part, kind, at_s, phrase)
        lasting = when.lasting_s
        if lasting is None and event.part == "outages":
            lasting = DURATION_CHOICES_S[
                self._draft.ask(
                    phrase.span, "for how long?", [f"{choice:g} s" for choice in DURATION_CHOICES_S]
                )
            ]
        # An order has no duration in a SimSpec, so `for 60 s` becomes a second order.
        if event.kind == "stop_reporting" and lasting is not None:
            self._begin(event.part, "resume_reporting", at_s + lasting, phrase)
        if lasting is not None and event.part != "orders" and event.kind != "battery_drop":
            self._draft.put((*base, "duration_s"), lasting, phrase.span)
        if event.part == "orders" and when.within_s is not None:
            self._draft.put((*base, "within_s"), when.within_s, phrase.span)
        if event.part == "vehicle.failures":
            self._failure(base, event.kind, phrase)
        if part is not None:
            self._task(base, phrase)

    def _begin(self, part: str, kind: str, at_s: float, phrase: Phrase) -> FieldPath:
        number = self._numbers[part] = self._numbers.get(part, -1) + 1
        # Orders have ids, because an agent answers them by id; failures and outages are plain lists.
        key: str | int = f"{kind.replace('_', '-')}-{number + 1}" if part == "orders" else number
        base: FieldPath = (*part.split("."), key)
        self._last = kind
        if part == "orders":
            self._draft.put((*base, "id"), key, phrase.span)
        self._draft.put((*base, "at_s"), at_s, phrase.span)
        self._draft.put((*base, "kind"), kind, phrase.span)
        return base

    def _failure(self, base: FieldPath, kind: str, phrase: Phrase) -> None:
        if kind == "battery_drop":
            fraction = _low(phrase, "PERCENT")
            if fraction is None:
                readings = [0.1, 0.3]
                fraction = readings[
                    self._draft.ask(phrase.span, "to what charge?", [f"{choice:.0%}" for choice in readings])
                ]
            self._draft.put((*base, "to_fraction"), fraction, phrase.span)
        if kind == "gps_drift":
            speed = _low(phrase, "SPEED")
            if speed is None:
                readings = [0.2, 0.5, 1.0]
                speed = readings[
                    self._draft.ask(phrase.span, "how fast?", [f"{choice:g} m/s" for choice in readings])
                ]
            self._draft.put((*base, "drift_mps"), speed, phrase.span)
            if direction := phrase.first("DIR"):
                self._draft.put((*base, "towards_deg"), direction.value, phrase.span)
        if kind == "motor_off":
            number = _low(phrase, "COUNT")
            if number is None:
                number = 1 + self._draft.ask(
                    phrase.span, "which motor?", ["motor 1", "motor 2", "motor 3", "motor 4"]
                )
            self._draft.put((*base, "instance"), int(number), phrase.span)

    def _task(self, base: FieldPath, phrase: Phrase) -> None:
        it = phrase.refs[0].first("THEM")
        groups = self._intelligence.last() or self._groups.subject if it else self._groups.groups_in(phrase)
        if not groups:
            self._draft.unread(
                phrase.span, "an order to mark or to go somewhere is about a report on a group"
            )
            self._draft.forget(base)
            return
        self._draft.put((*base, "intelligence"), self._intelligence.on(groups[0], phrase.span), phrase.span)


def _low(phrase: Phrase, kind: str) -> float | None:
    part = phrase.first(kind)
    return part.value.low if part is not None and isinstance(part.value, Quantity) else None


def _seconds(part: Part) -> float:
    assert isinstance(part.value, Quantity)
    return part.value.low


def _timing_of(phrase: Phrase) -> EventTiming:
    times: dict[str, float] = {}
    bare: list[Part] = []
    preceding = ""
    for part in phrase.parts:
        if isinstance(part, Part) and part.kind == "TIME" and isinstance(part.value, Quantity):
            time = part.value
            if not time.single and preceding not in ("FOR", "OF", "WITHIN"):
                times |= {"at": time.low, "until": time.high}
            elif name := TIMES.get(preceding):
                times[name] = time.low
            else:
                bare.append(part)
        preceding = part.kind if isinstance(part, Part) else ""
    if bare and "at" not in times:
        times["at"] = _seconds(bare.pop(0))
    if bare and "lasting" not in times:
        times["lasting"] = _seconds(bare.pop(0))
    for part in bare:
        part.disown()
    if "until" in times:
        times.setdefault("at", 0.0)
        times["lasting"] = times["until"] - times["at"]
    return EventTiming(times.get("at"), times.get("lasting"), times.get("within"))
