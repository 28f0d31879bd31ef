"""The battery that an autopilot's own simulation has, as PX4's and ArduCopter's were observed."""

from __future__ import annotations

from collections.abc import Mapping

from ._pilot import State

# Of ArduCopter: it warns of a battery below this voltage after this time.
LOW_V, LOW_S = 10.5, 10.0


class Px4Battery:
    """Empties by the clock while armed, whatever the rotors draw, down to its least charge; full when disarmed."""

    def __init__(self, parameters: Mapping[str, float]) -> None:
        self._empties_s = parameters.get("SIM_BAT_DRAIN", 60.0)
        self._least = parameters.get("SIM_BAT_MIN_PCT", 50.0)
        self._percent = 100.0

    def advance(self, span_s: float, armed: bool) -> None:
        percent = self._percent - 100.0 * span_s / self._empties_s if armed else 100.0
        self._percent = max(percent, self._least)

    def set_parameter(self, name: str, value: float) -> None:
        if name == "SIM_BAT_MIN_PCT":
            self._least = value

    def reset(self, percent: float) -> bool:
        return False

    def remaining(self) -> int:
        return round(self._percent)


class ArduPilotBattery:
    """Counts coulombs of what the physics tells, where BATT_MONITOR is 4; without a monitor there is no charge at all."""

    def __init__(self, parameters: Mapping[str, float], state: State) -> None:
        self._state = state
        self._capacity_mah = parameters.get("BATT_CAPACITY", 3300.0)
        self._is_watched = parameters.get("BATT_MONITOR", 0.0) == 4.0
        self._used_mah = 0.0
        self._low_s = 0.0

    def advance(self, span_s: float, armed: bool) -> None:
        self._used_mah += self._state.amperes * span_s / 3.6
        self._low_s = self._low_s + span_s if self._is_watched and self._state.volts < LOW_V else 0.0

    def set_parameter(self, name: str, value: float) -> None:
        """All that it has are set before the start."""

    def reset(self, percent: float) -> bool:
        self._used_mah = self._capacity_mah * (1.0 - 0.01 * percent)
        return self._is_watched

    def remaining(self) -> int:
        return round(100.0 * (1.0 - self._used_mah / self._capacity_mah)) if self._is_watched else -1

    @property
    def fails(self) -> bool:
        return self._low_s > LOW_S
