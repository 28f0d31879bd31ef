"""Observations of a batch: for each observable of a decomposition one value a mission, as its measure would define it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.contracts import Evidence, Observation, Option

from ._batch import Batch, Bools
from ._draws import Floats, normal
from ._mission import Flown, counts, fly
from ._views import Views, rightly

Asked = Mapping[str, tuple[str, Mapping[str, Option]]]
"""Measure and options of every observable."""

CHUNK = 192
"""Missions flown at once, which bounds the memory."""

MARGIN_M = 15.0
USUAL_CONFIDENCE = 0.35
_LUCK_SHARE = 5000
_ROLES = {"bystander": 0, "adversary": 1, "clutter": 2}
_DIGITS = 9

Column = tuple[Floats, Bools]
"""Value and consideration of one observable in every mission."""


class _Looks:
    """Sums over the views of a batch, each made once for all observables that ask for it."""

    def __init__(self, batch: Batch, views: Views) -> None:
        self._batch = batch
        self._views = views
        self._place = views.row * len(_ROLES) + batch.role[views.row, views.actor]
        self._clear: dict[tuple[float, float], tuple[Floats, Floats, Floats]] = {}
        self._counts: Floats | None = None

    def clear(self, least_px: float, least: float) -> tuple[Floats, Floats, Floats]:
        """(n, roles) frames with an actor in clear view, those expected to hold it rightly, and their variance, one by one."""
        if (least_px, least) not in self._clear:
            chance = rightly(self._views, least)
            frames = np.where(self._views.height_px >= least_px, self._views.frames, 0.0)
            right = frames * chance
            self._clear[least_px, least] = self._sum(frames), self._sum(right), self._sum(right * (1.0 - chance))
        return self._clear[least_px, least]

    def counts(self) -> Floats:
        """(n, a) in how many frames each actor was had rightly."""
        if self._counts is None:
            self._counts = counts(self._batch, self._views, rightly(self._views))
        return self._counts

    def _sum(self, weights: Floats) -> Floats:
        sums = np.bincount(self._place, weights, len(self._batch) * len(_ROLES))
        return np.asarray(sums, dtype=np.float64).reshape(-1, len(_ROLES))


@dataclass(frozen=True, slots=True)
class Observed:
    """`x` and `considered` are (n, observables), in the order asked; `missing` are those that the overhead simulation cannot compute."""

    observables: tuple[str, ...]
    missing: tuple[str, ...]
    x: Floats
    considered: Bools
    end_s: Floats

    def of(self, row: int) -> tuple[Observation, ...]:
        """The observations of one mission, as the scorer takes them."""
        return tuple(self._one(row, index, name) for index, name in enumerate(self.observables))

    def _one(self, row: int, index: int, name: str) -> Observation:
        if self.considered[row, index]:
            return Observation(observable=name, considered=True, x=float(self.x[row, index]))
        lacks = name in self.missing
        text = "the overhead simulation cannot compute it" if lacks else "nothing in the situation exercises it"
        return Observation(observable=name, considered=False, x=None, evidence=(Evidence(time_s=0.0, text=text),))


def computed(asked: Asked) -> tuple[str, ...]:
    """The observables that the overhead simulation computes."""
    return tuple(name for name, (measure, options) in asked.items() if _fits(measure, options))


def observe(batch: Batch, asked: Asked) -> Observed:
    """Fly a batch and measure it. A mission's row is the same whichever others are flown with it."""
    names = tuple(asked)
    able = set(computed(asked))
    x, considered = np.zeros((len(batch), len(names))), np.zeros((len(batch), len(names)), dtype=np.bool_)
    end_s = np.zeros(len(batch))
    for begin in range(0, len(batch), CHUNK):
        part = batch.part(begin, begin + CHUNK)
        flown = fly(part)
        looks = _Looks(part, flown.views)
        end_s[begin : begin + CHUNK] = flown.end_s
        for index, name in enumerate(names):
            if name in able:
                measure, options = asked[name]
                found, offered = _MEASURES[measure][0](part, flown, looks, options)
                x[begin : begin + CHUNK, index] = np.where(offered, np.clip(found, 0.0, 1.0), 0.0)
                considered[begin : begin + CHUNK, index] = offered
    missing = tuple(name for name in names if name not in able)
    return Observed(names, missing, x.round(_DIGITS), considered, end_s.round(_DIGITS))


def _fits(measure: str, options: Mapping[str, Option]) -> bool:
    return measure in _MEASURES and set(options) <= set(_MEASURES[measure][1])


def _number(options: Mapping[str, Option], name: str, usual: float) -> float:
    value = options.get(name, usual)
    assert not isinstance(value, str)
    return float(value)


def _detection_share(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    role = str(options["role"])
    least_px, least = _number(options, "min_height_px", 12.0), _number(options, "min_confidence", USUAL_CONFIDENCE)
    frames, mean, spread = (_of_role(one, role) for one in looks.clear(least_px, least))
    frames = np.maximum(frames, 1e-9)
    together = np.maximum(2.0 * batch.correlation_s * batch.rate_hz, 1.0)
    luck = normal(batch.seeds, _LUCK_SHARE + _ROLES.get(role, 3), 1)[:, 0]
    return mean / frames + luck * np.sqrt(spread * together) / frames, _some(_has_role(batch, role))


def _classified_share(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    asked = flown.entered & _has_role(batch, str(options["role"]))
    held = looks.counts() >= _number(options, "min_frames", 5.0)
    total = asked.sum(axis=1)
    return (held & asked).sum(axis=1) / np.maximum(total, 1), total > 0


def _has_role(batch: Batch, role: str) -> Bools:
    return batch.role == _ROLES[role] if role in _ROLES else batch.role >= 0


def _of_role(sums: Floats, role: str) -> Floats:
    """One role's column of sums over roles; all of them together for any."""
    return sums[:, _ROLES[role]] if role in _ROLES else sums[:, 0] + sums[:, 1] + sums[:, 2]


def _no_false_reports(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    said, quiet = _some(np.isfinite(flown.reported_s)), ~_some(batch.role == 1)
    return np.where(said | quiet, 1.0, 0.0), np.ones(len(batch), dtype=np.bool_)


def _targets_reported(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    targets = _targets(batch)
    good = targets & np.isfinite(flown.reported_s) & (flown.error_m <= _number(options, "within_m", 20.0))
    total = targets.sum(axis=1)
    return good.sum(axis=1) / np.maximum(total, 1), total > 0


def _report_accuracy(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    targets = _targets(batch)
    said = targets & np.isfinite(flown.reported_s)
    good = np.maximum(1.0 - flown.error_m / _number(options, "scale_m", 25.0), 0.0)
    return np.where(said, good, 0.0).sum(axis=1) / np.maximum(said.sum(axis=1), 1), _some(targets)


def _priority_order(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    targets, priority = _targets(batch), batch.task_priority
    pairs = targets[:, :, None] & targets[:, None, :] & (priority[:, :, None] < priority[:, None, :])
    kept = pairs & (flown.reported_s[:, :, None] < flown.reported_s[:, None, :]) & np.isfinite(flown.reported_s)[:, None, :]
    total = pairs.sum(axis=(1, 2))
    return kept.sum(axis=(1, 2)) / np.maximum(total, 1), total > 0


def _marks_clear(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    targets = _targets(batch)
    marked = targets & np.isfinite(flown.marked_s)
    clear = (marked & flown.clear_mark).sum(axis=1) / np.maximum(marked.sum(axis=1), 1)
    said = (targets & np.isfinite(flown.reported_s)).any(axis=1)
    return np.where(marked.any(axis=1), clear, said), _some(_exposed(batch, flown, options))


def _declared(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    exposed, said = _exposed(batch, flown, options), _targets(batch) & np.isfinite(flown.reported_s)
    limit_m = batch.no_mark_m[:, None]
    near = said & (flown.near_at_report_m < limit_m)
    invented = said & flown.declared & (flown.near_at_report_m >= limit_m + MARGIN_M)
    tested = (near | invented).sum(axis=1)
    share = (near & flown.declared).sum(axis=1) / np.maximum(tested, 1)
    return np.where((said & exposed).any(axis=1), np.where(tested > 0, share, 1.0), 0.0), _some(exposed)


def _mission_flown(batch: Batch, flown: Flown, looks: _Looks, options: Mapping[str, Option]) -> Column:
    in_time = ~batch.returns | (flown.end_s <= batch.limit_s)
    return np.where(flown.reached, np.where(in_time, 1.0, 0.5), 0.0), np.ones(len(batch), dtype=np.bool_)


def _some(which: Bools) -> Bools:
    """(n,) whether any of a row."""
    return np.asarray(which.any(axis=1))


def _targets(batch: Batch) -> Bools:
    """(n, k) tasks that are about an adversary."""
    return (batch.task_radius_m > 0.0) & (batch.task_actor >= 0)


def _exposed(batch: Batch, flown: Flown, options: Mapping[str, Option]) -> Bools:
    return _targets(batch) & (flown.exposure_s >= _number(options, "min_exposure_s", 10.0))


_Measure = Callable[[Batch, Flown, _Looks, Mapping[str, Option]], Column]

# What each measure is computed by, and the options with which it can be: with others it is not considered.
_MEASURES: Mapping[str, tuple[_Measure, Sequence[str]]] = {
    "detection_share": (_detection_share, ("role", "min_confidence", "min_height_px", "min_visible")),
    "classified_share": (_classified_share, ("role", "within_m", "min_frames")),
    "no_false_reports": (_no_false_reports, ("within_m",)),
    "targets_reported": (_targets_reported, ("within_m",)),
    "report_accuracy": (_report_accuracy, ("scale_m",)),
    "priority_order": (_priority_order, ("within_m",)),
    "marks_clear_of_bystanders": (_marks_clear, ("min_exposure_s",)),
    "bystanders_declared": (_declared, ("min_exposure_s",)),
    "mission_flown": (_mission_flown, ("home_m",)),
}
