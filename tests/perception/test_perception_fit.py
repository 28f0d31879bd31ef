"""A fitted model behaves as the detections that it was fitted to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from detector_fit import DetectorFit, fit_detector, joint_probability, shares_of, solve_rate
from made_views import breathing_frames, detections_of, grid_frame, made_spec, made_tape
from scipy import stats

from bench.contracts import CameraFrame, Detection, DetectionFrame, Sighting, SimTime, Tape
from bench.errors import SetupError
from bench.simspec import CLASS_LABELS, DetectionModel, Outage, ScoreQuantiles, Seeds, SimSpec

ASSETS = ["soldier", "civilian", "radar-vehicle"] * 20
FRAMES = 400

# Each parameter differs from its default and from the other set's; the second has no drift, switches or persistence.
RICH: dict[str, Any] = {
    "half_height_px": 18.0,
    "slope": 2.5,
    "ceiling": 0.93,
    "correlation_s": 0.5,
    "mislabel": 0.3,
    "confusion": {"combatant": {"civilian": 0.3, "tree": 0.1}},
    "jitter_px": 2.0,
    "drift_px": 3.0,
    "drift_s": 2.5,
    "false_per_frame": 2.0,
    "false_persistence_s": 0.6,
    "latency_s": 0.15,
    "latency_jitter_s": 0.04,
    "id_switches_per_s": 0.08,
}
PLAIN: dict[str, Any] = {
    "half_height_px": 9.0,
    "slope": 4.5,
    "ceiling": 0.75,
    "correlation_s": 0.3,
    "mislabel": 0.15,
    "jitter_px": 0.8,
    "false_per_frame": 1.2,
    "latency_s": 0.33,
}


Case = tuple[Mapping[str, Any], SimSpec, Tape, DetectorFit]
"""Model, SimSpec and tape of a run, and what was fitted to it."""


@pytest.fixture(scope="module", params=[RICH, PLAIN], ids=["rich", "plain"])
def case(request: pytest.FixtureRequest) -> Case:
    model = request.param
    spec = made_spec(ASSETS, model)
    tape = made_tape(spec, breathing_frames(FRAMES, len(ASSETS)))
    return model, spec, tape, fit_detector([(spec, tape)])


def _nearest(frame: CameraFrame, result: DetectionFrame) -> Iterator[tuple[Sighting, Detection | None]]:
    """Each actor with the nearest detection, unless its edges are more than 10 pixels off on average."""
    actual = np.array([sighting.box for sighting in frame.sightings])
    reported = np.array([item.box for item in result.detections]).reshape(-1, 4)
    apart_px = np.abs(actual[:, None] - reported[None]).mean(axis=2)
    for sighting, distances in zip(frame.sightings, apart_px, strict=True):
        near = len(distances) and distances.min() < 10.0
        yield sighting, result.detections[int(distances.argmin())] if near else None


def _label(actor: int) -> str:
    return ("combatant", "civilian", "mobile_radar")[actor % 3]


def counts(tape: Tape, model: DetectionModel) -> dict[str, float]:
    """What a run shows, counted as plainly as can be, and how many wrong labels a model expects of it."""
    totals = dict.fromkeys(("false", "switches", "wrong", "expected wrong"), 0.0)
    seen: dict[int, tuple[float, str]] = {}
    for frame, result in zip(tape.frames, tape.detections, strict=True):
        totals["false"] += len(result.detections)
        for sighting, item in _nearest(frame, result):
            if item is None:
                continue
            actor, now_s = sighting.actor, frame.exposed.s
            last_s, track = seen.get(actor, (now_s, item.track))
            seen[actor] = (now_s, item.track)
            totals["false"] -= 1
            totals["switches"] += now_s - last_s <= 2.0 and track != item.track
            totals["wrong"] += item.class_label != _label(actor)
            doubt = 2.0 / (1.0 + (sighting.height_px / model.half_height_px) ** model.slope)
            totals["expected wrong"] += min(1.0, sum(model.confusion.get(_label(actor), {}).values()) * doubt)
    return totals


def test_the_fitted_model_expects_what_the_run_shows(case: Case) -> None:
    """Within 5 %: a second run of a few hundred rare events would have chance of its own."""
    _, _, tape, fit = case
    model, shown = fit.perception.model, counts(tape, fit.perception.model)
    assert shown["expected wrong"] == pytest.approx(shown["wrong"], rel=0.05)
    assert model.false_per_frame * FRAMES == pytest.approx(shown["false"], rel=0.05)
    if model.id_switches_per_s:
        assert model.id_switches_per_s * fit.evidence.track_s == pytest.approx(shown["switches"], rel=0.05)


def test_parameters_come_back(case: Case) -> None:
    """Within what chance leaves of 24,000 correlated sightings."""
    model, _, _, fit = case
    fitted = fit.perception.model
    wanted = {
        "half_height_px": 0.03,
        "slope": 0.06,
        "ceiling": 0.02,
        "correlation_s": 0.06,
        "mislabel": 0.35,
        "jitter_px": 0.02,
        "drift_px": 0.03,
        "drift_s": 0.04,
        "false_per_frame": 0.2,
        "false_persistence_s": 0.3,
        "latency_s": 0.01,
        "latency_jitter_s": 0.02,
        "id_switches_per_s": 0.2,
    }
    for name, tolerance in wanted.items():
        if name in model:
            assert getattr(fitted, name) == pytest.approx(model[name], rel=tolerance), name
    assert fit.evidence.sightings == FRAMES * len(ASSETS)
    assert not {"half_height_px", "correlation_s", "mislabel", "jitter_px"} & set(fit.evidence.unfitted)
    for label, row in model.get("confusion", {}).items():
        assert set(fitted.confusion[label]) == set(row)
    if "drift_px" not in model:
        assert (fitted.drift_px, fitted.false_persistence_s, fitted.id_switches_per_s) == (0.0, 0.0, 0.0)
        assert fitted.latency_jitter_s == 0.0


# A detector that no stated form fits: blind to large objects, poor at one class, boxes that err with their size, false
# detections of two kinds, and sure of them.
UNLIKE: dict[str, Any] = {
    "size_curve": [
        {"px": 6.0, "detected": 0.1, "doubt": 0.5},
        {"px": 18.0, "detected": 0.8, "doubt": 1.0},
        {"px": 60.0, "detected": 0.15, "doubt": 2.0},
    ],
    "class_factors": {"civilian": 0.5},
    "correlation_s": 0.3,
    "mislabel": 0.3,
    "confusion": {"combatant": {"civilian": 0.4}, "mobile_radar": {"crate": 0.1}, "civilian": {"tree": 0.2}},
    "jitter_px": 0.5,
    "jitter_share": 0.06,
    "false_per_frame": 1.5,
    "false_labels": {"tree": 0.75, "animal": 0.25},
    "false_score": 0.6,
}


@pytest.fixture(scope="module")
def unlike() -> Case:
    spec = made_spec(ASSETS, UNLIKE)
    tape = made_tape(spec, breathing_frames(500, len(ASSETS)))
    return UNLIKE, spec, tape, fit_detector([(spec, tape)])


def shares(tape: Tape, results: Iterable[DetectionFrame]) -> dict[tuple[str, str], list[float]]:
    """By class and by size: the share of sightings detected, and the share of labels that are wrong."""
    hits: dict[tuple[str, str], list[bool]] = {}
    wrong: dict[tuple[str, str], list[bool]] = {}
    for frame, result in zip(tape.frames, results, strict=True):
        for sighting, item in _nearest(frame, result):
            height = sighting.height_px
            size = "small" if height < 11.0 else "large" if height > 33.0 else "middle"
            for group in (("size", size), ("class", _label(sighting.actor))):
                hits.setdefault(group, []).append(item is not None)
                if item is not None:
                    wrong.setdefault(group, []).append(item.class_label != _label(sighting.actor))
    return {group: [float(np.mean(hits[group])), float(np.mean(wrong[group]))] for group in hits}


def test_a_detector_unlike_the_stated_form_is_reproduced_too(unlike: Case) -> None:
    """By size and by class, within 5 % and what chance leaves of 10,000 correlated sightings; false ones in kind and score."""
    model, spec, tape, fit = unlike
    fitted = fit.perception.model
    assert len(fitted.size_curve) >= 6
    other = spec.model_copy(update={"perception": fit.perception, "seeds": Seeds(root=99)})
    results = detections_of(other, tape.frames)
    before, after = shares(tape, tape.detections), shares(tape, results)
    assert set(before) == set(after)
    for group, (detected, wrong) in before.items():
        assert after[group][0] == pytest.approx(detected, rel=0.05, abs=0.01), group
        assert after[group][1] == pytest.approx(wrong, rel=0.05, abs=0.03), group
    assert before["size", "large"][0] < 0.6 * before["size", "middle"][0]
    assert before["class", "civilian"][0] < 0.6 * before["class", "combatant"][0]
    assert fitted.jitter_px == pytest.approx(0.5, abs=0.3)
    assert fitted.jitter_share == pytest.approx(0.06, rel=0.1)
    assert fitted.false_per_frame * 500 == pytest.approx(counts(tape, fitted)["false"], rel=0.05)
    assert fitted.false_labels == pytest.approx(model["false_labels"], abs=0.08)
    assert fitted.false_score == pytest.approx(0.6, abs=0.05)


def test_what_fits_the_stated_form_keeps_it(case: Case) -> None:
    fitted = case[3].perception.model
    assert (fitted.size_curve, fitted.class_factors, fitted.jitter_share) == ((), {}, 0.0)
    assert (fitted.false_labels, fitted.false_score) == ({}, DetectionModel().false_score)


def test_two_recordings_count_together_and_outages_do_not() -> None:
    """Frames in an outage of the detector say nothing about it, nor do frames without a result."""
    spec = made_spec(ASSETS, {})
    frames = breathing_frames(60, len(ASSETS))
    tape = made_tape(spec, frames)
    broken = spec.model_copy(update={"outages": (Outage(kind="detections", at_s=2.0, duration_s=4.0),)})
    once, twice = fit_detector([(spec, tape)]).evidence, fit_detector([(spec, tape)] * 2).evidence
    assert (twice.frames, twice.sightings, twice.detected) == (120, 2 * once.sightings, 2 * once.detected)
    # A result between exposure at 1.9 s and the end at 6 s is of the outage.
    assert fit_detector([(broken, tape)]).evidence.frames == 60 - 20
    half = fit_detector([(spec, replace(tape, detections=tape.detections[::2]))]).evidence
    assert (half.frames, half.unanswered) == (30, 30)


def test_what_cannot_be_fitted_is_said() -> None:
    """No detection at all, no recording, different weather parameters, and too few sightings for a curve."""
    spec = made_spec(ASSETS, {})
    frames = breathing_frames(3, len(ASSETS))
    silent = made_spec(ASSETS, {"ceiling": 0.0})
    with pytest.raises(SetupError, match="no detection in these recordings lies on an actor"):
        fit_detector([(silent, made_tape(silent, frames))])
    with pytest.raises(SetupError, match="there is no recording"):
        fit_detector([])
    foggy = made_spec(ASSETS, {"fog_extinction_per_m": 0.5})
    with pytest.raises(SetupError, match=r"perception\.model\.fog_extinction_per_m"):
        fit_detector([(spec, made_tape(spec, frames)), (foggy, made_tape(foggy, frames))])
    few = made_spec(["soldier"] * 2, {"ceiling": 1.0})
    large = [grid_frame(number, [80.0, 80.0]) for number in range(20)]
    fit = fit_detector([(few, made_tape(few, large))])
    assert {"half_height_px", "slope", "ceiling", "mislabel"} <= set(fit.evidence.unfitted)
    assert fit.perception.model.half_height_px == 14.0


def test_delays_rounded_up_to_ticks_are_read_back() -> None:
    """As a session records them: a delay that is fixed stays, one that varies loses a tick at its lower end."""
    spec = made_spec(ASSETS, {"latency_s": 0.1, "latency_jitter_s": 0.35})
    frames = breathing_frames(80, len(ASSETS))
    tape = made_tape(spec, frames)
    for jitter_s in (0.0, 0.35):
        moments = [one.published if jitter_s else one.exposed.after(0.1) for one in tape.detections]
        ticks = [SimTime(-(-moment.ns // 100_000_000) * 100_000_000) for moment in moments]
        results = tuple(
            DetectionFrame(result.exposed, tick, result.detections)
            for result, tick in zip(tape.detections, ticks, strict=True)
        )
        model = fit_detector([(spec, replace(tape, detections=results))]).perception.model
        assert model.latency_s == pytest.approx(0.1)
        assert model.latency_jitter_s == pytest.approx(jitter_s, abs=0.051)


def test_joint_probability_is_that_of_the_bivariate_normal() -> None:
    """Against scipy, over probabilities and correlations up to near one."""
    rng = np.random.default_rng(1)
    first, second, rho = rng.uniform(0.01, 0.99, 40), rng.uniform(0.01, 0.99, 40), rng.uniform(0.0, 0.98, 40)
    for p, q, r, joint in zip(first, second, rho, joint_probability(first, second, rho), strict=True):
        expected = stats.multivariate_normal.cdf(stats.norm.ppf([p, q]), cov=[[1.0, r], [r, 1.0]])
        assert joint == pytest.approx(expected, abs=2e-4)


def test_a_rate_solves_its_equation() -> None:
    spans_s = np.array([0.2] * 50 + [1.5] * 10)
    for events in (0, 1, 7, 59):
        rate = solve_rate(spans_s, events)
        assert sum(1.0 - np.exp(-rate * span) for span in spans_s) == pytest.approx(events, abs=1e-6)
    assert all(before < after for before, after in pairwise([solve_rate(spans_s, n) for n in range(60)]))


def rescored(tape: Tape, scores: tuple[float, float]) -> Tape:
    """The same detections with other scores: never below the first, and above the second for a tenth of them."""
    rng = np.random.default_rng(5)
    low, high = scores

    def score() -> float:
        return float(rng.uniform(high, 1.0) if rng.random() < 0.1 else rng.uniform(low, high))

    return replace(
        tape,
        detections=tuple(
            replace(result, detections=tuple(replace(item, score=score()) for item in result.detections))
            for result in tape.detections
        ),
    )


@pytest.mark.parametrize("case", [RICH], indirect=True, ids=["rich"])
def test_scores_of_a_detector_of_its_own_are_fitted(case: Case) -> None:
    """What the stated form gives is not fitted; other scores are kept by their quantiles, those of false detections too."""
    _, spec, tape, stated = case
    assert stated.perception.model.scores == ScoreQuantiles()
    scores = (0.1, 0.3)
    other = rescored(tape, scores)
    fit = fit_detector([(spec, other)])
    quantiles = fit.perception.model.scores
    assert all(each[0] == pytest.approx(scores[0], abs=0.01) for each in (quantiles.right, quantiles.wrong))
    fitted = spec.model_copy(update={"perception": fit.perception, "seeds": Seeds(root=99)})
    before, after = (
        np.array([item.score for result in results for item in result.detections])
        for results in (other.detections, detections_of(fitted, tape.frames))
    )
    for least in (scores[0], 0.2, 0.7):
        assert (after >= least).mean() == pytest.approx((before >= least).mean(), rel=0.05, abs=0.005)


@pytest.mark.parametrize(
    ("scores", "words"),
    [({"right": [0.5]}, "one quantile says nothing"), ({"false": [0.5, 0.4]}, "quantiles must not fall")],
)
def test_quantiles_of_scores_are_in_order(scores: dict[str, list[float]], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        DetectionModel.model_validate({"scores": scores})


def test_a_row_of_the_confusion_is_no_more_than_certain() -> None:
    """Seven shares of a certain mistake, each rounded up, would add up to more than a model takes."""
    row = shares_of(1.0, dict.fromkeys(CLASS_LABELS[:7], 3))
    assert math.fsum(row.values()) <= 1.0 < 7 * round(1 / 7, 5)
    DetectionModel(confusion={CLASS_LABELS[9]: row})
    assert shares_of(0.5, {"tree": 1, "crate": 3}) == {"tree": 0.125, "crate": 0.375}
