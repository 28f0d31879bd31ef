"""Detectors on the pictures in a session: what they see, when the agent hears of it, and what their faults are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from fake_agents import agent_manifest
from scipy import ndimage
from test_scene_detector import camera_frame
from test_session_pictures import FlownSession, flown_twice, fly, hits_of, watched_simspec

from bench.contracts import (
    DETECTOR_OPENED,
    BenchTraceback,
    CameraPicture,
    Detection,
    DetectionFrame,
    Outcome,
    PixelDetector,
    PixelDetectorBuild,
    Pixels,
    SimTime,
    VehicleTopics,
    cast_of,
)
from bench.errors import DetectorFault, SetupError
from bench.perception import open_detector
from bench.simspec import DetectionModel, Outage, Perception, SimSpec
from bench.simulation import session_faults
from bench.streams import Detection2DArray

DETECTIONS = VehicleTopics("vehicle_1").detections
MODEL = DetectionModel(latency_s=0.15, latency_jitter_s=0.2)


@dataclass(frozen=True)
class BlobDetector:
    """A box around whatever stands out from the ground by more than `contrast` levels, all of one label."""

    label: str = "civilian"
    contrast: float = 60.0
    version: str = "blobs 1, no weights"

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        levels = bgr.astype(np.float64)
        apart = np.abs(levels - np.median(levels, axis=(0, 1))).max(axis=2)
        regions, _ = ndimage.label(apart > self.contrast)
        return [
            Detection(
                self.label,
                min(1.0, (rows.stop - rows.start) / 50.0),
                (float(columns.start), float(rows.start), float(columns.stop), float(rows.stop)),
            )
            for rows, columns in ndimage.find_objects(regions)
        ]


@dataclass
class Seeing:
    """A detector that finds what a function says of the picture; it has no version."""

    see: Callable[[Pixels], Sequence[Detection]]

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        return self.see(bgr)


def mean_of(bgr: Pixels) -> Sequence[Detection]:
    """One box whose width is the mean level of the picture."""
    return [Detection("crate", 0.5, (0.0, 0.0, 1.0 + float(bgr.mean()), 50.0))]


def pixels_simspec(model: DetectionModel = MODEL, **camera: object) -> SimSpec:
    """Two people under a turning vehicle, seen by a detector."""
    perception = Perception(source="detector", detector="blobs", model=model, begin_detections=1)
    return watched_simspec(**camera).model_copy(update={"perception": perception})


def with_detector(folder: Path, spec: SimSpec, detector: PixelDetector | None) -> FlownSession:
    return fly(folder, spec, open_on_pixels=None if detector is None else lambda _: detector)


def detections_of(session: FlownSession) -> dict[int, tuple[int, Detection2DArray]]:
    """When each frame's result came, and the result, by the time of exposure."""
    messages = session.messages(DETECTIONS, Detection2DArray)
    return {message.header.stamp.ns: (time.ns, message) for time, message in messages}


@pytest.fixture(scope="module")
def blobs(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlownSession, FlownSession]:
    return flown_twice(tmp_path_factory, pixels_simspec(), open_on_pixels=lambda _: BlobDetector())


def test_the_agent_hears_what_the_detector_sees(blobs: tuple[FlownSession, FlownSession]) -> None:
    """One message a frame, the boxes of two people, the stated delay; nobody else gets pictures. Twice alike, and named
    before anything flies and in what stays of the session.
    """
    session, repeated = blobs
    assert session.records == repeated.records
    detections, views = detections_of(session), session.views()
    # The results of the last frames come after the end.
    assert list(detections) == list(views)[: len(detections)]
    assert len(detections) >= len(views) - 3
    delays_s = [(published_ns - exposed_ns) / 1e9 for exposed_ns, (published_ns, _) in detections.items()]
    # Results come with the first tick, of 0.1 s, after the delay.
    assert 0.15 <= min(delays_s) < max(delays_s) <= 0.15 + 0.2 + 0.1
    labels = [
        item.results[0].hypothesis.class_id
        for _, message in detections.values()
        for item in message.detections
    ]
    assert set(labels) == {"civilian"}
    hits, _ = hits_of(session, DETECTIONS)
    assert hits > 0.8 * 2 * len(detections)
    assert all("image_raw" not in record.topic for record in session.records)
    tracks = {item.id for _, message in detections.values() for item in message.detections}
    assert {"t1", "t2"} <= tracks
    assert session.end.fact(PixelDetectorBuild) == PixelDetectorBuild(
        description="blobs: blobs 1, no weights"
    )
    assert session.texts_of(DETECTOR_OPENED) == ["blobs: blobs 1, no weights"]


def test_lost_and_frozen_frames_reach_the_detector_as_they_are(tmp_path: Path) -> None:
    """A dropped frame has no result; a frozen one has the boxes of the picture that it repeats."""
    spec = pixels_simspec(
        DetectionModel(latency_s=0.0), width_px=200, height_px=120, dropped_share=0.25, frozen_share=0.4
    )
    session = with_detector(tmp_path, spec, Seeing(mean_of))
    assert session.end.fact(PixelDetectorBuild) == PixelDetectorBuild(description="blobs")
    # Which frame's picture each exposure showed.
    shown = {time.ns: picture.shown for time, picture in session.pictures()}
    detections = detections_of(session)
    exposed = [time_ns for time_ns, number in shown.items() if number is not None]
    assert len(exposed) < len(shown), "the camera lost no frame: choose another seed"
    assert len({shown[time_ns] for time_ns in exposed}) < len(exposed), "nothing froze: choose another seed"
    # The last exposure is at the end, after the last tick.
    assert list(detections) == [time_ns for time_ns in exposed if time_ns < max(shown)]
    widths: dict[int | None, set[float]] = {}
    for time_ns, (_, message) in detections.items():
        widths.setdefault(shown[time_ns], set()).update(item.bbox.size_x for item in message.detections)
    assert all(len(same) == 1 for same in widths.values())
    assert len({width for same in widths.values() for width in same}) == len(widths)


def test_outages_and_degradations_act_on_it_as_on_the_simulated_one(tmp_path: Path) -> None:
    outages = (
        Outage(kind="detections", at_s=0.5, duration_s=0.6),
        Outage(kind="detections_degraded", at_s=1.7, duration_s=0.8, lost_share=0.9),
    )
    spec = pixels_simspec(DetectionModel(latency_s=0.0)).model_copy(update={"outages": outages})
    crowd = [Detection("civilian", 1.0, (float(x), 1.0, x + 5.0, 9.0)) for x in range(0, 300, 10)]
    session = with_detector(tmp_path, spec, Seeing(lambda _: crowd))
    counts = {
        published_ns / 1e9: (len(message.detections), message.detections[0].results[0].hypothesis.score)
        for published_ns, message in detections_of(session).values()
    }
    assert not [time_s for time_s in counts if 0.5 <= time_s < 1.1]
    assert {count for time_s, (count, _) in counts.items() if not 1.6 <= time_s < 2.6} == {30}
    degraded = [pair for time_s, pair in counts.items() if 1.8 <= time_s < 2.5]
    assert degraded
    assert all(count < 12 and score == pytest.approx(0.55) for count, score in degraded)


def results_of(
    see: Callable[[Pixels], Sequence[Detection]], count: int = 1, first: int = 0, **perception: object
) -> Sequence[DetectionFrame]:
    """Of so many black pictures, seen from 30 m straight above, north up; a SimSpec's perception may be changed."""
    plain = pixels_simspec()
    spec = plain.model_copy(update={"perception": plain.perception.model_copy(update=perception)})
    down = np.array(((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)))
    bgr = np.zeros((240, 320, 3), dtype=np.uint8)
    detector = open_detector(spec, cast_of(spec), lambda _: Seeing(see))
    for number in range(first, first + count):
        detector.process(camera_frame(number, 2), CameraPicture(bgr, down, (0.0, 0.0, 30.0)))
    assert not bgr.any()
    return detector.due(SimTime(10**12))


def test_delays_are_those_of_the_simulated_detector() -> None:
    """Drawn from the same stream by frame: changing the source changes no delay."""
    times, simulated = (
        [result.published for result in results_of(mean_of, 20, source=source)]
        for source in ("detector", "simulated")
    )
    assert times == simulated
    assert len(set(times)) > 10


def _boxed(*edges: float, label: str = "civilian", score: float = 0.5) -> Detection:
    return Detection(label, score, (edges[0], edges[1], edges[2], edges[3]))


@pytest.mark.parametrize(
    ("report", "complaint"),
    [
        (lambda: _boxed(math.nan, 0.0, 5.0, 5.0), "left, top, right, bottom"),
        (lambda: _boxed(0.0, 0.0, math.inf, 5.0), "left, top, right, bottom"),
        (lambda: _boxed(9.0, 0.0, 5.0, 5.0), "each smaller than its opposite"),
        (lambda: _boxed(400.0, 0.0, 450.0, 5.0), "touch the picture of 320 x 240 pixels"),
        (lambda: _boxed(0.0, 0.0, 5.0, 5.0, label="dragon"), "no class label: 'dragon'; known: "),
        (lambda: _boxed(0.0, 0.0, 5.0, 5.0, score=math.nan), "the score is nan"),
        (lambda: _boxed(0.0, 0.0, 5.0, 5.0, score=1.5), "the score is 1.5"),
        (lambda: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda: "nonsense", "AttributeError"),
    ],
)
def test_nonsense_of_a_detector_is_named_with_frame_and_detector(
    report: Callable[[], Detection], complaint: str
) -> None:
    with pytest.raises(DetectorFault) as caught:
        results_of(lambda _: [report()], first=7)
    assert "detector 'blobs' in the picture of frame 7: " in str(caught.value)
    assert complaint in str(caught.value)


def test_boxes_end_at_the_border_and_pictures_are_not_to_be_changed() -> None:
    def paint(bgr: Pixels) -> Sequence[Detection]:
        bgr[0] = 255
        return []

    (wide,) = results_of(lambda _: [_boxed(-5.0, 10.0, 400.0, 250.0)])
    assert wide.detections[0].box == (0.0, 10.0, 320.0, 240.0)
    with pytest.raises(DetectorFault, match="read-only"):
        results_of(paint)


def test_a_track_begins_with_its_first_sure_detection() -> None:
    """What came before under its name is left out, what comes later is not; two tracks, one of which is never sure."""
    scores = ((0.3, 0.2), (0.3, 0.2), (0.5, 0.35), (0.1, 0.3))

    def published(begin_score: float) -> list[set[tuple[str, float]]]:
        rows = iter(scores)

        def see(bgr: Pixels) -> Sequence[Detection]:
            row = zip(next(rows), (10.0, 200.0), strict=True)
            return [_boxed(x, 50.0, x + 20.0, 90.0, score=score) for score, x in row]

        results = results_of(see, len(scores), begin_score=begin_score)
        return [{(item.track, item.score) for item in result.detections} for result in results]

    every = published(0.0)
    assert [sorted(score for _, score in row) for row in every] == [sorted(row) for row in scores]
    assert {name for row in every for name, _ in row} == {"t1", "t2"}
    assert published(0.4) == [set(), set(), {("t1", 0.5)}, {("t1", 0.1)}]
    assert published(0.35) == [set(), set(), *every[2:]]


@pytest.mark.parametrize("begin_detections", [1, 2, 3])
def test_a_false_box_of_one_picture_is_no_track(begin_detections: int) -> None:
    """Beside two people who are always seen, a box flashes somewhere else in each fourth picture."""
    flashes = iter(((60.0, 5.0), (290.0, 200.0), (40.0, 220.0)))
    counted = itertools.count(1)

    def see(bgr: Pixels) -> Sequence[Detection]:
        people = [_boxed(x, 50.0, x + 20.0, 90.0, score=0.9) for x in (10.0, 200.0)]
        if next(counted) % 4:
            return people
        x, y = next(flashes)
        return [*people, _boxed(x, y, x + 12.0, y + 12.0, label="combatant", score=0.95)]

    results = results_of(see, 12, begin_detections=begin_detections)
    labels = [[item.class_label for item in result.detections] for result in results]
    seen = [0] * (begin_detections - 1) + [2] * (13 - begin_detections)
    assert [row.count("civilian") for row in labels] == seen
    assert sum(row.count("combatant") for row in labels) == (3 if begin_detections == 1 else 0)
    assert Perception().begin_detections == 2


def test_a_fault_of_the_detector_is_the_benchs(tmp_path: Path) -> None:
    """Not the agent's fault: an error of the bench, or named before the start if not installed."""

    def closed(bgr: Pixels) -> Sequence[Detection]:
        raise OSError("the camera of the detector is closed")

    spec = pixels_simspec()
    failed = with_detector(tmp_path, spec, Seeing(closed)).end
    assert failed.outcome is Outcome.BENCH_ERROR
    assert not failed.outcome.counts
    assert failed.reason.startswith(
        "the detector failed: detector 'blobs' in the picture of frame 0: OSError: the camera"
    )
    assert "Seeing" not in failed.reason
    assert "raise OSError" in str(failed.fact(BenchTraceback))
    missing = with_detector(tmp_path, spec, None).end
    assert missing.outcome is Outcome.SETUP_INVALID
    assert "perception.detector: there is no detector 'blobs' (installed: " in missing.reason
    with pytest.raises(SetupError, match=r"perception.detector: .* install its package"):
        open_detector(spec, cast_of(spec))
    faults = session_faults(spec, agent_manifest("idle"))
    assert [fault.where for fault in faults] == ["perception.detector"]
