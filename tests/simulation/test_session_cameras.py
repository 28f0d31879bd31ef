"""Several cameras in a session: the main one on the gimbal, one fixed that looks down through a distorting lens."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
import pytest
from fake_agents import agent_manifest
from gl_renderer import declare, needs_gl
from scipy.spatial.transform import Rotation
from test_session import run, tape_from
from test_session_pictures import TOPICS, FlownSession, flown_twice, fly, watched_simspec

from bench.arrays import Floats
from bench.camera import decode_depth, decode_mask, open_camera
from bench.contracts import (
    START,
    TF,
    TF_STATIC,
    TRUTH_VIEW,
    CameraPose,
    Outcome,
    Picture,
    VehicleState,
    ViewDocument,
    truth_depth_topic,
    truth_mask_topic,
)
from bench.simspec import Camera, Distortion, Mission, SimSpec
from bench.simulation import camera_faults
from bench.simulation._camera_messages import CameraMessages
from bench.simulation._pictures import _build_of
from bench.streams import CameraInfo, CompressedImage, TFMessage, TransformStamped

BARREL = Distortion(k1=-0.25, k2=0.06, p1=0.001, p2=-0.0008, k3=-0.004)
DOWN = Camera(
    name="down",
    width_px=200,
    height_px=160,
    horizontal_fov_deg=90.0,
    tilt_deg=90.0,
    rate_hz=2.5,
    distortion=BARREL,
    record_boxes=True,
    record_masks=True,
    record_depth=True,
)
FRAMES = {"front": 11, "down": 6}


def two_cameras() -> SimSpec:
    """Two people below a vehicle whose gimbal is turned, so that only its fixed camera looks ahead."""
    spec = watched_simspec(gimbal=True, record_boxes=True)
    parameters = {**spec.vehicle.parameters, "STILL_PAN_DEG": 100.0}
    agent = spec.agent.model_copy(update={"options": {"cameras": "down"}})
    spec = spec.model_copy(update={"agent": agent, "mission": Mission(time_limit_s=2.0)})
    return changed_vehicle(spec, parameters=parameters, more_cameras=(DOWN,))


def changed_vehicle(spec: SimSpec, **changes: object) -> SimSpec:
    return spec.model_copy(update={"vehicle": spec.vehicle.model_copy(update=changes)})


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlownSession, FlownSession]:
    """With an agent that listens to the camera `down` alone."""
    return flown_twice(tmp_path_factory, two_cameras(), watched=True)


def transforms(session: FlownSession, topic: str) -> dict[int, dict[str, TransformStamped]]:
    """By time and child frame."""
    return {
        time.ns: {item.child_frame_id: item for item in message.transforms}
        for time, message in session.messages(topic, TFMessage)
    }


def matrix_of(transform: TransformStamped) -> Floats:
    """(4, 4) from the child frame to its parent."""
    place, turn = transform.transform.translation, transform.transform.rotation
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix()
    matrix[:3, 3] = (place.x, place.y, place.z)
    return matrix


def test_each_camera_has_its_rate_its_digests_and_its_topics(
    flown: tuple[FlownSession, FlownSession],
) -> None:
    """Frames are numbered camera by camera, the agent gets those of its topics, and two flights are equal."""
    session, repeated = flown
    assert session.records == repeated.records
    for camera, count in FRAMES.items():
        pictures = [picture for _, picture in session.pictures(camera)]
        assert [picture.frame for picture in pictures] == list(range(count))
        assert len({picture.sha256 for picture in pictures}) == count
        # What is exposed at the end of the session has no tick after it.
        assert len(session.on(TOPICS.camera_info(camera))) == count - 1
    assert session.renderer.opened == 2
    raw = [line for line in session.lines if line["topic"] == TOPICS.image_raw("down")]
    assert [line["sha256"] for line in raw] == [
        picture.sha256 for _, picture in session.pictures("down")[:-1]
    ]
    assert {(line["width"], line["height"], line["frame"]) for line in raw} == {
        (200, 160, "vehicle_1/camera_down_optical")
    }
    assert {str(line["topic"]).split("/")[3] for line in session.lines} == {"down"}
    builds = session.texts_of("camera opened")
    assert builds == [builds[0], f"down: {builds[0]}"]


def test_two_cameras_cost_nothing_while_nobody_listens(tmp_path: Path) -> None:
    """The session of an idle agent does not even import OpenCV, and still publishes what a camera costs nothing for."""
    silent = {"record_boxes": False, "record_masks": False, "record_depth": False}
    spec = two_cameras()
    front, down = (camera.model_copy(update=silent) for camera in (spec.vehicle.camera, DOWN))
    spec = changed_vehicle(spec, camera=front, more_cameras=(down,))
    spec = spec.model_copy(update={"mission": Mission(time_limit_s=1.0)})
    (tmp_path / "simspec.json").write_text(spec.model_dump_json())
    code = """
import sys
from pathlib import Path
sys.path.append(sys.argv[2])
from bench.agents import open_agent
from bench.simspec import SimSpec
from bench.simulation import SessionPlan, run_session
from fake_agents import agent_manifest
here = Path(sys.argv[1])
spec, records = SimSpec.model_validate_json((here / "simspec.json").read_text()), []
(here / "scratch").mkdir()
end = run_session(SessionPlan(spec, agent_manifest("idle"), here, open_agent, here / "scratch", records.append))
infos = sum(record.topic.endswith("/down/camera_info") for record in records)
print(end.outcome, infos, "cv2" in sys.modules)
"""
    answer = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path), str(Path(__file__).parents[1])],
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.split() == ["time_limit", "3", "False"], answer.stderr


def test_sightings_are_those_of_the_main_camera(flown: tuple[FlownSession, FlownSession]) -> None:
    """A second camera changes nothing about what the detector gets."""
    views = [view for _, view in flown[0].documents(TRUTH_VIEW, ViewDocument)]
    assert [view.frame for view in views] == list(range(FRAMES["front"]))
    assert {view.camera for view in views} == {"front"}


def test_people_are_where_camera_info_and_tf_of_each_camera_say(
    flown: tuple[FlownSession, FlownSession],
) -> None:
    """A person's waist by cv2.projectPoints, with the distortion of camera_info, lies in the box of its pixels."""
    session, _ = flown
    (fixed,) = transforms(session, TF_STATIC).values()
    assert set(fixed) == {"vehicle_1/camera_down_optical"}
    moving = transforms(session, TF)
    realized = two_cameras().realized
    assert realized is not None
    waists = np.array([(actor.east_m, actor.north_m, 0.9) for actor in realized.actors])
    checked = dict.fromkeys(FRAMES, 0)
    for camera in FRAMES:
        infos = session.messages(TOPICS.camera_info(camera), CameraInfo)
        by_stamp = {info.header.stamp.ns: info for _, info in infos}
        for time, picture in session.pictures(camera):
            at = time.ns
            # The first frame lies between two ticks, and the last one after them.
            if at not in moving or at not in by_stamp:
                continue
            frames = {**moving[at], **fixed}
            mount = frames[f"vehicle_1/camera_{camera}_optical"]
            to_map = matrix_of(frames[mount.header.frame_id]) @ matrix_of(mount)
            to_camera = np.linalg.inv(to_map)
            info = by_stamp[at]
            pixels, _ = cv2.projectPoints(
                waists,
                cv2.Rodrigues(to_camera[:3, :3])[0],
                to_camera[:3, 3],
                np.array(info.k).reshape(3, 3),
                np.array(info.d),
            )
            assert picture.actors is not None
            assert [actor.actor for actor in picture.actors] == [0, 1]
            for actor, (column, row) in zip(picture.actors, pixels[:, 0].tolist(), strict=True):
                left, top, right, bottom = actor.box
                assert left - 1 <= column <= right + 1, (camera, at, actor)
                assert top - 1 <= row <= bottom + 1, (camera, at, actor)
                checked[camera] += 1
    assert checked["front"] >= 12
    assert checked["down"] >= 4


def test_masks_and_depths_are_recorded_and_agree_with_boxes_and_geometry(
    flown: tuple[FlownSession, FlownSession],
) -> None:
    """Of the camera that asks for them: exact masks, depths in metres to the ground 30 m below and to heads above it."""
    session, _ = flown
    assert not session.on(truth_mask_topic("front"))
    assert not session.on(truth_depth_topic("front"))
    topics = (truth_mask_topic("down"), truth_depth_topic("down"))
    masks, depths = (session.messages(topic, CompressedImage) for topic in topics)
    pictures = session.pictures("down")
    assert len(masks) == len(depths) == len(pictures) == FRAMES["down"]
    for (mask_time, mask), (depth_time, depth), (time, picture) in zip(masks, depths, pictures, strict=True):
        assert mask_time == depth_time == time
        assert (mask.format, depth.format) == ("mono16; png compressed", "32FC1; tiff compressed")
        assert mask.header.frame_id == depth.header.frame_id == "vehicle_1/camera_down_optical"
        assert mask.header.stamp.ns == depth.header.stamp.ns == time.ns
        labels, metres = decode_mask(mask.data), decode_depth(depth.data)
        assert labels.shape == metres.shape == (160, 200)
        assert picture.actors is not None
        for actor in picture.actors:
            rows, columns = np.nonzero(labels == actor.actor + 1)
            assert len(rows) == actor.visible_px
            assert (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) == actor.box
            # Between the head of a person of at most 1.9 m and the ground, 30 m below.
            on_person = metres[labels == actor.actor + 1]
            assert 28.1 < on_person.min() < 28.6
            assert on_person.max() <= 30.0
        assert metres[labels == 0] == pytest.approx(30.0, abs=1e-3)


def test_a_tape_is_whole_beside_masks_and_depths(flown: tuple[FlownSession, FlownSession]) -> None:
    session, _ = flown
    assert {truth_mask_topic("down"), truth_depth_topic("down")} <= {it.topic for it in session.records}
    assert not tape_from(session.records, session.spec).malformed


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ({"renderer": "crayons"}, ["[1].renderer: there is no renderer 'crayons' (installed: ", "opencv"]),
        ({"distortion": Distortion(k1=-0.9)}, ["camera other: distortion", "folds over"]),
    ],
)
def test_a_camera_that_cannot_be_is_refused_before_the_flight(
    tmp_path: Path, broken: dict[str, object], words: list[str]
) -> None:
    """By the field that names it, before anything is opened."""
    cameras = (DOWN, DOWN.model_copy(update={"name": "other", **broken}))
    spec = changed_vehicle(two_cameras(), more_cameras=cameras)
    (fault,) = camera_faults(spec)
    assert all(word in f"{fault} {fault.remedy}" for word in words)
    end, _ = run(tmp_path, agent_manifest("idle"), spec)
    assert (end.outcome, words[0] in end.reason) == (Outcome.SETUP_INVALID, True), end.reason


def test_a_recording_says_what_a_renderer_rests_on() -> None:
    """What it says itself, else its package's version."""

    class Crayons:
        build = "wax 3, yellow"

        def render(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Picture:
            raise NotImplementedError

    assert _build_of(Crayons(), "opencv") == "wax 3, yellow"
    silent = open_camera(two_cameras()).renderer
    assert _build_of(silent, "opencv") == f"rebar-bench {version('rebar-bench')}"


@needs_gl
def test_a_session_flies_with_another_renderer_for_one_of_its_cameras(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The recording names renderer and driver, and both cameras see the same people in the same places."""
    declare(monkeypatch)
    spec = two_cameras()
    front = spec.vehicle.camera.model_copy(update={"renderer": "moderngl", "gimbal": False})
    twin = front.model_copy(update={"name": "twin", "renderer": "opencv"})
    spec = changed_vehicle(spec, camera=front, more_cameras=(twin,))
    spec = spec.model_copy(update={"mission": Mission(time_limit_s=1.0)})
    session = fly(tmp_path, spec, open_renderer=None)
    assert session.end.outcome is Outcome.TIME_LIMIT, f"{session.end.reason} {session.end.facts}"
    first, second = session.texts_of("camera opened")
    assert first.startswith("moderngl, moderngl ")
    assert first.endswith(f"; OpenCV {second.removeprefix('twin: OpenCV ')}")
    for (_, ours), (_, default) in zip(session.pictures("front"), session.pictures("twin"), strict=True):
        assert ours.sha256 != default.sha256
        assert ours.actors is not None
        assert default.actors is not None
        for mine, theirs in zip(ours.actors, default.actors, strict=True):
            assert mine.actor == theirs.actor
            assert mine.box == pytest.approx(theirs.box, abs=1.3)


def test_cameras_on_one_gimbal_turn_together() -> None:
    """Each has a frame of its own, and both have the direction of the gimbal."""
    spec = two_cameras()
    zoom = spec.vehicle.camera.model_copy(update={"name": "zoom", "horizontal_fov_deg": 12.0})
    state = VehicleState(START, (0.0, 0.0, 30.0), (0.0, 0.0, 0.0), 0.1, 0.0, 0.0, (0.0, 0.0, 0.0), 0.7, 1.1)
    main, beside = (
        CameraMessages.of(spec, camera).mount(START, state) for camera in (spec.vehicle.camera, zoom)
    )
    assert main.transform == beside.transform
    assert main.header.frame_id == beside.header.frame_id == "vehicle_1/base_level"
    for mount, name in ((main, "front"), (beside, "zoom")):
        assert mount.child_frame_id == f"vehicle_1/camera_{name}_optical"
