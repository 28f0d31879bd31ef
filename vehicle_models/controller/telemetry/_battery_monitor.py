"""The battery as the autopilot measures it, or as its simulation makes it up."""

from __future__ import annotations

from ..policies._safety import SafetyPolicy
from ..state._service_context import ServiceContext

# Four cells of 3.7 V.
_NOMINAL_V = 14.8


class BatteryMonitor:
    """Voltage and charge that failsafes and telemetry go by.

    PX4's simulation can make up a battery that empties by the clock alone, whatever the rotors draw: it
    drains while armed, never below its least charge, and is full again when disarmed. The vehicle's own
    battery empties behind it and stops the rotors.
    """

    def __init__(self, context: ServiceContext, policy: SafetyPolicy) -> None:
        self._flight = context.flight
        self._parameters = context.parameters
        self._policy = policy
        self._discharge = policy.simulated_discharge(context.parameters)
        self._fraction = 1.0
        context.parameters.on_change(self._parameters_changed)

    def tick(self) -> None:
        flight, discharge = self._flight, self._discharge
        # Without a simulated battery the autopilot measures the vehicle's own.
        if discharge is None:
            flight.simulated_fraction = None
            self._fraction = 1.0
            return
        fraction = self._fraction - flight.step_s / discharge.empties_s if flight.armed else 1.0
        self._fraction = flight.simulated_fraction = max(fraction, discharge.min_fraction)

    def volts(self) -> float:
        return self._policy.battery_volts(self._flight, self._parameters)

    def millivolts(self) -> int:
        return max(round(self.volts() * 1000.0), 0)

    def used_mah(self) -> float:
        return self._flight.battery_used_wh / _NOMINAL_V * 1000.0

    def _parameters_changed(self) -> None:
        self._discharge = self._policy.simulated_discharge(self._parameters)
