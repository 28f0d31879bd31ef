"""The camera's pictures in a session: to whom, when, what is recorded, and that nothing is drawn for nobody."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, get_args

import cv2
import numpy as np
import pytest
from fake_agents import agent_manifest
from test_session import run, session_simspec, tape_from

from bench.agents import load_manifest
from bench.arrays import Floats
from bench.camera import GroundType, open_camera, open_opencv_renderer
from bench.contracts import (
    SESSION_EVENTS,
    TRUTH_PICTURES,
    TRUTH_VIEW,
    CameraPose,
    EventDocument,
    Outcome,
    Picture,
    PictureDocument,
    Record,
    Renderer,
    SessionResult,
    SimTime,
    Stage,
    VehicleTopics,
    ViewDocument,
)
from bench.documents import Document
from bench.simspec import (
    ActorGroup,
    Camera,
    Mission,
    PlacedActor,
    Realized,
    Role,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation._air_network import open_air_network
from bench.streams import CompressedImage, Detection2DArray, RosMessage, String, decode, open_client

WATCHER = Path(__file__).parents[2] / "examples" / "picture_watch.yaml"
TOPICS = VehicleTopics("vehicle_1")
RAW, JPEG = TOPICS.image_raw("front"), TOPICS.image_compressed("front")
# Frames at 0.02 s and then every 0.2 s until the limit of 3 s; the last one has no tick after it.
FRAMES = 16

D = TypeVar("D", bound=Document)
M = TypeVar("M", bound=RosMessage)


def watched_simspec(**camera: object) -> SimSpec:
    """Two people below a vehicle that turns 30 m above the ground."""
    spec = session_simspec()
    home = {"east_m": 50.0, "north_m": 50.0, "heading_deg": 20.0}
    people = (("man", 50.0, 53.0), ("woman", 47.0, 46.0))
    placed = (
        PlacedActor(id=f"{asset}-1", group=asset, east_m=east, north_m=north, heading_deg=40.0)
        for asset, east, north in people
    )
    changes = {
        "vehicle": VehicleSpec(
            model="still",
            home=spec.vehicle.home.model_copy(update=home),
            parameters={"STILL_UP_M": 30.0, "STILL_TURN_DEGPS": 12.0},
            camera=Camera.model_validate({"width_px": 320, "height_px": 240, "tilt_deg": 88.0, **camera}),
        ),
        "actors": tuple(
            ActorGroup(id=asset, asset=asset, role=Role.BYSTANDER, count=1) for asset, _, _ in people
        ),
        "realized": Realized(actors=tuple(placed)),
    }
    return spec.model_copy(update=changes)


@dataclass
class CountedRenderer:
    """The default renderer, with a count of what it was asked for."""

    opened: int = 0
    drawn: int = 0

    def open(self, stage: Stage) -> Renderer:
        self.opened += 1
        return _Counted(self, open_opencv_renderer(stage))


@dataclass
class _Counted:
    counts: CountedRenderer
    renderer: Renderer

    def render(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Picture:
        self.counts.drawn += 1
        return self.renderer.render(pose, positions_enu_m, headings_rad)


@dataclass
class FlownSession:
    """One session: how it ended, what was recorded, what the agent wrote down, what was drawn."""

    spec: SimSpec
    end: SessionResult
    records: Sequence[Record]
    lines: Sequence[dict[str, object]] = ()
    renderer: CountedRenderer = field(default_factory=CountedRenderer)

    def on(self, topic: str) -> list[Record]:
        return [record for record in self.records if record.topic == topic]

    def messages(self, topic: str, kind: type[M]) -> list[tuple[SimTime, M]]:
        """With the time of publication."""
        pairs = [(record.time, decode(kind, record.data)) for record in self.on(topic)]
        return [(time, message) for time, message in pairs if message is not None]

    def documents(self, topic: str, kind: type[D]) -> list[tuple[SimTime, D]]:
        """With the time of publication."""
        messages = self.messages(topic, String)
        return [(time, kind.model_validate_json(message.data)) for time, message in messages]

    def pictures(self, camera: str = "front") -> list[tuple[SimTime, PictureDocument]]:
        """With the time of exposure."""
        every = self.documents(TRUTH_PICTURES, PictureDocument)
        return [(time, picture) for time, picture in every if picture.camera == camera]

    def views(self, camera: str = "front") -> dict[int, ViewDocument]:
        """By time of exposure."""
        every = self.documents(TRUTH_VIEW, ViewDocument)
        return {time.ns: view for time, view in every if view.camera == camera}

    def texts_of(self, event: str) -> list[str]:
        """Of the session's events of a name."""
        return [
            found.text for _, found in self.documents(SESSION_EVENTS, EventDocument) if found.name == event
        ]


def fly(folder: Path, spec: SimSpec, *, watched: bool = False, **plan: Any) -> FlownSession:
    manifest, home = load_manifest(str(WATCHER)) if watched else (agent_manifest("idle"), folder)
    renderer = CountedRenderer()
    plan = {"open_renderer": renderer.open, **plan}
    end, records = run(folder, manifest, spec, home=home, **plan)
    lines = (folder / "agent.log").read_text().splitlines() if watched else ()
    return FlownSession(
        spec, end, records, [json.loads(line) for line in lines if line.startswith("{")], renderer
    )


def flown_twice(
    factory: pytest.TempPathFactory, spec: SimSpec, **plan: Any
) -> tuple[FlownSession, FlownSession]:
    """The same session twice, to its limit of time."""
    first, second = (fly(factory.mktemp("flown"), spec, **plan) for _ in range(2))
    assert first.end.outcome is Outcome.TIME_LIMIT, f"{first.end.reason} {first.end.facts}"
    return first, second


def hits_of(session: FlownSession, topic: str, camera: str = "front") -> tuple[int, int]:
    """Clear sightings that a detection lies on, and all of them, in the frames with a result."""
    views = session.views(camera)
    hits = total = 0
    for _, message in session.messages(topic, Detection2DArray):
        centres = [(item.bbox.center.position.x, item.bbox.center.position.y) for item in message.detections]
        for sighting in views[message.header.stamp.ns].sightings:
            if sighting.visible < 0.5 or sighting.height_px < 5.0:
                continue
            left, top, right, bottom = sighting.box
            total += 1
            hits += any(left - 4 <= x <= right + 4 and top - 4 <= y <= bottom + 4 for x, y in centres)
    return hits, total


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlownSession, FlownSession]:
    """With an agent that listens to both topics."""
    return flown_twice(tmp_path_factory, watched_simspec(record_frames=True, record_boxes=True), watched=True)


def test_the_agent_gets_every_picture_with_its_stamp(watched: tuple[FlownSession, FlownSession]) -> None:
    """Raw and JPEG are the pictures whose digests are recorded, in the size and encoding that the messages state."""
    session, _ = watched
    exposed = [time.ns for time, _ in session.pictures()]
    pictures = [picture for _, picture in session.pictures()]
    assert [picture.frame for picture in pictures] == list(range(FRAMES))
    assert session.renderer.drawn == FRAMES
    raw, jpeg = ([line for line in session.lines if line["topic"] == topic] for topic in (RAW, JPEG))
    # The last exposure is at the end of the session, after the last tick.
    assert [line["stamp_ns"] for line in raw] == [line["stamp_ns"] for line in jpeg] == exposed[:-1]
    assert [line["sha256"] for line in raw] == [picture.sha256 for picture in pictures[:-1]]
    stated = {tuple(line[name] for name in ("width", "height", "encoding", "bytes", "frame")) for line in raw}
    assert stated == {(320, 240, "bgr8", 320 * 240 * 3, "vehicle_1/camera_front_optical")}
    recorded = [image for _, image in session.messages(JPEG, CompressedImage)]
    assert [hashlib.sha256(image.data).hexdigest() for image in recorded] == [line["sha256"] for line in jpeg]
    # Different pictures: the vehicle turns.
    assert len({picture.sha256 for picture in pictures}) == FRAMES
    assert recorded[0].format == "jpeg"
    pixels = cv2.imdecode(np.frombuffer(recorded[0].data, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (240, 320, 3)
    assert not session.on(RAW), "raw pictures fill no recording"


def test_two_flights_have_equal_pixels_and_the_build_is_recorded(
    watched: tuple[FlownSession, FlownSession],
) -> None:
    """The whole recordings are equal, and say on which OpenCV their pixels rest."""
    first, second = watched
    assert first.records == second.records
    (opened,) = first.texts_of("camera opened")
    assert opened.startswith(f"OpenCV {cv2.__version__}, build ")


def test_nothing_is_drawn_for_nobody(tmp_path: Path) -> None:
    """Without a listener and without a wish of the SimSpec, the renderer is not even opened."""
    session = fly(tmp_path, watched_simspec())
    assert session.end.outcome is Outcome.TIME_LIMIT, session.end.reason
    assert session.on(TOPICS.camera_info("front"))
    assert (session.renderer.opened, session.renderer.drawn) == (0, 0)
    assert not session.on(TRUTH_PICTURES)
    assert not session.on(JPEG)


@pytest.mark.parametrize("field_name", ["record_frames", "record_boxes"])
def test_a_simspec_may_record_what_nobody_listens_to(tmp_path: Path, field_name: str) -> None:
    """JPEG and boxes are recorded each by themselves, from a camera that loses frames and repeats others."""
    camera = {"dropped_share": 0.3, "frozen_share": 0.7, field_name: True}
    spec = watched_simspec(**camera).model_copy(update={"mission": Mission(time_limit_s=2.0)})
    session = fly(tmp_path, spec)
    pictures = [picture for _, picture in session.pictures()]
    live = {picture.frame: picture.sha256 for picture in pictures if picture.shown == picture.frame}
    frozen = [picture for picture in pictures if picture.shown in live and picture.frame not in live]
    assert len(pictures) == 11
    assert any(picture.shown is None for picture in pictures)
    assert frozen
    assert session.renderer.drawn == len(live)
    assert all(picture.sha256 == live[picture.shown] for picture in frozen if picture.shown is not None)
    if field_name == "record_frames":
        shown = [time for time, picture in session.pictures() if picture.sha256]
        stamps = [image.header.stamp.ns for _, image in session.messages(JPEG, CompressedImage)]
        # What was exposed at the end of the session has no tick after it.
        assert stamps == [time.ns for time in shown if time < session.records[-1].time]
        assert not any(picture.actors for picture in pictures)
    else:
        assert not session.on(JPEG)
        assert {len(picture.actors or ()) for picture in pictures if picture.sha256} == {2}
    assert not tape_from(session.records, spec).malformed


def test_in_real_time_pictures_are_for_whoever_subscribes_just_now() -> None:
    """A subscription opens its own topic alone, and its end closes it."""

    def settled(expected: bool) -> bool:
        deadline_s = time.monotonic() + 10.0
        while air.cameras[0].compressed.listened is not expected and time.monotonic() < deadline_s:
            time.sleep(0.01)
        return air.cameras[0].compressed.listened is expected

    with open_air_network(watched_simspec(), lambda record: None, zenoh=True) as air:
        air.open_for_all()
        assert air.cameras[0].info.listened
        assert settled(False)
        assert air.access is not None
        with open_client(air.access, "viewer") as node:
            node.subscribe(JPEG, CompressedImage)
            assert settled(True)
            assert not air.cameras[0].raw.listened
        assert settled(False)


def test_the_ground_of_a_simspec_is_drawn() -> None:
    """Snow is brighter than grass, and a SimSpec may name every kind of ground that there is."""
    assert set(get_args(World.model_fields["ground"].annotation)) == set(GroundType)
    spec = watched_simspec(width_px=64, height_px=48)
    snowy = spec.model_copy(update={"world": spec.world.model_copy(update={"ground": "snow"})})
    grass, snow = (open_camera(simspec).stage.ground.texture.mean() for simspec in (spec, snowy))
    assert snow > 1.5 * grass
