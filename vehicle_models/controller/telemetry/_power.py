"""Messages about the battery and the outputs that drain it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..links._frames import hundredths
from ..policies._telemetry import TelemetryPolicy
from ..state._service import Stream, Values
from ..state._service_context import ServiceContext
from ._battery_monitor import BatteryMonitor

# Chosen, not measured.
_MAX_ROTOR_RPM = 8000.0
_ESC_RPM = 6000.0
_NO_CELL = 65535
_UNKNOWN_TEMPERATURE = 32767
_ESC_TEMPERATURE_C = 25
_NOMINAL_V = 14.8


@dataclass(eq=False)
class PowerTelemetry:
    """Values in wire order."""

    _context: ServiceContext
    _policy: TelemetryPolicy
    _battery: BatteryMonitor
    _charge_state: Callable[[], int]

    def __post_init__(self) -> None:
        self._flight = self._context.flight

    def streams(self) -> Mapping[str, Stream]:
        return {
            "SERVO_OUTPUT_RAW": self._servo_outputs,
            "BATTERY_STATUS": self._battery_status,
            "POWER_STATUS": lambda: (5000, 0, 0),
            "ESC_TELEMETRY_1_TO_4": self._motors,
            "ESC_INFO": self._esc_info,
            "ESC_STATUS": self._esc_status,
        }

    def _servo_outputs(self) -> Values:
        outputs_us = [1000 + round(1000.0 * output) for output in self._context.airframe.outputs()]
        return (self._flight.time_us & 0xFFFFFFFF, *outputs_us, 0, 0, 0, 0, 0, *(0,) * 8)

    def _battery_status(self) -> Values:
        f = self._flight
        cells_mv = (self._battery.millivolts(), *(_NO_CELL,) * 9)
        used_mah, percent = round(self._battery.used_mah()), round(100.0 * f.battery_fraction)
        head = (used_mah, -1, _UNKNOWN_TEMPERATURE, *cells_mv, hundredths(f.battery_a), 0, 0)
        return (*head, self._policy.battery_type, percent, 0, self._charge_state(), 0, 0, 0, 0, 0, 0)

    # What PX4's simulator link makes up of four speed controllers, in its source.

    def _esc_info(self) -> Values:
        temperatures_c = [round(2000.0 + 4000.0 * output) for output in self._first_outputs()]
        return (self._flight.time_us, *(0,) * 4, 0, *(0,) * 4, *temperatures_c, 0, 4, 0, 0b1111)

    def _esc_status(self) -> Values:
        outputs, armed = self._first_outputs(), self._flight.armed
        amperes = [1.0 + 15.0 * output if armed else 0.0 for output in outputs]
        rpm = [round(_ESC_RPM * output) for output in outputs]
        return (self._flight.time_us, *rpm, *(self._battery.volts(),) * 4, *amperes, 0)

    def _first_outputs(self) -> list[float]:
        return [max(output, 0.0) for output in [*self._context.airframe.outputs(), 0.0, 0.0, 0.0, 0.0][:4]]

    def _motors(self) -> Values:
        """Four motors at their share of full speed, with the current in equal parts."""
        f = self._flight
        outputs = [*self._context.airframe.outputs(), 0.0, 0.0, 0.0, 0.0][:4]
        turning = sum(output > 0.0 for output in outputs) or 1
        amperes = [f.battery_a / turning if output > 0.0 else 0.0 for output in outputs]
        # Each motor has used a quarter.
        used_mah = round(f.battery_used_wh / _NOMINAL_V * 250.0) & 0xFFFF
        count = f.time_ms // 20 & 0xFFFF
        volts_c = (min(max(round(self._battery.volts() * 100.0), 0), 65535),) * 4
        amperes_c = [min(max(round(current * 100.0), 0), 65535) for current in amperes]
        rpm = [round(max(output, 0.0) * _MAX_ROTOR_RPM) for output in outputs]
        return (*volts_c, *amperes_c, *(used_mah,) * 4, *rpm, *(count,) * 4, *(_ESC_TEMPERATURE_C,) * 4)
