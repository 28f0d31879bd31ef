"""Receiver and battery of an autopilot that simulates them itself: told what those of the bench are."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.simspec import VehicleSpec

from ._firmware import RunningFirmware
from ._telemetry import Telemetry

# Until it says that a parameter of its simulation is set. Chosen: fifty steps.
_CONFIRMATION_NS = 1_000_000_000


class SimulatedParts:
    """Tells changes on the connection of the estimate, and looks whether they have been taken."""

    def __init__(
        self, running: RunningFirmware, telemetry: Telemetry, vehicle: VehicleSpec, charge: float
    ) -> None:
        self._running, self._telemetry = running, telemetry
        # Parameters of the autopilot's own simulation, as they were set last.
        self._simulated = running.simulated_parameters(gps_off=False, charge=charge)
        self._confirm_by_ns = -1
        # When its charge falls at once. A battery that is not full at the start fell before it.
        self._drops_ns = [
            round(failure.at_s * 1e9) for failure in vehicle.failures if failure.kind == "battery_drop"
        ]
        if vehicle.battery.initial_fraction < 1.0:
            self._drops_ns.append(0)
        # What of them it has to confirm: parameters, and commands.
        self._told: dict[str, float] = {}
        self._commanded: set[int] = set()

    def tell(self, now_ns: int, *, gps_off: bool, charge: float) -> Sequence[str]:
        """Tell what has changed; returns what was not confirmed in time, where nobody but the bench may be why."""
        wanted = self._running.simulated_parameters(gps_off=gps_off, charge=charge)
        changed = {name: value for name, value in wanted.items() if self._simulated[name] != value}
        frames = [self._telemetry.parameter(name, value) for name, value in changed.items()]
        if dropped := [at_ns for at_ns in self._drops_ns if at_ns <= now_ns]:
            self._drops_ns = [at_ns for at_ns in self._drops_ns if at_ns not in dropped]
            if command := self._running.drop_command(charge):
                self._telemetry.results.pop(command[0], None)
                self._commanded.add(command[0])
                frames.append(self._telemetry.command(*command))
        if frames:
            self._running.estimate_port.send(frames)
            self._simulated |= changed
            self._told |= changed
            self._confirm_by_ns = now_ns + _CONFIRMATION_NS
        elif now_ns == self._confirm_by_ns:
            return self._unconfirmed()
        return ()

    def _unconfirmed(self) -> Sequence[str]:
        """Where it shares its connection with clients, they may be why: it is told again then."""
        telemetry, port = self._telemetry, self._running.estimate_port
        silent = {
            name: value
            for name, value in self._told.items()
            if abs(telemetry.parameters.get(name, math.inf) - value) > 1e-3
        }
        refused = [f"command {number}" for number in self._commanded if telemetry.results.get(number) != 0]
        if (silent or refused) and port in self._running.ports.values():
            port.send([telemetry.parameter(name, value) for name, value in silent.items()])
            self._confirm_by_ns += _CONFIRMATION_NS
            return ()
        return [*silent, *refused]
