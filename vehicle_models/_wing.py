"""The fixed wing as a vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from bench.contracts import MavlinkTap, VehiclePlan

from ._aircraft import Aircraft, Plant, SteeredAirframe
from ._battery import BatteryModel
from ._jsbsim import StartPose
from .controller import WING_AUTOPILOTS, WingManoeuvres, open_links
from .wing import WingAirframe, WingPlant

_NEAR_GROUND_M, _TOUCH_M = 0.5, 0.05
_CRASH_SINK_MPS = 2.5
# A faster touchdown breaks the wing, however flat; chosen, not measured.
_CRASH_MPS = 18.0
_CRASH_TILT_RAD = math.radians(50.0)


@contextmanager
def open_wing(plan: VehiclePlan, tap: MavlinkTap | None = None) -> Iterator[Wing]:
    """Yield a fixed wing on its belly at home, its links open. Raises SetupError as `open_x500` does."""
    with open_links(plan.links) as links:
        yield Wing(plan, links, tap)


class Wing(Aircraft):
    """The fixed wing."""

    autopilots = WING_AUTOPILOTS
    manoeuvres = WingManoeuvres()
    hover_thrust = 0.27
    rotors = 1

    def _build(self, place: StartPose) -> tuple[Plant, SteeredAirframe]:
        self._wing = WingPlant(place, self.step_s)
        self._sinking_mps = 0.0
        return self._wing, WingAirframe(self._wing, self._frame, self.step_s)

    def _drain(self, battery: BatteryModel) -> None:
        battery.spend(self._wing.electric_w(), self.step_s)

    def _crashed(self, speed_before_mps: float) -> bool:
        """A hit at over 2.5 m/s of sink or 18 m/s of speed, or lying on a side or nose near the ground."""
        motion, sinking = self._wing.motion, self._sinking_mps
        self._sinking_mps = motion.vd_mps
        if motion.up_m > _NEAR_GROUND_M:
            return False
        if max(abs(motion.roll_rad), abs(motion.pitch_rad)) > _CRASH_TILT_RAD:
            return True
        return motion.up_m < _TOUCH_M and (
            sinking > _CRASH_SINK_MPS or (sinking > 0.3 and speed_before_mps > _CRASH_MPS)
        )
