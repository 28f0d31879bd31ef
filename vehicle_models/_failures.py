"""What breaks on a vehicle, and when: the SimSpec's timeline, at exact simulated times, and what is broken on command."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bench.errors import Fault, SetupError
from bench.simspec import Failure

from ._battery import BatteryModel
from ._navigation import Navigation

SetWorks = Callable[[int, bool], None]
"""Let rotor number (from 0) turn, or not."""


@dataclass(frozen=True, slots=True)
class _Moment:
    at_ns: int
    order: int
    failure: Failure
    breaks: bool


class Failures:
    """Breaks and repairs parts; `active` names what is broken. One comparison a step while nothing is due."""

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
        self._check(timeline)
        self._moments = sorted(_moments(timeline), key=lambda one: (one.at_ns, one.order))
        self._next_ns = self._moments[0].at_ns if self._moments else None

    def apply(self, now_ns: int) -> None:
        """Do everything that is due at `now_ns`."""
        while self._next_ns is not None and self._next_ns <= now_ns:
            moment = self._moments.pop(0)
            self._do(moment.failure, moment.breaks)
            self._next_ns = self._moments[0].at_ns if self._moments else None

    def break_part(self, kind: str, instance: int, breaks: bool) -> bool:
        """On command: instance 0 is all of them. False when there is no such part."""
        if kind == "gps_off" and instance in (0, 1):
            self._set("gps_off", breaks)
            self._navigation.set_off(breaks)
        elif kind == "motor_off" and instance <= self._rotors:
            for number in range(1, self._rotors + 1) if instance == 0 else (instance,):
                self._motor(number, breaks)
        elif kind == "link_loss" and instance == 0:
            self._lose(None, breaks)
        else:
            return False
        return True

    def _do(self, failure: Failure, breaks: bool) -> None:
        if failure.kind == "battery_drop":
            assert failure.to_fraction is not None
            self._battery.drop_to(failure.to_fraction)
            self.active = (*self.active, f"battery_drop {failure.to_fraction:g}")
        elif failure.kind == "gps_drift":
            self._drift(failure, breaks)
        elif failure.kind == "motor_off":
            assert failure.instance is not None
            self._motor(failure.instance, breaks)
        elif failure.kind == "link_loss":
            self._lose(failure.link, breaks)
        else:
            self.break_part("gps_off", 0, breaks)

    def _drift(self, failure: Failure, breaks: bool) -> None:
        towards = math.radians(failure.towards_deg or 0.0)
        speed = failure.drift_mps or 0.0
        self._set("gps_drift", breaks)
        self._navigation.set_drift_en_mps((speed * math.sin(towards), speed * math.cos(towards)) if breaks else None)

    def _motor(self, number: int, breaks: bool) -> None:
        self._set(f"motor_off {number}", breaks)
        self._set_works(number - 1, not breaks)

    def _lose(self, link: str | None, breaks: bool) -> None:
        for name in self._links if link is None else (link,):
            self._set(f"link_loss {name}", breaks)
            self._silence(name, breaks)

    def _set(self, name: str, breaks: bool) -> None:
        rest = tuple(one for one in self.active if one != name)
        self.active = (*rest, name) if breaks else rest

    def _check(self, timeline: Sequence[Failure]) -> None:
        faults = []
        for index, one in enumerate(timeline):
            where = f"vehicle.failures[{index}]"
            if one.instance is not None and one.instance > self._rotors:
                faults.append(Fault(f"{where}.instance", f"there is no rotor {one.instance}", f"there are {self._rotors}"))
            if one.link is not None and one.link not in self._links:
                known = ", ".join(self._links) or "none"
                faults.append(Fault(f"{where}.link", f"there is no link {one.link!r}", f"there are {known}"))
        if faults:
            raise SetupError(faults)


def _moments(timeline: Sequence[Failure]) -> list[_Moment]:
    moments = []
    for order, one in enumerate(timeline):
        moments.append(_Moment(round(one.at_s * 1e9), order, one, breaks=True))
        if one.duration_s is not None:
            moments.append(_Moment(round((one.at_s + one.duration_s) * 1e9), order, one, breaks=False))
    return moments
