"""Whether the charge and the time that are left still allow anything but the way home."""

from __future__ import annotations

import math

from bench.contracts import MissionOrder

from .._settings import Settings
from .._watch import Watch
from ..mission._planner import Planner
from ._paths import Place
from ._piloted_vehicle import PilotedVehicle

# How old the length of the way home may be where it leads round something: routing ten times a second is not
# needed.
# Chosen, not measured.
ROUTE_AGE_S = 1.0

# Of the charge, on top of the reserve that the rules ask for: PX4 states whole percent. Chosen, not measured.
BATTERY_MARGIN = 0.03

# Of flight that the charge has to bear on top of the way home: what the way may take longer than planned. Chosen, not
# measured.
CHARGE_SPARE_S = 15.0

# Of flight before the use of charge is worked out from it: whole percent say little before. Chosen.
LEAST_FLOWN_S = 20.0


class Reserve:
    """What one flight has used so far, and what the way home needs."""

    battery_margin = BATTERY_MARGIN
    charge_spare_s = CHARGE_SPARE_S

    def __init__(
        self, order: MissionOrder, vehicle: PilotedVehicle, watch: Watch, settings: Settings, planner: Planner
    ) -> None:
        self._vehicle = vehicle
        self._watch = watch
        self._planner = planner
        self._reserve_fraction = order.battery_reserve_fraction
        self._min_battery = settings.min_battery
        self._reason: tuple[float, str] = (-math.inf, "")  # when it was last worked out, and what came of it
        self._takeoff: tuple[float, float] | None = None  # moment and charge

    def allows_takeoff(self) -> bool:
        """Whether the charge is enough to fly at all and keep the reserve."""
        return self._vehicle.battery_fraction > self._reserve_fraction + self.battery_margin

    def took_off(self) -> None:
        """From here on charge is used for flying; what was lost at once is not counted."""
        self._takeoff = (self._vehicle.now_s, self._vehicle.battery_fraction + self._watch.charge_lost)

    def homeward(self, place: Place, *, routed: bool) -> str:
        """Why it must go home from a place now; empty when it need not.

        `routed`: ways may lead round something.
        """
        now_s = self._vehicle.now_s
        if not routed or now_s - self._reason[0] >= ROUTE_AGE_S:
            self._reason = (now_s, self._must_go_home(place))
        return self._reason[1]

    def _must_go_home(self, place: Place) -> str:
        charge, needed = self._vehicle.battery_fraction, self._min_battery
        if self._takeoff is not None:
            took_off_s, full = self._takeoff
            used, flown_s = full - charge - self._watch.charge_lost, self._vehicle.now_s - took_off_s
            use_per_s = used / flown_s if flown_s > LEAST_FLOWN_S else 0.0
            home_s = self._planner.home_s(place) + self.charge_spare_s
            needed = max(needed, self._reserve_fraction + use_per_s * home_s + self.battery_margin)
        if charge <= needed:
            return (
                f"the battery is down to {charge:.0%}, {needed:.0%} are needed to come home with the reserve"
            )
        if self._planner.must_turn_back(place, self._vehicle.now_s, self._vehicle.poses.velocity_en_mps):
            return "the time left is needed for the way home"
        return ""
