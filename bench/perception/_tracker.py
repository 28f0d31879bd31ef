"""A Kalman tracker: identities of detections over pictures, from their boxes alone.

Each of a box's four coordinates (middle and sides) moves with a constant velocity that white noise disturbs. Boxes are
assigned to tracks frame by frame, sure ones first. After A. Bewley et al. (2016), Simple online and realtime tracking
(SORT), and Y. Zhang et al. (2022), ByteTrack; what differs is written beside it, and in docs/detection.md.

The camera flies. Who knows its poses gives the `warp` between two pictures (`ground_warp`): the tracks go along with
the ground, and only their own motion is left to predict. Otherwise the displacement that most tracks share is taken out
of the predictions before anything is assigned (`_take_out_camera_motion`), which a turn with few boxes in the picture
defeats.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from bench.arrays import Bools, Floats, product
from bench.contracts import NO_DISTORTION, Detection, Lens, SimTime

from ._box_tracks import FARTHEST_PX, LEAST_SIDE_PX, BoxTracks, TrackerSettings

DEFAULT_FOCAL_PX = 457.0
"""Focal length of a camera with 640 pixels over 70 degrees."""

# Chi-square quantiles of 0.99 with four degrees of freedom (a box), and with two (its middle). DeepSORT takes 0.95 of
# four; more room costs less here, where few boxes are near each other.
_BOX_GATE = 13.277
_MIDDLE_GATE = 9.210
# So far that no sum of admissible costs reaches it.
_INADMISSIBLE = 1e9
# The search for the camera's displacement takes time with the fourth power of these.
_VOTERS = 16
_VOTED_BOXES = 32
# Tracks that were lost for longer may be anywhere, and tell nothing of the camera's motion.
_LATELY_S = 0.5

DEFAULT_SETTINGS = TrackerSettings()


class BegunTracks:
    """Leaves out the detections of a track until one has reached a score and there were so many.

    After the assignment, so that a doubtful detection can still be continued by a sure one.
    """

    def __init__(self, begin_score: float = 0.0, begin_detections: int = 2) -> None:
        self._begin_score, self._begin_detections = begin_score, begin_detections
        self._counts: Counter[str] = Counter()
        self._sure: set[str] = set()

    def of(self, detections: Sequence[Detection]) -> tuple[Detection, ...]:
        """Those of one picture, with the names of their tracks, that are of tracks that have begun."""
        self._counts.update(item.track for item in detections)
        self._sure.update(item.track for item in detections if item.score >= self._begin_score)
        return tuple(
            item
            for item in detections
            if item.track in self._sure and self._counts[item.track] >= self._begin_detections
        )


class KalmanTracker:
    """Names the detections of one camera's pictures, given in order of exposure.

    Names are `t1`, `t2`, ... as those of the simulated tracker, and are never used again. Memory and time for a frame
    are bounded by `max_tracks`. Nothing is random: equal input gives equal names.
    """

    def __init__(
        self,
        focal_px: float = DEFAULT_FOCAL_PX,
        settings: TrackerSettings = DEFAULT_SETTINGS,
        lens: Lens | None = None,
        prefix: str = "",
    ) -> None:
        """With a `lens`, boxes are followed where it would show them without its distortion: a warp has straight lines.
        Names begin with the `prefix`.
        """
        if not (math.isfinite(focal_px) and focal_px > 0.0):
            raise ValueError(f"focal_px is {focal_px}: give the camera's focal length, a number above 0")
        self._settings = settings
        self._focal_px = focal_px
        self._prefix = prefix
        self._distorting = lens if lens is not None and lens.distortion != NO_DISTORTION else None
        self._tracks = BoxTracks.none()
        self._time: SimTime | None = None
        self._names = 0

    def name(
        self, detections: Sequence[Detection], exposed: SimTime, warp: Floats | None = None
    ) -> tuple[Detection, ...]:
        """The same detections, surest first, each with its track. Tracks they had are not looked at.

        `warp` (3, 3) takes pixels of the last picture to those of this one that show the same place on the ground;
        without it the camera's motion is estimated from the boxes.

        Raises ValueError for a score that is not finite, for a box that is neither finite nor in order, and for an
        exposure before the last one.
        """
        if self._time is not None and exposed < self._time:
            raise ValueError(f"a picture of {exposed.s} s comes after one of {self._time.s} s")
        # By score and box, as the simulated tracker orders them.
        ordered = sorted(detections, key=lambda detection: (-detection.score, detection.box))
        boxes = _checked_boxes(ordered)
        if self._distorting is not None:
            boxes = straight_boxes(self._distorting, boxes)
        span_s = 0.0 if self._time is None else exposed.since(self._time)
        self._time = exposed
        tracked = ordered[: self._settings.max_tracks]
        numbers = self._advance(tracked, middles_and_sides(boxes[: len(tracked)]), span_s, warp)
        numbers += [self._next() for _ in ordered[len(tracked) :]]
        return tuple(
            Detection(detection.class_label, detection.score, detection.box, f"{self._prefix}t{number}")
            for detection, number in zip(ordered, numbers, strict=True)
        )

    def _advance(
        self, detections: Sequence[Detection], measured: Floats, span_s: float, warp: Floats | None
    ) -> list[int]:
        """The numbers of the detections' tracks."""
        settings, tracks = self._settings, self._tracks
        if not len(tracks.numbers) and not detections:
            return []
        if warp is not None:
            tracks.warp(warp)
        tracks.predict(span_s, settings, self._focal_px, uneven=warp is None)
        self._tracks = tracks = tracks.kept(settings, self._focal_px, span_s)
        noise = noise_px2(measured, settings, 0.0 if warp is None else settings.warp_rad * self._focal_px)
        if span_s > 0.0 and warp is None:
            self._take_out_camera_motion(detections, measured, noise, span_s)
        matches = self._matches(detections, measured, noise)
        rows = np.array(list(matches.values()), dtype=np.intp)
        columns = np.array(list(matches), dtype=np.intp)
        tracks.update(rows, measured[columns], noise[columns])
        for column, row in matches.items():
            tracks.labels[row] = detections[column].class_label
        numbers = {column: int(tracks.numbers[row]) for column, row in matches.items()}
        new = [column for column in range(len(detections)) if column not in matches]
        numbers.update((column, self._next()) for column in new)
        begun = self._begun(detections, measured, noise, new, numbers, compensated=warp is not None)
        self._tracks = tracks.joined(begun)
        return [numbers[column] for column in range(len(detections))]

    def _matches(self, detections: Sequence[Detection], measured: Floats, noise: Floats) -> dict[int, int]:
        """Detection -> row of the track that it continues."""
        costs = self._costs(detections, measured, noise)
        sure = np.array(
            [detection.score >= self._settings.sure_score for detection in detections], dtype=bool
        )
        confirmed = self._tracks.hits >= self._settings.confirm_hits
        matches: dict[int, int] = {}
        # Doubtful boxes must not take the tracks of sure ones (ByteTrack), nor new tracks the boxes of old ones.
        for rows, columns in ((confirmed, sure), (confirmed, ~sure), (~confirmed, np.ones_like(sure))):
            matches.update(assign(costs, rows, columns, matches))
        return matches

    def _next(self) -> int:
        self._names += 1
        return self._names

    def _take_out_camera_motion(
        self, detections: Sequence[Detection], measured: Floats, noise: Floats, span_s: float
    ) -> None:
        """Move all tracks by the displacement that two or more of them share; else let them be less certain."""
        tracks = self._tracks
        density = self._settings.camera_rad2_per_s3 * self._focal_px**2
        shift, voters = self._shared_displacement(detections, measured, noise, density * span_s**3 / 3.0)
        if voters >= 2:
            # The expected change of velocity that goes with a displacement by white acceleration.
            tracks.place[:, :2] += shift
            tracks.rate[:, :2] += 1.5 * shift / span_s
            tracks.covariance[:, :2, 2] += density * span_s / 4.0
        else:
            tracks.disturb(slice(0, 2), density, span_s)

    def _shared_displacement(
        self, detections: Sequence[Detection], measured: Floats, noise: Floats, variance_px2: float
    ) -> tuple[Floats, int]:
        """The displacement with the most votes, and how many tracks vote for it.

        A track votes for a displacement that brings it onto a detection of its label, by how well it fits; against it
        speaks how unlikely it is as such.
        """
        tracks, nothing = self._tracks, np.zeros(2)
        rows = np.flatnonzero(tracks.unseen_s <= _LATELY_S)[:_VOTERS]
        columns = range(min(len(detections), _VOTED_BOXES))
        if not len(rows) or not columns:
            return nothing, 0
        apart = measured[columns][None, :, :] - tracks.place[rows][:, None, :]
        spread = tracks.covariance[rows][:, None, :, 0] + noise[columns][None, :, :]
        alike = np.array([[tracks.labels[r] == detections[c].class_label for c in columns] for r in rows])
        alike &= (apart[..., 2:] ** 2 / spread[..., 2:]).sum(axis=-1) <= _MIDDLE_GATE
        middles, spread = apart[..., :2], spread[..., :2]
        candidates = np.concatenate([nothing[None], middles[alike]])
        candidates = candidates[(candidates**2).sum(axis=1) <= 4.0 * _MIDDLE_GATE * variance_px2]
        if not len(candidates):
            return nothing, 0
        distance2 = ((middles[None] - candidates[:, None, None, :]) ** 2 / spread[None]).sum(axis=-1)
        distance2[:, ~alike] = _MIDDLE_GATE
        nearest = distance2.min(axis=2)
        votes = np.maximum(_MIDDLE_GATE - nearest, 0.0).sum(axis=1)
        # Twice the log likelihood of a displacement, with tails: turns begin suddenly.
        votes -= 2.0 * np.log1p((candidates**2).sum(axis=1) / variance_px2)
        best = int(votes.argmax())
        voting = nearest[best] < _MIDDLE_GATE
        if not voting.any():
            return nothing, 0
        chosen = distance2[best].argmin(axis=1)
        offsets = middles[np.arange(len(rows)), chosen][voting]
        weights = 1.0 / spread[np.arange(len(rows)), chosen][voting]
        shift: Floats = (weights * offsets).sum(axis=0) / weights.sum(axis=0)
        return shift, int(voting.sum())

    def _costs(self, detections: Sequence[Detection], measured: Floats, noise: Floats) -> Floats:
        """(tracks, detections): twice the negative log likelihood but for a constant; large where inadmissible."""
        tracks, settings = self._tracks, self._settings
        spread = tracks.covariance[:, None, :, 0] + noise[None, :, :]
        distance2 = ((measured[None] - tracks.place[:, None]) ** 2 / spread).sum(axis=-1)
        admissible = (distance2 <= _BOX_GATE) | (overlaps(tracks.place, measured) >= settings.least_overlap)
        costs: Floats = np.minimum(distance2, _BOX_GATE) + np.log(spread).sum(axis=-1)
        labels = np.array([detection.class_label for detection in detections], dtype=object)
        costs += settings.label_penalty * (np.array(tracks.labels, dtype=object)[:, None] != labels[None])
        costs[~admissible] = _INADMISSIBLE
        return costs

    def _begun(
        self,
        detections: Sequence[Detection],
        measured: Floats,
        noise: Floats,
        new: list[int],
        numbers: Mapping[int, int],
        *,
        compensated: bool,
    ) -> BoxTracks:
        """Tracks of the detections that continue none. They move as the others do, or stand on the ground."""
        settings, tracks = self._settings, self._tracks
        guides = (tracks.hits >= settings.confirm_hits) & (tracks.unseen_s == 0.0)
        rate = np.zeros((len(new), 4))
        speed_radps = settings.object_radps if compensated else settings.camera_radps
        if guides.any() and not compensated:
            rate[:, :2] = tracks.rate[guides, :2].mean(axis=0)
            speed_radps = settings.object_radps
        covariance = np.zeros((len(new), 4, 3))
        covariance[:, :, 0] = noise[new]
        covariance[:, :2, 2] = (speed_radps * self._focal_px) ** 2
        # A fifth of the side in a second: approaching at 12 m/s from 60 m.
        covariance[:, 2:, 2] = (0.2 * measured[new, 2:]) ** 2
        return BoxTracks(
            np.array([numbers[column] for column in new], dtype=np.int64),
            [detections[column].class_label for column in new],
            np.ones(len(new), dtype=np.int64),
            np.zeros(len(new)),
            measured[new],
            rate,
            covariance,
        )


def _checked_boxes(detections: Sequence[Detection]) -> Floats:
    """(n, 4) left, top, right, bottom. Raises ValueError where they are not."""
    boxes: Floats = np.array([detection.box for detection in detections], dtype=np.float64).reshape(-1, 4)
    # Squares and products of larger numbers would overflow.
    if not ((np.abs(boxes) <= FARTHEST_PX).all() and (boxes[:, 2:] >= boxes[:, :2]).all()):
        raise ValueError("a detection's box is not left, top, right, bottom in finite pixels, in this order")
    if not all(math.isfinite(detection.score) for detection in detections):
        raise ValueError("a detection's score is not finite")
    return boxes


def straight_boxes(lens: Lens, boxes: Floats) -> Floats:
    """(n, 4) boxes where the lens would show them without its distortion, by the middles of their edges.

    A box stays as it is where the distortion has no inverse, which is outside the picture.
    """
    left, top, right, bottom = boxes.T
    across, down = (left + right) / 2.0, (top + bottom) / 2.0
    edges = lens.straight_pixels(
        np.stack(((left, down), (across, top), (right, down), (across, bottom))).swapaxes(1, 2)
    )
    straight: Floats = np.stack((edges[0, :, 0], edges[1, :, 1], edges[2, :, 0], edges[3, :, 1]), axis=1)
    # Comparisons with NaN are false.
    usable = (straight[:, :2] <= straight[:, 2:]).all(axis=1)
    straight[~usable] = boxes[~usable]
    return straight


def ground_warp(before: Floats, after: Floats) -> Floats | None:
    """(3, 3) `KalmanTracker.name`'s warp between two pictures that see the ground by these (`ground_homography`).

    None where the ground cannot be seen: a camera on it.
    """
    # The inverse by its cofactors, because LAPACK rounds as the processor likes.
    cofactors = np.cross(before[[1, 2, 0]], before[[2, 0, 1]])
    determinant = product(before[0], cofactors[0])
    if not determinant:
        return None
    warp = product(after, cofactors.T / determinant)
    # Neither is scaled, so that the depth of a warped pixel is positive where it lies in front of the camera.
    return warp if np.isfinite(warp).all() else None


def ground_homography(
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    axes_enu: Floats,
    position_enu_m: Floats,
    height_m: float = 1.0,
) -> Floats:
    """(3, 3) takes (east, north, 1) of a place `height_m` above the ground to (u w, v w, w) in the picture.

    `axes_enu` (3, 3) has the camera's right, down and forward axes as rows. A metre high is the middle of most boxes.
    Source: R. Hartley, A. Zisserman (2003), Multiple View Geometry, section 8.1.1.
    """
    lens = np.array([[focal_px[0], 0.0, centre_px[0]], [0.0, focal_px[1], centre_px[1]], [0.0, 0.0, 1.0]])
    plane = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, height_m]])
    plane[:, 2] -= position_enu_m
    return product(product(lens, axes_enu), plane)


def middles_and_sides(boxes: Floats) -> Floats:
    """(n, 4) middle and sides of boxes that are given by their edges."""
    sides = np.maximum(boxes[:, 2:] - boxes[:, :2], LEAST_SIDE_PX)
    return np.concatenate([(boxes[:, :2] + boxes[:, 2:]) / 2.0, sides], axis=1)


def noise_px2(measured: Floats, settings: TrackerSettings, camera_px: float) -> Floats:
    """(n, 4) variances of middle and sides. Edges err independently: half of their variance in the middle, twice in the
    side."""
    edges = settings.jitter_px**2 + (settings.jitter_share * measured[:, 2:]) ** 2
    return np.concatenate([edges / 2.0 + camera_px**2, 2.0 * edges], axis=1)


def overlaps(first: Floats, second: Floats) -> Floats:
    """(n, m) intersection over union of boxes given by middle and sides."""
    halves, others = first[:, None, 2:] / 2.0, second[None, :, 2:] / 2.0
    middles, middles_of_others = first[:, None, :2], second[None, :, :2]
    shared = np.minimum(middles + halves, middles_of_others + others) - np.maximum(
        middles - halves, middles_of_others - others
    )
    area = np.maximum(shared, 0.0).prod(axis=-1)
    overlap: Floats = area / (first[:, 2:].prod(axis=1)[:, None] + second[:, 2:].prod(axis=1)[None] - area)
    return overlap


def assign(costs: Floats, tracks: Bools, detections: Bools, taken: Mapping[int, int]) -> dict[int, int]:
    """Detection -> track among these, without those taken: as many pairs as are admissible, at the least cost."""
    open_tracks, open_detections = tracks.copy(), detections.copy()
    open_tracks[list(taken.values())] = False
    open_detections[list(taken)] = False
    rows, columns = np.flatnonzero(open_tracks), np.flatnonzero(open_detections)
    if not len(rows) or not len(columns):
        return {}
    # Imported here: it takes longer to import than all else in this room, and simulated detections need no tracker.
    from scipy.optimize import linear_sum_assignment

    part = costs[np.ix_(rows, columns)]
    chosen_rows, chosen_columns = linear_sum_assignment(part)
    return {
        int(columns[column]): int(rows[row])
        for row, column in zip(chosen_rows, chosen_columns, strict=True)
        if part[row, column] < _INADMISSIBLE
    }
