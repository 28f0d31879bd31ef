"""Failures of a vehicle: those of the SimSpec, at exact simulated times, and those injected on command."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import assert_never

from bench.errors import Fault, SetupError
from bench.simspec import Failure

from ._battery import BatteryModel
from ._navigation import Navigation

SetWorks = Callable[[int, bool], None]
"""Lets a rotor (numbered from 0) turn, or stops it."""


@dataclass(frozen=True, slots=True)
class _FailureChange:
    at_ns: int
    order: int
    failure: Failure
    breaks: bool


class Failures:
    """Breaks and repairs parts; `active` names the broken. Until something is due, a step is one comparison."""

    def __init__(
        self,
        timeline: Sequence[Failure],
        navigation: Navigation,
        battery: BatteryModel,
        rotors: int,
        set_works: SetWorks,
        links: Sequence[str],
        silence: Callable[[str, bool], None],
    ) -> None:
        self._navigation = navigation
        self._battery = battery
        self._rotors = rotors
        self._set_works = set_works
        self._links = links
        self._silence = silence
        self.active: tuple[str, ...] = ()
        # By name: what the SimSpec broke, and what a command broke. A command repairs only the latter, or an
        # agent could end the failure that it is to be tested with.
        self._planned: set[str] = set()
        self._commanded: set[str] = set()
        self._check(timeline)
        self._changes = sorted(_failure_changes(timeline), key=lambda change: (change.at_ns, change.order))
        self._next_ns = self._changes[0].at_ns if self._changes else None

    def apply(self, now_ns: int) -> None:
        """Break and repair everything that is due at `now_ns`."""
        while self._next_ns is not None and self._next_ns <= now_ns:
            change = self._changes.pop(0)
            self._apply_failure(change.failure, change.breaks)
            self._next_ns = self._changes[0].at_ns if self._changes else None

    def break_part(self, kind: str, instance: int, breaks: bool) -> bool:
        """Break or repair on command, but for what the SimSpec broke; instance 0 is all. False without any."""
        if kind == "gps_off" and instance in (0, 1):
            self._set_gps(self._commanded, breaks)
        elif kind == "motor_off" and instance <= self._rotors:
            for number in range(1, self._rotors + 1) if instance == 0 else (instance,):
                self._set_motor(self._commanded, number, breaks)
        elif kind == "link_loss" and instance == 0:
            self._set_link_loss(self._commanded, None, breaks)
        else:
            return False
        return True

    def _apply_failure(self, failure: Failure, breaks: bool) -> None:
        match failure.kind:
            case "battery_drop":
                assert failure.to_fraction is not None
                self._battery.drop_to(failure.to_fraction)
                self.active = (*self.active, f"battery_drop {failure.to_fraction:g}")
            case "gps_drift":
                self._set_drift(failure, breaks)
            case "gps_off":
                self._set_gps(self._planned, breaks)
            case "motor_off":
                assert failure.instance is not None
                self._set_motor(self._planned, failure.instance, breaks)
            case "link_loss":
                self._set_link_loss(self._planned, failure.link, breaks)
            case _:
                assert_never(failure.kind)

    def _set_drift(self, failure: Failure, breaks: bool) -> None:
        towards_rad = math.radians(failure.towards_deg or 0.0)
        speed_mps = failure.drift_mps or 0.0
        self._mark_active("gps_drift", breaks)
        self._navigation.set_drift_en_mps(
            (speed_mps * math.sin(towards_rad), speed_mps * math.cos(towards_rad)) if breaks else None
        )

    def _set_gps(self, source: set[str], breaks: bool) -> None:
        self._navigation.set_off(self._switch(source, "gps_off", breaks))

    def _set_motor(self, source: set[str], number: int, breaks: bool) -> None:
        self._set_works(number - 1, not self._switch(source, f"motor_off {number}", breaks))

    def _set_link_loss(self, source: set[str], link: str | None, breaks: bool) -> None:
        for name in self._links if link is None else (link,):
            self._silence(name, self._switch(source, f"link_loss {name}", breaks))

    def _switch(self, source: set[str], name: str, breaks: bool) -> bool:
        """Break or repair for one source; whether the part is broken then."""
        if breaks:
            source.add(name)
        else:
            source.discard(name)
        broken = name in self._planned or name in self._commanded
        if breaks or not broken:
            self._mark_active(name, broken)
        return broken

    def _mark_active(self, name: str, breaks: bool) -> None:
        others = tuple(other for other in self.active if other != name)
        self.active = (*others, name) if breaks else others

    def _check(self, timeline: Sequence[Failure]) -> None:
        faults = []
        for index, failure in enumerate(timeline):
            field = f"vehicle.failures[{index}]"
            if failure.instance is not None and failure.instance > self._rotors:
                what = f"there is no rotor {failure.instance}"
                faults.append(Fault(f"{field}.instance", what, f"there are {self._rotors}"))
            if failure.link is not None and failure.link not in self._links:
                what, names = f"there is no link {failure.link!r}", ", ".join(self._links) or "none"
                faults.append(Fault(f"{field}.link", what, f"there are {names}"))
        if faults:
            raise SetupError(faults)


def _failure_changes(timeline: Sequence[Failure]) -> list[_FailureChange]:
    moments = []
    for order, failure in enumerate(timeline):
        moments.append(_FailureChange(round(failure.at_s * 1e9), order, failure, breaks=True))
        if failure.duration_s is not None:
            end_ns = round((failure.at_s + failure.duration_s) * 1e9)
            moments.append(_FailureChange(end_ns, order, failure, breaks=False))
    return moments
