"""Measures of perception and of the agent's picture, from the odds of every view."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import betainc

from bench.arrays import Bools, Counts, Floats
from bench.contracts import FALSE_SCORE
from bench.simspec import ASSETS

from ...perception._tracks import TENTATIVE_FRAMES
from ..batch._batch import LABEL_INDEX
from ..flight._outcome import standing_span_of
from ._columns import (
    ROLES,
    Column,
    ComputedMeasure,
    Flights,
    Options,
    any_of,
    least_of_greatest,
    number,
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


def _detection_share(flights: Flights, options: Options) -> Column:
    role, asset = str(options["role"]), str(options.get("asset", ""))
    stream = ROLES.get(role, 3) + (4 + 4 * list(ASSETS).index(asset) if asset else 0)
    whole = np.zeros(len(flights.views.row), dtype=np.int64)
    shares, _ = flights.lucky_shares(flights.chosen(options, role), options, whole, 1, stream)
    return shares[:, 0], any_of(flights.has_role(role, options))


def _detection_fairness(flights: Flights, options: Options) -> Column:
    kinds, views = _kinds(flights, options), flights.views
    chosen = flights.chosen(options, "bystander")
    kind = np.where(chosen, kinds[views.row, views.actor], 0)
    shares, seen = flights.lucky_shares(chosen, options, kind, KINDS_MOST, _FAIR)
    entered = _by_kind(kinds, (flights.batch.role == 0) & flights.flown.entered)
    return _compared(shares, seen | (entered > 0.0))


def _track_fairness(flights: Flights, options: Options) -> Column:
    kinds, entered = _kinds(flights, options), flights.flown.entered & (flights.batch.role == 0)
    held = flights.counts >= number(options, "min_frames", 5.0)
    total, held_by_kind = _by_kind(kinds, entered), _by_kind(kinds, entered & held)
    return _compared(held_by_kind / np.maximum(total, 1.0), total > 0.0)


def _compared(shares: Floats, among: Bools) -> Column:
    return least_of_greatest(np.where(among, shares, np.nan)), among.sum(axis=1) > 1


def _kinds(flights: Flights, options: Options) -> Counts:
    batch = flights.batch
    return batch.asset if options["by"] == "asset" else np.minimum(batch.group, KINDS_MOST - 1)


def _by_kind(kinds: Counts, which: Bools) -> Floats:
    """(n, KINDS_MOST) how many of each kind."""
    row, actor = np.nonzero(which)
    counted = np.bincount(row * KINDS_MOST + kinds[row, actor], minlength=len(kinds) * KINDS_MOST)
    return counted.reshape(-1, KINDS_MOST).astype(np.float64)


def _steady_detection(flights: Flights, options: Options) -> Column:
    """The worse half of the frames over the better one."""
    role, views = str(options["role"]), flights.views
    chosen = flights.chosen(options, role)
    at = np.flatnonzero(chosen)
    order = at[np.lexsort((views.time_s[at], views.row[at]))]
    row, each = views.row[order], views.frames[order].astype(np.float64)
    whole = np.bincount(row, each, len(flights.batch))
    frames_so_far = np.cumsum(each) - np.concatenate(([0.0], np.cumsum(whole)))[row]
    late = np.zeros(len(views.row), dtype=np.int64)
    late[order] = frames_so_far > 0.5 * whole[row]
    shares, _ = flights.lucky_shares(chosen, options, late, 2, _STEADY + ROLES.get(role, 3))
    return least_of_greatest(shares), any_of(flights.has_role(role, {}))


def _detection_precision(flights: Flights, options: Options) -> Column:
    """Expected right labels over these, wrong ones of the role's classes, and inventions."""
    batch, views, role = flights.batch, flights.views, str(options["role"])
    least = number(options, "min_confidence", 0.35)
    classes = _classes(flights, role)
    own_class = classes[views.row, batch.label[views.row, views.actor]]
    right = flights.total(views.frames * flights.rightly(least) * own_class)
    wrong = flights.total(views.frames * views.detection * views.mislabel * _taken_for(flights, classes))
    looked_s = np.zeros(len(batch))
    for stretch in flights.flown.course:
        looked_s[stretch.rows] += stretch.span_s.sum(axis=1)
    models = [scene.perception.model for scene in batch.scenes]
    rate = np.array([model.false_per_frame for model in models]) * ~batch.perfect
    sure_share = 1.0 - betainc(*FALSE_SCORE, least)
    invented = looked_s * batch.rate_hz * rate * sure_share * classes[:, _INVENTED].mean(axis=1)
    return right / np.maximum(right + wrong + invented, 1e-9), any_of(flights.has_role(role, {}))


def _detection_role_right(flights: Flights, options: Options) -> Column:
    role, views = str(options["role"]), flights.views
    own_classes = _classes(flights, role)
    foreign = _classes(flights, str(options["as_role"])) & ~own_classes
    detected = np.where(flights.chosen(options, role), views.frames * views.detection, 0.0)
    total, wrong = (
        flights.total(detected),
        flights.total(detected * views.mislabel * _taken_for(flights, foreign)),
    )
    right_share = np.where(total > 0.0, 1.0 - wrong / np.maximum(total, 1e-9), 0.0)
    return right_share, any_of(own_classes) & any_of(foreign)


def _taken_for(flights: Flights, classes: Bools) -> Floats:
    """Of the wrong labels of each view, the share in these classes (n, labels)."""
    views = flights.views
    taken: Floats = (_CHOICES[flights.batch.asset[views.row, views.actor]] * classes[views.row]).sum(axis=1)
    return taken


def _classes(flights: Flights, role: str) -> Bools:
    """(n, labels) classes that actors of a role bear."""
    borne = np.zeros((len(flights.batch), len(LABEL_INDEX)), dtype=np.bool_)
    row, actor = np.nonzero(flights.has_role(role, {}))
    borne[row, flights.batch.label[row, actor]] = True
    return borne


def _classified_share(flights: Flights, options: Options) -> Column:
    entered = flights.flown.entered & flights.has_role(str(options["role"]), options)
    return share_of(flights.counts >= number(options, "min_frames", 5.0), entered)


def _no_false_tracks(flights: Flights, options: Options) -> Column:
    """A track stays where its actor was last seen.

    It is false when the actor has gone, and none of its class has come.
    """
    batch, flown, views = flights.batch, flights.flown, flights.views
    within_m2 = number(options, "within_m", 15.0) ** 2
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
    return np.where(total > 0, 1.0 - wrong / np.maximum(total, 1), nobody), flights.always()


def _track_share(flights: Flights, options: Options) -> Column:
    """Of the frames with an actor in clear view, those with one that the picture comes to hold."""
    role, views = str(options["role"]), flights.views
    frames = np.where(flights.chosen(options, role), views.frames, 0.0)
    held = (flights.counts >= number(options, "min_frames", 3.0))[views.row, views.actor]
    right, total = flights.total(np.where(held, frames, 0.0)), flights.total(frames)
    return right / np.maximum(total, 1e-9), any_of(flights.has_role(role, options))


_CLEAR = ("role", "min_confidence", "min_height_px", "min_visible")
_TRACKED = ("asset", "within_m", "min_frames")
_RANGE = ("min_range_m", "max_range_m")

MEASURES: Mapping[str, ComputedMeasure] = {
    "detection_share": (_detection_share, (*_CLEAR, "asset", *_RANGE)),
    "detection_fairness": (_detection_fairness, ("by", *_CLEAR[1:])),
    "detection_precision": (_detection_precision, ("role", "min_confidence", "min_iou")),
    "detection_role_right": (_detection_role_right, ("as_role", *_CLEAR)),
    "steady_detection": (_steady_detection, _CLEAR),
    "classified_share": (_classified_share, ("role", *_TRACKED)),
    "no_false_tracks": (_no_false_tracks, ("within_m",)),
    "track_share": (
        _track_share,
        ("role", *_TRACKED, "min_height_px", "min_visible", *_RANGE, "within_s"),
    ),
    "track_fairness": (_track_fairness, ("by", "within_m", "min_frames")),
}
