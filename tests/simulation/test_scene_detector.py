"""The detector against its documented model.

Bounds on counts are exceeded once in a billion runs (binomial distribution).
"""

from __future__ import annotations

import datetime as dt
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scene_simspecs import hovering, scene_simspec
from scipy import stats

from bench.contracts import CameraFrame, Detection, DetectionFrame, Sighting, SimTime, cast_of, light_of
from bench.perception import DetectionOdds, open_detector
from bench.simspec import ASSETS, Camera, DetectionModel, Environment, Perception, SimSpec
from bench.simulation import open_plain_scene

PERIOD_NS = 200_000_000
NOON = dt.datetime(2026, 6, 21, 11, 30, tzinfo=dt.UTC)


def spec(
    asset: str = "civilian",
    actors: int = 100,
    mode: str = "degraded",
    concealment: float = 0.0,
    fog: float = 0.0,
    rain: float = 0.0,
    when: dt.datetime = NOON,
    root: int = 0,
    **model: float,
) -> SimSpec:
    """Many actors of one asset; the model makes no false detections and moves no box unless `model` says so."""
    return scene_simspec(
        [(asset, float(index), 0.0, 0.0) for index in range(actors)],
        concealment=concealment,
        environment=Environment(start_utc=when, fog_level=fog, rain_level=rain),
        perception=Perception.model_validate(
            {"mode": mode, "model": {"false_per_frame": 0.0, "jitter_px": 0.0, **model}}
        ),
        root=root,
    )


def frame(number: int, sightings: Sequence[Sighting]) -> CameraFrame:
    return CameraFrame(number, "front", SimTime(number * PERIOD_NS), tuple(sightings))


def camera_frame(
    number: int, actors: int, height_px: float = 18.0, range_m: float = 80.0, visible: float = 1.0
) -> CameraFrame:
    """Equal sightings in rows of sixty boxes, so that an unjittered box identifies its actor."""
    boxes = ((20.0 * (index % 60), 14.0 * (index // 60)) for index in range(actors))
    return frame(
        number,
        [
            Sighting(index, range_m, height_px, visible, (left_px, top_px, left_px + 8.0, top_px + 8.0))
            for index, (left_px, top_px) in enumerate(boxes)
        ],
    )


def results_of(simspec: SimSpec, frames: Sequence[CameraFrame]) -> list[DetectionFrame]:
    detector = open_detector(simspec, cast_of(simspec))
    for frame in frames:
        detector.process(frame)
    return list(detector.due(SimTime(10**15)))


def detected(simspec: SimSpec, frames: int = 30, **view: float) -> set[tuple[int, int]]:
    """(frame, actor) of every detection."""
    assert simspec.realized is not None
    actors = len(simspec.realized.actors)
    results = results_of(simspec, [camera_frame(number, actors, **view) for number in range(frames)])
    return {
        (number, round(detection.box[0] / 20.0) + 60 * round(detection.box[1] / 14.0))
        for number, result in enumerate(results)
        for detection in result.detections
    }


def binomial(trials: int, p: float) -> tuple[float, float]:
    """Bounds that a count exceeds once in a billion draws."""
    low, high = stats.binom.ppf([5e-10, 1.0 - 5e-10], trials, p)  # type: ignore[misc]
    return float(low), float(high)


WORSE_VIEWS: dict[str, Callable[[int], set[tuple[int, int]]]] = {
    "fog": lambda step: detected(spec(fog=3.0 * step)),
    "rain": lambda step: detected(spec(rain=3.0 * step), range_m=300.0),
    "concealment": lambda step: detected(spec(concealment=step / 3)),
    "darkness": lambda step: detected(spec(when=NOON + dt.timedelta(hours=[0.0, 7.8, 8.2, 11.0][step]))),
    "range": lambda step: detected(spec(fog=5.0), range_m=80.0 + 150.0 * step),
    "size": lambda step: detected(spec(), height_px=24.0 - 6.0 * step),
    "hiding": lambda step: detected(spec(), visible=1.0 - 0.25 * step),
}


@pytest.mark.parametrize("detected_at", WORSE_VIEWS.values(), ids=WORSE_VIEWS)
def test_a_worse_view_gives_a_proper_subset_of_the_detections(
    detected_at: Callable[[int], set[tuple[int, int]]],
) -> None:
    """The draws are common random numbers, so a worse view only removes detections."""
    detections_by_step = [detected_at(step) for step in range(4)]
    for better, worse in itertools.pairwise(detections_by_step):
        assert worse < better
    assert len(detections_by_step[-1]) < 0.9 * len(detections_by_step[0])


@pytest.mark.parametrize(("correlation_s", "height_px"), [(0.0, 25.0), (0.8, 14.0), (5.0, 10.0)])
def test_the_marginal_probability_does_not_depend_on_the_correlation(
    correlation_s: float, height_px: float
) -> None:
    """In a late frame, 3000 independent actors are detected as often as the formula says."""
    simspec = spec(actors=3000, correlation_s=correlation_s)
    expected = DetectionOdds.of(simspec).clarity(seen(height_px), 0.0).detection
    count = sum(number == 7 for number, _ in detected(simspec, frames=8, height_px=height_px))

    low, high = binomial(3000, expected)
    assert low <= count <= high


def test_without_correlation_frames_are_independent() -> None:
    detections = detected(spec(actors=400, correlation_s=0.0), frames=40, height_px=14.0)
    table = np.zeros((40, 400), dtype=bool)
    table[tuple(np.array(sorted(detections)).T)] = True

    assert (table[1:] == table[:-1]).mean() == pytest.approx(0.5, abs=0.03)


def seen(height_px: float, range_m: float = 80.0) -> Sighting:
    return Sighting(0, range_m, height_px, 1.0, (0, 0, 1, 1))


def test_the_detection_formula_at_its_reference_points() -> None:
    """Half the ceiling at half_height_px, the ceiling when huge, zero past the range (contrast 0.02)."""
    odds = DetectionOdds.of(spec(fog=9.0, mislabel=0.3))
    clear = DetectionOdds.of(spec(mislabel=0.3))
    visibility_m = -math.log(0.02) / (0.00012 * 81.0)
    half, giant = clear.clarity(seen(14.0), 0.0), clear.clarity(seen(1e6), 0.0)
    assert (half.contrast, half.detection, half.mislabel) == pytest.approx((1.0, 0.49, 0.3))
    assert (giant.detection, giant.mislabel) == pytest.approx((0.98, 0.0), abs=1e-6)
    assert odds.clarity(seen(1e6, visibility_m * 0.95), 0.0).detection > 0.9
    assert odds.clarity(seen(1e6, visibility_m * 1.01), 0.0).detection == 0.0
    assert (DetectionModel().half_height_px, DetectionModel().ceiling) == (14.0, 0.98)


def test_light_decreases_through_twilight() -> None:
    """1 by day, the night level by night, half way at the horizon, and never rising as the sun sinks."""
    levels = [light_of(math.radians(elevation), 0.25) for elevation in np.linspace(20, -20, 81)]

    assert (levels[0], levels[-1]) == (1.0, 0.25)
    assert light_of(0.0, 0.25) == pytest.approx(0.625)
    assert levels == sorted(levels, reverse=True)


@pytest.mark.parametrize("slope", [1e-9, 1e6])
@pytest.mark.parametrize("height_px", [1e-300, 1.0, 1e300])
def test_extreme_parameters_neither_overflow_nor_divide_by_zero(slope: float, height_px: float) -> None:
    clarity = DetectionOdds.of(spec(slope=slope)).clarity(seen(height_px, 1.0), 1.0)
    assert 0.0 <= clarity.detection <= 0.98


def test_wrong_labels_occur_at_the_mislabel_rate_and_come_from_the_catalogue() -> None:
    """At half_height_px a share `mislabel` of late labels is wrong; in clear views none is."""
    simspec = spec("soldier", actors=3000, mislabel=0.25)
    frames = [camera_frame(number, 3000, height_px=14.0) for number in range(3)]
    late = results_of(simspec, frames)[-1].detections
    wrong = [detection.class_label for detection in late if detection.class_label != "combatant"]
    clear = results_of(simspec, [camera_frame(0, 3000, height_px=4000.0)])[0].detections

    low, high = binomial(len(late), 0.25)
    assert low <= len(wrong) <= high
    assert set(wrong) == set(ASSETS["soldier"].confused_with)
    assert {detection.class_label for detection in clear} == {"combatant"}


def test_a_wrong_label_persists_through_an_encounter() -> None:
    """Successive labels of a track agree far more often than independent draws would."""
    simspec = spec("soldier", actors=300, mislabel=0.25)
    results = results_of(simspec, [camera_frame(number, 300, height_px=16.0) for number in range(12)])
    pairs = [
        (detection.class_label, label)
        for before, after in itertools.pairwise(results)
        for detection in before.detections
        if (label := {other.track: other.class_label for other in after.detections}.get(detection.track))
        is not None
    ]
    wrong = [second != "combatant" for first, second in pairs if first != "combatant"]

    assert len(wrong) > 200
    assert sum(wrong) / len(wrong) > 0.7


def test_scores_are_calibrated_and_lower_for_wrong_labels() -> None:
    """In each band of scores, the share of right labels is within 0.08 of the mean score."""
    simspec = spec("soldier", actors=3000, mislabel=0.25, correlation_s=0.0)
    views = [
        camera_frame(number, 3000, height_px=height) for number, height in enumerate((10.0, 14.0, 18.0, 22.0))
    ]
    every = [detection for result in results_of(simspec, views) for detection in result.detections]
    score = np.array([detection.score for detection in every])
    right = np.array([detection.class_label == "combatant" for detection in every])

    assert ((score > 0.0) & (score < 1.0)).all()
    assert score[~right].mean() < score[right].mean() - 0.15
    for low, high in ((0.1, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.95)):
        band = (score >= low) & (score < high)
        assert band.sum() > 200
        assert right[band].mean() == pytest.approx(score[band].mean(), abs=0.08)


def test_scores_fall_as_the_view_gets_worse() -> None:
    def mean(fog: float) -> float:
        results = results_of(
            spec(actors=1000, fog=fog), [camera_frame(0, 1000, height_px=20.0, range_m=150.0)]
        )
        return float(np.mean([detection.score for detection in results[0].detections]))

    assert mean(6.0) < mean(0.0) - 0.03


def test_boxes_are_jittered_by_jitter_px_and_stay_inside_the_image() -> None:
    """Edges scatter with the stated deviation; boxes at the border stay inside, of a positive size."""
    simspec = spec(actors=1000, jitter_px=3.0)
    wide, tiny = (
        frame(0, [Sighting(index, 50.0, 400.0, 1.0, box) for index in range(1000)])
        for box in ((100, 100, 300, 500), (1279, 0, 1280, 1))
    )
    edges = np.array([found.box for found in results_of(simspec, [wide])[0].detections])
    border = np.array([found.box for found in results_of(simspec, [tiny])[0].detections])

    assert edges.mean(axis=0) == pytest.approx([100, 100, 300, 500], abs=0.6)
    assert edges.std(axis=0) == pytest.approx([3.0] * 4, rel=0.2)
    assert (border >= 0.0).all()
    assert (border[:, [0, 2]] <= 1280.0).all()
    assert (border[:, [1, 3]] <= 720.0).all()
    assert (border[:, 2:] - border[:, :2] >= 1.0 - 1e-9).all()


def test_false_detections_have_their_rate_low_scores_and_new_tracks() -> None:
    """With no actor in view, counts are Poisson, labels the catalogue's, and no track repeats."""
    simspec = spec(actors=1, false_per_frame=0.5)
    results = results_of(simspec, [frame(number, ()) for number in range(1000)])
    false = [detection for result in results for detection in result.detections]
    low, high = stats.poisson.ppf([5e-10, 1.0 - 5e-10], 500.0)  # type: ignore[misc]

    assert low <= len(false) <= high
    assert np.mean([detection.score for detection in false]) < 0.4
    assert {detection.class_label for detection in false} == {
        asset.class_label for asset in ASSETS.values() if asset.possible_false_alarm
    }
    # Labels of rare classes would change what older SimSpecs draw.
    assert not {"aid_worker", "animal", "tent"} & {detection.class_label for detection in false}
    assert len({detection.track for detection in false}) == len(false)


def test_each_result_is_due_once_after_the_latency_in_order() -> None:
    """A result is due exactly at its time and only once; an empty frame gives a result as well."""
    simspec = spec(actors=2, latency_s=0.3)
    detector = open_detector(simspec, cast_of(simspec))
    for number in range(3):
        detector.process(camera_frame(number, 2 if number != 1 else 0, height_px=500.0))

    assert list(detector.due(SimTime(299_999_999))) == []
    (first,) = detector.due(SimTime(300_000_000))
    assert (first.exposed.ns, first.published.ns) == (0, 300_000_000)
    later = list(detector.due(SimTime(10**10)))
    assert [result.exposed.ns for result in later] == [PERIOD_NS, 2 * PERIOD_NS]
    assert later[0].detections == ()
    assert list(detector.due(SimTime(10**11))) == []


def test_perfect_perception_detects_every_actor_that_is_visible_enough() -> None:
    """A visible actor is detected at once with its true box and label; a barely visible one is not."""
    simspec = spec(
        "soldier", actors=3, mode="perfect", fog=9.0, concealment=1.0, false_per_frame=5.0, latency_s=1.0
    )
    detector = open_detector(simspec, cast_of(simspec))
    box = (10.0, 20.0, 30.0, 60.0)
    views = (
        Sighting(0, 900.0, 4.0, 0.2, box),
        Sighting(1, 10.0, 40.0, 0.19, box),
        Sighting(2, 10.0, 3.9, 1.0, box),
    )
    detector.process(CameraFrame(0, "front", SimTime(5), views))

    (result,) = detector.due(SimTime(5))
    assert result == DetectionFrame(SimTime(5), SimTime(5), (Detection("combatant", 1.0, box, "t1"),))


def test_a_track_survives_short_gaps_and_is_renewed_after_long_ones() -> None:
    """An actor out of view for up to two seconds keeps its track id; after a longer gap it gets a new id."""
    simspec, view = spec(actors=1, mode="perfect"), camera_frame(0, 1)
    frames = [
        replace(view, number=number, exposed=SimTime(round(moment_s * 1e9)))
        for number, moment_s in enumerate((0.0, 0.2, 2.2, 4.3, 4.5))
    ]
    tracks = [result.detections[0].track for result in results_of(simspec, frames)]
    assert tracks == ["t1", "t1", "t1", "t2", "t2"]


def test_detections_do_not_reveal_the_order_of_the_cast() -> None:
    """Shuffling the cast does not change perfect perception: it holds no index, id or order."""
    rng = np.random.default_rng(3)
    placements = [
        (asset, *rng.uniform(-40, 40, 2).tolist(), 10.0)
        for asset in ("civilian", "soldier", "crate")
        for _ in range(10)
    ]
    shuffled = [placements[index] for index in rng.permutation(len(placements))]

    def perceived(order: Sequence[tuple[str, float, float, float]]) -> list[list[tuple[object, ...]]]:
        simspec = scene_simspec(order, camera=Camera(tilt_deg=90.0), perception=Perception(mode="perfect"))
        scene = open_plain_scene(simspec)
        frames = [scene.observe(hovering(0, 0, 40), 0), scene.observe(hovering(20, 0, 40), 1)]
        # Rounded, because the last bits depend on the order of the sums.
        return [
            [(found.class_label, found.track, *np.round(found.box, 6)) for found in result.detections]
            for result in results_of(simspec, frames)
        ]

    first = perceived(placements)
    assert len(first[0]) > 5
    assert first == perceived(shuffled)


def test_degraded_tracks_are_numbered_by_descending_score() -> None:
    """Only actors 40 to 49 are in view, and their tracks are t1, t2, ... in order of score."""
    view = camera_frame(0, 50, height_px=300.0)
    (result,) = results_of(spec(actors=50), [frame(0, view.sightings[40:])])
    scores = [detection.score for detection in result.detections]
    assert [detection.track for detection in result.detections] == [f"t{n + 1}" for n in range(len(scores))]
    assert len(scores) > 5
    assert scores == sorted(scores, reverse=True)


def test_results_are_reproducible_and_depend_on_the_seed() -> None:
    frames = [camera_frame(number, 50, height_px=14.0) for number in range(20)]
    first, again, other = (results_of(spec(actors=50, jitter_px=2.0, root=r), frames) for r in (0, 0, 1))
    assert first == again != other


def test_random_draws_do_not_depend_on_other_actors_in_view() -> None:
    simspec = spec(actors=20)
    crowd = [camera_frame(number, 20) for number in range(30)]
    alone = [frame(number, crowd[number].sightings[7:8] if number >= 10 else ()) for number in range(30)]

    def scores(frames: list[CameraFrame]) -> list[list[float]]:
        return [
            sorted(detection.score for detection in result.detections)
            for result in results_of(simspec, frames)[10:]
        ]

    assert any(scores(alone))
    for single, many in zip(scores(alone), scores(crowd), strict=True):
        assert set(single) <= set(many)


def test_five_thousand_actors_in_one_frame_take_bounded_time() -> None:
    simspec = spec(actors=5000)
    view = camera_frame(0, 5000, height_px=500.0)
    began = time.process_time()
    (result,) = results_of(simspec, [view])
    low, high = binomial(5000, 0.98)

    assert low <= len(result.detections) <= high
    assert time.process_time() - began < 5.0
