"""The parts of the error model that came after the first, against independent references.

Bounds on counts are exceeded once in a billion runs (binomial or Poisson distribution).
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from made_views import PERIOD_S, actor_at, detections_of, made_spec, steady_frames
from pydantic import ValidationError
from scipy import stats

from bench.contracts import CameraFrame, DetectionFrame, SimTime
from bench.perception import DetectionOdds
from bench.simspec import DetectionModel

TAIL = 5e-10
ACTORS = 60
SURE = {"ceiling": 1.0, "half_height_px": 0.01, "mislabel": 0.0, "jitter_px": 0.0}
"""Everything is detected, under its own label, in its place."""


def binomial(trials: int, share: float) -> tuple[float, float]:
    low, high = stats.binom.ppf([TAIL, 1.0 - TAIL], trials, share)  # type: ignore[misc]
    return float(low), float(high)


def test_confusion_follows_the_matrix_class_by_class() -> None:
    """A row of two wrong labels, an empty row, and a class without a row, at the threshold of detection."""
    assets = ["soldier"] * 30 + ["civilian"] * 15 + ["radar-vehicle"] * 15
    confusion = {"combatant": {"civilian": 0.3, "crate": 0.1}, "civilian": {}}
    model = {"confusion": confusion, "mislabel": 0.2, "correlation_s": 0.0, "jitter_px": 0.0}
    spec = made_spec(assets, model)
    counts: dict[str, Counter[str]] = {asset: Counter() for asset in assets}
    for result in detections_of(spec, steady_frames(300, len(assets), 14.0)):
        for detection in result.detections:
            counts[assets[actor_at(detection.box)]][detection.class_label] += 1

    assert set(counts["civilian"]) == {"civilian"}
    for asset, expected in (
        ("soldier", {"civilian": 0.3, "crate": 0.1, "combatant": 0.6}),
        # Without a row: `mislabel`, evenly over the asset's look-alikes.
        ("radar-vehicle", {"military_vehicle": 0.1, "civilian_vehicle": 0.1, "mobile_radar": 0.8}),
    ):
        total = counts[asset].total()
        assert total > 1500
        assert set(counts[asset]) == set(expected)
        for label, share in expected.items():
            low, high = binomial(total, share)
            assert low <= counts[asset][label] <= high, (asset, label)


def test_a_matrix_that_makes_no_sense_is_refused_with_the_reason() -> None:
    for confusion, reason in (
        ({"combatant": {"combatant": 0.1}}, "state the wrong labels only"),
        ({"combatant": {"civilian": 0.7, "tree": 0.4}}, "add up to more than 1"),
    ):
        with pytest.raises(ValidationError, match=reason):
            DetectionModel(confusion=confusion)


def hits_of(results: list[DetectionFrame]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(frames, actors) of 1 for detected."""
    hits = np.zeros((len(results), ACTORS))
    for row, result in enumerate(results):
        hits[row, [actor_at(detection.box) for detection in result.detections]] = 1.0
    return hits


def test_actors_of_two_classes_are_missed_independently_and_each_at_its_rate() -> None:
    """Neighbours in the cast and the picture, of two assets: rates within bounds, no correlation between them."""
    assets = ["soldier", "civilian-car"] * (ACTORS // 2)
    spec = made_spec(assets, {"correlation_s": 0.0, "jitter_px": 0.0})
    hits = hits_of(detections_of(spec, steady_frames(600, ACTORS, 14.0)))
    for kind in (0, 1):
        low, high = binomial(hits[:, kind::2].size, 0.49)
        assert low <= hits[:, kind::2].sum() <= high
    correlation = np.corrcoef(hits[:, 0::2].ravel(), hits[:, 1::2].ravel())[0, 1]
    # 18,000 pairs: the standard deviation is 0.0075.
    assert abs(correlation) < 6.0 / np.sqrt(hits[:, 0::2].size)


def test_misses_last_as_the_copula_says() -> None:
    """Probability of two hits in a row, against scipy's bivariate normal distribution."""
    spec = made_spec(["soldier"] * ACTORS, {"correlation_s": 0.8, "jitter_px": 0.0})
    hits = hits_of(detections_of(spec, steady_frames(800, ACTORS, 14.0)))
    share = DetectionOdds.of(spec).clarity(steady_frames(1, 1, 14.0)[0].sightings[0], 0.0).detection
    edge = stats.norm.ppf(share)
    for lag in (1, 5):
        rho = np.exp(-lag * PERIOD_S / 0.8)
        expected = stats.multivariate_normal.cdf([edge, edge], cov=[[1.0, rho], [rho, 1.0]])
        assert (hits[lag:] * hits[:-lag]).mean() == pytest.approx(expected, abs=0.02)


def test_drift_displaces_whole_boxes_and_lasts() -> None:
    """Spread, autocorrelation at three lags, no correlation between axes or actors, and no change of size."""
    spec = made_spec(["soldier"] * ACTORS, {**SURE, "drift_px": 4.0, "drift_s": 1.5})
    results = detections_of(spec, steady_frames(500, ACTORS, 30.0))
    sightings = steady_frames(1, ACTORS, 30.0)[0].sightings
    truth = {sighting.actor: np.array(sighting.box) for sighting in sightings}
    drift = np.zeros((len(results), ACTORS, 4))
    for row, result in enumerate(results):
        assert len(result.detections) == ACTORS
        for detection in result.detections:
            actor = actor_at(detection.box)
            drift[row, actor] = np.array(detection.box) - truth[actor]

    assert np.ptp(drift[..., [0, 2]], axis=-1).max() == pytest.approx(0.0, abs=1e-9)
    x, y = drift[..., 0], drift[..., 1]
    assert [x.std(), y.std()] == pytest.approx([4.0, 4.0], rel=0.05)
    for lag in (1, 4, 10):
        expected = np.exp(-lag * PERIOD_S / 1.5)
        assert (x[lag:] * x[:-lag]).mean() / x.var() == pytest.approx(expected, abs=0.05)
    assert abs(np.corrcoef(x.ravel(), y.ravel())[0, 1]) < 0.1
    assert abs(np.corrcoef(x[:, 0], x[:, 1])[0, 1]) < 0.5


def empty_frames(count: int) -> list[CameraFrame]:
    return [CameraFrame(number, "front", SimTime(number * 200_000_000), ()) for number in range(count)]


def test_false_detections_stay_and_keep_their_rate() -> None:
    """Mean number a frame as without persistence, exponential survival, one track and label for each."""
    spec = made_spec(["soldier"], {"false_per_frame": 2.0, "false_persistence_s": 1.0, "jitter_px": 0.0})
    frames = 3000
    results = detections_of(spec, empty_frames(frames))
    present = [{detection.track for detection in result.detections} for result in results]
    # The count has the correlation of a queue: its variance over n frames is that of n / 10 independent ones.
    most = 6.0 * np.sqrt(2.0 / (frames / 10))
    assert np.mean([len(tracks) for tracks in present]) == pytest.approx(2.0, abs=most)
    kept = sum(len(before & after) for before, after in pairwise(present))
    total = sum(len(before) for before in present[:-1])
    low, high = binomial(total, float(np.exp(-PERIOD_S)))
    assert low <= kept <= high
    seen = {(one.track, one.class_label, one.box) for result in results for one in result.detections}
    assert len(seen) == len({track for track, _, _ in seen})


def test_delays_are_spread_and_results_stay_in_order() -> None:
    """Uniform between the two ends where frames do not catch up with one another; never out of order."""
    spec = made_spec(["soldier"], {"latency_s": 0.05, "latency_jitter_s": 0.12})
    results = detections_of(spec, empty_frames(3000))
    delays_s = [result.published.since(result.exposed) for result in results]
    assert stats.kstest(delays_s, stats.uniform(0.05, 0.12).cdf).pvalue > 1e-6
    crowded = made_spec(["soldier"], {"latency_s": 0.05, "latency_jitter_s": 2.0})
    late = detections_of(crowded, empty_frames(300))
    assert [result.exposed for result in late] == sorted(result.exposed for result in late)
    assert all(before.published <= after.published for before, after in pairwise(late))
    assert max(result.published.since(result.exposed) for result in late) <= 2.05


@pytest.mark.parametrize("assets", [["soldier"] * ACTORS, ["soldier"]])
def test_identities_switch_at_the_stated_rate(assets: list[str]) -> None:
    """In a crowd that exchanges tracks, and for an actor alone that gets new ones."""
    frames = 200 if len(assets) > 1 else 4000
    spec = made_spec(assets, {**SURE, "id_switches_per_s": 0.15})
    results = detections_of(spec, steady_frames(frames, len(assets), 30.0))
    tracks = [{actor_at(one.box): one.track for one in result.detections} for result in results]
    changes = sum(before[actor] != after[actor] for before, after in pairwise(tracks) for actor in before)
    expected = (1.0 - np.exp(-0.15 * PERIOD_S)) * (frames - 1) * len(assets)
    # An exchange changes two identities at once, which doubles the variance.
    assert changes == pytest.approx(expected, abs=6.0 * np.sqrt(2.0 * expected))
    names = {track for row in tracks for track in row.values()}
    assert len(names) == (ACTORS if len(assets) > 1 else 1 + changes)
    assert all(len(set(row.values())) == len(assets) for row in tracks)


def test_new_parameters_move_no_other_draw() -> None:
    """Detected actors, labels, scores and false detections are those of a model without them."""
    assets = ["soldier", "civilian"] * 20
    plain = {"false_per_frame": 0.5}
    rich = plain | {"drift_px": 3.0, "latency_jitter_s": 0.3, "id_switches_per_s": 0.5}
    frames = steady_frames(60, len(assets), 20.0)
    labels = [
        [[(item.class_label, item.score) for item in result.detections] for result in results]
        for results in (detections_of(made_spec(assets, model), frames) for model in (plain, rich))
    ]
    assert labels[0] == labels[1]
