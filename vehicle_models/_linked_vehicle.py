"""What vehicles share, whoever flies them: clock, links, wind, battery and failures."""

from __future__ import annotations

from collections.abc import Mapping

from bench.contracts import START, MavlinkTap, VehiclePlan
from bench.simspec import generator

from ._battery import BatteryModel
from ._failures import Failures, SetWorks
from ._gusts import Gusts
from ._navigation import Navigation
from .controller import Link


class LinkedVehicle:
    """A vehicle on its opened links."""

    def __init__(self, plan: VehiclePlan, links: list[Link], tap: MavlinkTap | None) -> None:
        simspec = plan.simspec
        self.step_s = 1.0 / plan.controller_hz
        self._step_ns = round(1e9 / plan.controller_hz)
        self.time = START
        self._links, self._tap = links, tap
        self._wind = simspec.environment.wind
        self._gusts = Gusts(self._wind, self.step_s, generator(simspec.seeds, "gusts"))
        self._battery = BatteryModel(simspec.vehicle.battery)

    def endpoints(self) -> Mapping[str, str]:
        return {link.spec.name: link.endpoint for link in self._links}

    def sent(self) -> Mapping[str, int]:
        return {link.spec.name: link.sent for link in self._links}

    def receive(self) -> Mapping[str, int]:
        for link in self._links:
            link.poll()
        return {link.spec.name: link.received for link in self._links}

    def _failures_of(
        self, plan: VehiclePlan, navigation: Navigation, rotors: int, set_works: SetWorks
    ) -> Failures:
        names = [link.spec.name for link in self._links]
        timeline = plan.simspec.vehicle.failures
        return Failures(timeline, navigation, self._battery, rotors, set_works, names, self._silence)

    def _silence(self, name: str, lost: bool) -> None:
        for link in self._links:
            if link.spec.name == name:
                link.silenced = lost
