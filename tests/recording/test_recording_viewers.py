"""Exports for viewers, decoded by an independent reader and compared with the recording that they come from."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import fields as dataclass_fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pymap3d
import pytest
from made_run import BOX, cast, detections, estimate, records, simspec, text_record, tracks
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bench.campaign import load_measurable_decomposition, rescore
from bench.cli._app import run
from bench.contracts import TRUTH_ACTORS, Observation, Outcome, Record, SessionResult, VehicleTopics
from bench.errors import SetupError
from bench.recording import open_recording, read_metadata, read_records, read_simspec, read_tape
from bench.recording.viewers import _messages as messages
from bench.recording.viewers import export_for_viewers
from bench.recording.viewers._ground import ground_map
from bench.simspec import Role, SimSpec
from bench.streams import CameraInfo, CompressedImage, Header, Time, encode, schema_text_of

LAYOUT = Path(__file__).parents[2] / "docs" / "foxglove-layout.json"
ROLE_RGB = {
    Role.ADVERSARY: (0.85, 0.15, 0.15),
    Role.BYSTANDER: (0.20, 0.45, 0.90),
    Role.CLUTTER: (0.55, 0.55, 0.55),
}
OTHER_BOX = (10.0, 20.0, 110.0, 80.0)
SIZE_PX = (640, 480)
# Foxglove's published schemas, release 2.1.0: the fields of each message as its generator for ROS 2 writes them.
PUBLISHED = {
    "SceneUpdate": "SceneEntityDeletion[] deletions, SceneEntity[] entities",
    "SceneEntityDeletion": "time timestamp, uint8 type, string id",
    "SceneEntity": "time timestamp, string frame_id, string id, duration lifetime, bool frame_locked, "
    "KeyValuePair[] metadata, ArrowPrimitive[] arrows, CubePrimitive[] cubes, SpherePrimitive[] spheres, "
    "CylinderPrimitive[] cylinders, LinePrimitive[] lines, TriangleListPrimitive[] triangles, "
    "TextPrimitive[] texts, ModelPrimitive[] models",
    "KeyValuePair": "string key, string value",
    "Color": "float64 r, float64 g, float64 b, float64 a",
    "ArrowPrimitive": "Pose pose, float64 shaft_length, float64 shaft_diameter, float64 head_length, "
    "float64 head_diameter, Color color",
    "CubePrimitive": "Pose pose, Vector3 size, Color color",
    "SpherePrimitive": "Pose pose, Vector3 size, Color color",
    "CylinderPrimitive": "Pose pose, Vector3 size, float64 bottom_scale, float64 top_scale, Color color",
    "LinePrimitive": "uint8 type, Pose pose, float64 thickness, bool scale_invariant, Point[] points, Color color, "
    "Color[] colors, uint32[] indices",
    "TriangleListPrimitive": "Pose pose, Point[] points, Color color, Color[] colors, uint32[] indices",
    "TextPrimitive": "Pose pose, bool billboard, float64 font_size, bool scale_invariant, Color color, string text",
    "ModelPrimitive": "Pose pose, Vector3 scale, Color color, bool override_color, string url, string media_type, "
    "uint8[] data",
    "ImageAnnotations": "time timestamp, CircleAnnotation[] circles, PointsAnnotation[] points, TextAnnotation[] texts, "
    "KeyValuePair[] metadata",
    "CircleAnnotation": "time timestamp, Point2 position, float64 diameter, float64 thickness, Color fill_color, "
    "Color outline_color, KeyValuePair[] metadata",
    "PointsAnnotation": "time timestamp, uint8 type, Point2[] points, Color outline_color, Color[] outline_colors, "
    "Color fill_color, float64 thickness, KeyValuePair[] metadata",
    "TextAnnotation": "time timestamp, Point2 position, string text, float64 font_size, Color text_color, "
    "Color background_color, KeyValuePair[] metadata",
    "Point2": "float64 x, float64 y",
    "Log": "time timestamp, uint8 level, string message, string name, string file, uint32 line",
    "GeoJSON": "string geojson",
}
ABBREVIATIONS = {
    "builtin_interfaces/Time": "time",
    "builtin_interfaces/Duration": "duration",
    "foxglove_msgs/": "",
    "geometry_msgs/": "",
}


@dataclass(frozen=True)
class Exported:
    """A recording, its export, and the messages of the export by topic with their log times."""

    simspec: SimSpec
    source: Path
    target: Path
    by_topic: dict[str, list[tuple[int, Any]]]

    def messages(self, topic: str) -> list[Any]:
        return [message for _, message in self.by_topic[topic]]


def situation(vehicle: str, *, areas: bool) -> SimSpec:
    """The made situation with a vehicle of this name; with `areas` also roads, named areas, no-fly areas and a fence."""
    corners = [
        {"east_m": 150.0, "north_m": -50.0},
        {"east_m": 260.0, "north_m": -50.0},
        {"east_m": 200.0, "north_m": 40.0},
    ]
    base = simspec(vehicle={"name": vehicle})
    if not areas:
        return base
    document = base.model_dump(mode="json")
    document["world"]["origin"] = {"latitude_deg": -33.4, "longitude_deg": 151.2, "altitude_m": 21.0}
    document["world"]["areas"] = [{"id": "yard", "corners": corners}, {"id": "village", "corners": corners}]
    document["world"]["roads"] = [
        {"id": "north-road", "points": corners[:2], "width_m": 7.0},
        {"id": "south-road", "points": corners[1:], "width_m": 4.0},
    ]
    document["rules"]["geofence"] = document["world"]["area"]
    document["rules"]["no_fly"] = [
        {"id": "clinic", "area": {"corners": corners}},
        {"id": "school", "area": {"corners": corners}, "from_s": 5.0, "until_s": 9.0},
    ]
    return SimSpec.model_validate(document)


def recorded(path: Path, spec: SimSpec, *, pictures: bool) -> Path:
    """A recording of a made run under the vehicle's name, with camera frames and perhaps their pictures."""
    vehicle = spec.vehicle.name
    topics = VehicleTopics(vehicle)
    frames: list[tuple[float, str, CameraInfo | CompressedImage]] = []
    for step in range(0, 100, 5):
        stamp, frame = Time.of(step * 100_000_000), f"{vehicle}/camera_front_optical"
        info = CameraInfo(Header(stamp, frame), height=SIZE_PX[1], width=SIZE_PX[0])
        frames.append((step / 10, topics.camera_info("front"), info))
        if pictures:
            picture = CompressedImage(Header(stamp, frame), "jpeg", bytes([step]) * 50)
            frames.append((step / 10, f"/{vehicle}/camera/front/image_raw/compressed", picture))
    extra = [
        Record(text_record(time_s, topic, "").time, topic, message.TYPE, encode(message))
        for time_s, topic, message in frames
    ]
    extra += [detections(time_s, topics.detections, "truck", 0.5, OTHER_BOX) for time_s in (3.05, 7.05)]
    extra += [
        text_record(4.05, topics.tracks, tracks(4.05, ("civilian", 1.0, 2.0), ("truck", 3.0, 4.0)).value)
    ]
    extra += [estimate(0.05, (9.0, 8.0, 7.0), vehicle)]
    with open_recording(path, simspec=spec, versions={"rebar": "0"}, metadata={"agent": vehicle}) as recorder:
        for record in records(spec, seconds=10.0, extra=extra):
            recorder(record)
    return path


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Every message of a file by topic, decoded by mcap-ros2-support; asserts the order of time."""
    by_topic: dict[str, list[tuple[int, Any]]] = {}
    last_ns = 0
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert message.log_time >= last_ns
            last_ns = message.log_time
            by_topic.setdefault(channel.topic, []).append((message.log_time, decoded))
    return by_topic


@pytest.fixture(
    scope="module", params=[("vehicle_1", True, False), ("scout_2", False, True)], ids=["areas", "bare"]
)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """Two recordings: with areas and without pictures; the other way round, and another vehicle."""
    vehicle, areas, pictures = request.param
    folder = tmp_path_factory.mktemp(vehicle)
    spec = situation(vehicle, areas=areas)
    source = recorded(folder / "recording.mcap", spec, pictures=pictures)
    result = export_for_viewers(source, folder / "viewer.mcap")
    assert (result.cut, result.pictures, dict(result.malformed)) == (None, pictures, {})
    by_topic = read(folder / "viewer.mcap")
    assert result.copied + result.derived == sum(map(len, by_topic.values()))
    return Exported(spec, source, folder / "viewer.mcap", by_topic)


def test_the_recording_itself_is_in_the_export_unchanged(exported: Exported) -> None:
    """Every record with its bytes, the SimSpec and the metadata; so an export can be scored too."""
    kept = [record for record in read_records(exported.target) if not record.topic.startswith("/viewer/")]
    assert kept == list(read_records(exported.source))
    assert read_simspec(exported.target) == exported.simspec
    assert read_metadata(exported.target) == read_metadata(exported.source)


def test_each_actor_has_its_size_name_colour_and_place(exported: Exported) -> None:
    """At each moment of the truth, compared with the tape of the source."""
    tape = read_tape(exported.source)
    updates = exported.messages("/viewer/actors")
    assert len(updates) == len(tape.actor_time_s) >= 2
    assert not np.array_equal(tape.actor_position_enu_m[0], tape.actor_position_enu_m[-1])
    for update, time_s, places in zip(updates, tape.actor_time_s, tape.actor_position_enu_m, strict=True):
        assert [entity.id for entity in update.entities] == [member.id for member in cast(exported.simspec)]
        for entity, member, place in zip(update.entities, cast(exported.simspec), places, strict=True):
            cube = entity.cubes[0]
            assert entity.frame_id == "map"
            assert seconds(entity.timestamp) == pytest.approx(time_s)
            assert [text.text for text in entity.texts] == [member.id]
            assert xyz(cube.size) == (member.length_m, member.width_m, member.height_m)
            assert rgb(cube.color) == ROLE_RGB[member.role]
            # The cuboid stands on the place, so its centre is half its height above.
            assert xyz(cube.pose.position) == pytest.approx(
                place + np.array([0.0, 0.0, member.height_m / 2.0])
            )
            assert {pair.key: pair.value for pair in entity.metadata}["role"] == member.role.value


def test_the_vehicle_on_the_map_is_where_the_truth_says(exported: Exported) -> None:
    tape, origin = read_tape(exported.source), exported.simspec.world.origin
    for topic, places in (
        ("/viewer/fix", tape.vehicle_position_enu_m),
        ("/viewer/estimate_fix", tape.estimate_position_enu_m),
    ):
        fixes = np.array([(fix.latitude, fix.longitude, fix.altitude) for fix in exported.messages(topic)])
        back = pymap3d.geodetic2enu(*fixes.T, origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
        assert np.column_stack(back) == pytest.approx(places, abs=1e-5)
        # The map panel draws no fix below 0 (STATUS_FIX).
        assert {fix.status.status for fix in exported.messages(topic)} == {0}
    cubes = [update.entities[0].cubes[0] for update in exported.messages("/viewer/vehicle")]
    assert np.array([xyz(cube.pose.position) for cube in cubes]) == pytest.approx(tape.vehicle_position_enu_m)


def test_boxes_equal_the_detections_and_the_views(exported: Exported) -> None:
    tape = read_tape(exported.source)
    annotations = exported.messages("/viewer/detections")
    assert {detection.box for frame in tape.detections for detection in frame.detections} == {BOX, OTHER_BOX}
    for message, frame in zip(annotations, tape.detections, strict=True):
        assert seconds(message.timestamp) == pytest.approx(frame.exposed.s)
        assert [box(points) for points in message.points] == [
            pytest.approx(detection.box) for detection in frame.detections
        ]
        names = [f"{detection.class_label} {detection.score:.2f} t1" for detection in frame.detections]
        assert [text.text for text in message.texts][1:] == names
        stamps = {seconds(part.timestamp) for part in (*message.points, *message.texts)}
        assert stamps == {seconds(message.timestamp)}
    truth = exported.messages("/viewer/front/truth_boxes")
    assert len(truth) == len(tape.frames)
    assert {text.text for message in truth for text in message.texts[1:]} == {"walker-1"}
    assert {rgb(points.outline_color) for message in truth for points in message.points} == {
        ROLE_RGB[Role.BYSTANDER]
    }


def test_an_empty_picture_for_each_frame_only_where_there_are_none(exported: Exported) -> None:
    own = f"/{exported.simspec.vehicle.name}/camera/front/image_raw/compressed"
    infos = exported.by_topic[f"/{exported.simspec.vehicle.name}/camera/front/camera_info"]
    if own in exported.by_topic:
        assert "/viewer/empty_picture" not in exported.by_topic
        return
    pictures = exported.by_topic["/viewer/empty_picture"]
    assert [time for time, _ in pictures] == [time for time, _ in infos]
    assert [seconds(picture.header.stamp) for _, picture in pictures] == [
        seconds(info.header.stamp) for _, info in infos
    ]
    decoded = cv2.imdecode(np.frombuffer(pictures[0][1].data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded is not None
    assert decoded.shape == SIZE_PX[::-1]
    assert len(np.unique(decoded)) == 1


def test_areas_roads_and_home_are_in_the_scene_and_on_the_map(exported: Exported) -> None:
    (update,), (document,) = exported.messages("/viewer/ground"), exported.messages("/viewer/ground_map")
    entities = {entity.id: entity for entity in update.entities}
    features = {
        feature["properties"]["name"]: feature["geometry"]
        for feature in json.loads(document.geojson)["features"]
    }
    spec = exported.simspec
    outlines = {"area": spec.world.area.corners}
    if spec.rules.geofence is not None:
        outlines["geofence"] = spec.rules.geofence.corners
    outlines |= {f"no_fly {area.id}": area.area.corners for area in spec.rules.no_fly}
    outlines |= {f"area {area.id}": area.corners for area in spec.world.areas}
    roads = {f"road {road.id}": road for road in spec.world.roads}
    assert set(entities) == {*outlines, *roads, "home"}
    assert len(features) == len(entities)
    for name, corners in outlines.items():
        line = entities[name].lines[0]
        assert line.type == 1  # LINE_LOOP
        assert [(point.x, point.y) for point in line.points] == [(c.east_m, c.north_m) for c in corners]
    for name, road in roads.items():
        line = entities[name].lines[0]
        assert (line.type, line.thickness, line.scale_invariant) == (0, road.width_m, False)
    if spec.rules.no_fly:
        assert entities["no_fly school"].texts[0].text == "no-fly school from 5 s until 9 s"
    longitude, latitude = features["area"]["coordinates"][0][0]
    east, north, _ = pymap3d.geodetic2enu(
        latitude,
        longitude,
        spec.world.origin.altitude_m,
        *(spec.world.origin.latitude_deg, spec.world.origin.longitude_deg, spec.world.origin.altitude_m),
    )
    assert (east, north) == pytest.approx((-300.0, -300.0), abs=0.1)


@pytest.mark.parametrize("longitude_deg", [180.0, -180.0, 179.9999])
def test_no_line_of_the_map_goes_round_the_earth(longitude_deg: float) -> None:
    """At the date line longitudes go on beyond 180 degrees, and stay those of the same places."""
    document = situation("drone_1", areas=True).model_dump(mode="json")
    document["world"]["origin"]["longitude_deg"] = longitude_deg
    spec = SimSpec.model_validate(document)
    features = {
        feature["properties"]["name"]: feature["geometry"]
        for feature in json.loads(ground_map(spec))["features"]
    }
    ring = np.array(features["area"]["coordinates"][0])
    assert np.abs(np.diff(ring[:, 0])).max() < 0.02
    origin = spec.world.origin
    east, north, _ = pymap3d.geodetic2enu(
        *ring[0, ::-1], origin.altitude_m, origin.latitude_deg, longitude_deg, origin.altitude_m
    )
    assert (east, north) == pytest.approx((-300.0, -300.0), abs=0.1)


def test_states_are_those_of_the_tape(exported: Exported) -> None:
    """Height, speed, the error of the estimate, and distances, computed here with arrays."""
    tape, states = read_tape(exported.source), exported.messages("/viewer/state")
    places, speeds = tape.vehicle_position_enu_m, tape.vehicle_velocity_enu_mps
    assert [state.height_m for state in states] == pytest.approx(places[:, 2])
    assert [state.ground_speed_mps for state in states] == pytest.approx(np.hypot(*speeds[:, :2].T))
    assert [state.climb_mps for state in states] == pytest.approx(speeds[:, 2], abs=1e-9)
    assert tape.vehicle_tilt_rad is not None
    assert np.radians([state.tilt_deg for state in states]) == pytest.approx(tape.vehicle_tilt_rad, abs=1e-9)
    assert {round(state.heading_deg, 6) % 360.0 for state in states} == {0.0}
    walkers = [index for index, member in enumerate(cast(exported.simspec)) if member.role is Role.BYSTANDER]
    last = np.searchsorted(tape.actor_time_s, tape.vehicle_time_s[1:], side="left") - 1
    away = np.linalg.norm(tape.actor_position_enu_m[last][:, walkers] - places[1:, None], axis=2).min(axis=1)
    # Records of one moment have an order: a state may be of the actors' place of that moment or of the one before.
    close = np.abs(np.array([state.nearest_bystander_m for state in states[1:]]) - away) < 0.3
    assert close.all()
    assert np.isnan(states[0].estimate_error_m)
    error_m = np.linalg.norm(places[-1] - tape.estimate_position_enu_m[-1])
    assert states[-1].estimate_error_m == pytest.approx(error_m, abs=0.3)
    assert {state.mode for state in states[1:]} == {"offboard"}
    assert {state.operator_link_up for state in states} == {True, False}


def test_tracks_and_reports_show_what_the_agent_said_last(exported: Exported) -> None:
    by_time = {
        round(seconds(update.entities[0].timestamp), 2): update
        for update in exported.messages("/viewer/agent")
    }
    tracks_at, reports_at = by_time[4.05].entities[:2]
    assert [xyz(ball.pose.position)[:2] for ball in tracks_at.spheres] == [(1.0, 2.0), (3.0, 4.0)]
    assert not reports_at.cylinders
    # The later message of tracks replaces both; the report stays.
    later = exported.messages("/viewer/agent")[-1].entities
    assert [xyz(ball.pose.position)[:2] for ball in later[0].spheres] == [(120.0, 100.0)]
    assert [xyz(pillar.pose.position)[:2] for pillar in later[1].cylinders] == [(101.0, 99.0)]
    lines = [log.message for log in exported.messages("/viewer/log")]
    assert any("mobile_radar, east 101 m, north 99 m, confidence 0.90, marked" in line for line in lines)
    assert "order hold: hold" in lines
    assert [log.message for log in exported.messages("/viewer/log") if log.level == 3] == [
        "operator link down"
    ]


def test_the_schemas_are_those_that_viewers_know() -> None:
    """Names, types and order of the fields of every published message; an independent parser reads each schema."""
    for name, published in PUBLISHED.items():
        kind = getattr(messages, name)
        assert f"foxglove_msgs/msg/{name}" == kind.TYPE
        text = schema_text_of(kind)
        definition = text.split("=" * 80)[0]
        for full, short in ABBREVIATIONS.items():
            definition = definition.replace(full, short)
        assert ", ".join(definition.splitlines()) == published, name
        store = get_typestore(Stores.EMPTY)
        main, *parts = text.split("=" * 80 + "\n")
        store.register(get_types_from_msg(main, kind.TYPE))
        for part in parts:
            head, _, body = part.partition("\n")
            store.register(get_types_from_msg(body, head.removeprefix("MSG: ").replace("/", "/msg/")))
        assert kind.TYPE in store.fielddefs


def test_the_layout_names_what_an_export_has(exported: Exported) -> None:
    """Every panel of the layout's tree has settings, and every topic and field that they name is in an export."""
    layout = json.loads(LAYOUT.read_text())
    panels = layout["configById"]
    assert sorted(leaves(layout["layout"])) == sorted(panels)
    camera, scene = panels["Image!rebarCamera"]["imageMode"], panels["3D!rebarScene"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    named = {*scene["topics"], *camera["annotations"], *panels["map!rebarMap"]["topicColors"]}
    named |= {panels["RosOut!rebarLog"]["topicToRender"], panels["RawMessages!rebarRaw"]["topicPath"]}
    # The frustum is that of the default names, which only one of the two recordings has.
    named.discard("/vehicle_1/camera/front/camera_info")
    assert named <= set(exported.by_topic)
    # Without it the viewer takes the first topic with pictures, whatever its name is.
    assert "imageTopic" not in camera
    fields = {f"/viewer/state.{field.name}" for field in dataclass_fields(messages.ViewerState)}
    assert len(paths) > 10
    assert set(paths) <= fields


def test_the_same_recording_gives_the_same_bytes(exported: Exported, tmp_path: Path) -> None:
    export_for_viewers(exported.source, tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == exported.target.read_bytes()


def test_what_was_measured_stands_at_its_moments_and_changes_no_score(
    exported: Exported, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the result beside the recording; edited or of another recording, an export is scored as the recording is."""
    folder = tmp_path / "run"
    folder.mkdir()
    source = folder / "recording.mcap"
    source.write_bytes(exported.source.read_bytes())
    decomposition = load_measurable_decomposition("search-and-report")
    flown = SessionResult(realization="run", outcome=Outcome.COMPLETED).model_dump_json()
    (folder / "result.json").write_text(flown)
    measured = rescore(folder, decomposition)
    edited = measured.model_copy(
        update={"observations": (Observation(observable="OBS-181", considered=True, x=0.0),)}
    )
    elsewhere = measured.model_copy(update={"recording_sha256": "0" * 64})
    for name, result in (("measured", measured), ("edited", edited), ("elsewhere", elsewhere)):
        (folder / "result.json").write_text(result.model_dump_json())
        target = tmp_path / name / "recording.mcap"
        target.parent.mkdir()
        assert run(["export", str(folder), "--foxglove", "--out", str(target)]) == 0
        (target.parent / "result.json").write_text(flown)
        assert rescore(target.parent, decomposition).observations == measured.observations
        by_topic = read(target)
        assert ("/viewer/observations" in by_topic) is (name != "elsewhere")
        if name == "measured":
            shown = [
                (time_ns, Observation.model_validate_json(message.data))
                for time_ns, message in by_topic["/viewer/observations"]
            ]
    assert capsys.readouterr().err == ""
    stated = [
        (observation.observable, observation.x, observation.stages, evidence)
        for observation in measured.observations
        for evidence in observation.evidence
    ]
    assert len({observable for observable, *_ in stated}) > 5
    assert sorted(map(str, stated)) == sorted(
        str((observation.observable, observation.x, observation.stages, *observation.evidence))
        for _, observation in shown
        if observation.evidence[0].text
    )
    assert all(time_ns == round(observation.evidence[0].time_s * 1e9) for time_ns, observation in shown)


def test_what_cannot_be_decoded_is_copied_and_counted(tmp_path: Path) -> None:
    """Also a recording that was cut off: the export holds what is before the cut."""
    spec = situation("vehicle_1", areas=False)
    source = tmp_path / "recording.mcap"
    with open_recording(source, simspec=spec, versions={}) as recorder:
        for number, record in enumerate(records(spec, seconds=40.0)):
            spoilt = record.topic == TRUTH_ACTORS and number % 3 == 0
            noise = bytes(zlib.crc32(b"%d.%d" % (number, part)) & 255 for part in range(400))
            recorder(replace(record, data=record.data[:20]) if spoilt else record)
            recorder(replace(record, topic="/noise", type_name="std_msgs/msg/String", data=noise))
    count = sum(record.topic == TRUTH_ACTORS and len(record.data) == 20 for record in read_records(source))
    result = export_for_viewers(source, tmp_path / "whole.mcap")
    assert count > 0
    assert dict(result.malformed) == {TRUTH_ACTORS: count}
    source.write_bytes(source.read_bytes()[: source.stat().st_size * 2 // 3])
    cut = export_for_viewers(source, tmp_path / "cut.mcap")
    assert cut.cut is not None
    assert 0 < cut.copied < result.copied
    # The noise is no message of its type, so it is counted and not decoded.
    with (tmp_path / "cut.mcap").open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) == cut.copied + cut.derived


def test_wrong_inputs_are_refused_and_leave_nothing(
    exported: Exported, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stranger, target = tmp_path / "notes.mcap", tmp_path / "out.mcap"
    stranger.write_text("no recording")
    with pytest.raises(SetupError, match="is not an MCAP recording"):
        export_for_viewers(stranger, target)
    with pytest.raises(SetupError, match="there is no such file"):
        export_for_viewers(tmp_path / "absent.mcap", target)
    with pytest.raises(SetupError, match="is an export already: it has the topic /viewer/"):
        export_for_viewers(exported.target, target)
    assert sorted(tmp_path.iterdir()) == [stranger]
    target.write_text("precious")
    line = ["export", str(exported.source.parent), "--foxglove", "--out"]
    assert run([*line, str(target)]) == 2
    assert "exists already (give another name with --out, or delete it)" in capsys.readouterr().err
    assert target.read_text() == "precious"
    assert run(["export", str(exported.source), "--out", str(tmp_path / "new.mcap")]) == 2
    assert "add --foxglove" in capsys.readouterr().err
    assert run([*line, str(tmp_path / "new.mcap")]) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.replace(str(tmp_path), "").splitlines())) <= 80
    assert (tmp_path / "new.mcap").read_bytes() == exported.target.read_bytes()


def leaves(node: Any) -> list[str]:
    """The panels of a layout's tree of splits."""
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec / 1e9)


def xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def rgb(color: Any) -> tuple[float, float, float]:
    return color.r, color.g, color.b


def box(points: Any) -> Sequence[float]:
    """left, top, right, bottom of the outline of a box."""
    across, down = [point.x for point in points.points], [point.y for point in points.points]
    return min(across), min(down), max(across), max(down)
