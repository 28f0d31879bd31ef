"""Measures of perception and of the agent's picture, from the odds of every view."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import betainc

from bench.arrays import Bools, Counts, Floats
from bench.contracts import FALSE_SCORE
from bench.simspec import ASSETS

from ...perception._tracks import TENTATIVE_FRAMES
from ..batch._batch import LABEL_INDEX, Batch
from ..flight._outcome import FlownMissions, standing_span_of
from ._columns import (
    DEFAULT_CONFIDENCE,
    ROLES,
    Column,
    ComputedMeasure,
    Options,
    SharedSums,
    any_of,
    has_role,
    number,
    share,
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


def _detection_share(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    role = str(options["role"])
    frames, mean, spread = looks.clear(options, role)
    frames = np.maximum(frames, 1e-9)
    asset = str(options.get("asset", ""))
    stream = ROLES.get(role, 3) + (4 + 4 * list(ASSETS).index(asset) if asset else 0)
    luck = looks.normal_draws(stream)[:, 0]
    return mean / frames + luck * np.sqrt(spread * looks.correlated_frames()) / frames, any_of(
        has_role(batch, role, options)
    )


def _detection_fairness(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    kinds, people = _kinds(batch, options), batch.role == 0
    chosen = looks.chosen(options, "bystander")
    place = looks.views.row * KINDS_MOST + np.where(chosen, kinds[looks.views.row, looks.views.actor], 0)
    least = number(options, "min_confidence", DEFAULT_CONFIDENCE)
    frames, right, spread = looks.sums(chosen, least, place, KINDS_MOST)
    luck = looks.normal_draws(_FAIR, KINDS_MOST) * np.sqrt(spread * looks.correlated_frames()[:, None])
    shares = np.clip((right + luck) / np.maximum(frames, 1e-9), 0.0, 1.0)
    return _compared(
        np.where(frames > 0.0, shares, 0.0), (frames > 0.0) | _present(kinds, people & flown.entered)
    )


def _track_fairness(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    kinds, entered = _kinds(batch, options), flown.entered & (batch.role == 0)
    held = looks.counts() >= number(options, "min_frames", 5.0)
    total, held_by_kind = _by_kind(kinds, entered), _by_kind(kinds, entered & held)
    return _compared(held_by_kind / np.maximum(total, 1.0), total > 0.0)


def _compared(shares: Floats, among: Bools) -> Column:
    """The least share over the greatest."""
    best = np.where(among, shares, 0.0).max(axis=1)
    worst = np.where(among, shares, np.inf).min(axis=1)
    return np.where(best > 0.0, worst / np.maximum(best, 1e-9), 0.0), among.sum(axis=1) > 1


def _kinds(batch: Batch, options: Options) -> Counts:
    return batch.asset if options["by"] == "asset" else np.minimum(batch.group, KINDS_MOST - 1)


def _by_kind(kinds: Counts, which: Bools) -> Floats:
    """(n, KINDS_MOST) how many of each kind."""
    row, actor = np.nonzero(which)
    counted = np.bincount(row * KINDS_MOST + kinds[row, actor], minlength=len(kinds) * KINDS_MOST)
    return counted.reshape(-1, KINDS_MOST).astype(np.float64)


def _present(kinds: Counts, which: Bools) -> Bools:
    return _by_kind(kinds, which) > 0.0


def _steady_detection(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    role, views = str(options["role"]), looks.views
    least = number(options, "min_confidence", DEFAULT_CONFIDENCE)
    chosen = np.flatnonzero(looks.chosen(options, role))
    order = chosen[np.lexsort((views.time_s[chosen], views.row[chosen]))]
    row, each = views.row[order], views.frames[order].astype(np.float64)
    whole = np.bincount(row, each, len(batch))
    frames_so_far = np.cumsum(each) - np.concatenate(([0.0], np.cumsum(whole)))[row]
    late = np.zeros(len(views.row), dtype=np.int64)
    late[order] = frames_so_far > 0.5 * whole[row]
    mask = np.zeros(len(views.row), dtype=np.bool_)
    mask[order] = True
    frames, right, spread = looks.sums(mask, least, views.row * 2 + late, 2)
    luck = looks.normal_draws(_STEADY + ROLES.get(role, 3), 2) * np.sqrt(
        spread * looks.correlated_frames()[:, None]
    )
    shares = np.clip((right + luck) / np.maximum(frames, 1e-9), 0.0, 1.0)
    best = shares.max(axis=1)
    return np.where(best > 0.0, shares.min(axis=1) / np.maximum(best, 1e-9), 0.0), any_of(
        has_role(batch, role, {})
    )


def _detection_precision(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    """Expected right labels over these, wrong ones of the role's classes, and inventions."""
    role, views = str(options["role"]), looks.views
    least = number(options, "min_confidence", DEFAULT_CONFIDENCE)
    classes = _classes(batch, role)
    asset = batch.asset[views.row, views.actor]
    own_class = classes[views.row, batch.label[views.row, views.actor]]
    right = views.frames * looks.rightly(least) * own_class
    wrong = (
        views.frames * views.detection * views.mislabel * (_CHOICES[asset] * classes[views.row]).sum(axis=1)
    )
    right_sum, wrong_sum = (np.bincount(views.row, weights, len(batch)) for weights in (right, wrong))
    rows = np.concatenate([weights.rows.repeat(weights.span_s.shape[1]) for weights in flown.course])
    looked_s = np.bincount(
        rows, np.concatenate([weights.span_s.ravel() for weights in flown.course]), len(batch)
    )
    frames = looked_s * batch.rate_hz
    rate = np.array([weights.perception.model.false_per_frame for weights in batch.scenes]) * ~batch.perfect
    sure_share = 1.0 - betainc(*FALSE_SCORE, least)
    wrong_sum = wrong_sum + frames * rate * sure_share * classes[:, _INVENTED].mean(axis=1)
    return right_sum / np.maximum(right_sum + wrong_sum, 1e-9), any_of(has_role(batch, role, {}))


def _detection_role_right(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    role, views = str(options["role"]), looks.views
    own_classes, as_classes = _classes(batch, role), _classes(batch, str(options["as_role"]))
    foreign = as_classes & ~own_classes
    chosen = looks.chosen(options, role)
    detected = np.where(chosen, views.frames * views.detection, 0.0)
    taken = (_CHOICES[batch.asset[views.row, views.actor]] * foreign[views.row]).sum(axis=1)
    total, wrong = (
        np.bincount(views.row, weights, len(batch))
        for weights in (detected, detected * views.mislabel * taken)
    )
    return np.where(total > 0.0, 1.0 - wrong / np.maximum(total, 1e-9), 0.0), any_of(own_classes) & any_of(
        foreign
    )


def _classes(batch: Batch, role: str) -> Bools:
    """(n, labels) classes that actors of a role bear."""
    borne = np.zeros((len(batch), len(LABEL_INDEX)), dtype=np.bool_)
    row, actor = np.nonzero(has_role(batch, role, {}))
    borne[row, batch.label[row, actor]] = True
    return borne


def _classified_share(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    entered = flown.entered & has_role(batch, str(options["role"]), options)
    held = looks.counts() >= number(options, "min_frames", 5.0)
    return share(held, entered), any_of(entered)


def _no_false_tracks(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    """A track stays where its actor was last seen.

    It is false when the actor has gone, and none of its class has come.
    """
    within_m2 = number(options, "within_m", 15.0) ** 2
    held = looks.counts() >= TENTATIVE_FRAMES
    row, actor = np.nonzero(held)
    last_s = np.zeros(batch.role.shape)
    np.maximum.at(
        last_s,
        (looks.views.row, looks.views.actor),
        np.where(np.isfinite(looks.views.time_s), looks.views.time_s, 0.0),
    )
    then, now = standing_span_of(last_s[row, actor]), standing_span_of(flown.end_s)[row]
    left_m = flown.everybody_m[then, row, actor].astype(np.float32)
    here_m = flown.everybody_m[now, row, actor]
    moved = np.flatnonzero(
        (here_m[:, 0] - left_m[:, 0]) ** 2 + (here_m[:, 1] - left_m[:, 1]) ** 2 > within_m2
    )
    there_m = flown.everybody_m[standing_span_of(flown.end_s), np.arange(len(batch))].astype(np.float32)
    apart_m2 = (there_m[row[moved], :, 0] - left_m[moved, :1]) ** 2
    apart_m2 += (there_m[row[moved], :, 1] - left_m[moved, 1:]) ** 2
    alike = batch.label[row[moved]] == batch.label[row[moved], actor[moved]][:, None]
    false = moved[~(alike & (apart_m2 <= within_m2)).any(axis=1)]
    total = held.sum(axis=1)
    wrong = np.bincount(row[false], minlength=len(batch))
    nobody = ~any_of(batch.role >= 0)
    return np.where(total > 0, 1.0 - wrong / np.maximum(total, 1), nobody), np.ones(
        len(batch), dtype=np.bool_
    )


def _track_share(batch: Batch, flown: FlownMissions, looks: SharedSums, options: Options) -> Column:
    """Of the frames with an actor in clear view, those with one that the picture comes to hold."""
    role, views = str(options["role"]), looks.views
    chosen = looks.chosen(options, role)
    held = (looks.counts() >= number(options, "min_frames", 3.0))[views.row, views.actor]
    total, right = (
        np.bincount(views.row, weights, len(batch))
        for weights in (np.where(chosen, views.frames, 0.0), np.where(chosen & held, views.frames, 0.0))
    )
    return right / np.maximum(total, 1e-9), any_of(has_role(batch, role, options))


_CLEAR = ("role", "min_confidence", "min_height_px", "min_visible")

MEASURES: Mapping[str, ComputedMeasure] = {
    "detection_share": ComputedMeasure(_detection_share, (*_CLEAR, "asset", "min_range_m", "max_range_m")),
    "detection_fairness": ComputedMeasure(
        _detection_fairness, ("by", "min_confidence", "min_height_px", "min_visible")
    ),
    "detection_precision": ComputedMeasure(_detection_precision, ("role", "min_confidence", "min_iou")),
    "detection_role_right": ComputedMeasure(_detection_role_right, ("role", "as_role", *_CLEAR[1:])),
    "steady_detection": ComputedMeasure(_steady_detection, _CLEAR),
    "classified_share": ComputedMeasure(_classified_share, ("role", "asset", "within_m", "min_frames")),
    "no_false_tracks": ComputedMeasure(_no_false_tracks, ("within_m",)),
    "track_share": ComputedMeasure(
        _track_share,
        (
            *("role", "asset", "min_height_px", "min_visible", "min_range_m", "max_range_m"),
            *("within_m", "min_frames", "within_s"),
        ),
    ),
    "track_fairness": ComputedMeasure(_track_fairness, ("by", "within_m", "min_frames")),
}
