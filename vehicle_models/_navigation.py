"""Where the vehicle believes itself to be: truth plus the error of its satellite navigation.

Horizontally a first-order Gauss-Markov wander (stationary from the start: the receiver has been on for a while) with
white noise on every fix; vertically white noise alone, since height is held by the barometer. What the autopilot flies
by follows the fixes through a first-order filter, as an estimator would. Velocity and attitude are taken as exact.
"""

from __future__ import annotations

import math

import numpy as np

from bench.contracts import Vector
from bench.simspec import Gps

FIX_S = 0.125  # PX4's simulated receiver gives 8 fixes a second
_FOLLOW_S = 0.5  # time constant with which the estimate follows the fixes
_BLOCK = 512


class Navigation:
    """The position error of one vehicle, in ENU metres. `wander_m` and `noise_m` are standard deviations of each axis."""

    def __init__(self, gps: Gps, step_s: float, random: np.random.Generator) -> None:
        self._gps = gps
        self._random = random
        self._draws: list[list[float]] = []
        self._follow = -math.expm1(-step_s / _FOLLOW_S)
        self._keep = math.exp(-FIX_S / gps.wander_time_s)
        self._fresh = gps.wander_m * math.sqrt(1.0 - self._keep * self._keep)
        east, north, *_ = self._draw()
        self._wander = (gps.wander_m * east, gps.wander_m * north)
        self.fix_error_enu_m: Vector = (*self._wander, 0.0)
        self.error_enu_m: Vector = self.fix_error_enu_m
        self.fixes = 0
        self._since_fix_s = 0.0
        self._step_s = step_s

    def step(self) -> None:
        """Advance by one step: take a fix when one is due, and follow it."""
        self._since_fix_s += self._step_s
        if self._since_fix_s > FIX_S - 1e-9:
            self._since_fix_s -= FIX_S
            self._fix()
        share = self._follow
        e, n, u = self.error_enu_m
        fe, fn, fu = self.fix_error_enu_m
        self.error_enu_m = (e + share * (fe - e), n + share * (fn - n), u + share * (fu - u))

    def _fix(self) -> None:
        a, b, c, d, e = self._draw()
        noise = self._gps.noise_m
        east, north = self._wander
        east, north = self._keep * east + self._fresh * a, self._keep * north + self._fresh * b
        self._wander = (east, north)
        self.fix_error_enu_m = (east + noise * c, north + noise * d, 1.5 * noise * e)
        self.fixes += 1

    def _draw(self) -> list[float]:
        if not self._draws:
            self._draws = self._random.standard_normal((_BLOCK, 5)).tolist()
        return self._draws.pop()
