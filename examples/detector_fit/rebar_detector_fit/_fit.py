"""Estimates every parameter of the error model from matched recordings. docs/detection.md says how."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Tape
from bench.errors import Fault, SetupError
from bench.perception import DetectionOdds
from bench.simspec import DetectionModel, Perception, SimSpec, SizePoint

from ._boxes import fit_boxes
from ._curves import MIN_IN_BIN, SizeCurve, crossing, fit_correlation_s, fit_curve, fit_points, solve_rate
from ._document import DetectorFit, FitEvidence, LabelCounts, SizeBand
from ._matching import MatchedRun, match_runs, successive
from ._results import fit_false, fit_latency, fit_scores

MIN_CONFUSABLE = 20.0
"""A class gets a row of its own in the confusion when so many wrong labels could have been seen; chosen."""

BANDS_PX = (0.0, 8.0, 12.0, 16.0, 24.0, 32.0, 64.0, 96.0, float(2**20))
"""Borders of the size bands; 32 and 96 pixels are those of COCO's small, medium and large objects."""

MISFIT_SHARE = 0.05
MISFIT_DEVIATIONS = 6.0
"""The stated form does not fit where a band has more or fewer detections than expected by both. Chosen: successive frames
are alike, so that the deviation of independent sightings counts double and more."""

CARRIED_PARAMETERS = (
    "fog_extinction_per_m",
    "rain_extinction_per_m",
    "dust_extinction_per_m",
    "night_contrast",
    "concealment_weight",
)
"""Recordings in one weather cannot show these: the fit takes them from the SimSpecs, as given."""


@dataclass(frozen=True, slots=True, eq=False)
class _Sightings:
    """All sightings of all runs, one row each; `actor` is equal for the same actor of the same run."""

    size_px: Floats
    time_s: Floats
    actor: tuple[tuple[int, int], ...]
    true_label: NDArray[np.str_]
    confusable: Bools
    label: NDArray[np.str_]  # of the detection, empty for a miss
    score: Floats  # likewise, NaN for a miss
    track: tuple[str, ...]
    known: Bools  # whether the detection has a label of the catalogue

    @property
    def hit(self) -> Bools:
        hit: Bools = self.label != ""
        return hit

    @property
    def wrong(self) -> Bools:
        """Whether the label is of the catalogue, and of another class."""
        wrong: Bools = self.known & (self.label != self.true_label)
        return wrong


@dataclass(frozen=True, slots=True, eq=False)
class _Views:
    """What a curve says of each sighting: the probability of detection, and the doubt about its label."""

    probability: Floats
    doubt: Floats
    points: tuple[SizePoint, ...] = ()
    factors: Mapping[str, float] = field(default_factory=dict)  # by true label


def fit_detector(runs: Sequence[tuple[SimSpec, Tape]]) -> DetectorFit:
    """The error model that behaves as the detections on these tapes do.

    Raises SetupError when there is nothing to fit, or the SimSpecs state different weather parameters.
    """
    given = _given_model(runs)
    matched = match_runs(runs)
    rows = _sightings(matched)
    if not rows.hit.any():
        what = "no detection in these recordings lies on an actor"
        remedy = "give recordings with detections of actors; with perception.source agent there are none"
        raise SetupError("fit-detector", what, remedy)
    stated = SizeCurve(given.half_height_px, given.slope, given.ceiling)
    fitted = fit_curve(rows.size_px, rows.hit, stated)
    form = fitted or stated
    share = form.share(rows.size_px)
    views = _Views(form.ceiling * share, 2.0 * (1.0 - share))
    if fitted is not None and _does_not_fit(rows, views):
        views = _views_by_points(rows)
    boxes, false = fit_boxes(matched), fit_false(matched)
    pairs = _frame_pairs(rows)
    both = int(rows.hit[pairs].all(axis=1).sum())
    mislabel = _at_threshold(rows, views.doubt, rows.known & rows.confusable)
    track_spans_s, switches = _track_changes(rows)
    latency_s, latency_jitter_s = fit_latency(matched)
    estimates: dict[str, Any] = {
        **({} if fitted is None else fitted.parameters),
        "size_curve": views.points,
        "class_factors": dict(views.factors),
        **_correlation_estimates(rows, views, pairs, both),
        "confusion": _confusion(rows, views.doubt),
        **({} if mislabel is None else {"mislabel": mislabel}),
        "jitter_share": 0.0,
        "drift_px": 0.0,
        "drift_s": DetectionModel().drift_s,
        **boxes.parameters,
        "latency_s": latency_s,
        "latency_jitter_s": latency_jitter_s,
        "false_per_frame": false.per_frame,
        "false_persistence_s": false.persistence_s,
        "false_labels": false.labels,
        "id_switches_per_s": solve_rate(track_spans_s, switches),
        "scores": fit_scores(
            rows.score[rows.known],
            rows.wrong[rows.known],
            _mislabel_rates(rows, views.doubt)[rows.known],
            np.array([item.score for run in matched for frame in run.frames for item in frame.false]),
            false.score,
        ),
    }
    estimates = {
        name: round(value, 5) if isinstance(value, float) else value for name, value in estimates.items()
    }
    # Rounded already, unless it is the stated one.
    estimates["false_score"] = false.score
    evidence = FitEvidence(
        recordings=len(runs),
        frames=sum(len(run.frames) for run in matched),
        unanswered=sum(run.unanswered for run in matched),
        sightings=len(rows.hit),
        detected=int(rows.hit.sum()),
        false_detections=false.detections,
        false_continued=(false.continued, false.followed),
        bands=_bands(rows, views.probability),
        frame_pairs=len(pairs),
        both_detected=both,
        labels=_label_counts(rows),
        unknown_labels=int((rows.hit & ~rows.known).sum()),
        boxes=boxes.boxes,
        box_pairs=boxes.pairs,
        track_pairs=len(track_spans_s),
        track_s=round(float(track_spans_s.sum()), 3),
        switches=switches,
        unfitted=tuple(name for name in DetectionModel.model_fields if name not in estimates),
    )
    # Validated: a copy alone does not check the ranges that the document promises.
    model = DetectionModel.model_validate(given.model_copy(update=estimates).model_dump())
    return DetectorFit(perception=Perception(model=model), evidence=evidence)


def _correlation_estimates(rows: _Sightings, views: _Views, pairs: Counts, both_hit: int) -> dict[str, float]:
    if not len(pairs):
        return {}
    first, second = pairs.T
    p, span_s = views.probability, rows.time_s[second] - rows.time_s[first]
    return {"correlation_s": fit_correlation_s(p[first], p[second], span_s, both_hit)}


def _given_model(runs: Sequence[tuple[SimSpec, Tape]]) -> DetectionModel:
    if not runs:
        raise SetupError("fit-detector", "there is no recording", "name one or more")
    models = [simspec.perception.model for simspec, _ in runs]
    if faults := [
        Fault(
            f"perception.model.{name}",
            f"differs between the recordings: {', '.join(f'{value:g}' for value in sorted(values))}",
            "fit recordings of one error model at a time",
        )
        for name in CARRIED_PARAMETERS
        if len(values := {getattr(model, name) for model in models}) > 1
    ]:
        raise SetupError(faults)
    return models[0]


def _sightings(matched: Sequence[MatchedRun]) -> _Sightings:
    rows = []
    for number, run in enumerate(matched):
        odds, cast = DetectionOdds.of(run.simspec), run.tape.cast
        for frame in run.frames:
            for sighting, detection in frame.sightings:
                member = cast[sighting.actor]
                rows.append(
                    (
                        odds.effective_px(sighting, member.concealment),
                        frame.exposed.s,
                        (number, sighting.actor),
                        member.class_label,
                        bool(run.simspec.group(member.group).definition.confused_with),
                        detection.class_label if detection else "",
                        detection.score if detection else math.nan,
                        detection.track if detection else "",
                    )
                )
    size_px, time_s, actor, true_label, confusable, label, score, track = (
        zip(*rows, strict=True) if rows else ((),) * 8
    )
    labels = np.array(label, dtype=np.str_)
    return _Sightings(
        np.array(size_px, dtype=np.float64),
        np.array(time_s, dtype=np.float64),
        actor,
        np.array(true_label, dtype=np.str_),
        np.array(confusable, dtype=np.bool_),
        labels,
        np.array(score, dtype=np.float64),
        track,
        np.isin(labels, sorted({name for run in matched for name in run.simspec.class_labels})),
    )


def _does_not_fit(rows: _Sightings, views: _Views) -> bool:
    """Whether sizes show other shares of detections, or of wrong labels, than the stated form."""
    expected_wrong = np.where(rows.known, _mislabel_rates(rows, views.doubt), 0.0)
    bands = np.digitize(rows.size_px, BANDS_PX[1:-1])
    _, classes = np.unique(rows.true_label, return_inverse=True)
    for groups, events, probability in (
        (bands, rows.hit, views.probability),
        (classes, rows.hit, views.probability),
        (bands, rows.wrong, expected_wrong),
    ):
        observed, expected = (np.bincount(groups, weights=part) for part in (events, probability))
        allowed = np.maximum(MISFIT_SHARE * observed, MISFIT_DEVIATIONS * np.sqrt(np.maximum(expected, 1.0)))
        if (np.abs(observed - expected) > allowed).any():
            return True
    return False


def _views_by_points(rows: _Sightings) -> _Views:
    names, group = np.unique(rows.true_label, return_inverse=True)
    sizes: Floats = np.log(np.maximum(rows.size_px, 1e-9))
    log_px, detected, factors = fit_points(rows.size_px, rows.hit, group)
    doubts = np.ones(len(log_px))
    known = rows.known
    if np.count_nonzero(known) >= 2 * MIN_IN_BIN and rows.wrong.any():
        at_px, shares, _ = fit_points(rows.size_px[known], rows.wrong[known], group[known])
        # The probability at the threshold of detection takes the mean as its unit.
        doubts = np.interp(log_px, at_px, shares / rows.wrong[known].mean())
    return _Views(
        np.minimum(1.0, factors[group] * np.interp(sizes, log_px, detected)),
        np.interp(sizes, log_px, doubts),
        tuple(
            SizePoint(px=round(math.exp(px), 3), detected=round(share, 5), doubt=round(doubt, 4))
            for px, share, doubt in np.column_stack((log_px, detected, doubts)).tolist()
        ),
        {str(name): round(float(factor), 5) for name, factor in zip(names, factors, strict=True)},
    )


def _frame_pairs(rows: _Sightings) -> Counts:
    """(n, 2) rows of one actor in two successive frames."""
    values = zip(rows.actor, rows.time_s.tolist(), range(len(rows.actor)), strict=True)
    return np.array([pair for _, *pair in successive(values)], dtype=np.int64).reshape(-1, 2)


def _track_changes(rows: _Sightings) -> tuple[Floats, int]:
    """Seconds between successive detections of one actor with tracks, and how many of them have another track."""
    values = zip(rows.actor, rows.time_s.tolist(), rows.track, strict=True)
    pairs = [pair for pair in successive(value for value in values if value[2]) if pair[0] > 0.0]
    spans_s: Floats = np.array([span_s for span_s, _, _ in pairs], dtype=np.float64)
    return spans_s, sum(first != second for _, first, second in pairs)


def _label_counts(rows: _Sightings) -> dict[str, LabelCounts]:
    """Of the detections with a known label."""
    labels = rows.label[rows.known]
    counts = {}
    for true in np.unique(rows.true_label[rows.known]).tolist():
        row = Counter(labels[rows.true_label[rows.known] == true].tolist())
        counts[true] = LabelCounts(detections=row.total(), labels=dict(sorted(row.items())))
    return counts


def _confusion(rows: _Sightings, doubt: Floats) -> dict[str, dict[str, float]]:
    """The probability of each wrong label at the threshold, for every class that was seen unclearly enough."""
    confusion = {}
    for true, counts in _label_counts(rows).items():
        probability = _at_threshold(rows, doubt, rows.known & (rows.true_label == true))
        if probability is not None:
            wrong = {name: count for name, count in counts.labels.items() if name != true}
            confusion[true] = shares_of(probability, wrong)
    return confusion


def shares_of(probability: float, counts: Mapping[str, int]) -> dict[str, float]:
    """The probability, shared out as the counts are."""
    total = sum(counts.values())
    row = {name: round(probability * count / total, 5) for name, count in counts.items()}
    excess = math.fsum(row.values()) - 1.0
    if excess > 0.0:
        # Each share may be rounded up: a model refuses a row that adds up to more than 1.
        largest = max(row, key=lambda name: row[name])
        row[largest] = round(row[largest] - excess, 5)
    return row


def _mislabel_rates(rows: _Sightings, doubt: Floats) -> Floats:
    """(n,) the fitted probability of a wrong label."""
    confusion = _confusion(rows, doubt)
    others = _at_threshold(rows, doubt, rows.known & rows.confusable) or 0.0
    by_label = {
        true: sum(confusion[true].values()) if true in confusion else others
        for true in np.unique(rows.true_label).tolist()
    }
    at_threshold = np.array([by_label[true] for true in rows.true_label.tolist()], dtype=np.float64)
    rates: Floats = np.minimum(1.0, doubt * at_threshold)
    return rates


def _at_threshold(rows: _Sightings, doubt: Floats, chosen: Bools) -> float | None:
    """The probability with which as many wrong labels are expected as there were; None where too few could be seen."""
    doubts = doubt[chosen]
    if float(np.minimum(1.0, doubts).sum()) < MIN_CONFUSABLE:
        return None
    wrong = int(rows.wrong[chosen].sum())
    return crossing(lambda p: float(np.minimum(1.0, p * doubts).sum()) - wrong, 0.0, 1.0)


def _bands(rows: _Sightings, p: Floats) -> tuple[SizeBand, ...]:
    bands = [(low, high, (rows.size_px >= low) & (rows.size_px < high)) for low, high in pairwise(BANDS_PX)]
    return tuple(
        SizeBand(
            from_px=low,
            until_px=high,
            sightings=int(inside.sum()),
            detected=int(rows.hit[inside].sum()),
            expected=round(float(p[inside].sum()), 2),
        )
        for low, high, inside in bands
        if inside.any()
    )
