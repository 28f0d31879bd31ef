"""Detectors on the pictures in a session: what they see, when the agent hears of it, and what their faults are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from test_scene_detector import camera_frame
from test_session_pictures import watched_simspec

from bench.agents import open_agent
from bench.contracts import (
    DETECTOR_OPENED,
    SESSION_EVENTS,
    TRUTH_PICTURES,
    TRUTH_VIEW,
    BenchTraceback,
    CameraPicture,
    Detection,
    DetectionFrame,
    Detector,
    EventDocument,
    Outcome,
    PictureDocument,
    PixelDetector,
    PixelDetectorBuild,
    Pixels,
    Record,
    SessionResult,
    SimTime,
    VehicleTopics,
    ViewDocument,
    cast_of,
    parse_document,
)
from bench.errors import DetectorFault, SetupError
from bench.perception import open_detector
from bench.simspec import DetectionModel, Outage, Perception, SimSpec
from bench.simulation import SessionPlan, run_session, session_faults
from bench.streams import Detection2DArray, String, decode
from bench.testing import agent_manifest

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


class MeanDetector:
    """A second, quite different one, without a version: one box whose width is the mean level of the picture."""

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        return [Detection("crate", 0.5, (0.0, 0.0, 1.0 + float(bgr.mean()), 50.0))]


def pixels_simspec(model: DetectionModel = MODEL, **camera: object) -> SimSpec:
    """Two people under a turning vehicle, seen by a detector."""
    perception = Perception(source="detector", detector="blobs", model=model, begin_detections=1)
    return watched_simspec(**camera).model_copy(update={"perception": perception})


@dataclass
class DetectorSession:
    """One session: how it ended and what was recorded."""

    end: SessionResult
    records: list[Record]

    @property
    def detector(self) -> str:
        build = self.end.fact(PixelDetectorBuild)
        return build.description if build else ""

    def detections(self) -> dict[int, tuple[int, Detection2DArray]]:
        """When each frame's result came, and the result, by the time of exposure."""
        messages = [
            (record.time.ns, decode(Detection2DArray, record.data))
            for record in self.records
            if record.topic == DETECTIONS
        ]
        return {
            message.header.stamp.ns: (published_ns, message)
            for published_ns, message in messages
            if message is not None
        }

    def texts(self, topic: str) -> list[tuple[int, str]]:
        strings = [
            (record.time.ns, decode(String, record.data)) for record in self.records if record.topic == topic
        ]
        return [(time_ns, string.data) for time_ns, string in strings if string is not None]

    def shown(self) -> dict[int, int | None]:
        """Which frame's picture each exposure showed."""
        return {
            time_ns: PictureDocument.model_validate_json(text).shown
            for time_ns, text in self.texts(TRUTH_PICTURES)
        }


def fly(folder: Path, spec: SimSpec, detector: PixelDetector | None) -> DetectorSession:
    records: list[Record] = []
    plan = SessionPlan(
        spec,
        agent_manifest("idle"),
        folder,
        open_agent,
        folder / "scratch",
        records.append,
        open_on_pixels=None if detector is None else lambda _: detector,
    )
    return DetectorSession(run_session(plan), records)


@pytest.fixture(scope="module")
def blobs(tmp_path_factory: pytest.TempPathFactory) -> tuple[DetectorSession, DetectorSession]:
    """The same session twice."""
    first, second = (
        fly(tmp_path_factory.mktemp("blobs"), pixels_simspec(), BlobDetector()) for _ in range(2)
    )
    return first, second


def test_the_agent_hears_what_the_detector_sees(blobs: tuple[DetectorSession, DetectorSession]) -> None:
    """One message a frame, the boxes of two people, the stated delay; nobody else gets pictures."""
    session, _ = blobs
    assert session.end.outcome is Outcome.TIME_LIMIT, f"{session.end.reason} {session.end.facts}"
    detections = session.detections()
    views = {time_ns: ViewDocument.model_validate_json(text) for time_ns, text in session.texts(TRUTH_VIEW)}
    # The results of the last frames come after the end.
    assert list(detections) == list(views)[: len(detections)]
    assert len(detections) >= len(views) - 3
    delays_s = [(published_ns - exposed_ns) / 1e9 for exposed_ns, (published_ns, _) in detections.items()]
    # Results come with the first tick, of 0.1 s, after the delay.
    assert 0.15 <= min(delays_s) < max(delays_s) <= 0.15 + 0.2 + 0.1
    hits = 0
    for exposed_ns, (_, message) in detections.items():
        assert {item.results[0].hypothesis.class_id for item in message.detections} == {"civilian"}
        centres = [(item.bbox.center.position.x, item.bbox.center.position.y) for item in message.detections]
        for sighting in views[exposed_ns].sightings:
            left, top, right, bottom = sighting.box
            hits += any(left - 4 <= x <= right + 4 and top - 4 <= y <= bottom + 4 for x, y in centres)
    assert hits > 0.8 * 2 * len(detections)
    assert all("image_raw" not in record.topic for record in session.records)
    tracks = {item.id for _, message in detections.values() for item in message.detections}
    assert {"t1", "t2"} <= tracks


def test_two_flights_with_pixels_are_one_recording(blobs: tuple[DetectorSession, DetectorSession]) -> None:
    first, second = blobs
    assert first.records == second.records


def test_recording_and_end_name_the_detector(blobs: tuple[DetectorSession, DetectorSession]) -> None:
    """Both before anything flies and in what stays of the session."""
    session, _ = blobs
    assert session.detector == "blobs: blobs 1, no weights"
    events = [parse_document(EventDocument, text) for _, text in session.texts(SESSION_EVENTS)]
    assert [event.text for event in events if event and event.name == DETECTOR_OPENED] == [session.detector]


def test_lost_and_frozen_frames_reach_the_detector_as_they_are(tmp_path: Path) -> None:
    """A dropped frame has no result; a frozen one has the boxes of the picture that it repeats."""
    spec = pixels_simspec(
        DetectionModel(latency_s=0.0), width_px=200, height_px=120, dropped_share=0.25, frozen_share=0.4
    )
    session = fly(tmp_path, spec, MeanDetector())
    assert session.detector == "blobs"
    shown, detections = session.shown(), session.detections()
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

    class CrowdDetector:
        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            return crowd

    counts = {
        published_ns / 1e9: (len(message.detections), message.detections[0].results[0].hypothesis.score)
        for published_ns, message in fly(tmp_path, spec, CrowdDetector()).detections().values()
    }
    assert not [time_s for time_s in counts if 0.5 <= time_s < 1.1]
    assert {count for time_s, (count, _) in counts.items() if not 1.6 <= time_s < 2.6} == {30}
    degraded = [pair for time_s, pair in counts.items() if 1.8 <= time_s < 2.5]
    assert degraded
    assert all(count < 12 and score == pytest.approx(0.55) for count, score in degraded)


def test_delays_are_those_of_the_simulated_detector() -> None:
    """Drawn from the same stream by frame: changing the source changes no delay."""
    pixels = pixels_simspec()
    simulated = pixels.model_copy(update={"perception": Perception(model=MODEL)})
    bgr = np.zeros((240, 320, 3), dtype=np.uint8)

    def published(detector: Detector) -> list[SimTime]:
        for number in range(20):
            detector.process(camera_frame(number, 2), picture_of(bgr))
        return [result.published for result in detector.due(SimTime(10**12))]

    times = published(open_detector(pixels, cast_of(pixels), lambda _: MeanDetector()))
    assert times == published(open_detector(simulated, cast_of(simulated)))
    assert len(set(times)) > 10


def picture_of(bgr: Pixels) -> CameraPicture:
    """Straight down from 30 m, north up."""
    return CameraPicture(
        bgr, np.array(((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))), (0.0, 0.0, 30.0)
    )


def _boxed(*edges: float) -> Detection:
    return Detection("civilian", 0.5, (edges[0], edges[1], edges[2], edges[3]))


@pytest.mark.parametrize(
    ("report", "complaint"),
    [
        (lambda: _boxed(math.nan, 0.0, 5.0, 5.0), "left, top, right, bottom"),
        (lambda: _boxed(0.0, 0.0, math.inf, 5.0), "left, top, right, bottom"),
        (lambda: _boxed(9.0, 0.0, 5.0, 5.0), "each smaller than its opposite"),
        (lambda: _boxed(400.0, 0.0, 450.0, 5.0), "touch the picture of 320 x 240 pixels"),
        (lambda: Detection("dragon", 0.5, (0.0, 0.0, 5.0, 5.0)), "no class label: 'dragon'; known: "),
        (lambda: Detection("civilian", math.nan, (0.0, 0.0, 5.0, 5.0)), "the score is nan"),
        (lambda: Detection("civilian", 1.5, (0.0, 0.0, 5.0, 5.0)), "the score is 1.5"),
        (lambda: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda: "nonsense", "AttributeError"),
    ],
)
def test_nonsense_of_a_detector_is_named_with_frame_and_detector(
    report: Callable[[], Detection], complaint: str
) -> None:
    class FaultyDetector:
        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            return [report()]

    spec = pixels_simspec()
    detector = open_detector(spec, cast_of(spec), lambda _: FaultyDetector())
    with pytest.raises(DetectorFault) as caught:
        detector.process(camera_frame(7, 2), picture_of(np.zeros((240, 320, 3), dtype=np.uint8)))
    assert "detector 'blobs' in the picture of frame 7: " in str(caught.value)
    assert complaint in str(caught.value)


def test_boxes_end_at_the_border_and_pictures_are_not_to_be_changed() -> None:
    spec = pixels_simspec()
    bgr = np.zeros((240, 320, 3), dtype=np.uint8)

    class WideDetector:
        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            return [_boxed(-5.0, 10.0, 400.0, 250.0)]

    class PaintingDetector:
        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            bgr[0] = 255
            return []

    wide = open_detector(spec, cast_of(spec), lambda _: WideDetector())
    wide.process(camera_frame(0, 2), picture_of(bgr))
    results: Sequence[DetectionFrame] = wide.due(SimTime(10**12))
    assert results[0].detections[0].box == (0.0, 10.0, 320.0, 240.0)
    painting = open_detector(spec, cast_of(spec), lambda _: PaintingDetector())
    with pytest.raises(DetectorFault, match="read-only"):
        painting.process(camera_frame(0, 2), picture_of(bgr))
    assert not bgr.any()


def test_a_track_begins_with_its_first_sure_detection() -> None:
    """What came before under its name is left out, what comes later is not; two tracks, one of which is never sure."""
    scores = ((0.3, 0.2), (0.3, 0.2), (0.5, 0.35), (0.1, 0.3))

    class TurningDetector:
        def __init__(self) -> None:
            self._rows = iter(scores)

        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            rows = zip(next(self._rows), (10.0, 200.0), strict=True)
            return [Detection("civilian", score, (x, 50.0, x + 20.0, 90.0)) for score, x in rows]

    def published(begin_score: float) -> list[set[tuple[str, float]]]:
        plain = pixels_simspec()
        perception = plain.perception.model_copy(update={"begin_score": begin_score})
        spec = plain.model_copy(update={"perception": perception})
        detector = open_detector(spec, cast_of(spec), lambda _: TurningDetector())
        for number in range(len(scores)):
            detector.process(camera_frame(number, 2), picture_of(np.zeros((240, 320, 3), dtype=np.uint8)))
        results = detector.due(SimTime(10**12))
        return [{(item.track, item.score) for item in result.detections} for result in results]

    every = published(0.0)
    assert [sorted(score for _, score in row) for row in every] == [sorted(row) for row in scores]
    assert {name for row in every for name, _ in row} == {"t1", "t2"}
    assert published(0.4) == [set(), set(), {("t1", 0.5)}, {("t1", 0.1)}]
    assert published(0.35) == [set(), set(), *every[2:]]


@pytest.mark.parametrize("begin_detections", [1, 2, 3])
def test_a_false_box_of_one_picture_is_no_track(begin_detections: int) -> None:
    """Beside two people who are always seen, a box flashes somewhere else in each fourth picture."""

    class FlashingDetector:
        def __init__(self) -> None:
            self._count = 0

        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            people = [Detection("civilian", 0.9, (x, 50.0, x + 20.0, 90.0)) for x in (10.0, 200.0)]
            self._count += 1
            x, y = ((60.0, 5.0), (290.0, 200.0), (40.0, 220.0))[self._count // 4 - 1]
            flash = Detection("combatant", 0.95, (x, y, x + 12.0, y + 12.0))
            return people + [flash] * (self._count % 4 == 0)

    plain = pixels_simspec()
    perception = plain.perception.model_copy(update={"begin_detections": begin_detections})
    spec = plain.model_copy(update={"perception": perception})
    detector = open_detector(spec, cast_of(spec), lambda _: FlashingDetector())
    for number in range(12):
        detector.process(camera_frame(number, 2), picture_of(np.zeros((240, 320, 3), dtype=np.uint8)))
    results = [[item.class_label for item in r.detections] for r in detector.due(SimTime(10**12))]

    assert [row.count("civilian") for row in results] == [0] * (begin_detections - 1) + [2] * (
        13 - begin_detections
    )
    assert sum(row.count("combatant") for row in results) == (3 if begin_detections == 1 else 0)
    assert Perception().begin_detections == 2


def test_a_fault_of_the_detector_is_the_benchs(tmp_path: Path) -> None:
    """Not the agent's fault: an error of the bench, or named before the start if not installed."""

    class ClosedDetector:
        def detect(self, bgr: Pixels) -> Sequence[Detection]:
            raise OSError("the camera of the detector is closed")

    failed = fly(tmp_path, pixels_simspec(), ClosedDetector()).end
    assert failed.outcome is Outcome.BENCH_ERROR
    assert not failed.outcome.counts
    assert failed.reason.startswith(
        "the detector failed: detector 'blobs' in the picture of frame 0: OSError: the camera"
    )
    assert "ClosedDetector" not in failed.reason
    assert "raise OSError" in str(failed.fact(BenchTraceback))
    missing = fly(tmp_path, pixels_simspec(), None).end
    assert missing.outcome is Outcome.SETUP_INVALID
    assert "perception.detector: there is no detector 'blobs' (installed: " in missing.reason
    spec = pixels_simspec()
    with pytest.raises(SetupError, match=r"perception.detector: .* install its package"):
        open_detector(spec, cast_of(spec))
    faults = session_faults(spec, agent_manifest("idle"))
    assert [fault.where for fault in faults] == ["perception.detector"]
