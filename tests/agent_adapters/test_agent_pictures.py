"""The reference agent that flies on its camera's pictures alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from bench.contracts import TRUTH_PICTURES, Detection, Outcome, Pixels, Record, VehicleTopics
from bench.documents import load_document
from bench.perception import ground_homography
from bench.realization import place
from bench.recording import TapeBuilder
from bench.simspec import SimSpec
from bench.simulation import SessionPlan, run_session
from bench.streams import CompressedImage, Header, Time

CAMERA = GroundCamera.of(camera_info(), mount_quaternion(), level=True)


Place = tuple[float, float]


def pose(
    east_m: float,
    north_m: float,
    height_m: float,
    yaw_rad: float,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
) -> VehiclePose:
    return VehiclePose(0.0, east_m, north_m, height_m, roll_rad, pitch_rad, yaw_rad)


def projected(camera: GroundCamera, at: VehiclePose, place: Place, up_m: float) -> Place:
    """The pixel of a place in front of a camera."""
    lens, eye = camera.lens, np.array([at.east_m, at.north_m, at.height_m])
    homography = ground_homography((lens.fx, lens.fy), (lens.cx, lens.cy), camera.axes_enu(at), eye, up_m)
    u, v, depth = (homography @ [*place, 1.0]).tolist()
    assert depth > 0.0
    return u / depth, v / depth


@pytest.mark.parametrize("level", [True, False])
def test_axes_lead_back_to_the_pixel(level: bool) -> None:
    """A pixel's place on the ground, projected by the axes, is the pixel: for a level mount and one that tilts."""
    rng = np.random.default_rng(9)
    camera = GroundCamera.of(camera_info(), mount_quaternion(), level=level)
    for _ in range(20):
        low, high = (-50, -50, 20, -3, -0.2, -0.2), (50, 50, 90, 3, 0.2, 0.2)
        at = pose(*rng.uniform(low, high).tolist())
        pixel = rng.uniform(100.0, 1100.0), rng.uniform(250.0, 700.0)
        place = camera.ground_point(*pixel, at, 0.7)
        assert place is not None
        assert projected(camera, at, place, 0.7) == pytest.approx(pixel, abs=1e-6)


class ProjectingDetector:
    """Boxes of people who stand still, where a camera shows them that moves as the test says."""

    def __init__(self, places: Sequence[Place]) -> None:
        self.places = places
        self.at = pose(0.0, 0.0, 50.0, 0.0)

    def middles(self) -> list[Place]:
        return [projected(CAMERA, self.at, place, 0.9) for place in self.places]

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
    middles: list[list[Place]] = []
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
                name
                for middle in middles[-1]
                for name, c in centres.items()
                if math.dist((c.x, c.y), middle) < 1e-6
            ]
        )
    assert min(math.dist(a[0], b[0]) for a, b in pairwise(middles)) > 70.0
    assert len(names[0]) == 2
    assert names == [names[0]] * 7


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
    for number in range(21):
        time_s = 0.4 * number
        north = {"a": 100.0 + 1.5 * time_s, "b": 112.0 - 1.5 * time_s}
        sights = [
            PlacedDetection(
                time_s,
                east_m,
                north[walker],
                "civilian",
                0.9,
                0.0,
                60.0,
                picture_track=walker if named else "",
            )
            for walker, east_m in (("a", 0.0), ("b", 0.5))
        ]
        tracks.take(time_s, sights)
    assert len(tracks) == 2
    first, second = tracks
    assert (first.north_m > second.north_m) is named


class TruthFedDetector:
    """A stand-in for a network: what the world's camera shows, whatever the picture."""

    def __init__(self, world: World) -> None:
        self._world = world

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        found = []
        for item in self._world.frame().detections:
            best, box = item.results[0].hypothesis, item.bbox
            at, half_x, half_y = box.center.position, box.size_x / 2.0, box.size_y / 2.0
            corners = (at.x - half_x, at.y - half_y, at.x + half_x, at.y + half_y)
            found.append(Detection(best.class_id, best.score, corners))
        return found


def test_a_mission_is_flown_without_any_detections_of_the_bench() -> None:
    """Two targets in two sub-areas, and people; the same reports as with the bench's detections of the same boxes."""
    places = (("mobile_radar", 120.0, 10.0), ("military_vehicle", -20.0, 150.0))
    people = (("civilian", 60.0, 70.0), ("civilian", 64.0, 70.0))
    told = (
        intelligence("alpha", "mobile_radar", 115.0, 0.0, uncertainty_m=40.0),
        intelligence("bravo", "military_vehicle", -10.0, 140.0, priority=2, uncertainty_m=40.0),
    )
    flown = {
        eyes: World([Actor(*at) for at in (*places, *people)], {0.0: told}, open_detector=detector).fly(
            "naive"
        )
        for eyes, detector in (("pictures", TruthFedDetector), ("detections", None))
    }
    for world in flown.values():
        assert world.phase == "complete"
        found = {report.intelligence_id: (report.east_m, report.north_m) for report in world.reports}
        assert found["alpha"] == pytest.approx((120.0, 10.0), abs=2.0)
        assert found["bravo"] == pytest.approx((-20.0, 150.0), abs=2.0)
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


@pytest.mark.flight
@pytest.mark.process
def test_it_flies_in_lockstep_on_what_its_own_detector_sees(tmp_path: Path) -> None:
    """examples/search.yaml, low, from near the first target, with small pictures: pictures come and no detections; the
    agent flies out, and its tracks are there to be measured.
    """
    base = load_document(Path(__file__).parents[2] / "examples" / "search.yaml", SimSpec)
    document = base.model_dump()
    document["vehicle"]["camera"] = {"width_px": 320, "height_px": 240, "rate_hz": 1.0}
    document["vehicle"]["home"]["north_m"] = 45.0
    document["mission"] |= {"time_limit_s": 80.0, "altitude_m": 20.0}
    document["perception"] = {"source": "agent"}
    document["agent"] = {"manifest": "reference-pictures"}
    spec = place(SimSpec.model_validate(document))
    manifest, folder = load_manifest("reference-pictures")
    records: list[Record] = []
    builder = TapeBuilder(spec)

    def tap(record: Record) -> None:
        records.append(record)
        builder(record)

    end = run_session(SessionPlan(spec, manifest, folder, open_agent, tmp_path, tap))
    tape = builder.tape()
    assert end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), f"{end.reason} {end.facts}"
    topics = VehicleTopics(NAME)
    recorded = {record.topic for record in records}
    assert topics.detections not in recorded
    assert tape.detections == ()
    pictures = [record for record in records if record.topic == TRUTH_PICTURES]
    # Every frame of the camera was rendered, because the agent listens.
    assert len(pictures) == len(tape.frames) > 50
    assert tape.vehicle_position_enu_m[:, 2].max() > 15.0
    assert len(tape.tracks) >= 25
    # It would notice if pictures had not come. That they become worse may well be.
    decisions = [(decision.value.action, decision.value.subject) for decision in tape.decisions]
    assert ("notice", "detections") not in decisions
