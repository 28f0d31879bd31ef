"""A crude pilot, who flies by the truth."""

from __future__ import annotations

import math

# The X500 of docs/vehicle.md: thrust of a rotor at full speed, moments of inertia in kg m2, mass.
MAX_THRUST_N, INERTIA, YAW_INERTIA = 8.5486, 0.02167, 0.04
WEIGHT_N = 2.0643 * 9.81
G = 9.80665
Vector = tuple[float, float, float]


class State:
    """Truth: metres north, east, down of the start, m/s, quaternion, rad/s, and geodetic place."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.position: Vector = (0.0, 0.0, 0.0)
        self.velocity: Vector = (0.0, 0.0, 0.0)
        self.quaternion = (1.0, 0.0, 0.0, 0.0)
        self.rates: Vector = (0.0, 0.0, 0.0)
        self.latitude_deg = self.longitude_deg = self.altitude_m = 0.0
        # Of the battery, where the link tells them: ArduPilot's does.
        self.volts = self.amperes = 0.0

    def euler(self) -> Vector:
        w, x, y, z = self.quaternion
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def to_ned(self, body: Vector) -> Vector:
        w, x, y, z = self.quaternion
        a, b, c = body
        return (
            (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
            2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
            2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
        )


class Pilot:
    """Arms, takes off and lands, by proportional control of the truth."""

    def __init__(self, arm_m: float, torque_m: float) -> None:
        self.arm_m, self.torque_m = arm_m, torque_m
        self.armed = self.landing = False
        self.target: Vector | None = None
        self.heading_rad = 0.0

    def rotors(self, state: State) -> list[float]:
        """Rotor speeds 0 to 1: front right, rear left, front left, rear right."""
        north, east, down = state.position
        if not self.armed:
            self.heading_rad = state.euler()[2]
            return [0.0] * 4
        if self.target is None:
            return [0.1] * 4
        if self.landing and -down < 0.03 and abs(state.velocity[2]) < 0.05:
            self.armed, self.landing, self.target = False, False, None
            return [0.0] * 4
        speed_n, speed_e = (
            self._bounded(0.6 * (goal - at), 3.0)
            for goal, at in zip(self.target[:2], (north, east), strict=True)
        )
        sink = 2.0 if down < -3.0 else 0.5
        speed_d = sink if self.landing else self._bounded(1.2 * (self.target[2] - down), 3.0)
        return self.rotors_for(state, (speed_n, speed_e, speed_d))

    def rotors_for(self, state: State, velocity: Vector) -> list[float]:
        """Rotor speeds that lead to a velocity (m/s, north, east, down) at `heading_rad`."""
        push = [
            self._bounded(1.5 * (want - v), 3.0) for want, v in zip(velocity, state.velocity, strict=True)
        ]
        roll, pitch, yaw = state.euler()
        forward = push[0] * math.cos(yaw) + push[1] * math.sin(yaw)
        right = -push[0] * math.sin(yaw) + push[1] * math.cos(yaw)
        turn = math.remainder(self.heading_rad - yaw, 2 * math.pi)
        wanted = (7.0 * (right / G - roll), 7.0 * (-forward / G - pitch), 2.5 * turn)
        p, q, r = (want - rate for want, rate in zip(wanted, state.rates, strict=True))
        force = WEIGHT_N * (1.0 - 2.0 * push[2] / G) / max(0.7, math.cos(roll) * math.cos(pitch))
        a, b = (20 * INERTIA * rate / (4 * self.arm_m) for rate in (p, q))
        c = self._bounded(8 * YAW_INERTIA * r / (4 * self.torque_m), 1.5)
        thrusts = (force / 4 - a + b + c, force / 4 + a - b + c, force / 4 + a + b - c, force / 4 - a - b - c)
        return [math.sqrt(min(max(thrust / MAX_THRUST_N, 0.0), 1.0)) for thrust in thrusts]

    @staticmethod
    def _bounded(value: float, limit: float) -> float:
        return min(max(value, -limit), limit)
