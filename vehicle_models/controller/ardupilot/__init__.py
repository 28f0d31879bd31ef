"""ArduCopter's way, as observed on its SITL, as far as it is filled in (docs/flight-controller.md)."""

from __future__ import annotations

from ._personality import ArduPilot as ArduPilot
