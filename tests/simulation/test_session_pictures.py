"""The camera's pictures in a session: to whom, when, what is recorded, and that nothing is drawn for nobody."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar, get_args

import cv2
import numpy as np
import pytest
from test_session import session_simspec

from bench.agents import load_manifest, open_agent
from bench.arrays import Floats
from bench.camera import GroundType, open_camera, open_opencv_renderer
from bench.campaign.execution._flight import AgentStarter
from bench.contracts import (
    SESSION_EVENTS,
    TRUTH_PICTURES,
    CameraPose,
    EventDocument,
    OpenRenderer,
    Outcome,
    Picture,
    PictureDocument,
    Record,
    Renderer,
    SessionResult,
    Stage,
    VehicleTopics,
)
from bench.documents import Document
from bench.recording import TapeBuilder
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
from bench.simulation import SessionPlan, run_session
from bench.simulation._air_network import open_air_network
from bench.streams import CompressedImage, String, decode, open_client
from bench.testing import agent_manifest

WATCHER = Path(__file__).parents[2] / "examples" / "picture_watch.yaml"
TOPICS = VehicleTopics("vehicle_1")
RAW, JPEG = TOPICS.image_raw("front"), TOPICS.image_compressed("front")
# Frames at 0.02 s and then every 0.2 s until the limit of 3 s; the last one has no tick after it.
FRAMES = 16

D = TypeVar("D", bound=Document)


def watched_simspec(**camera: object) -> SimSpec:
    """Two people below a vehicle that turns 30 m above the ground."""
    spec = session_simspec()
    people = (("man", 50.0, 53.0), ("woman", 47.0, 46.0))
    return spec.model_copy(
        update={
            "vehicle": VehicleSpec(
                model="still",
                home=spec.vehicle.home.model_copy(
                    update={"east_m": 50.0, "north_m": 50.0, "heading_deg": 20.0}
                ),
                parameters={"STILL_UP_M": 30.0, "STILL_TURN_DEGPS": 12.0},
                camera=Camera.model_validate({"width_px": 320, "height_px": 240, "tilt_deg": 88.0, **camera}),
            ),
            "actors": tuple(
                ActorGroup(id=asset, asset=asset, role=Role.BYSTANDER, count=1) for asset, _, _ in people
            ),
            "realized": Realized(
                actors=tuple(
                    PlacedActor(id=f"{asset}-1", group=asset, east_m=east, north_m=north, heading_deg=40.0)
                    for asset, east, north in people
                )
            ),
        }
    )


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

    end: SessionResult
    records: Sequence[Record]
    lines: Sequence[dict[str, object]]
    renderer: CountedRenderer = field(default_factory=CountedRenderer)

    def on(self, topic: str) -> list[Record]:
        return [record for record in self.records if record.topic == topic]

    def pictures(self) -> list[PictureDocument]:
        return [document(PictureDocument, record) for record in self.on(TRUTH_PICTURES)]


def document(kind: type[D], record: Record) -> D:
    message = decode(String, record.data)
    assert message is not None
    return kind.model_validate_json(message.data)


def fly(folder: Path, spec: SimSpec, *, watched: bool) -> FlownSession:
    records: list[Record] = []
    manifest, home = load_manifest(str(WATCHER)) if watched else (agent_manifest("idle"), folder)
    renderer = CountedRenderer()
    open_renderer: OpenRenderer = renderer.open
    starter = AgentStarter(open_agent)
    end = run_session(
        SessionPlan(
            spec,
            manifest,
            home,
            starter.open,
            folder / "scratch",
            records.append,
            open_renderer=open_renderer,
        )
    )
    lines = [json.loads(line) for line in (starter.output or b"").splitlines()]
    return FlownSession(end, records, lines, renderer)


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlownSession, FlownSession]:
    """The same session flown twice, with an agent that listens to both topics."""
    spec = watched_simspec(record_frames=True, record_boxes=True)
    first, second = (fly(tmp_path_factory.mktemp("watched"), spec, watched=True) for _ in range(2))
    return first, second


def test_the_agent_gets_every_picture_with_its_stamp(watched: tuple[FlownSession, FlownSession]) -> None:
    """Raw and JPEG are the pictures whose digests are recorded, in the size and encoding that the messages state."""
    session, _ = watched
    assert session.end.outcome is Outcome.TIME_LIMIT, f"{session.end.reason} {session.end.facts}"
    exposed = [record.time.ns for record in session.on(TRUTH_PICTURES)]
    pictures = session.pictures()
    assert [picture.frame for picture in pictures] == list(range(FRAMES))
    assert session.renderer.drawn == FRAMES
    raw = [line for line in session.lines if line["topic"] == RAW]
    jpeg = [line for line in session.lines if line["topic"] == JPEG]
    # The last exposure is at the end of the session, after the last tick.
    assert [line["stamp_ns"] for line in raw] == [line["stamp_ns"] for line in jpeg] == exposed[:-1]
    assert [line["sha256"] for line in raw] == [picture.sha256 for picture in pictures[:-1]]
    assert {
        (line["width"], line["height"], line["encoding"], line["bytes"], line["frame"]) for line in raw
    } == {(320, 240, "bgr8", 320 * 240 * 3, "vehicle_1/camera_front_optical")}
    recorded = [decode(CompressedImage, record.data) for record in session.on(JPEG)]
    assert [hashlib.sha256(image.data).hexdigest() for image in recorded if image] == [
        line["sha256"] for line in jpeg
    ]
    # Different pictures: the vehicle turns.
    assert len({picture.sha256 for picture in pictures}) == FRAMES
    first = recorded[0]
    assert first is not None
    assert first.format == "jpeg"
    pixels = cv2.imdecode(np.frombuffer(first.data, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (240, 320, 3)
    assert not session.on(RAW), "raw pictures fill no recording"


def test_two_flights_have_equal_pixels_and_the_build_is_recorded(
    watched: tuple[FlownSession, FlownSession],
) -> None:
    """The whole recordings are equal, and say on which OpenCV their pixels rest."""
    first, second = watched
    assert first.records == second.records
    opened = [
        event.text
        for event in (document(EventDocument, record) for record in first.on(SESSION_EVENTS))
        if event.name == "camera opened"
    ]
    assert len(opened) == 1
    assert opened[0].startswith(f"OpenCV {cv2.__version__}, build ")


def test_nothing_is_drawn_for_nobody(tmp_path: Path) -> None:
    """Without a listener and without a wish of the SimSpec, the renderer is not even opened."""
    session = fly(tmp_path, watched_simspec(), watched=False)
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
    session = fly(tmp_path, spec, watched=False)
    pictures = session.pictures()
    lost = [picture.frame for picture in pictures if picture.shown is None]
    live = {picture.frame: picture.sha256 for picture in pictures if picture.shown == picture.frame}
    frozen = [picture for picture in pictures if picture.shown in live and picture.frame not in live]
    assert len(pictures) == 11
    assert lost
    assert frozen
    assert session.renderer.drawn == len(live)
    assert all(picture.sha256 == live[picture.shown] for picture in frozen if picture.shown is not None)
    shown = [
        record for record, picture in zip(session.on(TRUTH_PICTURES), pictures, strict=True) if picture.sha256
    ]
    if field_name == "record_frames":
        stamps = [decode(CompressedImage, record.data).header.stamp.ns for record in session.on(JPEG)]  # type: ignore[union-attr]
        # What was exposed at the end of the session has no tick after it.
        assert stamps == [record.time.ns for record in shown if record.time < session.records[-1].time]
        assert not any(picture.actors for picture in pictures)
    else:
        assert not session.on(JPEG)
        assert {len(picture.actors or ()) for picture in pictures if picture.sha256} == {2}
    builder = TapeBuilder(spec)
    for record in session.records:
        builder(record)
    assert not builder.tape().malformed


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
