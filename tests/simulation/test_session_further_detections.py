"""Detections in the frames of further cameras: whose, when, under which names, and who judges them."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest
from detector_fit import fit_detector, match_runs
from test_session import tape_from
from test_session_detectors import BlobDetector
from test_session_pictures import FlownSession, flown_twice, hits_of, watched_simspec
from test_session_pictures import fly as fly_with

from bench.contracts import (
    TRUTH_PICTURES,
    Outcome,
    PictureDocument,
    SimTime,
    VehicleTopics,
    cast_of,
)
from bench.perception import open_detectors, seeds_of_camera
from bench.recording import open_recording
from bench.reporting.pictures._frame_pixels import DRAWN_AGAIN, frame_pixels
from bench.simspec import Camera, DetectionModel, Mission, Outage, Perception, PerceptionSource, SimSpec
from bench.simulation import open_plain_scene
from bench.simulation._scene import PlainScene
from bench.simulation._session_cameras import scene_faults
from bench.streams import Detection2DArray
from test_ports.perception.answers import Answers

TOPICS = VehicleTopics("vehicle_1")
MAIN, DOWN, WIDE = TOPICS.detections, TOPICS.camera_detections("down"), TOPICS.camera_detections("wide")
CAMERAS = (
    Camera(name="down", width_px=200, height_px=160, horizontal_fov_deg=90.0, tilt_deg=90.0, rate_hz=2.5),
    Camera(name="wide", width_px=160, height_px=120, horizontal_fov_deg=100.0, tilt_deg=80.0, rate_hz=4.0),
)
MODEL = DetectionModel(latency_s=0.15, latency_jitter_s=0.1, half_height_px=2.0, false_per_frame=0.4)


def spec_of(source: PerceptionSource, *names: str, model: DetectionModel = MODEL) -> SimSpec:
    """Two people below a vehicle with three cameras, all of which see them."""
    spec = watched_simspec()
    perception = Perception(source=source, model=model, more_cameras=names, begin_detections=1)
    # So low that people have ten pixels and more in the coarsest picture.
    parameters = {**spec.vehicle.parameters, "STILL_UP_M": 12.0}
    vehicle = spec.vehicle.model_copy(update={"more_cameras": CAMERAS, "parameters": parameters})
    mission = Mission(time_limit_s=2.0)
    return spec.model_copy(update={"vehicle": vehicle, "perception": perception, "mission": mission})


def fly(folder: Path, spec: SimSpec) -> FlownSession:
    session = fly_with(folder, spec, open_on_pixels=lambda _: BlobDetector())
    assert session.end.outcome is Outcome.TIME_LIMIT, f"{session.end.reason} {session.end.facts}"
    return session


@pytest.fixture(scope="module")
def blobs(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlownSession, FlownSession]:
    """With a detector on pixels."""
    return flown_twice(
        tmp_path_factory, spec_of("detector", "wide", "down"), open_on_pixels=lambda _: BlobDetector()
    )


def test_each_camera_has_its_detections(blobs: tuple[FlownSession, FlownSession]) -> None:
    """In its own pixels, frame and rate, late by the stated delay, with names that no other camera gives; twice alike."""
    session, repeated = blobs
    assert session.records == repeated.records
    names: dict[str, set[str]] = {}
    for topic, camera, period_ns in ((MAIN, "front", 2e8), (DOWN, "down", 4e8), (WIDE, "wide", 2.5e8)):
        messages = session.messages(topic, Detection2DArray)
        assert len(messages) >= 2e9 / period_ns - 2
        frames = {message.header.frame_id for _, message in messages}
        frames |= {item.header.frame_id for _, message in messages for item in message.detections}
        assert frames == {f"vehicle_1/camera_{camera}_optical"}
        stamps = [message.header.stamp.ns for _, message in messages]
        assert stamps == list(session.views(camera))[: len(stamps)]
        delays_s = [(time.ns - stamp) / 1e9 for (time, _), stamp in zip(messages, stamps, strict=True)]
        # A tick of 0.1 s after the delay at most.
        assert 0.15 <= min(delays_s) <= max(delays_s) <= 0.35
        hits, total = hits_of(session, topic, camera)
        assert hits > 0.6 * total > 5
        names[camera] = {item.id for _, message in messages for item in message.detections}
    for camera, begin in (("front", "t"), ("down", "down/t"), ("wide", "wide/t")):
        assert all(name.startswith(begin) for name in names[camera])


def test_views_and_pictures_of_other_cameras_are_left_alone(tmp_path: Path) -> None:
    """A camera that is not named has no views, no pictures and no topic; without any the recording is as it was."""
    session = fly(tmp_path / "down", spec_of("detector", "down"))
    assert session.views("down")
    assert not session.views("wide")
    assert not session.messages(WIDE, Detection2DArray)
    drawn = session.documents(TRUTH_PICTURES, PictureDocument)
    assert {picture.camera for _, picture in drawn} == {"front", "down"}
    alone = fly(tmp_path / "alone", spec_of("detector"))
    assert not alone.on(DOWN) + alone.on(WIDE)
    assert not alone.views("down")
    # The main camera's are the same with and without the others.
    assert alone.messages(MAIN, Detection2DArray) == session.messages(MAIN, Detection2DArray)
    assert alone.views("front") == session.views("front")


@pytest.mark.parametrize("source", ["truth", "simulated", "agent"])
def test_every_source_serves_every_camera_without_a_picture(tmp_path: Path, source: PerceptionSource) -> None:
    """The truth and the error model as well, at no cost of pixels; an agent with its own eyes gets none, and the views that
    judge it are there.
    """
    session = fly(tmp_path, spec_of(source, "down", "wide"))
    assert session.views("down")
    assert session.views("wide")
    assert not session.on(TRUTH_PICTURES)
    for topic, camera in ((MAIN, "front"), (DOWN, "down"), (WIDE, "wide")):
        messages = session.messages(topic, Detection2DArray)
        if source == "agent":
            assert not messages
            continue
        assert messages
        hits, total = hits_of(session, topic, camera)
        assert hits == total if source == "truth" else hits > 0.5 * total
    if source == "simulated":
        # Each camera errs by draws of its own: scores of equal labels hold fresh evidence.
        scores = [
            {
                round(item.results[0].hypothesis.score, 9)
                for _, message in session.messages(topic, Detection2DArray)
                for item in message.detections
            }
            for topic in (MAIN, DOWN, WIDE)
        ]
        assert not scores[0] & scores[1]
        assert not scores[1] & scores[2]


def test_cameras_err_by_seeds_of_their_own() -> None:
    """The main camera keeps the SimSpec's; another order of the names changes nothing."""
    spec, turned = spec_of("simulated", "down", "wide"), spec_of("simulated", "wide", "down")
    seeds = [seeds_of_camera(spec, camera).perception for camera in spec.perceiving_cameras]
    assert len(set(seeds)) == 3
    assert seeds == [seeds_of_camera(turned, camera).perception for camera in turned.perceiving_cameras]
    assert [camera.name for camera in turned.perceiving_cameras] == ["front", "down", "wide"]
    stated = spec.model_copy(update={"seeds": spec.seeds.model_copy(update={"perception": 7})})
    assert seeds_of_camera(stated, stated.vehicle.camera).perception == 7
    assert seeds_of_camera(stated, CAMERAS[0]).perception not in (7, seeds[1])


def test_an_outage_silences_every_camera(tmp_path: Path) -> None:
    """The service is lost as a whole; a degradation takes other detections from each camera."""
    outages = (
        Outage(kind="detections", at_s=0.5, duration_s=0.6),
        Outage(kind="detections_degraded", at_s=1.2, duration_s=0.8, lost_share=0.5),
    )
    spec = spec_of("truth", "down", "wide").model_copy(update={"outages": outages})
    session = fly(tmp_path, spec)
    for topic in (MAIN, DOWN, WIDE):
        messages = session.messages(topic, Detection2DArray)
        assert not [time for time, _ in messages if 0.5 <= time.s < 1.1]
        late = [message for time, message in messages if time.s >= 1.3]
        assert late
        scores = {item.results[0].hypothesis.score for message in late for item in message.detections}
        assert scores <= {0.75}


def test_measures_and_fit_take_in_every_camera(blobs: tuple[FlownSession, FlownSession]) -> None:
    """Frames are paired with the detections of their own camera, also where two cameras expose at one moment."""
    session, _ = blobs
    spec = session.spec
    tape = tape_from(session.records, spec)
    assert not tape.malformed
    by_camera = {camera: len(session.views(camera)) for camera in ("front", "down", "wide")}
    assert len(tape.frames) == sum(by_camera.values())
    answers = Answers.of(tape, spec)
    for frame, result in zip(tape.frames, answers.results, strict=True):
        if result is not None:
            assert result.camera == ("" if frame.camera == "front" else frame.camera)
            assert result.exposed == frame.exposed
    shared = [row for row, frame in enumerate(tape.frames) if frame.exposed.ns == tape.frames[0].exposed.ns]
    assert [tape.frames[row].camera for row in shared] == ["front", "down", "wide"]
    assert answers.answered[shared].all()
    counted = answers.answered[answers.sightings.frame]
    overlapping = set(answers.overlaps(0.001).sighting.tolist())
    assert overlapping <= set(counted.nonzero()[0].tolist())
    assert len(overlapping) > 0.6 * counted.sum()
    matched = match_runs([(spec, tape)])
    assert [run.camera.name for run in matched] == ["front", "down", "wide"]
    assert [len(run.frames) + run.unanswered for run in matched] == list(by_camera.values())
    fit = fit_detector([(spec, tape)])
    assert fit.evidence.frames == sum(len(run.frames) for run in matched)
    # Names never change from camera to camera, so no switch is seen where there is none.
    assert fit.evidence.track_s > 0.0


def test_the_report_draws_frames_of_further_cameras_again(
    blobs: tuple[FlownSession, FlownSession], tmp_path: Path
) -> None:
    """Equal in every pixel, from the recording alone."""
    session, _ = blobs
    path = tmp_path / "recording.mcap"
    with open_recording(path, simspec=session.spec, versions={}) as recorder:
        for record in session.records:
            recorder(record)
    for camera in session.spec.perceiving_cameras[1:]:
        view_ns, view = list(session.views(camera.name).items())[3]
        pixels = frame_pixels(path, session.spec, camera, view.frame, SimTime(view_ns))
        assert pixels is not None
        assert pixels.origin == DRAWN_AGAIN
        assert pixels.bgr.shape == (camera.height_px, camera.width_px, 3)


class MainCameraScene:
    """A scene that knows one camera."""

    def __init__(self, scene: PlainScene) -> None:
        self.cast, self.advance, self.positions = scene.cast, scene.advance, scene.positions
        self.headings, self.observe = scene.headings, scene.observe


def test_a_scene_of_one_camera_is_refused() -> None:
    """Before anything flies, with the field and the fix; without further detections it serves."""
    for names, faulty in (((), False), (("down",), True)):
        spec = spec_of("truth", *names)
        scene = open_plain_scene(spec)
        assert isinstance(scene, PlainScene)
        assert not scene_faults(spec, scene)
        faults = scene_faults(spec, MainCameraScene(scene))
        assert [fault.where for fault in faults] == ["perception.more_cameras"] * faulty


def test_the_plug_in_is_opened_once_for_all_cameras() -> None:
    """Its weights may be large; each camera has a tracker of its own."""
    spec = spec_of("detector", "down", "wide")
    open_blobs = Mock(return_value=BlobDetector())
    assert len(open_detectors(spec, cast_of(spec), open_blobs)) == 3
    open_blobs.assert_called_once()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("up",), "there is no camera 'up' in vehicle.more_cameras (there: down, wide)"),
        (("front",), "'front' is the main camera, which always has detections"),
        (("down", "wide", "down"), "the camera 'down' stands twice"),
    ],
)
def test_names_of_cameras_are_checked(names: tuple[str, ...], words: str) -> None:
    with pytest.raises(ValueError, match="perception") as fault:
        SimSpec.model_validate(spec_of("truth", *names).model_dump())
    assert words in str(fault.value)
