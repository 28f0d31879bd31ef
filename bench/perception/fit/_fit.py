"""Estimates every parameter of the error model from matched recordings. docs/detection.md says how."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Tape
from bench.errors import Fault, SetupError
from bench.simspec import DetectionModel, Perception, ScoreQuantiles, SimSpec, SizePoint

from .._odds import DetectionOdds
from .._tracks import TRACK_GAP_S
from ._boxes_fit import BoxFit, fit_boxes
from ._curve import SizeCurve, fit_correlation_s, fit_curve, solve_rate
from ._document import DetectorFit, FitEvidence, LabelCounts, SizeBand
from ._matching import MatchedRun, match_runs, successive
from ._points import at_threshold, fit_doubts, fit_points, misfits
from ._scores_fit import fit_scores
from ._timing import FalseFit, LatencyFit, fit_false, fit_latency

MIN_CONFUSABLE = 20.0
"""A class gets a row of its own in the confusion when so many wrong labels could have been seen; chosen."""

BANDS_PX = (0.0, 8.0, 12.0, 16.0, 24.0, 32.0, 64.0, 96.0, float(2**20))
"""Borders of the size bands; 32 and 96 pixels are those of COCO's small, medium and large objects."""

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
    """All sightings of all runs, one row each; `chain` is equal for the same actor of the same run."""

    size_px: Floats
    hit: Bools
    time_s: Floats
    chain: tuple[tuple[int, int], ...]
    true_label: tuple[str, ...]
    confusable: Bools
    label: tuple[str, ...]  # of the detection, empty for a miss
    score: Floats  # likewise, NaN for a miss
    known_labels: frozenset[str]


def fit_detector(runs: Sequence[tuple[SimSpec, Tape]]) -> DetectorFit:
    """The error model that behaves as the detections on these tapes do.

    Raises SetupError when there is nothing to fit, or the SimSpecs state different weather parameters.
    """
    given = _given_model(runs)
    matched = match_runs(runs)
    rows = _sightings(matched)
    if not rows.hit.any():
        raise SetupError(
            "fit-detector",
            "no detection in these recordings lies on an actor",
            "give recordings with detections of actors; with perception.source agent there are none",
        )
    unfitted = list(CARRIED_PARAMETERS)
    form = fit_curve(rows.size_px, rows.hit, SizeCurve(given.half_height_px, given.slope, given.ceiling))
    if form is None:
        unfitted += ["half_height_px", "slope", "ceiling"]
    views = _views(rows, form or SizeCurve(given.half_height_px, given.slope, given.ceiling))
    if form is not None and _does_not_fit(rows, views):
        views = _views_by_points(rows, form)
    p = views.probability
    first, second, span_s = _frame_pairs(rows)
    both = int((rows.hit[first] & rows.hit[second]).sum())
    correlation_s = given.correlation_s
    if len(first):
        correlation_s = fit_correlation_s(p[first], p[second], span_s, both)
    else:
        unfitted.append("correlation_s")
    labels = _fit_labels(rows, views.doubt)
    boxes = fit_boxes(matched, TRACK_GAP_S)
    latency, false = fit_latency(matched), fit_false(matched)
    track_spans_s, track_changes = _track_changes(matched)
    unfitted += [] if boxes.jitter_px is not None else ["jitter_px"]
    unfitted += [] if labels.mislabel is not None else ["mislabel"]
    model = given.model_copy(
        update={
            "half_height_px": round(views.form.half_px, 4),
            "slope": round(views.form.slope, 4),
            "ceiling": round(views.form.ceiling, 5),
            "size_curve": views.points,
            "class_factors": {label: round(factor, 5) for label, factor in sorted(views.factors.items())},
            "correlation_s": round(correlation_s, 4),
            "mislabel": given.mislabel if labels.mislabel is None else round(labels.mislabel, 5),
            "confusion": labels.confusion,
            **_box_parameters(boxes, given),
            **_timing_parameters(latency, false),
            "scores": _fit_scores(matched, rows, views.doubt, labels, false.score),
            "id_switches_per_s": round(solve_rate(track_spans_s, track_changes), 5),
        }
    )
    evidence = FitEvidence(
        recordings=len(runs),
        frames=sum(len(run.frames) for run in matched),
        unanswered=sum(run.unanswered for run in matched),
        sightings=len(rows.hit),
        detected=int(rows.hit.sum()),
        false_detections=false.detections,
        false_continued=(false.continued, false.followed),
        bands=_bands(rows, p),
        frame_pairs=len(first),
        both_detected=both,
        labels=labels.counts,
        unknown_labels=labels.unknown,
        boxes=boxes.boxes,
        box_pairs=boxes.pairs,
        delays=latency.frames,
        track_pairs=len(track_spans_s),
        track_s=round(sum(track_spans_s), 3),
        switches=track_changes,
        unfitted=tuple(unfitted),
    )
    # Validated again: model_copy does not check the ranges that the document promises.
    checked = DetectionModel.model_validate(model.model_dump())
    return DetectorFit(perception=Perception(model=checked), evidence=evidence)


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
    rows: list[tuple[float, float, tuple[int, int], str, bool, str, float]] = []
    for number, run in enumerate(matched):
        odds, cast = DetectionOdds.of(run.simspec), run.tape.cast
        for frame in run.frames:
            for item in frame.sightings:
                member = cast[item.sighting.actor]
                rows.append(
                    (
                        odds.effective_px(item.sighting, member.concealment),
                        frame.exposed.s,
                        (number, item.sighting.actor),
                        member.class_label,
                        bool(run.simspec.group(member.group).definition.confused_with),
                        item.detection.class_label if item.detection else "",
                        item.detection.score if item.detection else math.nan,
                    )
                )
    size_px, time_s, chain, true_label, confusable, label, score = (
        zip(*rows, strict=True) if rows else ((),) * 7
    )
    return _Sightings(
        np.array(size_px, dtype=np.float64),
        np.array([name != "" for name in label], dtype=np.bool_),
        np.array(time_s, dtype=np.float64),
        chain,
        true_label,
        np.array(confusable, dtype=np.bool_),
        label,
        np.array(score, dtype=np.float64),
        frozenset(label for run in matched for label in run.simspec.class_labels),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Views:
    """What a curve says of each sighting: the probability of detection, and the doubt about its label."""

    form: SizeCurve
    points: tuple[SizePoint, ...]
    factors: dict[str, float]  # by true label
    probability: Floats
    doubt: Floats


def _views(rows: _Sightings, form: SizeCurve) -> _Views:
    return _Views(form, (), {}, form.probability(rows.size_px), 2.0 * (1.0 - form.share(rows.size_px)))


def _does_not_fit(rows: _Sightings, views: _Views) -> bool:
    """Whether sizes show other shares of detections, or of wrong labels, than the stated form."""
    known, wrong = _labelled(rows)
    rate = _mislabel_rates(rows, _fit_labels(rows, views.doubt))
    bands = np.digitize(rows.size_px, BANDS_PX[1:-1])
    _, classes = np.unique(np.array(rows.true_label), return_inverse=True)
    expected_wrong = np.where(known, np.minimum(1.0, rate * views.doubt), 0.0)
    return any(
        misfits(groups, observed, expected)
        for groups, observed, expected in (
            (bands, rows.hit, views.probability),
            (classes, rows.hit, views.probability),
            (bands, wrong, expected_wrong),
        )
    )


def _mislabel_rates(rows: _Sightings, labels: _LabelFit) -> Floats:
    """(n,) the fitted probability of a wrong label at the threshold."""
    return np.array(
        [
            sum(labels.confusion[true].values()) if true in labels.confusion else labels.mislabel or 0.0
            for true in rows.true_label
        ]
    )


def _fit_scores(
    matched: Sequence[MatchedRun], rows: _Sightings, doubt: Floats, labels: _LabelFit, false_mean: float
) -> ScoreQuantiles:
    known, wrong = _labelled(rows)
    mislabel: Floats = np.minimum(1.0, _mislabel_rates(rows, labels) * doubt)
    return fit_scores(matched, rows.score[known], wrong[known], mislabel[known], false_mean)


def _views_by_points(rows: _Sightings, form: SizeCurve) -> _Views:
    known, wrong = _labelled(rows)
    curve, factors = fit_points(rows.size_px, rows.hit, rows.true_label)
    groups = [rows.true_label[row] for row in np.flatnonzero(known)]
    curve = fit_doubts(curve, rows.size_px[known], wrong[known], groups)
    factor = np.array([factors[true] for true in rows.true_label])
    probability: Floats = np.minimum(1.0, factor * curve.probability(rows.size_px))
    return _Views(form, curve.points(), factors, probability, curve.doubt_at(rows.size_px))


def _labelled(rows: _Sightings) -> tuple[Bools, Bools]:
    """The sightings that were detected with a label of the catalogue, and those of them with a wrong one."""
    known = rows.hit & np.array([name in rows.known_labels for name in rows.label], dtype=np.bool_)
    wrong = known & np.array(
        [name != true for name, true in zip(rows.label, rows.true_label, strict=True)], dtype=np.bool_
    )
    return known, wrong


def _frame_pairs(rows: _Sightings) -> tuple[Counts, Counts, Floats]:
    """(n,) rows of one actor in two successive frames, and the time between them."""
    # After a longer absence nothing of the process is left to see.
    values = zip(rows.chain, rows.time_s.tolist(), range(len(rows.chain)), strict=True)
    pairs = [(first, second) for _, first, second in successive(values, TRACK_GAP_S)]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return first, second, rows.time_s[second] - rows.time_s[first]


@dataclass(frozen=True, slots=True)
class _LabelFit:
    mislabel: float | None
    confusion: dict[str, dict[str, float]]
    counts: dict[str, LabelCounts]
    unknown: int


def _fit_labels(rows: _Sightings, doubt: Floats) -> _LabelFit:
    """The probability of a wrong label at the threshold, for every class that was seen unclearly enough."""
    known, wrong = _labelled(rows)
    true = np.array(rows.true_label)
    confusion, counts = {}, {}
    for label in sorted(set(true[known])):
        chosen = known & (true == label)
        label_counts = Counter(rows.label[row] for row in np.flatnonzero(chosen))
        counts[str(label)] = LabelCounts(
            detections=label_counts.total(), labels=dict(sorted(label_counts.items()))
        )
        probability = _at_threshold(doubt[chosen], int(wrong[chosen].sum()))
        if probability is not None:
            wrong_counts = {name: count for name, count in sorted(label_counts.items()) if name != label}
            confusion[str(label)] = _row(probability, wrong_counts)
    confusable = known & rows.confusable
    return _LabelFit(
        _at_threshold(doubt[confusable], int(wrong[confusable].sum())),
        confusion,
        counts,
        int((rows.hit & ~known).sum()),
    )


def _row(probability: float, counts: Mapping[str, int]) -> dict[str, float]:
    """The probability, shared out as the counts are."""
    total = sum(counts.values())
    row = {name: round(probability * count / total, 5) for name, count in counts.items()}
    excess = math.fsum(row.values()) - 1.0
    if excess > 0.0:
        # Each share may be rounded up: a model refuses a row that adds up to more than 1.
        largest = max(row, key=lambda name: row[name])
        row[largest] = round(row[largest] - excess, 5)
    return row


def _at_threshold(doubt: Floats, wrong: int) -> float | None:
    """The probability with which as many wrong labels are expected as there were; None where too few could be seen."""
    if float(np.minimum(1.0, doubt).sum()) < MIN_CONFUSABLE:
        return None

    return at_threshold(doubt, wrong)


def _track_changes(matched: Sequence[MatchedRun]) -> tuple[list[float], int]:
    """Seconds between successive detections of one actor with tracks, and how many of them have another track."""
    values = (
        ((number, item.sighting.actor), frame.exposed.s, item.detection.track)
        for number, run in enumerate(matched)
        for frame in run.frames
        for item in frame.sightings
        if item.detection is not None and item.detection.track
    )
    pairs = [pair for pair in successive(values, TRACK_GAP_S) if pair[0] > 0.0]
    return [span_s for span_s, _, _ in pairs], sum(first != second for _, first, second in pairs)


def _box_parameters(boxes: BoxFit, given: DetectionModel) -> Mapping[str, Any]:
    return {
        "jitter_px": given.jitter_px if boxes.jitter_px is None else round(boxes.jitter_px, 4),
        "jitter_share": round(boxes.jitter_share, 5),
        "drift_px": round(boxes.drift_px, 4),
        "drift_s": 2.0 if boxes.drift_s is None else round(boxes.drift_s, 4),
    }


def _timing_parameters(latency: LatencyFit, false: FalseFit) -> Mapping[str, Any]:
    return {
        "latency_s": round(latency.latency_s, 6),
        "latency_jitter_s": round(latency.jitter_s, 6),
        "false_per_frame": round(false.per_frame, 6),
        "false_persistence_s": round(false.persistence_s, 4),
        "false_labels": false.labels,
        "false_score": false.score,
    }


def _bands(rows: _Sightings, p: Floats) -> tuple[SizeBand, ...]:
    bands = []
    for low, high in pairwise(BANDS_PX):
        inside = (rows.size_px >= low) & (rows.size_px < high)
        if inside.any():
            bands.append(
                SizeBand(
                    from_px=low,
                    until_px=high,
                    sightings=int(inside.sum()),
                    detected=int(rows.hit[inside].sum()),
                    expected=round(float(p[inside].sum()), 2),
                )
            )
    return tuple(bands)
