"""Measures of perception and of the agent's picture, from the odds of every view."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import betainc

from bench.arrays import Bools, Counts, Floats
from bench.contracts import FALSE_SCORE
from bench.simspec import ASSETS

from ...perception._tracks import TENTATIVE_FRAMES
from ..batch._batch import LABEL, Batch
from ..flight._outcome import Flown, epoch_of
from ._columns import ROLES, USUAL_CONFIDENCE, Column, Computed, Looks, Options, has_role, number, share, some

KINDS_MOST = 64
_FAIR = 64
_STEADY = 96

_CHOICES = np.zeros((len(ASSETS), len(LABEL)))
"""Share of an asset's wrong labels that is each class."""

for _index, _asset in enumerate(ASSETS.values()):
    for _label in _asset.confused_with:
        _CHOICES[_index, LABEL[_label]] += 1.0 / len(_asset.confused_with)

_INVENTED = sorted({LABEL[_asset.class_label] for _asset in ASSETS.values() if _asset.possible_false_alarm})


def _detection_share(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    role = str(options["role"])
    frames, mean, spread = looks.clear(options, role)
    frames = np.maximum(frames, 1e-9)
    asset = str(options.get("asset", ""))
    stream = ROLES.get(role, 3) + (4 + 4 * list(ASSETS).index(asset) if asset else 0)
    luck = looks.luck(stream)[:, 0]
    return mean / frames + luck * np.sqrt(spread * looks.together()) / frames, some(has_role(batch, role, options))


def _detection_fairness(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    kinds, people = _kinds(batch, options), batch.role == 0
    chosen = looks.chosen(options, "bystander")
    place = looks.views.row * KINDS_MOST + np.where(chosen, kinds[looks.views.row, looks.views.actor], 0)
    least = number(options, "min_confidence", USUAL_CONFIDENCE)
    frames, right, spread = looks.sums(chosen, least, place, KINDS_MOST)
    luck = looks.luck(_FAIR, KINDS_MOST) * np.sqrt(spread * looks.together()[:, None])
    shares = np.clip((right + luck) / np.maximum(frames, 1e-9), 0.0, 1.0)
    return _compared(np.where(frames > 0.0, shares, 0.0), (frames > 0.0) | _present(kinds, people & flown.entered))


def _track_fairness(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    kinds, entered = _kinds(batch, options), flown.entered & (batch.role == 0)
    held = looks.counts() >= number(options, "min_frames", 5.0)
    total, good = _by_kind(kinds, entered), _by_kind(kinds, entered & held)
    return _compared(good / np.maximum(total, 1.0), total > 0.0)


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


def _steady_detection(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    role, views = str(options["role"]), looks.views
    least = number(options, "min_confidence", USUAL_CONFIDENCE)
    chosen = np.flatnonzero(looks.chosen(options, role))
    order = chosen[np.lexsort((views.time_s[chosen], views.row[chosen]))]
    row, each = views.row[order], views.frames[order].astype(np.float64)
    whole = np.bincount(row, each, len(batch))
    so_far = np.cumsum(each) - np.concatenate(([0.0], np.cumsum(whole)))[row]
    late = np.zeros(len(views.row), dtype=np.int64)
    late[order] = so_far > 0.5 * whole[row]
    mask = np.zeros(len(views.row), dtype=np.bool_)
    mask[order] = True
    frames, right, spread = looks.sums(mask, least, views.row * 2 + late, 2)
    luck = looks.luck(_STEADY + ROLES.get(role, 3), 2) * np.sqrt(spread * looks.together()[:, None])
    shares = np.clip((right + luck) / np.maximum(frames, 1e-9), 0.0, 1.0)
    best = shares.max(axis=1)
    return np.where(best > 0.0, shares.min(axis=1) / np.maximum(best, 1e-9), 0.0), some(has_role(batch, role, {}))


def _detection_precision(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    """Expected right labels over these, wrong ones of the role's classes, and inventions."""
    role, views = str(options["role"]), looks.views
    least = number(options, "min_confidence", USUAL_CONFIDENCE)
    classes = _classes(batch, role)
    asset = batch.asset[views.row, views.actor]
    own = classes[views.row, batch.label[views.row, views.actor]]
    right = views.frames * looks.rightly(least) * own
    wrong = views.frames * views.detection * views.mislabel * (_CHOICES[asset] * classes[views.row]).sum(axis=1)
    good, bad = (np.bincount(views.row, one, len(batch)) for one in (right, wrong))
    rows = np.concatenate([one.rows.repeat(one.span_s.shape[1]) for one in flown.course])
    looked_s = np.bincount(rows, np.concatenate([one.span_s.ravel() for one in flown.course]), len(batch))
    frames = looked_s * batch.rate_hz
    rate = np.array([one.perception.model.false_per_frame for one in batch.scenes]) * ~batch.perfect
    sure = 1.0 - betainc(*FALSE_SCORE, least)
    bad = bad + frames * rate * sure * classes[:, _INVENTED].mean(axis=1)
    return good / np.maximum(good + bad, 1e-9), some(has_role(batch, role, {}))


def _detection_role_right(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    role, views = str(options["role"]), looks.views
    own, other = _classes(batch, role), _classes(batch, str(options["as_role"]))
    foreign = other & ~own
    chosen = looks.chosen(options, role)
    had = np.where(chosen, views.frames * views.detection, 0.0)
    taken = (_CHOICES[batch.asset[views.row, views.actor]] * foreign[views.row]).sum(axis=1)
    total, wrong = (np.bincount(views.row, one, len(batch)) for one in (had, had * views.mislabel * taken))
    return np.where(total > 0.0, 1.0 - wrong / np.maximum(total, 1e-9), 0.0), some(own) & some(foreign)


def _classes(batch: Batch, role: str) -> Bools:
    """(n, labels) classes that actors of a role bear."""
    found = np.zeros((len(batch), len(LABEL)), dtype=np.bool_)
    row, actor = np.nonzero(has_role(batch, role, {}))
    found[row, batch.label[row, actor]] = True
    return found


def _classified_share(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    asked = flown.entered & has_role(batch, str(options["role"]), options)
    held = looks.counts() >= number(options, "min_frames", 5.0)
    return share(held, asked), some(asked)


def _no_false_tracks(batch: Batch, flown: Flown, looks: Looks, options: Options) -> Column:
    """A track stays where its actor was last seen. It is false when the actor has gone, and none of its class has come."""
    within_m2 = number(options, "within_m", 15.0) ** 2
    held = looks.counts() >= TENTATIVE_FRAMES
    row, actor = np.nonzero(held)
    last_s = np.zeros(batch.role.shape)
    np.maximum.at(
        last_s, (looks.views.row, looks.views.actor), np.where(np.isfinite(looks.views.time_s), looks.views.time_s, 0.0)
    )
    then, now = epoch_of(last_s[row, actor]), epoch_of(flown.end_s)[row]
    left_m = flown.everybody_m[then, row, actor].astype(np.float32)
    here_m = flown.everybody_m[now, row, actor]
    moved = np.flatnonzero((here_m[:, 0] - left_m[:, 0]) ** 2 + (here_m[:, 1] - left_m[:, 1]) ** 2 > within_m2)
    there_m = flown.everybody_m[epoch_of(flown.end_s), np.arange(len(batch))].astype(np.float32)
    apart_m2 = (there_m[row[moved], :, 0] - left_m[moved, :1]) ** 2
    apart_m2 += (there_m[row[moved], :, 1] - left_m[moved, 1:]) ** 2
    alike = batch.label[row[moved]] == batch.label[row[moved], actor[moved]][:, None]
    false = moved[~(alike & (apart_m2 <= within_m2)).any(axis=1)]
    total = held.sum(axis=1)
    wrong = np.bincount(row[false], minlength=len(batch))
    nobody = ~some(batch.role >= 0)
    return np.where(total > 0, 1.0 - wrong / np.maximum(total, 1), nobody), np.ones(len(batch), dtype=np.bool_)


_CLEAR = ("role", "min_confidence", "min_height_px", "min_visible")

MEASURES: Mapping[str, Computed] = {
    "detection_share": Computed(_detection_share, (*_CLEAR, "asset", "min_range_m", "max_range_m")),
    "detection_fairness": Computed(_detection_fairness, ("by", "min_confidence", "min_height_px", "min_visible")),
    "detection_precision": Computed(_detection_precision, ("role", "min_confidence", "min_iou")),
    "detection_role_right": Computed(_detection_role_right, ("role", "as_role", *_CLEAR[1:])),
    "steady_detection": Computed(_steady_detection, _CLEAR),
    "classified_share": Computed(_classified_share, ("role", "asset", "within_m", "min_frames")),
    "no_false_tracks": Computed(_no_false_tracks, ("within_m",)),
    "track_fairness": Computed(_track_fairness, ("by", "within_m", "min_frames")),
}
