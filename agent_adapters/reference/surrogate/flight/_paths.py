"""Ways over the ground plan, many at once: corners, when each is reached, and moments along them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.arrays import Counts, Floats

from ..._settings import DEFAULTS
from ._views import Stretch

# What a corner costs when it is flown. The agent plans with 3.0 s (TURN_S), to be on the safe side.
CORNER_S = 2.2
"""Slowing down to a corner and speeding up again, by the reference agent's speeds and braking."""

# Enough that a moment is shorter than a side; more cost time in proportion. Chosen, not measured.
RING_MOMENTS = 20


def lawnmower(
    center_m: Floats, radius_m: Floats, heading_rad: Floats, swath_m: Floats, near_m: Floats, middle_m: Floats
) -> Floats:
    """(r, w, 2) the agent's lawnmower over discs; with fewer legs a row's last corner is repeated."""
    spacing_m = np.maximum((1.0 - DEFAULTS.overlap) * swath_m, 5.0)
    count = np.maximum(1, np.ceil(2.0 * radius_m / spacing_m)).astype(np.int64)
    between_m = 2.0 * radius_m / count
    corners = []
    for leg in range(int(count.max())):
        row_leg = np.minimum(leg, count - 1)
        across_m = -radius_m + (row_leg + 0.5) * between_m
        inner_m = np.maximum(np.abs(across_m) - between_m / 2.0, 0.0)
        half_m = np.sqrt(np.maximum(radius_m**2 - inner_m**2, 0.0))
        begin_m = -half_m - near_m
        end_m = np.maximum(half_m - middle_m, begin_m + 10.0)
        sign = np.where(row_leg % 2 == 0, 1.0, -1.0)
        first = np.where(leg == row_leg, begin_m, end_m)
        for along_m in (sign * first, sign * end_m):
            sine, cosine = np.sin(heading_rad), np.cos(heading_rad)
            east_m = center_m[:, 0] + along_m * sine + across_m * cosine
            north_m = center_m[:, 1] + along_m * cosine - across_m * sine
            corners.append(np.stack((east_m, north_m), axis=-1))
    return np.stack(corners, axis=1)


def path_stretch(
    rows: Counts, corners_m: Floats, begin_s: Floats, speed_mps: Floats, height_m: Floats, moments: int
) -> tuple[Stretch, Floats]:
    """The corners flown one after the other, seen at so many moments; and when the last is reached."""
    steps = np.diff(corners_m, axis=1)
    length_m = np.hypot(steps[:, :, 0], steps[:, :, 1])
    moving_s = length_m / speed_mps[:, None]
    reached_s = np.cumsum(moving_s + np.where(length_m > 1e-6, CORNER_S, 0.0), axis=1)
    took_s = reached_s[:, -1]
    since_s = (np.arange(moments) + 0.5) / moments * took_s[:, None]
    on = np.minimum((since_s[:, :, None] >= reached_s[:, None, :]).sum(axis=2), length_m.shape[1] - 1)
    row = np.arange(len(rows))[:, None]
    left_s = reached_s[row, on] - since_s
    spare_s = np.maximum(left_s - CORNER_S, 0.0)
    share = 1.0 - spare_s / np.maximum(moving_s[row, on], 1e-9)
    place_m = corners_m[row, on] + np.clip(share, 0.0, 1.0)[:, :, None] * steps[row, on]
    course_rad = np.arctan2(steps[:, :, 0], steps[:, :, 1])
    # The legs of length 0 that fill up a row turn nowhere.
    turn_rad = (
        np.remainder(np.diff(course_rad, axis=1, append=course_rad[:, -1:]) + np.pi, 2.0 * np.pi) - np.pi
    )
    turn_rad[:, :-1] *= length_m[:, 1:] > 1e-6
    heading_rad = course_rad[row, on] + turn_rad[row, on] * np.clip(1.0 - left_s / CORNER_S, 0.0, 1.0)
    return _stretch(rows, begin_s, took_s, place_m, heading_rad, height_m), begin_s + took_s


def ring_stretch(
    rows: Counts, center_m: Floats, from_m: Floats, radius_m: Floats, begin_s: Floats, height_m: Floats
) -> tuple[Stretch, Floats]:
    """Once round a place, facing it, from the side where it comes from."""
    took_s = 2.0 * np.pi * radius_m / DEFAULTS.inspect_speed_mps
    since = (np.arange(RING_MOMENTS) + 0.5) / RING_MOMENTS
    first = np.arctan2(from_m[:, 0] - center_m[:, 0], from_m[:, 1] - center_m[:, 1])
    angle = first[:, None] + 2.0 * np.pi * since[None, :]
    out = np.stack((np.sin(angle), np.cos(angle)), axis=-1)
    place_m = center_m[:, None, :] + radius_m[:, None, None] * out
    return _stretch(rows, begin_s, took_s, place_m, angle + np.pi, height_m), begin_s + took_s


def _stretch(
    rows: Counts, begin_s: Floats, took_s: Floats, place_m: Floats, heading_rad: Floats, height_m: Floats
) -> Stretch:
    """Moments at equal spans, all at one height."""
    moments = heading_rad.shape[1]
    since_s = (np.arange(moments) + 0.5) / moments * took_s[:, None]
    high_m, span_s = (np.repeat(each[:, None], moments, axis=1) for each in (height_m, took_s / moments))
    return Stretch(rows, begin_s[:, None] + since_s, place_m, heading_rad, high_m, span_s)


def cut_off(stretch: Stretch, place_m: Floats, cut_s: Floats, begin_m: Floats) -> tuple[Stretch, Floats]:
    """What is flown of a stretch up to a moment (r,), the rest without a span, and where that ends."""
    flown = stretch.time_s <= cut_s[:, None]
    count = flown.sum(axis=1)
    last_m = stretch.place_m[np.arange(len(count)), np.maximum(count - 1, 0)]
    last_m = np.where((count > 0)[:, None], last_m, begin_m)
    stretch = replace(stretch, span_s=np.where(flown, stretch.span_s, 0.0))
    return stretch, np.where(np.isfinite(cut_s)[:, None], last_m, place_m)
