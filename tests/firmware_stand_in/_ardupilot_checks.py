"""What the answers of ArduPilot's JSON physics must keep."""

from __future__ import annotations

import json
import math

from ._frames import require
from ._pilot import G, State, Vector


class AnswerChecks:
    """What the answers of the JSON physics must keep."""

    def __init__(
        self, state: State, rate_hz: int, home: tuple[float, float, float], heading_rad: float
    ) -> None:
        self.state, self.rate_hz, self.home, self.heading_rad = state, rate_hz, home, heading_rad
        self.answers = 0
        self.felt: Vector = (0.0, 0.0, -G)

    def take(self, answer: bytes) -> None:
        require(
            answer[:1] == b"\n" and answer[-1:] == b"\n" and answer.count(b"\n") == 2,
            f"line feeds of {answer!r}",
        )
        require(b'": ' not in answer and b" " not in answer, "a blank behind a colon")
        document = json.loads(answer)
        fields = {"timestamp", "imu", "position", "quaternion", "velocity", "battery"}
        require(
            set(document) == fields and set(document["imu"]) == {"gyro", "accel_body"},
            f"keys {set(document)}",
        )
        self.answers += 1
        state = self.state
        # ArduPilot looks for its keys as text, so what it reads first must stand first.
        require(set(document["battery"]) == {"voltage", "current"}, f"battery {document['battery']}")
        state.volts, state.amperes = document["battery"]["voltage"], document["battery"]["current"]
        require(8.0 < state.volts <= 12.6, f"{state.volts} V, of three cells")
        require(0.0 <= state.amperes < 150.0, f"{state.amperes} A")
        step_s = document["timestamp"] - state.time_s
        require(abs(step_s - 1 / self.rate_hz) < 1e-8, f"a step of {step_s} s at {self.rate_hz} Hz")
        before, was_at = state.velocity, state.position
        state.time_s = document["timestamp"]
        state.position, state.velocity = tuple(document["position"]), tuple(document["velocity"])
        state.quaternion, state.rates = tuple(document["quaternion"]), tuple(document["imu"]["gyro"])
        require(abs(sum(v * v for v in state.quaternion) - 1) < 1e-6, "quaternion")
        force = tuple(document["imu"]["accel_body"])
        self._check_motion(force, before, was_at, step_s)
        north, east, down = state.position
        state.latitude_deg = self.home[0] + north / 111318.845
        state.longitude_deg = self.home[1] + east / 111318.845 / math.cos(math.radians(self.home[0]))
        state.altitude_m = self.home[2] - down

    def _check_motion(self, force: Vector, before: Vector, was_at: Vector, step_s: float) -> None:
        state = self.state
        if self.answers < 5:
            require(-10.5 < force[2] < -9.1, f"accelerometer z {force[2]} at rest")
            turned = math.remainder(state.euler()[2] - self.heading_rad, 2 * math.pi)
            require(
                abs(turned) < 0.01, f"a heading of {state.euler()[2]} rad, --home says {self.heading_rad}"
            )
        # The receiver's error is in the horizontal position: fixes jump.
        for axis in range(3):
            moved = state.position[axis] - was_at[axis] - state.velocity[axis] * step_s
            require(
                abs(moved) < (3.0 if axis < 2 else 0.01),
                f"axis {axis} moved {moved:.3f} m beside its velocity",
            )
        if -state.position[2] > 0.5:
            # In the air velocity changes by what the accelerometer feels, and gravity.
            felt = state.to_ned(force)
            for axis, gravity in enumerate((0.0, 0.0, G)):
                change = (state.velocity[axis] - before[axis]) / step_s
                # Where a rotor stops at once, the integrator of the physics goes on by half a step more.
                jump = abs(felt[axis] - self.felt[axis])
                require(
                    abs(change - felt[axis] - gravity) < 1.0 + 0.6 * jump,
                    f"axis {axis}: {change:.2f} m/s2, felt {felt[axis]:.2f}",
                )
            self.felt = felt
