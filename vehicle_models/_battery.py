"""A battery that empties by the power drawn.

Power of a rotor by momentum theory (Leishman, Principles of Helicopter Aerodynamics, 2.2): P = T^1.5 / sqrt(2
rho A), divided by what rotor, motor and controller make of it together, plus the electronics. For the X500
(10 inch propellers, 2.06 kg, sea level) hovering takes 178 W. Translational lift and descent are left out:
forward flight is charged as hover at the same thrust, which overstates it by some ten per cent at 10 m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.simspec import Battery as BatterySpec

_DISK_M2 = math.pi * 0.127**2
_AIR_KGPM3 = 1.225
_EFFICIENCY = 0.75
_ELECTRONICS_W = 6.0
_PER_THRUST15 = 1.0 / math.sqrt(2.0 * _AIR_KGPM3 * _DISK_M2) / _EFFICIENCY
_CELLS = 4
# Of one cell at rest; linear in between, which holds from 100 % to 5 % of charge.
_FULL_V, _EMPTY_V = 4.15, 3.45
FULL_V = _CELLS * _FULL_V
"""Of the whole battery, full and at rest."""
_RESISTANCE_OHM = 0.02


class BatteryModel:
    """State of charge of one battery; `fraction` 1 is full, 0 is dead."""

    def __init__(self, spec: BatterySpec) -> None:
        self._capacity_j = spec.capacity_wh * 3600.0
        self._remaining_j = self._capacity_j * spec.initial_fraction
        self.power_w = 0.0

    def drain(self, thrust_n: Sequence[float], span_s: float) -> None:
        """Take the energy that rotors and electronics use in `span_s`."""
        power = _ELECTRONICS_W
        # T^1.5 as T times its root: a power with a fraction is slower.
        for rotor_thrust_n in thrust_n:
            power += _PER_THRUST15 * rotor_thrust_n * math.sqrt(rotor_thrust_n)
        self.spend(power, span_s)

    def spend(self, power_w: float, span_s: float) -> None:
        """Take `power_w` for `span_s`."""
        self.power_w = power_w
        self._remaining_j = max(0.0, self._remaining_j - power_w * span_s)

    def drop_to(self, fraction: float) -> None:
        """Lose charge at once, as when a cell fails; the charge never rises."""
        self._remaining_j = min(self._remaining_j, fraction * self._capacity_j)

    @property
    def fraction(self) -> float:
        return self._remaining_j / self._capacity_j

    @property
    def used_wh(self) -> float:
        return (self._capacity_j - self._remaining_j) / 3600.0

    def terminals(self) -> tuple[float, float]:
        """Volts and amperes under the present load."""
        rest_v = _CELLS * (_EMPTY_V + (_FULL_V - _EMPTY_V) * (self._remaining_j / self._capacity_j))
        volts = rest_v - _RESISTANCE_OHM * self.power_w / rest_v
        return volts, self.power_w / volts
