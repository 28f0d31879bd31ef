"""The X500 in JSBSim: from setpoints to motion, with the control cascade in the aircraft's XML file."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .._jsbsim import JsbsimPlant, StartPose, VehicleMotion

_FT = 0.3048
# Execrate of the outer channel in x500.xml.
_OUTER_EVERY = 4
# Height of the centre of gravity when the feet carry the weight.
_FEET_M = 0.1507
_MAX_THRUST_N = 8.5486
FULL_THRUST_N = 4.0 * _MAX_THRUST_N
# Share of full thrust that carries the vehicle.
HOVER_THRUST = 2.0643 * 9.81 / FULL_THRUST_N
# Of each rotor from the hub along each axis, and its torque for each newton of thrust; as in x500.xml.
ROTOR_ARM_M, ROTOR_TORQUE_M = 0.174, 0.016
# PX4's order, motors 1 to 4.
ROTORS = ("front-right", "rear-left", "front-left", "rear-right")

_FROM_START = ("position/from-start-neu-n-ft", "position/from-start-neu-e-ft")
_WANTED = ("target-roll-rad", "target-pitch-rad", "target-yaw-rad", "thrust-n")
_CRASH_MPS = 3.0
_CRASH_TILT_RAD = math.radians(70.0)
_NEAR_GROUND_M = 0.5
_TOUCH_M = 0.02


class X500Plant(JsbsimPlant):
    """One quadrotor standing at `place`, advanced by `step_s` at a time in steps of 1 / `physics_hz`.

    `shift_ne_m` is what the cascade measures from the start of the flight, less metres in the plane of the
    origin; `outer_s` is the period of the cascade's outer channel. Without `cascade` somebody else turns the rotors. Raises
    SetupError when the step is not a whole number of physics steps.
    """

    def __init__(
        self, place: StartPose, step_s: float, physics_hz: int = 200, *, cascade: bool = True
    ) -> None:
        super().__init__("x500", place, _FEET_M, step_s, physics_hz)
        self._start_north, self._start_east = (self.node(name).get_double_value for name in _FROM_START)
        self._motors = [self.node(f"motor/{name}").get_double_value for name in ROTORS]
        self._wanted = [self.node(f"ap/{name}").get_double_value for name in _WANTED]
        super().write("ground-m", self._ground_m)
        self.outer_s = _OUTER_EVERY / physics_hz
        super().write("outer-dt-s", self.outer_s)
        self._written: dict[str, float] = {}
        self._cascade = cascade
        self.node("ap/cascade").set_double_value(float(cascade))
        self._rotors = [self.node(f"ap/rotor-{name}").set_double_value for name in ROTORS]
        self.shift_ne_m = self._shift()

    def write(self, name: str, value: float) -> None:
        """As of any aircraft; only changes cost anything."""
        if self._written.get(name) != value:
            self._written[name] = value
            super().write(name, value)

    def thrust_n(self) -> list[float]:
        """Thrust of each rotor, in PX4's order."""
        return [_MAX_THRUST_N * get() ** 2 for get in self._motors]

    def rotor_commands(self) -> list[float]:
        """Speed of each rotor as a share of its greatest, 0 to 1."""
        return [get() for get in self._motors]

    def turn_rotors(self, speeds: Sequence[float]) -> None:
        """Command the speed of each rotor as a share of its greatest, where no cascade does."""
        for put, speed in zip(self._rotors, speeds, strict=True):
            put(0.0 if speed < 0.0 else 1.0 if speed > 1.0 else speed)

    def set_works(self, rotor: int, works: bool) -> None:
        self.write(f"works-{ROTORS[rotor]}", 1.0 if works else 0.0)

    def commanded_attitude(self) -> tuple[float, float, float, float]:
        """Roll, pitch and yaw that the cascade steers to, radians; the share of full thrust."""
        roll, pitch, yaw, thrust_n = (get() for get in self._wanted)
        return roll, pitch, yaw, thrust_n / FULL_THRUST_N

    def advance(self) -> None:
        super().advance()
        if self._cascade:
            self.shift_ne_m = self._shift()

    def _shift(self) -> tuple[float, float]:
        return self._start_north() * _FT - self.motion.north_m, self._start_east() * _FT - self.motion.east_m


def has_crashed(motion: VehicleMotion, speed_before_mps: float) -> bool:
    """Whether it hits the ground at over 3 m/s (`speed_before_mps`: a step before), or lies on its side."""
    if motion.up_m > _NEAR_GROUND_M:
        return False
    # The angle between the body's down axis and the vertical, from roll and pitch.
    tilt = math.acos(min(max(math.cos(motion.roll_rad) * math.cos(motion.pitch_rad), -1.0), 1.0))
    return tilt > _CRASH_TILT_RAD or (motion.up_m < _TOUCH_M and speed_before_mps > _CRASH_MPS)
