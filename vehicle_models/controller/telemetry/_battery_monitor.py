"""The battery as the autopilot measures it, or as its simulation makes it up."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..links._enums import MAV_CMD
from ..policies._safety import SafetyPolicy
from ..state._service import Command, CommandHandler, CommandResult
from ..state._service_context import ServiceContext

# Four cells of 3.7 V.
_NOMINAL_V = 14.8
# In the mask of MAV_CMD_BATTERY_RESET.
_FIRST_BATTERY = 1


class BatteryMonitor:
    """Voltage and charge that failsafes and telemetry go by.

    PX4's simulation can make up a battery that empties by the clock alone, whatever the rotors draw: it
    drains while armed, never below its least charge, and is full again when disarmed. The vehicle's own
    battery empties behind it and stops the rotors. ArduPilot counts what is drawn, from wherever a client
    says that it begins.
    """

    def __init__(self, context: ServiceContext, policy: SafetyPolicy) -> None:
        self._flight = context.flight
        self._parameters = context.parameters
        self._policy = policy
        self._discharge = policy.simulated_discharge(context.parameters)
        self._fraction = 1.0
        # What the count is above the charge.
        self._miscount: float | None = None
        context.parameters.on_change(self._parameters_changed)

    def tick(self) -> None:
        flight, discharge = self._flight, self._discharge
        # Without a simulated battery the autopilot measures the vehicle's own.
        if discharge is None:
            counted = None if self._miscount is None else flight.charge_fraction + self._miscount
            flight.simulated_fraction = None if counted is None else min(max(counted, 0.0), 1.0)
            self._fraction = 1.0
            return
        fraction = self._fraction - flight.step_s / discharge.empties_s if flight.armed else 1.0
        self._fraction = flight.simulated_fraction = max(fraction, discharge.min_fraction)

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.BATTERY_RESET: self._reset} if self._policy.counts_charge else {}

    def volts(self) -> float:
        return self._policy.battery_volts(self._flight, self._parameters)

    def millivolts(self) -> int:
        return max(round(self.volts() * 1000.0), 0)

    def used_mah(self) -> float:
        return self._flight.battery_used_wh / _NOMINAL_V * 1000.0

    def _reset(self, command: Command) -> CommandResult:
        """Batteries that are not there are passed over, and no number counts as half, as in the source of ArduPilot."""
        mask, percent = command.params[:2]
        if math.isfinite(mask) and int(mask) & _FIRST_BATTERY:
            percent = 50.0 if math.isnan(percent) else min(max(percent, 0.0), 100.0)
            self._miscount = percent * 0.01 - self._flight.charge_fraction
        return CommandResult.ACCEPTED

    def _parameters_changed(self) -> None:
        self._discharge = self._policy.simulated_discharge(self._parameters)
