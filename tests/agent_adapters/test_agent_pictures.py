"""The reference agent that flies on its camera's pictures alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from agent_fakes import NAME, Actor, World, camera_info, grey_jpeg, intelligence, mount_quaternion

from agent_adapters.client import AgentEnvironment
from agent_adapters.reference import GroundCamera, VehiclePose
from agent_adapters.reference._agent import wanted
from agent_adapters.reference.perception._pictures import PictureDetections
from agent_adapters.reference.perception._pose import PoseHistory
from agent_adapters.reference.perception._tracks import PlacedDetection, Tracks
from bench.agents import load_manifest, open_agent
from bench.contracts import (
    TRUTH_PICTURES,
    Detection,
    IntelligenceDocument,
    Outcome,
    Pixels,
    Record,
    SessionResult,
    Tape,
    VehicleTopics,
)
from bench.documents import load_document
from bench.perception import ground_homography
from bench.realization import place
from bench.recording import TapeBuilder
from bench.simspec import AgentSpec, Camera, Perception, SimSpec
from bench.simulation import SessionPlan, run_session
from bench.streams import CompressedImage, Header, Time

CAMERA = GroundCamera.of(camera_info(), mount_quaternion(), level=True)


def pose(
    east_m: float,
    north_m: float,
    height_m: float,
    yaw_rad: float,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
    time_s: float = 0.0,
) -> VehiclePose:
    return VehiclePose(time_s, east_m, north_m, height_m, roll_rad, pitch_rad, yaw_rad)


@pytest.mark.parametrize("level", [True, False])
def test_axes_lead_back_to_the_pixel(level: bool) -> None:
    """A pixel's place on the ground, projected by the axes, is the pixel: for a level mount and one that tilts."""
    rng = np.random.default_rng(9)
    camera = GroundCamera.of(camera_info(), mount_quaternion(), level=level)
    lens = camera.lens
    for _ in range(20):
        at = pose(
            rng.uniform(-50, 50),
            rng.uniform(-50, 50),
            rng.uniform(20, 90),
            rng.uniform(-3, 3),
            rng.uniform(-0.2, 0.2),
            rng.uniform(-0.2, 0.2),
        )
        pixel = rng.uniform(100.0, 1100.0), rng.uniform(250.0, 700.0)
        place = camera.ground_point(*pixel, at, 0.7)
        assert place is not None
        homography = ground_homography(
            (lens.fx, lens.fy),
            (lens.cx, lens.cy),
            camera.axes_enu(at),
            np.array([at.east_m, at.north_m, at.height_m]),
            0.7,
        )
        u, v, depth = homography @ [*place, 1.0]
        assert depth > 0.0
        assert (u / depth, v / depth) == pytest.approx(pixel, abs=1e-6)


class ProjectingDetector:
    """Boxes of people who stand still, where a camera shows them that moves as the test says."""

    def __init__(self, places: Sequence[tuple[float, float]]) -> None:
        self.places = places
        self.at = pose(0.0, 0.0, 50.0, 0.0)

    def middles(self) -> list[tuple[float, float]]:
        lens, at = CAMERA.lens, self.at
        homography = ground_homography(
            (lens.fx, lens.fy),
            (lens.cx, lens.cy),
            CAMERA.axes_enu(at),
            np.array([at.east_m, at.north_m, at.height_m]),
            0.9,
        )
        projected = [homography @ [*place, 1.0] for place in self.places]
        return [(float(u / w), float(v / w)) for u, v, w in projected]

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        assert bgr.shape == (8, 8, 3)
        assert bgr.dtype == np.uint8
        return [Detection("civilian", 0.9, (x - 5.0, y - 9.0, x + 5.0, y + 9.0)) for x, y in self.middles()]


def picture(time_s: float, data: bytes | None = None) -> CompressedImage:
    header = Header(Time.of(round(time_s * 1e9)), "optical")
    return CompressedImage(header, "bgr8; jpeg compressed bgr8", grey_jpeg() if data is None else data)


def test_identities_last_through_a_turn() -> None:
    """Two people, while the vehicle turns by 50 degrees a second: the picture moves by 70 px and more from frame to frame."""
    poses = PoseHistory()
    detector = ProjectingDetector([(0.0, 25.0), (6.0, 30.0)])
    pictures = PictureDetections(detector, poses, lambda: CAMERA)
    middles: list[list[tuple[float, float]]] = []
    names = []
    for number in range(8):
        time_s, yaw_rad = 0.2 * number, math.radians(-35.0 + 10.0 * number)
        poses.place(time_s, 0.0, 0.0, 50.0, (0.0, 0.0, 0.0))
        poses.turn(time_s, 0.0, 0.0, yaw_rad)
        detector.at = pose(0.0, 0.0, 50.0, yaw_rad)
        middles.append(detector.middles())
        message = pictures.detections(picture(time_s))
        assert message is not None
        assert message.header.stamp.ns == round(time_s * 1e9)
        centres = {item.id: item.bbox.center.position for item in message.detections}
        if number == 0:
            # What is in one picture alone may be nothing.
            assert not centres
            continue
        names.append(
            [
                next(
                    name for name, centre in centres.items() if math.dist((centre.x, centre.y), middle) < 1e-6
                )
                for middle in middles[-1]
            ]
        )
    assert min(math.dist(a[0], b[0]) for a, b in pairwise(middles)) > 70.0
    assert {tuple(row) for row in names} == {tuple(names[0])}


def test_what_is_no_picture_is_passed_over() -> None:
    """Broken and empty data, an old picture, and any picture before the camera is known."""
    poses = PoseHistory()
    cameras: list[GroundCamera] = []
    pictures = PictureDetections(
        ProjectingDetector([(0.0, 25.0)]), poses, lambda: cameras[0] if cameras else None
    )
    assert pictures.detections(picture(1.0)) is None
    cameras.append(CAMERA)
    first = pictures.detections(picture(1.0))
    assert first is not None
    assert not first.detections
    for late in (picture(1.0), picture(0.8), picture(1.2, b""), picture(1.2, b"\xff\xd8 nothing")):
        assert pictures.detections(late) is None
    # Without any pose it still names: by the boxes alone.
    detections = pictures.detections(picture(1.2))
    assert detections is not None
    assert [item.id for item in detections.detections] == ["t1"]


@pytest.mark.parametrize("named", [True, False])
def test_own_identities_tell_walkers_apart_who_meet(named: bool) -> None:
    """Two walkers pass each other at half a metre: by place alone their tracks are exchanged, by name never."""
    tracks = Tracks()
    places: dict[str, list[float]] = {"a": [], "b": []}
    for number in range(21):
        time_s = 0.4 * number
        north = {"a": 100.0 + 1.5 * time_s, "b": 112.0 - 1.5 * time_s}
        sights = [
            PlacedDetection(
                time_s,
                0.5 * (walker == "b"),
                north[walker],
                "civilian",
                0.9,
                0.0,
                60.0,
                picture_track=walker if named else "",
            )
            for walker in ("a", "b")
        ]
        tracks.take(time_s, sights)
        for walker in ("a", "b"):
            places[walker].append(north[walker])
    assert len(tracks) == 2
    first, second = tracks
    went_on = first.north_m > second.north_m
    assert went_on is named


class TruthFedDetector:
    """A stand-in for a network: what the world's camera shows, whatever the picture."""

    def __init__(self, world: World) -> None:
        self._world = world

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        boxes = [(item.results[0].hypothesis, item.bbox) for item in self._world.frame().detections]
        return [
            Detection(
                hypothesis.class_id,
                hypothesis.score,
                (
                    box.center.position.x - box.size_x / 2.0,
                    box.center.position.y - box.size_y / 2.0,
                    box.center.position.x + box.size_x / 2.0,
                    box.center.position.y + box.size_y / 2.0,
                ),
            )
            for hypothesis, box in boxes
        ]


def test_a_mission_is_flown_without_any_detections_of_the_bench() -> None:
    """Two targets in two sub-areas, and people; the same reports as with the bench's detections of the same boxes."""
    actors = [
        Actor("mobile_radar", 120.0, 10.0),
        Actor("military_vehicle", -20.0, 150.0),
        Actor("civilian", 60.0, 70.0),
        Actor("civilian", 64.0, 70.0),
    ]
    reports: dict[float, IntelligenceDocument | tuple[IntelligenceDocument, ...]] = {
        0.0: (
            intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=40.0),
            intelligence("bravo", "military_vehicle", -10.0, 140.0, priority=2, uncertainty_m=40.0),
        )
    }
    flown = {
        eyes: World(
            list(actors), reports, open_detector=TruthFedDetector if eyes == "pictures" else None
        ).fly("naive")
        for eyes in ("pictures", "detections")
    }
    for world in flown.values():
        assert world.phase == "complete"
        places = {report.intelligence_id: (report.east_m, report.north_m) for report in world.reports}
        assert places["alpha"] == pytest.approx((120.0, 10.0), abs=2.0)
        assert places["bravo"] == pytest.approx((-20.0, 150.0), abs=2.0)
    assert len(flown["pictures"].reports) == len(flown["detections"].reports) == 2


def test_it_listens_to_pictures_in_place_of_detections() -> None:
    environment = AgentEnvironment(NAME, {}, None, "", "", 0, ("127.0.0.1", 1), {}, 0)
    topics = VehicleTopics(NAME)
    seeing = {want.topic for want in wanted(environment, "front", "pictures")}
    subscribed = {want.topic for want in wanted(environment, "front", "detections")}
    assert seeing - subscribed == {topics.image_compressed("front")}
    assert subscribed - seeing == {topics.detections}
    manifest, _ = load_manifest("reference-pictures")
    assert manifest.command[-4:] == ("--policy", "naive", "--eyes", "pictures")


@dataclass(frozen=True)
class PictureFlight:
    """How a session with the real detector ended, what was recorded, and what measures read in it."""

    end: SessionResult
    records: list[Record]
    tape: Tape


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> PictureFlight:
    """examples/search.yaml, low, from near the first target, with small pictures."""
    base = load_document(Path(__file__).parents[2] / "examples" / "search.yaml", SimSpec)
    camera = Camera(width_px=320, height_px=240, rate_hz=2.0)
    home = base.vehicle.home.model_copy(update={"north_m": 45.0})
    spec = place(
        base.model_copy(
            update={
                "vehicle": base.vehicle.model_copy(update={"camera": camera, "home": home}),
                "mission": base.mission.model_copy(update={"time_limit_s": 80.0, "altitude_m": 20.0}),
                "perception": Perception(source="agent"),
                "agent": AgentSpec(manifest="reference-pictures"),
            }
        )
    )
    manifest, folder = load_manifest("reference-pictures")
    records: list[Record] = []
    builder = TapeBuilder(spec)

    def tap(record: Record) -> None:
        records.append(record)
        builder(record)

    end = run_session(
        SessionPlan(spec, manifest, folder, open_agent, tmp_path_factory.mktemp("scratch"), tap)
    )
    return PictureFlight(end, records, builder.tape())


@pytest.mark.flight
@pytest.mark.process
def test_it_flies_in_lockstep_on_what_its_own_detector_sees(flight: PictureFlight) -> None:
    """Pictures come and no detections; the agent flies out, and its tracks are there to be measured."""
    ends = (Outcome.COMPLETED, Outcome.TIME_LIMIT)
    assert flight.end.outcome in ends, f"{flight.end.reason} {flight.end.facts}"
    topics = VehicleTopics(NAME)
    recorded = {record.topic for record in flight.records}
    assert topics.detections not in recorded
    assert flight.tape.detections == ()
    pictures = [record for record in flight.records if record.topic == TRUTH_PICTURES]
    # Every frame of the camera was rendered, because the agent listens.
    assert len(pictures) == len(flight.tape.frames) > 50
    assert flight.tape.vehicle_position_enu_m[:, 2].max() > 15.0
    assert len(flight.tape.tracks) >= 25
    # It would notice if pictures had not come. That they become worse may well be.
    decisions = [(decision.value.action, decision.value.subject) for decision in flight.tape.decisions]
    assert ("notice", "detections") not in decisions
