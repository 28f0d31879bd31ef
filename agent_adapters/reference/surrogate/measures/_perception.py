"""Measures of perception and of the agent's picture, from the odds of every view."""

from __future__ import annotations

import numpy as np
from scipy.special import betainc

from bench.arrays import Bools, Counts, Floats
from bench.contracts import FALSE_SCORE
from bench.simspec import ASSETS

from ...perception._tracks import TENTATIVE_FRAMES
from ..batch._batch import ASSET_INDEX, LABEL_INDEX, NO_ASSET, standing_span_of
from ._columns import (
    FARTHEST_M,
    LEAST_CONFIDENCE,
    LEAST_PX,
    ROLES,
    Column,
    Flights,
    any_of,
    least_of_greatest,
    share_of,
)

KINDS_MOST = 64
_FAIR = 64
_STEADY = 96

_CHOICES = np.zeros((len(ASSETS), len(LABEL_INDEX)))
"""Share of an asset's wrong labels that is each class."""

for _index, _asset in enumerate(ASSETS.values()):
    for _label in _asset.confused_with:
        _CHOICES[_index, LABEL_INDEX[_label]] += 1.0 / len(_asset.confused_with)

_INVENTED = sorted(
    {LABEL_INDEX[_asset.class_label] for _asset in ASSETS.values() if _asset.possible_false_alarm}
)


def detection_share(
    flights: Flights,
    *,
    role: str,
    asset: str = "",
    min_confidence: float = LEAST_CONFIDENCE,
    min_height_px: float = LEAST_PX,
    min_range_m: float = 0.0,
    max_range_m: float = FARTHEST_M,
) -> Column:
    stream = ROLES.get(role, 3) + (4 + 4 * ASSET_INDEX.get(asset, NO_ASSET) if asset else 0)
    whole = np.zeros(len(flights.views.row), dtype=np.int64)
    chosen = flights.chosen(role, asset, min_height_px, min_range_m, max_range_m)
    shares, _ = flights.lucky_shares(chosen, min_confidence, whole, 1, stream)
    return shares[:, 0], any_of(flights.has_role(role, asset))


def detection_fairness(
    flights: Flights, *, by: str, min_confidence: float = LEAST_CONFIDENCE, min_height_px: float = LEAST_PX
) -> Column:
    kinds, views = _kinds(flights, by), flights.views
    chosen = flights.chosen("bystander", min_height_px=min_height_px)
    kind = np.where(chosen, kinds[views.row, views.actor], 0)
    shares, seen = flights.lucky_shares(chosen, min_confidence, kind, KINDS_MOST, _FAIR)
    entered = _by_kind(kinds, (flights.batch.role == 0) & flights.entered)
    return _compared(shares, seen | (entered > 0.0))


def track_fairness(flights: Flights, *, by: str, min_frames: float = 5.0) -> Column:
    kinds, entered = _kinds(flights, by), flights.entered & (flights.batch.role == 0)
    held = flights.counts >= min_frames
    total, held_by_kind = _by_kind(kinds, entered), _by_kind(kinds, entered & held)
    return _compared(held_by_kind / np.maximum(total, 1.0), total > 0.0)


def _compared(shares: Floats, among: Bools) -> Column:
    return least_of_greatest(np.where(among, shares, np.nan)), among.sum(axis=1) > 1


def _kinds(flights: Flights, by: str) -> Counts:
    batch = flights.batch
    return batch.asset if by == "asset" else np.minimum(batch.group, KINDS_MOST - 1)


def _by_kind(kinds: Counts, which: Bools) -> Floats:
    """(n, KINDS_MOST) how many of each kind."""
    row, actor = np.nonzero(which)
    counted = np.bincount(row * KINDS_MOST + kinds[row, actor], minlength=len(kinds) * KINDS_MOST)
    return counted.reshape(-1, KINDS_MOST).astype(np.float64)


def steady_detection(
    flights: Flights, *, role: str, min_confidence: float = LEAST_CONFIDENCE, min_height_px: float = LEAST_PX
) -> Column:
    """The worse half of the frames over the better one."""
    views, chosen = flights.views, flights.chosen(role, min_height_px=min_height_px)
    at = np.flatnonzero(chosen)
    order = at[np.lexsort((views.time_s[at], views.row[at]))]
    row, each = views.row[order], views.frames[order].astype(np.float64)
    whole = np.bincount(row, each, len(flights.batch))
    frames_so_far = np.cumsum(each) - np.concatenate(([0.0], np.cumsum(whole)))[row]
    late = np.zeros(len(views.row), dtype=np.int64)
    late[order] = frames_so_far > 0.5 * whole[row]
    shares, _ = flights.lucky_shares(chosen, min_confidence, late, 2, _STEADY + ROLES.get(role, 3))
    return least_of_greatest(shares), any_of(flights.has_role(role))


def detection_precision(flights: Flights, *, role: str, min_confidence: float = LEAST_CONFIDENCE) -> Column:
    """Expected right labels over these, wrong ones of the role's classes, and inventions."""
    batch, views = flights.batch, flights.views
    classes = _classes(flights, role)
    own_class = classes[views.row, batch.label[views.row, views.actor]]
    right = flights.total(views.frames * flights.rightly(min_confidence) * own_class)
    wrong = flights.total(views.frames * views.detection * views.mislabel * _taken_for(flights, classes))
    looked_s = np.zeros(len(batch))
    for stretch in flights.flown.course:
        looked_s[stretch.rows] += stretch.span_s.sum(axis=1)
    rate = np.array([scene.perception.model.false_per_frame for scene in batch.scenes]) * ~batch.perfect
    sure_share = 1.0 - betainc(*FALSE_SCORE, min_confidence)
    invented = looked_s * batch.rate_hz * rate * sure_share * classes[:, _INVENTED].mean(axis=1)
    return right / np.maximum(right + wrong + invented, 1e-9), any_of(flights.has_role(role))


def detection_role_right(
    flights: Flights, *, role: str, as_role: str, min_height_px: float = LEAST_PX
) -> Column:
    views, own_classes = flights.views, _classes(flights, role)
    foreign = _classes(flights, as_role) & ~own_classes
    chosen = flights.chosen(role, min_height_px=min_height_px)
    detected = np.where(chosen, views.frames * views.detection, 0.0)
    total = flights.total(detected)
    wrong = flights.total(detected * views.mislabel * _taken_for(flights, foreign))
    right_share = np.where(total > 0.0, 1.0 - wrong / np.maximum(total, 1e-9), 0.0)
    return right_share, any_of(own_classes) & any_of(foreign)


def _taken_for(flights: Flights, classes: Bools) -> Floats:
    """Of the wrong labels of each view, the share in these classes (n, labels)."""
    views = flights.views
    return np.asarray(
        (_CHOICES[flights.batch.asset[views.row, views.actor]] * classes[views.row]).sum(axis=1)
    )


def _classes(flights: Flights, role: str) -> Bools:
    """(n, labels) classes that actors of a role bear."""
    borne = np.zeros((len(flights.batch), len(LABEL_INDEX)), dtype=np.bool_)
    row, actor = np.nonzero(flights.has_role(role))
    borne[row, flights.batch.label[row, actor]] = True
    return borne


def classified_share(flights: Flights, *, role: str, asset: str = "", min_frames: float = 5.0) -> Column:
    entered = flights.entered & flights.has_role(role, asset)
    return share_of(flights.counts >= min_frames, entered)


def no_false_tracks(flights: Flights, *, within_m: float = 15.0) -> Column:
    """A track stays where its actor was last seen.

    It is false when the actor has gone, and none of its class has come.
    """
    batch, flown, views = flights.batch, flights.flown, flights.views
    within_m2 = within_m**2
    held = flights.counts >= TENTATIVE_FRAMES
    row, actor = np.nonzero(held)
    last_s = np.zeros(batch.role.shape)
    seen_s = np.where(np.isfinite(views.time_s), views.time_s, 0.0)
    np.maximum.at(last_s, (views.row, views.actor), seen_s)
    now = standing_span_of(flown.end_s)
    left_m = flown.everybody_m[standing_span_of(last_s[row, actor]), row, actor].astype(np.float32)
    here_m = flown.everybody_m[now[row], row, actor]
    moved = np.flatnonzero(
        (here_m[:, 0] - left_m[:, 0]) ** 2 + (here_m[:, 1] - left_m[:, 1]) ** 2 > within_m2
    )
    there_m = flown.everybody_m[now, np.arange(len(batch))].astype(np.float32)
    apart_m2 = (there_m[row[moved], :, 0] - left_m[moved, :1]) ** 2
    apart_m2 += (there_m[row[moved], :, 1] - left_m[moved, 1:]) ** 2
    alike = batch.label[row[moved]] == batch.label[row[moved], actor[moved]][:, None]
    false = moved[~(alike & (apart_m2 <= within_m2)).any(axis=1)]
    total, wrong = held.sum(axis=1), np.bincount(row[false], minlength=len(batch))
    nobody = ~any_of(batch.role >= 0)
    return np.where(total > 0, 1.0 - wrong / np.maximum(total, 1), nobody), flights.always


def track_share(
    flights: Flights,
    *,
    role: str,
    asset: str = "",
    min_frames: float = 3.0,
    min_height_px: float = LEAST_PX,
    min_range_m: float = 0.0,
    max_range_m: float = FARTHEST_M,
) -> Column:
    """Of the frames with an actor in clear view, those with one that the picture comes to hold."""
    views = flights.views
    chosen = flights.chosen(role, asset, min_height_px, min_range_m, max_range_m)
    frames = np.where(chosen, views.frames, 0.0)
    held = (flights.counts >= min_frames)[views.row, views.actor]
    right, total = flights.total(np.where(held, frames, 0.0)), flights.total(frames)
    return right / np.maximum(total, 1e-9), any_of(flights.has_role(role, asset))
