"""What the camera sees on the ground plan, and how well: docs/detection.md's odds without hiding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Counts, Floats, Narrow
from bench.contracts import LABEL_EVIDENCE, LEAST_DOUBT, THRESHOLD_CONTRAST

from ..._settings import DEFAULTS
from ..batch._batch import Batch
from ..batch._draws import normal

_LUCK_COUNT = 3000
BLOCK = 24
"""Missions looked at together, so that the pairs stay in the processor's cache."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A flown piece of some missions: `rows` (r,), and at j moments of each where it was, which way it
    looked, how high.

    A moment stands for a span; it is in the middle of it.
    """

    rows: Counts
    time_s: Floats  # (r, j)
    place_m: Floats  # (r, j, 2)
    heading_rad: Floats  # (r, j)
    height_m: Floats  # (r, j)
    span_s: Floats  # (r, j)

    def select(self, rows: Counts) -> Stretch:
        """Some of the missions."""
        return Stretch(*(getattr(self, name)[rows] for name in Stretch.__slots__))

    def flown_m(self) -> Floats:
        """(r, j) how far it is to each moment's place from that of the moment before."""
        steps_m = np.diff(self.place_m, axis=1, prepend=self.place_m[:, :1])
        return np.hypot(steps_m[..., 0], steps_m[..., 1])


@dataclass(frozen=True, slots=True)
class Views:
    """Pairs of moment and actor in the picture, flat: mission, moment, actor, range, frames, clarity."""

    row: Counts
    moment: Counts
    actor: Counts
    time_s: Floats
    range_m: Narrow
    frames: Narrow
    height_px: Narrow
    detection: Narrow
    mislabel: Narrow

    @staticmethod
    def joined(parts: list[Views]) -> Views:
        """All of them as one."""
        names = Views.__slots__
        return Views(*(np.concatenate([getattr(views, name) for views in parts]) for name in names))

    def where(self, chosen: Bools) -> Views:
        """Some of them."""
        return Views(*(getattr(self, name)[chosen] for name in Views.__slots__))


def views_of(batch: Batch, stretch: Stretch, places_m: Floats) -> Views:
    """Who is in the picture on a stretch, while everybody stands at `places_m` (r, a, 2)."""
    at, moment, actor = _shown(batch, stretch, places_m)
    away = places_m[at, actor] - stretch.place_m[at, moment]
    return _clarity(batch, stretch, at, moment, actor, away[:, 0], away[:, 1])


def unseen_share(
    batch: Batch, course: Sequence[Stretch], rows: Counts, target_m: Floats, until_s: Floats
) -> Floats:
    """(r,) share of the ground round targets (r, 2) that no stretch has shown lately before `until_s`."""
    if not len(rows):
        return np.zeros(0)
    radius_m, since_s = batch.no_mark_m[rows] + DEFAULTS.bystander_margin_m, until_s - DEFAULTS.memory_s
    places_m = target_m[:, None] + radius_m[:, None, None] * _DISC[None]
    index = np.full(len(batch), -1)
    index[rows] = np.arange(len(rows))
    shown_lately = np.zeros(places_m.shape[:2], dtype=np.bool_)
    for stretch in course:
        place_of = index[stretch.rows]
        late = (place_of >= 0) & (stretch.time_s[:, 0] <= until_s[place_of])
        late &= stretch.time_s[:, -1] >= since_s[place_of]
        part = np.flatnonzero(late)
        if len(part):
            at = place_of[part]
            shown = _shown_between(batch, stretch.select(part), places_m[at], since_s[at], until_s[at])
            shown_lately[at] |= shown
    return np.asarray(1.0 - shown_lately.mean(axis=1))


def _disc() -> Floats:
    """Places of a disc of radius 1 on a grid: some 11 m apart in surroundings of 56 m."""
    steps = np.linspace(-1.0, 1.0, 11)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return np.asarray(grid[np.hypot(grid[:, 0], grid[:, 1]) <= 1.0])


_DISC = _disc()


def _shown_between(
    batch: Batch, stretch: Stretch, places_m: Floats, since_s: Floats, until_s: Floats
) -> Bools:
    """(r, p) which places (r, p, 2) were in the picture, for two frames or more, between moments (r,)."""
    at, moment, place = _shown(batch, stretch, places_m)
    time_s = stretch.time_s[at, moment]
    long = batch.rate_hz[stretch.rows[at]] * stretch.span_s[at, moment] >= 2.0
    counts = long & (time_s >= since_s[at]) & (time_s <= until_s[at])
    in_picture = np.zeros(places_m.shape[:2], dtype=np.bool_)
    in_picture[at[counts], place[counts]] = True
    return in_picture


def _shown(batch: Batch, stretch: Stretch, places_m: Floats) -> tuple[Counts, Counts, Counts]:
    rows, place_m = stretch.rows, stretch.place_m
    sine, cosine = np.sin(stretch.heading_rad), np.cos(stretch.heading_rad)
    ahead_m = place_m[:, :, 0] * sine + place_m[:, :, 1] * cosine
    across_m = place_m[:, :, 0] * cosine - place_m[:, :, 1] * sine
    widens = batch.tan_half[rows] * np.cos(batch.tilt_rad[rows])
    half_m = (batch.tan_half[rows] * np.sin(batch.tilt_rad[rows]))[:, None] * stretch.height_m
    # The picture's edges on the ground: limits of coordinates along and across the way it looks. In single precision,
    # block by block, for that is where the time goes.
    near_m = ahead_m + batch.near_edge[rows][:, None] * stretch.height_m
    far_m = ahead_m + batch.far_edge[rows][:, None] * stretch.height_m
    wider_m = widens[:, None] * ahead_m
    right_m, left_m = across_m + half_m - wider_m, across_m - half_m + wider_m
    of_moments = (sine, cosine, near_m, far_m, widens[:, None], right_m, left_m)
    frame = [values[..., None].astype(np.float32) for values in of_moments]
    frame += [places_m[:, None, :, axis].astype(np.float32) for axis in range(2)]
    blocks = [
        _in_picture(begin, [values[begin : begin + BLOCK] for values in frame])
        for begin in range(0, len(rows), BLOCK)
    ]
    at, moment, place = (np.concatenate(indices) for indices in zip(*blocks, strict=True))
    return at, moment, place


def _in_picture(first: int, frame: Sequence[Narrow]) -> tuple[Counts, Counts, Counts]:
    """Row, moment and actor of all pairs of a block that begins with row `first`."""
    sine, cosine, near_m, far_m, widens, right_m, left_m, east_m, north_m = frame
    ahead = east_m * sine
    ahead += north_m * cosine
    across = east_m * cosine
    across -= north_m * sine
    shown = ahead > near_m
    shown &= ahead < far_m
    ahead *= widens
    shown &= across - ahead < right_m
    across += ahead
    shown &= across > left_m
    at, moment, actor = np.nonzero(shown)
    return at + first, moment, actor


def _clarity(
    batch: Batch, stretch: Stretch, at: Counts, moment: Counts, actor: Counts, east_m: Floats, north_m: Floats
) -> Views:
    """In single precision, as the pairs are many."""
    row, east, north = stretch.rows[at], east_m.astype(np.float32), north_m.astype(np.float32)

    def of_moment(values: Floats) -> Narrow:
        return values.astype(np.float32)[at, moment]

    def of_mission(values: Floats) -> Narrow:
        return values.astype(np.float32)[row]

    def of_actor(values: Floats) -> Narrow:
        return values.astype(np.float32)[row, actor]

    up = of_moment(stretch.height_m)
    sine, cosine = of_moment(np.sin(stretch.heading_rad)), of_moment(np.cos(stretch.heading_rad))
    tilt_sine, tilt_cosine = of_mission(np.sin(batch.tilt_rad)), of_mission(np.cos(batch.tilt_rad))
    range_m = np.sqrt(east * east + north * north + up * up)
    tall_m, wide_m = of_actor(batch.tall_m), of_actor(batch.wide_m)
    middle = up - np.float32(0.5) * tall_m
    ahead = east * sine + north * cosine
    across = np.abs(east * cosine - north * sine)
    depth: Narrow = np.maximum(ahead * tilt_cosine + middle * tilt_sine, np.float32(1.0))
    # The box's larger side. A row of the picture changes with height by f ahead / depth^2 and with distance
    # by f up / depth^2, a column with height by f across sin(tilt) / depth^2 and with what lies across by
    # f / depth.
    down = (tall_m * ahead + wide_m * middle) / depth
    over = tall_m * across * tilt_sine / depth + wide_m
    height_px: Narrow = of_mission(batch.focal_px) / depth * np.maximum(down, over)
    contrast = np.exp(-of_mission(batch.extinction_per_m) * range_m) * of_mission(batch.light)
    contrast *= of_actor(1.0 - batch.concealment_weight[:, None] * batch.concealment)
    above = np.maximum((contrast - THRESHOLD_CONTRAST) / (1.0 - THRESHOLD_CONTRAST), 0.0)
    ratio = np.maximum(height_px * above / of_mission(batch.half_height_px), 1e-9) ** of_mission(batch.slope)
    share = ratio / (1.0 + ratio)
    perfect = batch.perfect[row]
    wrong = np.minimum(1.0, 2.0 * of_mission(batch.mislabel) * (1.0 - share)) * batch.mistakable[row, actor]
    return Views(
        row=row,
        moment=moment,
        actor=actor,
        time_s=stretch.time_s[at, moment],
        range_m=range_m,
        frames=of_moment(batch.rate_hz[stretch.rows][:, None] * stretch.span_s),
        height_px=height_px,
        detection=np.where(perfect, np.float32(1.0), of_mission(batch.ceiling) * share),
        mislabel=np.where(perfect, np.float32(0.0), wrong),
    )


def right_label_chance(views: Views, min_confidence: float = 0.0) -> Narrow:
    """Chance that one frame of each view holds the actor with its own class, no less sure than that."""
    right: Narrow = views.detection * (1.0 - views.mislabel)
    if min_confidence <= 0.0:
        return right
    prior = np.clip(views.mislabel, LEAST_DOUBT, 1.0 - LEAST_DOUBT)
    edge = (
        np.log(prior / (1.0 - prior)) - np.log(1.0 / min_confidence - 1.0)
    ) / LABEL_EVIDENCE - 0.5 * LABEL_EVIDENCE
    # The logistic curve for the normal one: within 0.01, and sooner worked out.
    sure_enough = right / (1.0 + np.exp(np.clip(1.702 * edge, -50.0, 50.0)))
    return np.where(views.detection < 1.0, sure_enough, right)  # what misses nothing doubts nothing


def frame_counts(batch: Batch, views: Views, chance: Narrow) -> Floats:
    """(n, a) in how many frames each actor was had, where `chance` is that of one frame of each view; with
    its luck.

    Misses hang together for a while, so the spread is that of as many looks as there are such whiles.
    """
    actors = batch.role.shape[1]
    flat = views.row * actors + views.actor
    size = len(batch) * actors
    mean = np.bincount(flat, views.frames * chance, size).reshape(-1, actors)
    spread = np.bincount(
        flat, views.frames * batch.correlated_frames[views.row] * chance * (1.0 - chance), size
    ).reshape(-1, actors)
    return mean + np.sqrt(spread) * normal(batch.seeds, _LUCK_COUNT, actors)
