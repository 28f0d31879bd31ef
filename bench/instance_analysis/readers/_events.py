"""Reads what happens during the flight: failures, outages, orders, answers to requests, and intelligence."""

from __future__ import annotations

from collections.abc import Collection

from bench.simspec import DEFAULT_VEHICLE, FAILURES, OUTAGES, Role

from .._draft import Draft, FieldPath
from ..language._grammar import Part
from ..language._phrases import NounPhrase
from ..language._tokens import Span
from ._not_read import NotReadError
from ._places import PlaceReader
from ._scene import Scene

DURATION_CHOICES_S = (10.0, 30.0, 60.0)
"""Readings that are offered for `for how long?`. Chosen, not measured."""
REPORTED = {
    "priority": "priority",
    "age": "latency_s",
    "accuracy": "uncertainty_m",
    "delivered": "delivered_s",
}
"""Fields of a report, by the slots that give them."""
DRIFT_MPS = 0.5


class EventReader:
    """Reads events and reports into a draft, in the order of the text."""

    def __init__(self, draft: Draft, scene: Scene, places: PlaceReader, uncertainty_m: float) -> None:
        self._draft, self._scene, self._places, self._uncertainty_m = draft, scene, places, uncertainty_m
        self._numbers: dict[str, int] = {}
        self._silent = False

    def _next(self, part: str) -> int:
        self._numbers[part] = self._numbers.get(part, -1) + 1
        return self._numbers[part]

    def event(self, part: Part) -> None:
        """Read a failure of the vehicle, or an outage around it."""
        kind = part.form.kind
        is_outage = kind in OUTAGES
        where = "outages" if is_outage else "failures"
        base: FieldPath = (where, self._next(where)) if is_outage else ("vehicle", where, self._next(where))
        duration_s = self._duration_s(part, needed=is_outage)
        self._draft.put((*base, "at_s"), part.first("at"), part.span)
        self._draft.put((*base, "kind"), kind, part.span)
        takes = (FAILURES | OUTAGES)[kind].takes
        if duration_s is not None and "duration_s" in takes:
            self._draft.put((*base, "duration_s"), duration_s, part.span)
        self._values(base, part, takes)

    def _duration_s(self, part: Part, *, needed: bool) -> float | None:
        """How long an event lasts; asked where it must be told and is not."""
        lasting, until_s = part.first("lasting"), part.first("until")
        if lasting is None and until_s is None:
            if not needed:
                return None
            readings = [f"{choice:g} s" for choice in DURATION_CHOICES_S]
            return DURATION_CHOICES_S[self._draft.ask(part.span, "for how long?", readings)]
        duration_s = float(lasting.low if lasting is not None else until_s - part.first("at"))
        if duration_s <= 0:
            raise NotReadError("it ends before it begins")
        return duration_s

    def _values(self, base: FieldPath, part: Part, takes: Collection[str]) -> None:
        """Set the numbers that an event has beside its times."""
        share, speed = part.first("share"), part.first("speed")
        if share is not None:
            name = "to_fraction" if "to_fraction" in takes else "lost_share"
            self._draft.put((*base, name), share.low, part.span)
        if part.first("number") is not None:
            self._draft.put((*base, "instance"), int(part.first("number")), part.span)
        if "drift_mps" in takes:
            if speed is None:
                self._draft.ask(part.span, "how fast does it drift?", [f"{DRIFT_MPS:g} m/s"])
            self._draft.put((*base, "drift_mps"), speed.low if speed is not None else DRIFT_MPS, part.span)
        if part.first("direction") is not None:
            self._draft.put((*base, "towards_deg"), part.first("direction"), part.span)

    def order(self, part: Part) -> None:
        """Read an order of the operator."""
        kind = part.form.kind
        if kind == "resume" and self._silent:
            kind = "resume_reporting"
        self._silent = kind == "stop_reporting" or (self._silent and kind not in ("resume_reporting",))
        report = (
            self._on(self._scene.single_group(part.first("group")), part.span)
            if part.first("group")
            else None
        )
        # Orders have ids, because an agent answers them by id; failures and outages are plain lists.
        key = f"{kind.replace('_', '-')}-{self._next('orders') + 1}"
        base: FieldPath = ("orders", key)
        self._draft.put((*base, "id"), key, part.span)
        self._draft.put((*base, "at_s"), part.first("at"), part.span)
        self._draft.put((*base, "kind"), kind, part.span)
        if (within := part.first("within")) is not None:
            self._draft.put((*base, "within_s"), within.low, part.span)
        if report is not None:
            self._draft.put((*base, "intelligence"), report, part.span)

    def consent(self, part: Part) -> None:
        """Read how the operator answers requests about one report."""
        group = self._target(part.first("group"))
        base: FieldPath = ("consents", self._next("consents"))
        self._draft.put((*base, "answer"), part.form.kind, part.span)
        if (after := part.first("after")) is not None:
            self._draft.put((*base, "after_s"), after.low, part.span)
        self._draft.put((*base, "intelligence"), self._on(group, part.span), part.span)

    def _target(self, phrase: NounPhrase | None) -> str:
        if phrase is not None:
            return self._scene.single_group(phrase)
        targets = self._scene.targets()
        if len(targets) != 1:
            raise NotReadError("it is about a report on a group, and the text does not say which")
        return targets[0]

    def _check_motors(self) -> None:
        """Leave out the failure of a motor that the vehicle does not have."""
        model = self._draft.entries.get(("vehicle", "model"))
        # The vehicle itself refuses others, but only in flight.
        motors = self._scene.vocabulary.motors.get(DEFAULT_VEHICLE if model is None else str(model.value))
        if motors is None:
            return
        for path, entry in self._draft.entries.items():
            named = path[:2] == ("vehicle", "failures") and path[-1] == "instance"
            if named and entry.span is not None and not 1 <= entry.value <= motors:
                self._draft.fault(entry.span, f"the vehicle has no motor {entry.value}", f"it has {motors}")

    # Intelligence.

    def _place_reports(self) -> None:
        """Keep whoever was last seen at a place within the accuracy of the report on it."""
        places = {
            path[1]: entry
            for path, entry in self._draft.entries.items()
            if path[0] == "intelligence" and path[2] == "at"
        }
        for report, entry in places.items():
            point, span = entry.value, entry.span
            group = self._draft.entries["intelligence", report, "about"].value
            accuracy = self._draft.entries.get(("intelligence", report, "uncertainty_m"))
            if accuracy is None:
                self._draft.reading = span
                note = "the default accuracy of a report"
                self._draft.put(("intelligence", report, "uncertainty_m"), self._uncertainty_m, None, note)
            place: FieldPath = ("actors", group, "placement")
            if (*place, "at", "east_m") not in self._draft.entries:
                rows = {entry[4] for entry in self._draft.entries if entry[:4] == (*place, "distances")}
                base: FieldPath = (*place, "distances", len(rows))
                self._draft.put((*base, "point"), point, span)
                most = self._uncertainty_m if accuracy is None else accuracy.value
                self._draft.put((*base, "max_m"), most, span, "where it was last seen")

    def intelligence(self, part: Part) -> None:
        """Read a report on a group: how old, how accurate, when it comes in."""
        group = self._scene.single_group(part.first("group"))
        if self._scene.role(group) is Role.CLUTTER:
            raise NotReadError("intelligence is about adversaries, the sought or bystanders")
        stated = [(name, slot) for slot, name in REPORTED.items() if part.first(slot) is not None]
        report = self._on(group, part.span)
        if any(("intelligence", report, name) in self._draft.entries for name, _ in stated):
            report = self._new_report(group, part.span)
        for name, slot in stated:
            value = part.first(slot)
            low, high = (value, value) if isinstance(value, int | float) else (value.low, value.high)
            unit = None if name == "priority" else name.rpartition("_")[2]
            path: FieldPath = ("intelligence", report, name)
            self._draft.vary(path, low, high, part.span, unit=unit, integer=name == "priority")
        if (place := part.first("place")) is not None:
            self._draft.put(("intelligence", report, "at"), self._places.point(place), part.span)
        if "known" in part.words:
            self._draft.put(("intelligence", report, "delivered_s"), 0.0, part.span)

    def _reports(self, group: str) -> list[str]:
        return [
            str(path[1])
            for path, entry in self._draft.entries.items()
            if path[0] == "intelligence" and path[-1] == "about" and entry.value == group
        ]

    def _on(self, group: str, span: Span) -> str:
        """Id of the last report on a group; creates the report when there is none."""
        return next(reversed(self._reports(group)), "") or self._new_report(group, span)

    def _new_report(self, group: str, span: Span | None) -> str:
        number = len(self._reports(group))
        report = f"{group}-sighting" + (f"-{number + 1}" if number else "")
        self._draft.put(("intelligence", report, "id"), report, span)
        self._draft.put(("intelligence", report, "about"), group, span)
        return report

    def finish(self) -> None:
        """Give a text without any report one on each target, and let whoever is asked be obeyed."""
        self._check_motors()
        self._place_reports()
        rule: FieldPath = ("rules", "mark_consent")
        if "consents" in self._numbers and rule not in self._draft.entries:
            self._draft.put(rule, True, None, "the text tells how requests are answered")
        if any(path[0] == "intelligence" for path in self._draft.entries):
            return
        for group in self._scene.targets():
            named = self._draft.entries["actors", group, "id"].span
            assert named is not None
            sentence = f"Intelligence on the {group}, 2 minutes old, accurate to 60 m."
            note = f"no sentence tells of intelligence, such as `{sentence}`"
            self._draft.reading = named
            report = self._new_report(group, None)
            path: FieldPath = ("intelligence", report, "uncertainty_m")
            self._draft.put(path, self._uncertainty_m, None, note)
