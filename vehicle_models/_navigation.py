"""The position that the vehicle estimates: the truth plus the error of its satellite navigation.

Horizontally a second-order Gauss-Markov wander (stationary from the start: the receiver has been on for a
while) with white noise on every fix; vertically white noise alone, since height is held by the barometer. It
is of second order because the errors of a receiver (ionosphere, multipath) have a rate: a first-order process
is rough, and a vehicle that follows it shakes. The estimate follows the fixes through a first-order filter,
as an estimator would. Velocity and attitude are taken as exact.

Source of the process: Gelb (ed.), "Applied Optimal Estimation" (1974), section 2.2: critically damped, with
correlation exp(-b t) (1 + b t), which falls to 1/e at `wander_time_s` for b = 2.146 / wander_time_s.

Without fixes the vehicle uses dead reckoning by its accelerometers alone: their bias, drawn when the fixes
end (0.03 m/s2 on each horizontal axis, a consumer sensor after calibration), makes the velocity wrong by bias
times time and the position by half the bias times time squared. Height is still the barometer's. When fixes
return, the estimate follows them as before and velocity is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bench.arrays import product
from bench.contracts import Vector
from bench.simspec import Gps

# PX4's simulated receiver gives 8 fixes a second.
FIX_S = 0.125
# Time constant with which the estimate follows the fixes.
_FOLLOW_S = 0.5
_BLOCK = 512
_BIAS_MPS2 = 0.03
# b times the correlation time: the root of exp(-z) (1 + z) = 1/e.
_DECAY = 2.1461932


class Navigation:
    """The position error of a vehicle, ENU metres; `wander_m` and `noise_m` are deviations of each axis."""

    def __init__(self, gps: Gps, step_s: float, random: np.random.Generator) -> None:
        self._gps = gps
        self._random = random
        self._draws: list[list[float]] = []
        self._follow = -math.expm1(-step_s / _FOLLOW_S)
        self._wander = _Wander.of(gps, FIX_S)
        a, b, c, d, *_ = self._draw_normal()
        rate = _DECAY / gps.wander_time_s
        self._east = (gps.wander_m * a, rate * gps.wander_m * b)
        self._north = (gps.wander_m * c, rate * gps.wander_m * d)
        self.fix_error_enu_m: Vector = (self._east[0], self._north[0], 0.0)
        self.error_enu_m: Vector = self.fix_error_enu_m
        self.fixes = 0
        self._since_fix_s = 0.0
        self._step_s = step_s
        self.off = False
        self.velocity_error_en_mps = (0.0, 0.0)
        self._bias_en_mps2 = (0.0, 0.0)
        self._drift_en_mps: tuple[float, float] | None = None
        self._drifted_en_m = (0.0, 0.0)

    def set_off(self, off: bool) -> None:
        """Stop or resume fixes."""
        if off and not self.off:
            first, second, *_ = self._draw_normal()
            self._bias_en_mps2 = (_BIAS_MPS2 * first, _BIAS_MPS2 * second)
        self.off = off
        self.velocity_error_en_mps = (0.0, 0.0)

    def set_drift_en_mps(self, drift_en_mps: tuple[float, float] | None) -> None:
        """Let fixes drift away with a velocity; None ends the drift."""
        self._drift_en_mps, self._drifted_en_m = drift_en_mps, (0.0, 0.0)

    def step(self) -> None:
        """Advance by one step: take a fix when one is due, and follow it."""
        if self.off:
            self._dead_reckon()
            return
        self._since_fix_s += self._step_s
        if self._since_fix_s > FIX_S - 1e-9:
            self._since_fix_s -= FIX_S
            self._fix()
        share = self._follow
        e, n, u = self.error_enu_m
        fe, fn, fu = self.fix_error_enu_m
        self.error_enu_m = (e + share * (fe - e), n + share * (fn - n), u + share * (fu - u))

    def _dead_reckon(self) -> None:
        (e, n, u), (ve, vn), (ae, an) = self.error_enu_m, self.velocity_error_en_mps, self._bias_en_mps2
        span = self._step_s
        self.velocity_error_en_mps = (ve, vn) = (ve + ae * span, vn + an * span)
        self.error_enu_m = (e + ve * span, n + vn * span, u)

    def _fix(self) -> None:
        a, b, c, d, e, f, g = self._draw_normal()
        noise = self._gps.noise_m
        self._east = self._wander.step(self._east, a, b)
        self._north = self._wander.step(self._north, c, d)
        self.fix_error_enu_m = (self._east[0] + noise * e, self._north[0] + noise * f, 1.5 * noise * g)
        if self._drift_en_mps:
            (away_e, away_n), (drift_e, drift_n) = self._drifted_en_m, self._drift_en_mps
            fix_e, fix_n, fix_u = self.fix_error_enu_m
            self._drifted_en_m = (away_e, away_n) = (away_e + drift_e * FIX_S, away_n + drift_n * FIX_S)
            self.fix_error_enu_m = (fix_e + away_e, fix_n + away_n, fix_u)
        self.fixes += 1

    def _draw_normal(self) -> list[float]:
        if not self._draws:
            self._draws = self._random.standard_normal((_BLOCK, 7)).tolist()
        return self._draws.pop()


@dataclass(frozen=True, slots=True)
class _Wander:
    """One axis of the wander: transition of (error, rate) in rows, and the Cholesky factor of its noise."""

    transition: tuple[float, float, float, float]
    noise: tuple[float, float, float]

    @classmethod
    def of(cls, gps: Gps, step_s: float) -> _Wander:
        b = _DECAY / gps.wander_time_s
        fade = math.exp(-b * step_s)
        m = fade * np.array([[1.0 + b * step_s, step_s], [-b * b * step_s, 1.0 - b * step_s]])
        stationary = gps.wander_m**2 * np.diag([1.0, b * b])
        q = stationary - product(product(m, stationary), m.T)
        # NumPy's Cholesky is not used: the matrix is singular without a wander, and nearly so for a slow one.
        rate = math.sqrt(max(q[1, 1], 0.0))
        cross = float(q[0, 1] / rate) if rate else 0.0
        return cls(
            (*m[0].tolist(), *m[1].tolist()), (math.sqrt(max(q[0, 0] - cross * cross, 0.0)), cross, rate)
        )

    def step(self, state: tuple[float, float], first: float, second: float) -> tuple[float, float]:
        """The state one fix later, for two standard normal draws."""
        error, rate = state
        a, b, c, d = self.transition
        of_error, cross, of_rate = self.noise
        return (
            a * error + b * rate + of_error * first + cross * second,
            c * error + d * rate + of_rate * second,
        )
