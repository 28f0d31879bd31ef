"""The detector against its stated model. Bounds come from the binomial distribution, at one in a billion."""

from __future__ import annotations

import datetime as dt
import itertools
import math
import time
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scene_situations import hovering, situation
from scipy import stats

from bench.contracts import CameraFrame, Detection, DetectionFrame, Sighting, SimTime, cast_of, light_of
from bench.simspec import ASSETS, Camera, DetectionModel, Environment, Perception, SimSpec
from bench.simulation import DetectionOdds, open_detector, open_plain_scene

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
    """Many actors of one kind, with a detection model that invents nothing unless told to."""
    return situation(
        [(asset, float(index), 0.0, 0.0) for index in range(actors)],
        concealment=concealment,
        environment=Environment(start_utc=when, fog_level=fog, rain_level=rain),
        perception=Perception.model_validate({"mode": mode, "model": {"false_per_frame": 0.0, **model}}),
        root=root,
    )


def frame(number: int, actors: int, height_px: float = 18.0, range_m: float = 80.0, visible: float = 1.0) -> CameraFrame:
    """Everybody alike, in rows of sixty boxes, so that an unjittered box tells whose it is."""
    boxes = ((20.0 * (one % 60), 14.0 * (one // 60)) for one in range(actors))
    seen = tuple(
        Sighting(one, range_m, height_px, visible, (left, top, left + 8.0, top + 8.0)) for one, (left, top) in enumerate(boxes)
    )
    return CameraFrame(number, "front", SimTime(number * PERIOD_NS), seen)


def actor_in(box: tuple[float, float, float, float]) -> int:
    return round(box[0] / 20.0) + 60 * round(box[1] / 14.0)


def flown(simspec: SimSpec, frames: Sequence[CameraFrame]) -> list[DetectionFrame]:
    """All results of a detector that saw these frames."""
    detector = open_detector(simspec, cast_of(simspec))
    for one in frames:
        detector.process(one)
    return list(detector.due(SimTime(10**15)))


def found(simspec: SimSpec, frames: int = 30, **view: float) -> set[tuple[int, int]]:
    """(frame, actor) of every detection."""
    assert simspec.realized is not None
    actors = len(simspec.realized.actors)
    still = simspec.model_copy(
        update={
            "perception": simspec.perception.model_copy(
                update={"model": simspec.perception.model.model_copy(update={"jitter_px": 0.0})}
            )
        }
    )
    results = flown(still, [frame(number, actors, **view) for number in range(frames)])
    return {(number, actor_in(one.box)) for number, result in enumerate(results) for one in result.detections}


def binomial(trials: int, p: float) -> tuple[float, float]:
    """Bounds that a count keeps to but for one time in a billion."""
    low, high = stats.binom.ppf([5e-10, 1.0 - 5e-10], trials, p)  # type: ignore[misc]
    return float(low), float(high)


def situations_getting_worse(ladder: str) -> list[set[tuple[int, int]]]:
    """Detections with one thing made worse in steps."""
    makers: dict[str, Callable[[int], set[tuple[int, int]]]] = {
        "fog": lambda step: found(spec(fog=3.0 * step)),
        "rain": lambda step: found(spec(rain=3.0 * step), range_m=300.0),
        "concealment": lambda step: found(spec(concealment=step / 3)),
        "darkness": lambda step: found(spec(when=NOON + dt.timedelta(hours=[0.0, 7.8, 8.2, 11.0][step]))),
        "range": lambda step: found(spec(fog=5.0), range_m=80.0 + 150.0 * step),
        "size": lambda step: found(spec(), height_px=24.0 - 6.0 * step),
        "hiding": lambda step: found(spec(), visible=1.0 - 0.25 * step),
    }
    return [makers[ladder](step) for step in range(4)]


@pytest.mark.parametrize("ladder", ["fog", "rain", "concealment", "darkness", "range", "size", "hiding"])
def test_every_worse_view_is_detected_less_and_nothing_new_is_seen(ladder: str) -> None:
    """Common random numbers: what is detected in the worse view is a proper part of what was detected in the better."""
    counts = situations_getting_worse(ladder)

    for better, worse in itertools.pairwise(counts):
        assert worse < better
    assert len(counts[-1]) < 0.9 * len(counts[0])


@pytest.mark.parametrize("correlation_s", [0.0, 0.8, 5.0])
@pytest.mark.parametrize("height_px", [10.0, 14.0, 25.0])
def test_the_marginal_probability_is_the_stated_one_whatever_the_correlation(correlation_s: float, height_px: float) -> None:
    """In a late frame, 3000 independent actors are detected as often as the formula says."""
    simspec = spec(actors=3000, correlation_s=correlation_s)
    expected = DetectionOdds.of(simspec).clarity(Sighting(0, 80.0, height_px, 1.0, (0, 0, 1, 1)), 0.0).detection

    count = sum(number == 11 for number, _ in found(simspec, frames=12, height_px=height_px))

    low, high = binomial(3000, expected)
    assert low <= count <= high


def test_misses_hang_together_over_the_correlation_time_and_no_longer() -> None:
    """Agreement of successive frames is well above chance, and back at chance after many correlation times."""
    seen = found(spec(actors=400, correlation_s=0.8), frames=60, height_px=14.0)
    table = np.zeros((60, 400), dtype=bool)
    table[tuple(np.array(sorted(seen)).T)] = True
    p = table.mean()
    chance = p * p + (1.0 - p) * (1.0 - p)

    # Orthant probability of two normals with correlation r, at the median: 1/2 + asin(r)/pi.
    assert (table[1:] == table[:-1]).mean() == pytest.approx(0.5 + math.asin(math.exp(-0.2 / 0.8)) / math.pi, abs=0.03)
    assert (table[40:] == table[:20]).mean() == pytest.approx(chance, abs=0.05)


def test_without_correlation_frames_are_independent() -> None:
    """correlation_s of zero is allowed and means fresh luck in each frame."""
    seen = found(spec(actors=400, correlation_s=0.0), frames=40, height_px=14.0)
    table = np.zeros((40, 400), dtype=bool)
    table[tuple(np.array(sorted(seen)).T)] = True

    assert (table[1:] == table[:-1]).mean() == pytest.approx(0.5, abs=0.03)


def test_the_formula_at_its_landmarks() -> None:
    """Half the ceiling at half_height_px, the ceiling for giants, nothing past the meteorological range (contrast threshold 0.02)."""
    odds = DetectionOdds.of(spec(fog=9.0, mislabel=0.3))
    clear = DetectionOdds.of(spec(mislabel=0.3))
    visibility_m = -math.log(0.02) / (0.00012 * 81.0)
    half = clear.clarity(Sighting(0, 80.0, 14.0, 1.0, (0, 0, 1, 1)), 0.0)
    giant = clear.clarity(Sighting(0, 80.0, 1e6, 1.0, (0, 0, 1, 1)), 0.0)

    assert (half.contrast, half.detection, half.mislabel) == pytest.approx((1.0, 0.49, 0.3))
    assert (giant.detection, giant.mislabel) == pytest.approx((0.98, 0.0), abs=1e-6)
    assert odds.clarity(Sighting(0, visibility_m * 0.95, 1e6, 1.0, (0, 0, 1, 1)), 0.0).detection > 0.9
    assert odds.clarity(Sighting(0, visibility_m * 1.01, 1e6, 1.0, (0, 0, 1, 1)), 0.0).detection == 0.0


def test_light_falls_through_twilight() -> None:
    """One by day, the night's share by night, half way at the horizon, never rising as the sun sinks."""
    levels = [light_of(math.radians(elevation), 0.25) for elevation in np.linspace(20, -20, 81)]

    assert (levels[0], levels[-1]) == (1.0, 0.25)
    assert light_of(0.0, 0.25) == pytest.approx(0.625)
    assert levels == sorted(levels, reverse=True)


def test_absurd_parameters_neither_overflow_nor_divide_by_zero() -> None:
    """A slope or a size beyond sense still gives probabilities."""
    for slope in (1e-9, 1e6):
        for height_px in (1e-300, 1.0, 1e300):
            clarity = DetectionOdds.of(spec(slope=slope)).clarity(Sighting(0, 1.0, height_px, 1.0, (0, 0, 1, 1)), 1.0)
            assert 0.0 <= clarity.detection <= 0.98


def test_wrong_labels_come_as_often_as_stated_and_from_the_catalogue() -> None:
    """At the threshold of detection a share `mislabel` of the detections of a late frame is wrong; clear views are right."""
    simspec = spec("soldier", actors=3000, mislabel=0.25)
    late = flown(simspec, [frame(number, 3000, height_px=14.0) for number in range(3)])[-1].detections
    wrong = [one.class_label for one in late if one.class_label != "combatant"]
    clear = flown(simspec, [frame(0, 3000, height_px=4000.0)])[0].detections

    low, high = binomial(len(late), 0.25)
    assert low <= len(wrong) <= high
    assert set(wrong) == set(ASSETS["soldier"].confused_with)
    assert {one.class_label for one in clear} == {"combatant"}


def test_a_wrong_label_persists_through_an_encounter() -> None:
    """Successive labels of one track agree far more often than independent draws would."""
    simspec = spec("soldier", actors=300, mislabel=0.25)
    results = flown(simspec, [frame(number, 300, height_px=16.0) for number in range(12)])
    pairs = [
        (one.class_label, label)
        for before, after in itertools.pairwise(results)
        for one in before.detections
        if (label := {other.track: other.class_label for other in after.detections}.get(one.track)) is not None
    ]
    wrong = [second != "combatant" for first, second in pairs if first != "combatant"]

    assert len(wrong) > 200
    assert sum(wrong) / len(wrong) > 0.7


def test_scores_are_about_calibrated_and_lower_for_wrong_labels() -> None:
    """In each band of scores, the share of right labels is what the scores say."""
    simspec = spec("soldier", actors=3000, mislabel=0.25, correlation_s=0.0)
    views = [frame(number, 3000, height_px=height) for number, height in enumerate((10.0, 14.0, 18.0, 22.0))]
    every = [one for result in flown(simspec, views) for one in result.detections]
    score = np.array([one.score for one in every])
    right = np.array([one.class_label == "combatant" for one in every])

    assert ((score > 0.0) & (score < 1.0)).all()
    assert score[~right].mean() < score[right].mean() - 0.15
    for low, high in ((0.1, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.95)):
        band = (score >= low) & (score < high)
        assert band.sum() > 200
        assert right[band].mean() == pytest.approx(score[band].mean(), abs=0.08)


def test_scores_fall_as_the_view_gets_worse() -> None:
    """The mean score of what is still detected is lower in fog."""

    def mean(fog: float) -> float:
        results = flown(spec(actors=1000, fog=fog), [frame(0, 1000, height_px=20.0, range_m=150.0)])
        return float(np.mean([one.score for one in results[0].detections]))

    assert mean(6.0) < mean(0.0) - 0.03


def test_boxes_are_jittered_as_stated_and_stay_inside_the_picture() -> None:
    """Edges scatter with the stated deviation; at the border boxes stay proper and inside."""
    simspec = spec(actors=1000, jitter_px=3.0)
    wide = CameraFrame(
        0, "front", SimTime(0), tuple(Sighting(one, 50.0, 400.0, 1.0, (100, 100, 300, 500)) for one in range(1000))
    )
    tiny = CameraFrame(0, "front", SimTime(0), tuple(Sighting(one, 50.0, 400.0, 1.0, (1279, 0, 1280, 1)) for one in range(1000)))
    edges = np.array([one.box for one in flown(simspec, [wide])[0].detections])
    border = np.array([one.box for one in flown(simspec, [tiny])[0].detections])

    assert edges.mean(axis=0) == pytest.approx([100, 100, 300, 500], abs=0.6)
    assert edges.std(axis=0) == pytest.approx([3.0] * 4, rel=0.2)
    assert (border >= 0.0).all()
    assert (border[:, [0, 2]] <= 1280.0).all()
    assert (border[:, [1, 3]] <= 720.0).all()
    assert (border[:, 2:] - border[:, :2] >= 1.0 - 1e-9).all()


def test_false_detections_come_at_their_rate_unsure_and_never_twice() -> None:
    """With nobody in view, Poisson many per frame, low scores, labels of the catalogue, every track a new one."""
    simspec = spec(actors=1, false_per_frame=0.5)
    results = flown(simspec, [CameraFrame(number, "front", SimTime(number * PERIOD_NS), ()) for number in range(1000)])
    false = [one for result in results for one in result.detections]
    low, high = stats.poisson.ppf([5e-10, 1.0 - 5e-10], 500.0)  # type: ignore[misc]

    assert low <= len(false) <= high
    assert np.mean([one.score for one in false]) < 0.4
    assert {one.class_label for one in false} == {asset.class_label for asset in ASSETS.values()} - {"aid_worker"}
    assert len({one.track for one in false}) == len(false)


def test_results_come_late_by_the_latency_in_order_and_once() -> None:
    """Nothing before its time, everything at it, never again; an empty frame is a result too."""
    simspec = spec(actors=2, latency_s=0.3)
    detector = open_detector(simspec, cast_of(simspec))
    for number in range(3):
        detector.process(frame(number, 2 if number != 1 else 0, height_px=500.0))

    assert list(detector.due(SimTime(299_999_999))) == []
    (first,) = detector.due(SimTime(300_000_000))
    assert (first.exposed.ns, first.published.ns) == (0, 300_000_000)
    later = list(detector.due(SimTime(10**10)))
    assert [one.exposed.ns for one in later] == [PERIOD_NS, 2 * PERIOD_NS]
    assert later[0].detections == ()
    assert list(detector.due(SimTime(10**11))) == []


def test_perfect_perception_is_perfect() -> None:
    """Whoever shows enough is reported with its box and label, surely and at once; who does not, is not."""
    simspec = spec("soldier", actors=3, mode="perfect", fog=9.0, concealment=1.0, false_per_frame=5.0, latency_s=1.0)
    detector = open_detector(simspec, cast_of(simspec))
    box = (10.0, 20.0, 30.0, 60.0)
    views = (Sighting(0, 900.0, 4.0, 0.2, box), Sighting(1, 10.0, 40.0, 0.19, box), Sighting(2, 10.0, 3.9, 1.0, box))
    detector.process(CameraFrame(0, "front", SimTime(5), views))

    (result,) = detector.due(SimTime(5))
    assert result == DetectionFrame(SimTime(5), SimTime(5), (Detection("combatant", 1.0, box, "t1"),))


def test_a_track_is_kept_over_short_gaps_and_renewed_after_long_ones() -> None:
    """Gone for two seconds or less keeps the id; gone for longer gives a new one."""
    simspec = spec(actors=1, mode="perfect")
    moments_s = [0.0, 0.2, 2.2, 4.3, 4.5]
    frames = [
        CameraFrame(number, "front", SimTime(round(moment * 1e9)), frame(0, 1).sightings)
        for number, moment in enumerate(moments_s)
    ]

    assert [one.detections[0].track for one in flown(simspec, frames)] == ["t1", "t1", "t1", "t2", "t2"]


def test_nothing_in_the_detections_tells_who_is_who() -> None:
    """Shuffling the cast changes nothing of what perfect perception says: no index, no id, no order of the cast."""
    rng = np.random.default_rng(3)
    standing = [(asset, *rng.uniform(-40, 40, 2).tolist(), 10.0) for asset in ("civilian", "soldier", "crate") for _ in range(10)]
    shuffled = [standing[index] for index in rng.permutation(len(standing))]

    def said(order: Sequence[tuple[str, float, float, float]]) -> list[DetectionFrame]:
        simspec = situation(order, camera=Camera(tilt_deg=90.0), perception=Perception(mode="perfect"))
        scene = open_plain_scene(simspec)
        return flown(simspec, [scene.observe(hovering(0, 0, 40), 0), scene.observe(hovering(20, 0, 40), 1)])

    first, second = said(standing), said(shuffled)
    assert len(first[0].detections) > 5
    assert rounded(first) == rounded(second)


def rounded(results: list[DetectionFrame]) -> list[list[tuple[str, str, tuple[float, ...]]]]:
    """Labels, tracks and boxes, free of the last bits that depend on the order of sums."""
    return [
        [(one.class_label, one.track, tuple(round(edge, 6) for edge in one.box)) for one in result.detections]
        for result in results
    ]


def test_degraded_tracks_count_up_from_one_and_come_surest_first() -> None:
    """Only actors 40 to 49 are in view: tracks are t1, t2, ... in order of score."""
    simspec = spec(actors=50)
    view = frame(0, 50, height_px=300.0)
    (result,) = flown(simspec, [CameraFrame(0, "front", SimTime(0), view.sightings[40:])])
    scores = [one.score for one in result.detections]

    assert [one.track for one in result.detections] == [f"t{number + 1}" for number in range(len(scores))]
    assert len(scores) > 5
    assert scores == sorted(scores, reverse=True)


def test_the_same_seed_gives_the_same_results_and_another_seed_others() -> None:
    """Everything that a detector says follows from the SimSpec."""
    frames = [frame(number, 50, height_px=14.0) for number in range(20)]

    assert flown(spec(actors=50), frames) == flown(spec(actors=50), frames)
    assert flown(spec(actors=50), frames) != flown(spec(actors=50, root=1), frames)


def test_luck_does_not_depend_on_who_else_is_in_view() -> None:
    """An actor is detected in the same frames whether or not the others are there to be seen."""
    simspec = spec(actors=20)
    alone = [
        CameraFrame(number, "front", SimTime(number * PERIOD_NS), frame(number, 20).sightings[7:8] if number >= 10 else ())
        for number in range(30)
    ]
    crowd = [frame(number, 20) for number in range(30)]

    def scores(frames: list[CameraFrame]) -> list[list[float]]:
        return [sorted(one.score for one in result.detections) for result in flown(simspec, frames)[10:]]

    assert any(scores(alone))
    for single, many in zip(scores(alone), scores(crowd), strict=True):
        assert set(single) <= set(many)


def test_fog_over_a_flown_scene_costs_detections() -> None:
    """From scene to detector: the same pass over the same people sees less in fog and less when they are concealed."""

    def seen(fog: float, concealment: float) -> int:
        people = [("soldier", 8.0 * a, 8.0 * b, 0.0) for a in range(-8, 9) for b in range(-8, 9)]
        simspec = situation(people, concealment=concealment, environment=Environment(fog_level=fog))
        scene = open_plain_scene(simspec)
        detector = open_detector(simspec, scene.cast)
        for number in range(20):
            now = SimTime(number * PERIOD_NS)
            scene.advance(now)
            detector.process(scene.observe(hovering(0.0, -60.0 + 2.0 * number, 60.0), number))
        return sum(one.track != "" for result in detector.due(SimTime(10**12)) for one in result.detections)

    clear = seen(0.0, 0.0)
    assert clear > 200
    assert seen(7.0, 0.0) < 0.9 * clear
    assert seen(0.0, 1.0) < 0.7 * clear


def test_the_largest_cast_is_seen_in_bounded_time() -> None:
    """Five thousand in one frame are answered, all of them, and quickly."""
    simspec = spec(actors=5000)
    view = frame(0, 5000, height_px=500.0)
    began = time.process_time()
    (result,) = flown(simspec, [view])
    low, high = binomial(5000, 0.98)

    assert low <= len(result.detections) <= high
    assert time.process_time() - began < 5.0


def test_the_model_of_the_simspec_is_what_counts() -> None:
    """A model with ceiling zero sees nothing at all; its defaults are those that docs/detection.md prints."""
    assert found(spec(ceiling=0.0), height_px=1000.0) == set()
    assert (DetectionModel().half_height_px, DetectionModel().ceiling) == (14.0, 0.98)
