"""The tracks of boxes over pictures, as arrays, and what the tracker assumes of their motion."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Floats, product

from ._tracks import TRACK_GAP_S

# Sizes divide: no side counts as smaller than this.
LEAST_SIDE_PX = 1.0
FARTHEST_PX = 1e6


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """What the tracker assumes. Motion is in radians of the camera's view, so that it holds for every focal length."""

    confirm_hits: int = 3
    """A track of so many detections is confirmed. SORT: 3."""
    tentative_s: float = 1.0
    """A track that is not confirmed ends when it is not detected for longer. SORT ends it after a single frame without;
    here detectors miss more often: with 0.5 s half as many identities again changed among the detections of `small`."""
    drop_s: float = TRACK_GAP_S
    """A confirmed track ends when it is not detected for longer: as for the simulated tracker. ByteTrack: 1 s."""
    sure_score: float = 0.6
    """Detections of at least this score choose their tracks first. ByteTrack: 0.6."""
    least_overlap: float = 0.3
    """A detection may also continue a track when they overlap by this (intersection over union). SORT: 0.3. It catches
    boxes that the border of the picture cuts."""
    object_rad2_per_s3: float = 0.001
    """Density of the white acceleration of one box, beside the camera's. Of 0.0005, 0.002 and 0.008 on a flight of
    reference-naive with a warp, the two smaller ones switch a third fewer identities."""
    camera_rad2_per_s3: float = 0.1
    """Without a warp: the same for the camera's motion, which moves all boxes. On that flight the second difference of
    their mean at 5 Hz has 8.4 px of 457 (0.06), with far tails."""
    uneven_rad2_per_s3: float = 0.007
    """Without a warp: what the camera's motion adds for each box, because it does not move all alike: 2.5 to 3.2 px."""
    size_share2_per_s3: float = 0.04
    """The same for the sides, as a share of them: 0.5 px of 40 on that flight."""
    jitter_px: float = 1.5
    """Deviation of a box's edges: as those of the simulated detector. Assumed."""
    jitter_share: float = 0.07
    """The same as a share of the side, added in squares; gives the middle 0.05 of it, as in DeepSORT."""
    warp_rad: float = 0.005
    """Deviation that errors of the poses leave in a warp. Assumed."""
    object_radps: float = 0.1
    """Deviation of a new track's velocity from that of the others. Assumed: 10 m/s seen from 100 m."""
    camera_radps: float = 0.4
    """Deviation of a new track's velocity when there is no other. Assumed: a turn of 45 degrees in two seconds."""
    label_penalty: float = 4.0
    """Added to the cost where the label differs: labels change over one object, but seldom. Assumed."""
    max_tracks: int = 256
    """So many detections of a frame, the surest, are tracked; the others get a name for that frame. Assumed."""


@dataclass(slots=True, eq=False)
class BoxTracks:
    """All tracks, one row each. The four coordinates of a box are independent: `covariance` has for each the variance of
    its place, the covariance of place and rate, and the variance of its rate.
    """

    numbers: NDArray[np.int64]
    labels: list[str]
    hits: NDArray[np.int64]
    unseen_s: Floats
    place: Floats  # (n, 4) middle and sides, in pixels
    rate: Floats  # (n, 4) pixels in a second
    covariance: Floats  # (n, 4, 3)

    @classmethod
    def none(cls) -> BoxTracks:
        counts = np.zeros(0, dtype=np.int64)
        return cls(counts, [], counts, np.zeros(0), np.zeros((0, 4)), np.zeros((0, 4)), np.zeros((0, 4, 3)))

    def warp(self, warp: Floats) -> None:
        """Go along with the ground from the last picture to this one: places by the warp, the rest by its derivative."""
        homogeneous = product(self.place[:, :2], warp[:, :2].T) + warp[:, 2]
        depth = homogeneous[:, 2]
        # The ground behind the camera would appear mirrored: what goes there stays where it was, and is lost in time.
        before = depth > 1e-6
        if not before.any():
            return
        depth, moved = depth[before], homogeneous[before, :2] / depth[before][:, None]
        # (n, 2, 2): how the new pixel depends on the old one.
        slope = (warp[None, :2, :2] - moved[:, :, None] * warp[None, None, 2, :2]) / depth[:, None, None]
        scale = np.sqrt(np.abs(slope[:, 0, 0] * slope[:, 1, 1] - slope[:, 0, 1] * slope[:, 1, 0]))[:, None]
        self.place[before, :2] = moved
        self.place[before, 2:] *= scale
        self.rate[before, :2] = product(slope, self.rate[before, :2, None])[..., 0]
        self.rate[before, 2:] *= scale
        # The two axes stay independent: a turn would correlate them only if their variances differed much.
        self.covariance[before, :2] = product(slope**2, self.covariance[before, :2])
        self.covariance[before, 2:] *= scale[..., None] ** 2

    def predict(self, span_s: float, settings: TrackerSettings, focal_px: float, *, uneven: bool) -> None:
        """Let time pass, without the part of the noise that all share."""
        self.unseen_s = self.unseen_s + span_s
        self.place = self.place + span_s * self.rate
        self.place[:, 2:] = np.maximum(self.place[:, 2:], LEAST_SIDE_PX)
        held, shared, moved = (self.covariance[..., part] for part in range(3))
        self.covariance = np.stack(
            [held + 2.0 * span_s * shared + span_s**2 * moved, shared + span_s * moved, moved], axis=-1
        )
        density = settings.object_rad2_per_s3 + (settings.uneven_rad2_per_s3 if uneven else 0.0)
        self.disturb(slice(0, 2), density * focal_px**2, span_s)
        self.disturb(slice(2, 4), settings.size_share2_per_s3 * self.place[:, 2:] ** 2, span_s)

    def disturb(self, coordinates: slice, density: Floats | float, span_s: float) -> None:
        """White acceleration over this time (Bar-Shalom, Li and Kirubarajan 2001, section 6.2.2)."""
        self.covariance[:, coordinates, 0] += density * span_s**3 / 3.0
        self.covariance[:, coordinates, 1] += density * span_s**2 / 2.0
        self.covariance[:, coordinates, 2] += density * span_s

    def update(self, rows: NDArray[np.intp], measured: Floats, noise: Floats) -> None:
        """Take in one detection for each of these rows."""
        held, shared, moved = (self.covariance[rows][..., part] for part in range(3))
        gain, rate_gain = held / (held + noise), shared / (held + noise)
        apart = measured - self.place[rows]
        self.place[rows] += gain * apart
        self.rate[rows] += rate_gain * apart
        self.covariance[rows] = np.stack(
            [held - gain * held, shared - gain * shared, moved - rate_gain * shared], axis=-1
        )
        self.hits[rows] += 1
        self.unseen_s[rows] = 0.0

    def kept(self, settings: TrackerSettings, focal_px: float, span_s: float) -> BoxTracks:
        """Without those that were not detected for too long, or that may be anywhere.

        Of more than `max_tracks` those stay that are confirmed and were seen lately.
        """
        confirmed = self.hits >= settings.confirm_hits
        # The next picture is always waited for, however late it comes.
        limit_s = np.where(confirmed, settings.drop_s, max(settings.tentative_s, span_s))
        # A hair more, because spans of floats add up to a little more or less than the limit.
        alive = self.unseen_s <= limit_s + 1e-9
        # Near the horizon a warp takes small errors to any size: such a track fits everything, or nothing at all.
        alive &= (self.covariance[:, :2, 0] < focal_px**2).all(axis=1)
        alive &= (np.abs(self.place) <= FARTHEST_PX).all(axis=1)
        rows = np.flatnonzero(alive)
        if len(rows) > settings.max_tracks:
            order = np.lexsort((self.numbers[rows], self.unseen_s[rows], ~confirmed[rows]))
            rows = np.sort(rows[order[: settings.max_tracks]])
        columns: list[Any] = [getattr(self, field.name) for field in fields(self)]
        # Labels are a list, all else arrays.
        kept: list[Any] = [
            [column[row] for row in rows] if isinstance(column, list) else column[rows] for column in columns
        ]
        return BoxTracks(*kept)

    def joined(self, begun: BoxTracks) -> BoxTracks:
        """These and those."""
        pairs: list[Any] = [(getattr(self, field.name), getattr(begun, field.name)) for field in fields(self)]
        joined: list[Any] = [
            first + second if isinstance(first, list) else np.concatenate([first, second])
            for first, second in pairs
        ]
        return BoxTracks(*joined)
