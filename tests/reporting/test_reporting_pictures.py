"""Pictures of the frames in which a detector failed: which frame, which boxes, and whose pixels."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import made_run
import numpy as np
import polars as pl
import pytest
from fake_agents import agent_manifest
from made_campaign import Made, make_campaign
from made_run import at_s

from bench.agents import open_agent
from bench.arrays import Bools
from bench.camera import decode_jpeg
from bench.cli._app import run
from bench.contracts import (
    TF,
    TRUTH_PICTURES,
    CameraFrame,
    Detection,
    DetectionFrame,
    Outcome,
    PictureDocument,
    Pixels,
    Record,
    Sighting,
    SimTime,
    VehicleState,
)
from bench.errors import SetupError
from bench.recording import open_recording, read_records, read_tape
from bench.reporting import ReportData, load_report_data, render_report
from bench.reporting._campaign_data import Run
from bench.reporting.pictures._boxed_frames import CAPTION_PX, COLOURS, GAP_PX, _at, _drawn, boxed_frames
from bench.reporting.pictures._frame_pixels import DRAWN_AGAIN, RECORDED, frame_pixels
from bench.reporting.pictures._recorded_state import RecordedStates
from bench.reporting.pictures._verdicts import JudgedBox, Verdict, judge, worst_frame
from bench.reporting.pictures._worst_pictures import MAX_PICTURES, WorstPicture, worst_pictures
from bench.simspec import Outage, Perception, SimSpec
from bench.simulation import SessionPlan, run_session
from bench.simulation._camera_messages import CameraMessages
from bench.simulation._truth import TruthRecorder
from bench.streams import String, TFMessage, decode, encode

Box = tuple[float, float, float, float]
Recordings = dict[str, tuple[SimSpec, Path]]
LEFT: Box = (0.0, 0.0, 20.0, 40.0)
RIGHT: Box = (100.0, 0.0, 120.0, 40.0)
FAR: Box = (200.0, 0.0, 210.0, 10.0)


def frame_of(*sightings: tuple[int, Box, float, float], number: int = 0) -> CameraFrame:
    """Actor, box, height and visible share of each."""
    rows = [Sighting(actor, 60.0, height_px, visible, box) for actor, box, height_px, visible in sightings]
    return CameraFrame(number, "front", at_s(0.2 * number), tuple(rows))


def answer(number: int, *detections: Detection) -> DetectionFrame:
    return DetectionFrame(at_s(0.2 * number), at_s(0.2 * number + 0.1), detections)


@pytest.mark.parametrize(
    ("detections", "expected"),
    [
        ((), [Verdict.MISSED, Verdict.MISSED, Verdict.UNCLEAR, Verdict.UNCLEAR]),
        (
            (Detection("civilian", 0.9, LEFT), Detection("mobile_radar", 0.9, RIGHT)),
            [*[Verdict.TRUTH] * 2, *[Verdict.UNCLEAR] * 2, Verdict.HIT, Verdict.MISLABELLED],
        ),
        (
            # Too unsure to count; beside everything; on what need not be seen.
            (
                Detection("civilian", 0.3, LEFT),
                Detection("civilian", 0.9, (50.0, 50.0, 70.0, 90.0)),
                Detection("civilian", 0.4, FAR),
            ),
            [Verdict.MISSED, Verdict.MISSED, Verdict.TRUTH, Verdict.UNCLEAR, Verdict.FALSE, Verdict.HIT],
        ),
    ],
)
def test_boxes_are_judged_as_measured(detections: Sequence[Detection], expected: Sequence[Verdict]) -> None:
    cast = made_run.cast(made_run.simspec())
    people = [index for index, member in enumerate(cast) if member.class_label == "civilian"]
    frame = frame_of(
        (people[0], LEFT, 40.0, 1.0),
        (people[1], RIGHT, 40.0, 0.6),
        (people[0], FAR, 10.0, 1.0),
        (people[1], (300.0, 0.0, 320.0, 40.0), 40.0, 0.4),
    )
    judged = judge(cast, frame, detections)
    assert [box.verdict for box in judged.boxes] == expected
    errors = (Verdict.MISSED, Verdict.MISLABELLED, Verdict.FALSE)
    assert judged.errors == sum(verdict in errors for verdict in expected)


def test_the_worst_frame_has_the_most_errors_outside_outages() -> None:
    outage = Outage(kind="detections_degraded", at_s=0.6, duration_s=0.2, lost_share=0.5)
    spec = made_run.simspec().model_copy(update={"outages": (outage,)})
    people = [i for i, member in enumerate(made_run.cast(spec)) if member.class_label == "civilian"]
    people_sightings = [(people[0], LEFT, 40.0, 1.0), (people[1], RIGHT, 40.0, 1.0)]
    hit, missing = Detection("civilian", 0.9, LEFT), Detection("crate", 0.9, (50.0, 50.0, 60.0, 60.0))
    frames = tuple(frame_of(*people_sightings, number=number) for number in range(7))
    other = replace(frame_of(*people_sightings, number=7), camera="rear")
    answers = (
        answer(0, hit),
        answer(2, hit, missing),  # two errors
        answer(3, missing, missing),  # four, but in the degradation
        answer(4, hit, missing),  # two again: the first counts
        answer(7, missing, missing),  # of another camera
    )
    tape = made_run.tape(spec, frames=(*frames, other), detections=answers)
    worst = worst_frame(spec, tape)
    assert worst is not None
    assert (worst.number, worst.errors, worst.counts[Verdict.HIT]) == (2, 2, 1)
    assert worst_frame(spec, made_run.tape(spec, frames=frames, detections=answers[:0])) is None
    rear = replace(answer(7, missing, missing), camera="rear")
    worst = worst_frame(spec, made_run.tape(spec, frames=(*frames, other), detections=(*answers, rear)))
    assert worst is not None
    assert (worst.camera, worst.number, worst.errors) == ("rear", 7, 4)


def test_states_come_back_from_their_records() -> None:
    """Attitude, velocity, rates and gimbal as the session recorded them; halfway between, half the way."""
    spec = made_run.simspec()
    camera = spec.vehicle.camera.model_copy(update={"gimbal": True})
    spec = spec.model_copy(update={"vehicle": spec.vehicle.model_copy(update={"camera": camera})})
    random = np.random.default_rng(5)
    states = [_random_state(random, at_s(0.1 * step)) for step in range(30)]
    recorded = RecordedStates(spec, camera)
    truth, messages = TruthRecorder(spec.vehicle.name, recorded.take), CameraMessages.of(spec, camera)
    for state in states:
        truth._odometry(state.time, state)
        mount = encode(TFMessage((messages.mount(state.time, state),)))
        recorded.take(Record(state.time, TF, TFMessage.TYPE, mount))
    for state in states:
        recovered = recorded.at(state.time)
        assert recovered is not None
        assert _numbers(recovered) == pytest.approx(_numbers(state), abs=1e-9)
    between = recorded.at(SimTime((states[3].time.ns + states[4].time.ns) // 2))
    assert between is not None
    middle = np.mean([states[3].position_enu_m, states[4].position_enu_m], axis=0)
    assert between.position_enu_m == pytest.approx(tuple(middle))
    assert recorded.at(at_s(99.0)) is None


def _random_state(random: np.random.Generator, time: SimTime) -> VehicleState:
    place, velocity, rates = random.normal(0.0, 20.0, (3, 3)).tolist()
    roll, pitch = random.uniform(-0.6, 0.6, 2).tolist()
    yaw, pan, tilt = random.uniform((-1.5, -2.0, 0.0), (4.5, 2.0, 1.5)).tolist()
    return VehicleState(time, tuple(place), tuple(velocity), roll, pitch, yaw, tuple(rates), pan, tilt)


def _numbers(state: VehicleState) -> list[float]:
    angles = (state.roll_rad, state.pitch_rad, state.camera_pan_rad or 0.0, state.camera_tilt_rad or 0.0)
    turned = (float(np.cos(state.yaw_rad)), float(np.sin(state.yaw_rad)))
    return [*state.position_enu_m, *state.velocity_enu_mps, *angles, *turned, *state.rates_body_radps]


@dataclass(frozen=True)
class CrateDetector:
    """Always the same crate, where none is."""

    box: Box

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        return [Detection("crate", 0.8, self.box)]


def watched(**camera: object) -> SimSpec:
    """Two people below a vehicle that turns in the wind; frames may freeze."""
    people = (("man", {"east_m": 29.0, "north_m": 31.0}), ("woman", {"east_m": 31.0, "north_m": 29.0}))
    placed = [{"id": f"{name}-1", "group": name, "heading_deg": 40.0, **at} for name, at in people]
    corners = [{"east_m": x, "north_m": y} for x, y in ((0, 0), (60, 0), (60, 60), (0, 60))]
    return SimSpec.model_validate(
        {
            "name": "watched",
            "world": {"area": {"corners": corners}},
            "environment": {"rain_level": 3.0},
            "perception": {"source": "detector", "detector": "crates", "begin_detections": 1},
            "vehicle": {
                "model": "still",
                "home": {"east_m": 30.0, "north_m": 30.0, "heading_deg": 20.0},
                "parameters": {"STILL_UP_M": 14.0, "STILL_TURN_DEGPS": 30.0, "STILL_PAN_DEG": 15.0},
                "camera": {"tilt_deg": 80.0, **camera},
            },
            "mission": {"time_limit_s": 1.6},
            "actors": [{"id": name, "asset": name, "role": "bystander", "count": 1} for name, _ in people],
            "realized": {"actors": placed},
        }
    )


def flown(folder: Path, spec: SimSpec) -> Path:
    folder.mkdir()
    path = folder / "recording.mcap"
    detector, agent = CrateDetector((5.0, 5.0, 45.0, 35.0)), agent_manifest("idle")
    with open_recording(path, simspec=spec, versions={}) as recording:
        plan = SessionPlan(spec, agent, folder, open_agent, folder / "scratch", recording)
        end = run_session(replace(plan, open_on_pixels=lambda _: detector))
    assert end.outcome is Outcome.TIME_LIMIT, f"{end.reason} {end.facts}"
    return path


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Recordings:
    """Frames that were not recorded, of a camera that freezes and of one on a gimbal; and frames that were."""
    root = tmp_path_factory.mktemp("pictures")
    specs = {
        "frozen": watched(width_px=640, height_px=480, frozen_share=0.5),
        "gimbal": watched(width_px=400, height_px=300, gimbal=True),
        "kept": watched(width_px=1200, height_px=400, record_frames=True),
    }
    return {name: (spec, flown(root / name, spec)) for name, spec in specs.items()}


def pictures_of(recording: Path) -> list[tuple[SimTime, PictureDocument]]:
    documents = []
    for record in read_records(recording):
        if record.topic == TRUTH_PICTURES:
            message = decode(String, record.data)
            assert message is not None
            documents.append((record.time, PictureDocument.model_validate_json(message.data)))
    return documents


@pytest.mark.parametrize("name", ["frozen", "gimbal"])
def test_frames_are_drawn_again_to_the_pixel(recordings: Recordings, name: str) -> None:
    """By the recorded digest: also frozen ones, which show the picture of an older frame."""
    spec, recording = recordings[name]
    pictures = pictures_of(recording)
    frozen = [number for number, (_, picture) in enumerate(pictures) if picture.shown != picture.frame]
    assert bool(frozen) == (name == "frozen")
    for number in (*frozen[:1], 5):
        exposed, picture = pictures[number]
        pixels = frame_pixels(recording, spec, spec.vehicle.camera, picture.frame, exposed)
        assert pixels is not None
        assert hashlib.sha256(pixels.bgr.tobytes()).hexdigest() == picture.sha256
        assert pixels.origin == DRAWN_AGAIN


def test_recorded_frames_are_taken_as_they_are(recordings: Recordings) -> None:
    spec, recording = recordings["kept"]
    exposed, picture = pictures_of(recording)[2]
    pixels = frame_pixels(recording, spec, spec.vehicle.camera, picture.frame, exposed)
    later = pictures_of(recording)[3][0]
    other = frame_pixels(recording, spec, spec.vehicle.camera, picture.frame + 1, later)
    assert pixels is not None
    assert other is not None
    assert (pixels.origin, pixels.bgr.shape) == (RECORDED, (400, 1200, 3))
    # The vehicle turns: another frame is another picture.
    assert float(np.abs(pixels.bgr.astype(float) - other.bgr).mean()) > 3.0


def made_data(folder: Path, recordings: Recordings, copies: int = 1) -> ReportData:
    """A campaign's data whose runs are these, each `copies` times."""
    data = load_report_data(make_campaign(folder, Made(scenes=1)))
    runs = [
        Run(f"{name}-{copy}", name, copy, data.agents[0], None, Outcome.TIME_LIMIT, recording=path)
        for copy in range(copies)
        for name, (_, path) in recordings.items()
    ]
    specs = {run.realization: recordings[run.design_point][0] for run in runs}
    return replace(data, runs=tuple(runs), simspecs=specs)


@pytest.fixture(scope="module")
def shown(
    tmp_path_factory: pytest.TempPathFactory, recordings: Recordings
) -> tuple[ReportData, list[WorstPicture]]:
    data = made_data(tmp_path_factory.mktemp("shown") / "c", recordings)
    pictures, notes = worst_pictures(data)
    assert not notes
    return data, pictures


def test_the_page_shows_the_picture_with_its_boxes(shown: tuple[ReportData, list[WorstPicture]]) -> None:
    """One for each run, scaled, with two missed people and a false crate in the worst frame."""
    data, pictures = shown
    assert sorted(picture.run.design_point for picture in pictures) == ["frozen", "gimbal", "kept"]
    page = render_report(data, pictures=pictures)
    assert page.count("data:image/jpeg;base64,") == 3
    assert 'href="#sensor"' in page
    assert page.index('id="sensor"') < page.index('id="pictures"') < page.index('id="configurations"')
    for picture in pictures:
        jpeg = decode_jpeg(base64.b64decode(picture.jpeg))
        assert jpeg is not None
        width_px = (picture.run.design_point == "kept" and 960) or picture.width_px
        assert jpeg.shape[:2] == (round(picture.height_px * width_px / picture.width_px), width_px)
        assert (picture.summary, len(picture.labels)) == ("2 missed and 1 false", 3)
    assert "<title>false: crate 0.80</title>" in page
    assert page.count("<title>missed: man-1 (civilian)") == 3
    # 1.5 MB are the library for the figures.
    assert len(page) < 3e6


def test_few_runs_are_shown_and_a_damaged_recording_is_named(tmp_path: Path, recordings: Recordings) -> None:
    """At most four pictures, of the runs with the lowest shares; runs without pictures have none."""
    small = {"gimbal": recordings["gimbal"]}
    data = made_data(tmp_path / "c", small, copies=MAX_PICTURES + 2)
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(b"no recording")
    runs = (replace(data.runs[0], recording=damaged), *data.runs[1:])
    failed = {"node": "OBS-9", "standing": "configured sensor", "considered": 1, "achieved": 0}
    rows = [
        failed | {"realization": run.realization, "agent": run.agent, "x": 0.1 * place}
        for place, run in enumerate(runs)
    ]
    scores = pl.concat([data.scores.clear(), pl.DataFrame(rows)], how="diagonal_relaxed")
    simulated = watched().model_copy(update={"perception": Perception()})
    specs = {**data.simspecs, runs[2].realization: simulated}
    pictures, notes = worst_pictures(replace(data, runs=runs, scores=scores, simspecs=specs))
    wanted = [runs[place].realization for place in (1, 3, 4, 5)]
    assert [picture.run.realization for picture in pictures] == wanted
    assert pictures[0].failed == "OBS-9"
    assert len(notes) == 1
    assert notes[0].startswith(f"No picture of {runs[0].realization}: ")


def test_frames_of_two_runs_stand_in_rows_with_their_boxes(recordings: Recordings, tmp_path: Path) -> None:
    """The pixels are those of the frame; the crate that is nowhere is drawn in its colour, and on top stands what is what."""
    files = [recordings[name][1] for name in ("gimbal", "kept")]
    sheet = boxed_frames(files, (0.6, 1.2))
    assert sheet.shape == (2 * (400 + CAPTION_PX) + GAP_PX, 2 * 1200 + GAP_PX, 3)
    tops = {"gimbal": CAPTION_PX, "kept": 400 + 2 * CAPTION_PX + GAP_PX}
    for name, top in tops.items():
        spec, recording = recordings[name]
        frames = [frame for frame in read_tape(recording, spec).frames if frame.exposed.s <= 0.6]
        pixels = frame_pixels(recording, spec, spec.vehicle.camera, frames[-1].number, frames[-1].exposed)
        assert pixels is not None
        height_px, width_px = pixels.bgr.shape[:2]
        shown = sheet[top : top + height_px, :width_px]
        # Words of another box may stand on a part of it.
        assert (shown[5:36, 5] == COLOURS[Verdict.FALSE]).all(axis=1).mean() > 0.5
        # Below the crate, where people and their labels are not.
        corner = slice(60, height_px // 3), slice(width_px // 3)
        assert (shown[corner] == pixels.bgr[corner]).all()
    # Without a time the frame with the most errors.
    assert boxed_frames(files[:1]).shape == (300 + CAPTION_PX, 400, 3)
    out = tmp_path / "new" / "frames.png"
    folders = [str(file.parent) for file in files]
    assert run(["camera", "frames", *folders, "--at", "0.6", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(SetupError, match="has no frame with a result of the detector up to -1 s"):
        boxed_frames(files, (0.6, -1.0))


def test_a_label_stays_in_the_frame(recordings: Recordings) -> None:
    """Of a box that leaves the frame it is as large as of any other; and its outline is no wider than its letters."""
    spec, recording = recordings["gimbal"]
    frame = _at(spec, read_tape(recording, spec), 0.6)
    assert frame is not None
    width_px, height_px = spec.vehicle.camera.width_px, spec.vehicle.camera.height_px
    label = "mobile_radar 0.84"

    def ink(box: Box) -> Bools:
        frames = (replace(frame, boxes=(JudgedBox(box, Verdict.HIT, text),)) for text in (label, ""))
        drawn, bare = (_drawn(recording, spec, judged, "")[CAPTION_PX:] for judged in frames)
        changed: Bools = (drawn != bare).any(axis=2)
        return changed

    inside = ink((150.0, 150.0, 180.0, 180.0))
    ((text_width_px, _), _) = cv2.getTextSize(label, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    columns = np.flatnonzero(inside.any(axis=0))
    assert columns.min() >= 148
    assert columns.max() <= 150 + text_width_px + 1
    left, right = (-40.0, 100.0, 20.0, 150.0), (width_px - 5.0, 100.0, width_px + 30.0, 150.0)
    for box in (left, right, (100.0, -20.0, 150.0, height_px + 9.0)):
        assert ink(box).sum() > 0.8 * inside.sum() > 40


def test_an_agent_that_looks_for_itself_is_told_no_errors(recordings: Recordings) -> None:
    spec, recording = recordings["gimbal"]
    own = spec.model_copy(update={"perception": Perception(source="agent")})
    frame = _at(own, read_tape(recording, spec), 1.2)
    assert frame is not None
    assert {item.verdict for item in frame.boxes} <= {Verdict.TRUTH}
    judged = _at(spec, read_tape(recording, spec), 1.2)
    assert judged is not None
    assert judged.errors >= 1
