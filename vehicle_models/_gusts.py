"""Seeded gusts: first-order Dryden turbulence at low altitude (MIL-F-8785C), over height above ground.

JSBSim's own turbulence is not used: it scales with height above sea level and leaks when airspeed changes
quickly. Each component is an exactly discretised Ornstein-Uhlenbeck process, so any change of airspeed or
height is safe.
"""

from __future__ import annotations

import math

import numpy as np

from bench.contracts import Vector
from bench.simspec import Wind

_FT = 0.3048
_BLOCK = 4096


def mean_wind_ned_mps(wind: Wind) -> Vector:
    """Velocity of the air, north, east, down: `from_deg` says where it comes from."""
    toward = math.radians(wind.from_deg) + math.pi
    return wind.speed_mps * math.cos(toward), wind.speed_mps * math.sin(toward), 0.0


class Gusts:
    """Gusts for one vehicle. Components along the mean wind, across it and down; `step_s` between two calls.

    With W20 the wind at 20 ft and h the height in feet (at least 10 ft, at most 1000 ft): sigma_w = 0.1 W20;
    sigma_u,v = sigma_w / (0.177 + 0.000823 h)^0.4; L_u,v = h / (0.177 + 0.000823 h)^1.2; L_w = h.
    """

    def __init__(self, wind: Wind, step_s: float, random: np.random.Generator) -> None:
        self._w20_mps = wind.turbulence_mps
        toward = math.radians(wind.from_deg) + math.pi
        self._cos, self._sin = math.cos(toward), math.sin(toward)
        self._step_s = step_s
        self._random = random
        self._along = self._across = self._down = 0.0
        self._draws: list[list[float]] = []

    @property
    def calm(self) -> bool:
        return self._w20_mps == 0.0

    def step(self, height_m: float, airspeed_mps: float) -> Vector:
        """Gust velocity (m/s NED) over the next step; taken at 0.5 m/s of airspeed at least."""
        # Drawing numbers in blocks is faster than one at a time.
        if not self._draws:
            self._draws = self._random.standard_normal((_BLOCK, 3)).tolist()
        x, y, z = self._draws.pop()
        # The specification defines the low-altitude model from 10 to 1000 ft.
        h = min(max(height_m / _FT, 10.0), 1000.0)
        k = 0.177 + 0.000823 * h
        sigma_down = 0.1 * self._w20_mps
        sigma = sigma_down / k**0.4
        travel_m = max(airspeed_mps, 0.5) * self._step_s
        keep = math.exp(-travel_m / (h / k**1.2 * _FT))
        keep_down = math.exp(-travel_m / (h * _FT))
        fresh = sigma * math.sqrt(1.0 - keep * keep)
        self._along = keep * self._along + fresh * x
        self._across = keep * self._across + fresh * y
        self._down = keep_down * self._down + sigma_down * math.sqrt(1.0 - keep_down * keep_down) * z
        return (
            self._cos * self._along - self._sin * self._across,
            self._sin * self._along + self._cos * self._across,
            self._down,
        )
