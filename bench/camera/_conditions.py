"""Light, air, and the state of the camera; and what a SimSpec says of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bench.arrays import Floats
from bench.contracts import Light
from bench.simspec import DUST_EXTINCTION_PER_M, Camera, SimSpec, sun_of

_CLEAR_EXTINCTION_PER_M = 1.5e-4
"""A meteorological range of 26 km, a clear day; the detection model's clear air absorbs nothing at all."""

# Rayleigh's optical depth of a vertical path at 450, 550 and 650 nm, after A. Bucholtz (1995), Applied Optics 34, 2765,
# rounded, plus 0.1 for aerosols (assumed).
_OPTICAL_DEPTH_BGR = np.array((0.22, 0.10, 0.05)) + 0.1

# Horizontal illuminance in lux over the sun's elevation in degrees: assumed, in the order of magnitude
# that almanacs print (noon 1e5, sunrise some hundred, end of civil twilight 3) and taken from none. Below, 0.3 lux of
# moon and street light are assumed too, so that a night is dark and not black.
_ELEVATION_DEG = np.array((-90.0, -12.0, -9.0, -6.0, -3.0, 0.0, 5.0, 15.0, 30.0, 60.0, 90.0))
_LOG_LUX = np.log10(np.array((0.3, 0.3, 0.5, 3.5, 60.0, 700.0, 5e3, 2e4, 5e4, 1e5, 1.2e5)))

# The camera (assumed): what it can still expose fully, and at which gain.
_FULL_EXPOSURE_LUX = 3e4
_SHORTEST_SHUTTER_S, _LONGEST_SHUTTER_S = 1.0 / 2000.0, 1.0 / 60.0
_HIGHEST_GAIN = 256.0
_DARKNESS_KEPT = 0.1
_WHITE_BALANCE = 0.35
"""The share of the light's colour that the camera takes out, as a power (assumed)."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """All that changes a picture beside the scene. Levels go from 0 (none) to 9 (the worst), shares from 0 to 1.

    `extinction_per_m` is that of fog and rain, to which clear air and dust are added, and `dust_extinction_per_m` that
    of dust at level 1, which grows as the level squared. `shutter_s` None: the camera chooses. A frame is lost with probability `dropped_share`; with `frozen_share` the camera repeats its last picture,
    in stretches of `frozen_frames` on average.
    """

    sun_elevation_rad: float
    sun_azimuth_rad: float
    extinction_per_m: float = 0.0
    rain_level: float = 0.0
    fog_level: float = 0.0
    dust_level: float = 0.0
    dust_extinction_per_m: float = DUST_EXTINCTION_PER_M
    exposure_ev: float = 0.0
    shutter_s: float | None = None
    noise: float = 1.0
    lens_dirt: float = 0.0
    dropped_share: float = 0.0
    frozen_share: float = 0.0
    frozen_frames: float = 5.0


def conditions_of(simspec: SimSpec, camera: Camera | None = None) -> Conditions:
    """What a SimSpec states: sun, fog, rain and dust, with the extinction of its detection model, and the camera's own
    state. `camera` defaults to the vehicle's main one.
    """
    sun, camera = sun_of(simspec), camera or simspec.vehicle.camera
    weather, model = simspec.environment, simspec.perception.model
    # The same air for pixels as for simulated detections (docs/detection.md). Dust is added apart: it is brown.
    air_per_m = model.extinction_per_m(weather.model_copy(update={"dust_level": 0.0}))
    dust_per_m = model.dust_extinction_per_m
    if weather.visibility_m is not None:
        # Clear air, which is always added, and dust are part of it.
        rest_per_m = max(0.0, air_per_m - _CLEAR_EXTINCTION_PER_M)
        level = weather.dust_level**2
        dust_per_m = min(dust_per_m, rest_per_m / level) if level else dust_per_m
        air_per_m = rest_per_m - dust_per_m * level
    return Conditions(
        sun.elevation_rad,
        sun.azimuth_rad,
        air_per_m,
        weather.rain_level,
        model.fog_level(weather),
        weather.dust_level,
        dust_per_m,
        exposure_ev=camera.exposure_ev,
        shutter_s=camera.shutter_s,
        noise=camera.noise,
        lens_dirt=camera.lens_dirt,
        dropped_share=camera.dropped_share,
        frozen_share=camera.frozen_share,
    )


@dataclass(frozen=True, slots=True)
class Exposure:
    """How the camera takes its pictures: shutter time, gain (1 by day), and the brightness that it reaches of 1."""

    shutter_s: float
    gain: float
    brightness: float


def illuminance_lux(conditions: Conditions) -> float:
    """Light on level ground."""
    degrees = math.degrees(conditions.sun_elevation_rad)
    clear = math.pow(10.0, float(np.interp(degrees, _ELEVATION_DEG, _LOG_LUX)))
    # Thick cloud lets a fifth of the light through.
    return clear * (1.0 - 0.8 * overcast(conditions))


def overcast(conditions: Conditions) -> float:
    """Share of the direct sun that cloud, fog or dust take away: all of it from level 5 on."""
    return min(1.0, max(conditions.rain_level, conditions.fog_level, conditions.dust_level) / 5.0)


def exposure_of(conditions: Conditions) -> Exposure:
    """Automatic exposure: a longer shutter first, then gain, then the picture stays dark."""
    darkness = max(1.0, _FULL_EXPOSURE_LUX / illuminance_lux(conditions))
    # Dusk looks darker than day on any camera: a tenth of the difference, in stops, is left.
    target = darkness**-_DARKNESS_KEPT * 2.0**conditions.exposure_ev
    lacking = darkness * target
    if conditions.shutter_s is None:
        shutter_s = min(_LONGEST_SHUTTER_S, max(_SHORTEST_SHUTTER_S, _SHORTEST_SHUTTER_S * lacking))
    else:
        shutter_s = conditions.shutter_s
    wanted = lacking * _SHORTEST_SHUTTER_S / shutter_s
    gain = min(_HIGHEST_GAIN, max(1.0, wanted))
    return Exposure(shutter_s, gain, target * min(1.0, gain / wanted) if wanted > 1.0 else target)


def light_of_conditions(conditions: Conditions) -> Light:
    """Light and air as the camera exposes them: level ground in the sun keeps its colour by day."""
    elevation = conditions.sun_elevation_rad
    sine = math.sin(elevation)
    sunward = np.array(
        (
            math.cos(elevation) * math.sin(conditions.sun_azimuth_rad),
            math.cos(elevation) * math.cos(conditions.sun_azimuth_rad),
            sine,
        )
    )
    cloud = overcast(conditions)
    direct, ambient = _sun_and_sky(elevation, cloud)
    level = ambient + direct * max(0.0, sine)
    exposure = exposure_of(conditions)
    # Cameras balance white, but not wholly: a low sun stays warm.
    balance = exposure.brightness / (level**_WHITE_BALANCE * level.mean() ** (1.0 - _WHITE_BALANCE))
    air, dust = _air(conditions)
    shine = exposure.brightness ** (1.0 / 2.2)
    grey = np.array((232.0, 222.0, 212.0)) * (1.0 - cloud) + np.array((206.0, 204.0, 200.0)) * cloud
    tint = (level / level.mean()) ** (0.5 * (1.0 - _WHITE_BALANCE))
    haze = (grey * (1.0 - dust) + np.array((118.0, 166.0, 196.0)) * dust) * tint * min(1.0, shine)
    blue = np.array((206.0, 148.0, 92.0)) * (1.0 - cloud) + np.array((192.0, 188.0, 184.0)) * cloud
    zenith = (blue * (1.0 - dust) + np.array((130.0, 160.0, 180.0)) * dust) * min(1.0, shine)
    # Lamps and windows outshine what they stand in when the camera's gain is up.
    glow = np.array((120.0, 200.0, 250.0)) if exposure.gain > 8.0 else np.zeros(3)
    return Light(
        sunward,
        ambient * balance,
        direct * balance,
        np.clip(haze, 0, 255),
        np.clip(zenith, 0, 255),
        air,
        glow,
    )


def _sun_and_sky(elevation_rad: float, cloud: float) -> tuple[Floats, Floats]:
    """(3,) direct and ambient light, linear, relative to each other."""
    degrees = math.degrees(elevation_rad)
    # Near the horizon the sun colours the sky, too (assumed).
    warmth = max(0.0, 1.0 - abs(degrees) / 12.0)
    sky = np.array((0.20, 0.17, 0.15)) * (1.0 - warmth) + np.array((0.13, 0.16, 0.21)) * warmth
    if degrees <= 0.5:
        # After sunset the sky is all the light there is, bluer the deeper the sun stands.
        depth = min(1.0, max(0.0, -degrees / 8.0))
        return np.zeros(3), sky * (1.0 - depth) + np.array((0.26, 0.18, 0.13)) * depth
    # F. Kasten and A. T. Young (1989), Applied Optics 28, 4735: relative air mass.
    air_mass = 1.0 / (math.sin(elevation_rad) + 0.50572 * (degrees + 6.07995) ** -1.6364)
    direct = np.exp(-_OPTICAL_DEPTH_BGR * air_mass) * (1.0 - cloud)
    # A low sun lights less of the sky, so its long shadows still show (assumed).
    ambient = sky * (0.15 + 0.85 * min(1.0, degrees / 25.0)) * (1.0 - cloud) + np.full(3, 0.2) * cloud
    return direct, ambient


def _air(conditions: Conditions) -> tuple[float, float]:
    """Extinction per metre of all there is in the air, and the share of dust in it."""
    dust = conditions.dust_extinction_per_m * conditions.dust_level**2
    total = _CLEAR_EXTINCTION_PER_M + conditions.extinction_per_m + dust
    return total, dust / total
