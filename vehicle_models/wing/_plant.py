"""The fixed wing in JSBSim, and the numbers of wing.xml that its control and its battery use as well."""

from __future__ import annotations

import math

from bench.contracts import Vector

from .._jsbsim import JsbsimPlant, StartPose

MASS_KG, AREA_M2 = 2.5, 0.45
LIFT_0, LIFT_PER_RAD = 0.2, 4.8
DRAG_0, DRAG_PER_LIFT2 = 0.035, 0.052
_FEET_M = 0.0785
_G = 9.80665
_SURFACE_RAD = 0.4
_DISK_M2 = math.pi * 0.127**2
_AIR_KGPM3 = 1.225
# Of propeller, motor and controller together.
_EFFICIENCY = 0.6
_ELECTRONICS_W = 6.0
_SURFACES = ("aileron", "elevator", "rudder")


def most_thrust_n(airspeed_mps: float) -> float:
    """Thrust at full throttle, as in wing.xml."""
    return max(16.0 - 0.4 * airspeed_mps, 0.1)


class WingPlant(JsbsimPlant):
    """One fixed wing lying on its belly at `place`."""

    def __init__(self, place: StartPose, step_s: float, physics_hz: int = 200) -> None:
        super().__init__("wing", place, _FEET_M, step_s, physics_hz)
        self._held = self.node("forces/hold-down").set_double_value
        self._works = self.node("motor/works").set_double_value
        self.hold(True)
        self._power = self.node("motor/power").get_double_value
        self._surfaces = [self.node(f"surface/{name}-rad").get_double_value for name in _SURFACES]

    def hold(self, held: bool) -> None:
        """On the rail of the catapult, or fastened where it came to rest: no wind moves it."""
        self._held(float(held))
        self._is_held = held

    def set_works(self, rotor: int, works: bool) -> None:
        self._works(float(works))

    def specific_force_mps2(self) -> Vector:
        """What an accelerometer feels, body FRD; JSBSim has no forces while the aircraft is held."""
        if not self._is_held:
            return super().specific_force_mps2()
        roll, pitch = self.motion.roll_rad, self.motion.pitch_rad
        level = -_G * math.cos(pitch)
        return _G * math.sin(pitch), level * math.sin(roll), level * math.cos(roll)

    def outputs(self) -> list[float]:
        """Aileron, elevator and rudder, 0.5 neutral; throttle; all 0 to 1."""
        return [*(0.5 + 0.5 * get() / _SURFACE_RAD for get in self._surfaces), self._power()]

    def electric_w(self) -> float:
        """What the battery gives.

        Motor by momentum theory in axial flight: P = T (V + v), v = T / (2 rho A (V + v)).
        """
        speed = self.motion.airspeed_mps
        thrust = self._power() * most_thrust_n(speed)
        # The positive root of v (V + v) = T / (2 rho A).
        inflow = math.sqrt(0.25 * speed * speed + thrust / (2.0 * _AIR_KGPM3 * _DISK_M2)) - 0.5 * speed
        return thrust * (speed + inflow) / _EFFICIENCY + _ELECTRONICS_W
