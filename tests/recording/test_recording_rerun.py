"""The outside package of examples/rerun_export: what it writes, read back with Rerun's own package and compared with the
recording that it comes from.
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_run import BOX, at_s, cast, detections, records, simspec, text_record

from bench.cli._app import run
from bench.contracts import (
    TF_STATIC,
    TRUTH_ACTORS,
    AgentStatus,
    Decision,
    Evidence,
    Observation,
    Record,
    Tape,
    VehicleTopics,
    plugins,
)
from bench.errors import SetupError
from bench.recording import open_recording, read_tape
from bench.simspec import SimSpec
from bench.streams import (
    CompressedImage,
    Header,
    Quaternion,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Vector3,
    encode,
)

pytest.importorskip("rerun", reason="the package rerun-sdk is not installed")
sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "rerun_export"))
from rebar_rerun import export_for_rerun

OBSERVATIONS = (
    Observation(
        observable="OBS-1",
        considered=True,
        x=0.25,
        evidence=(Evidence(time_s=2.0, text="first\x1b[2J"), Evidence(time_s=7.5, text="then")),
    ),
    Observation(
        observable="OBS-2", considered=True, x=0.999, evidence=(Evidence(time_s=3.0, text="nearly"),)
    ),
    Observation(
        observable="OBS-3", considered=True, x=1.0, evidence=(Evidence(time_s=3.0, text="well done"),)
    ),
    Observation(observable="OBS-4", considered=False),
)

OTHER_BOX = (10.0, 20.0, 110.0, 80.0)
CORNERS = [(150.0, -50.0), (260.0, -50.0), (200.0, 40.0)]
MOUNT = (0.5, -0.5, 0.5, 0.5)
CAMERAS = {
    "camera": {"name": "front", "horizontal_fov_deg": 90.0, "width_px": 640, "height_px": 480},
    "more_cameras": [{"name": "down", "stabilized": False, "width_px": 320, "height_px": 200}],
}


def situation(name: str) -> SimSpec:
    """The made situation with two cameras, two named areas, two no-fly areas and a road."""
    ring = [{"east_m": east, "north_m": north} for east, north in CORNERS]
    document = simspec(vehicle={"name": name, **CAMERAS}).model_dump(mode="json")
    document["perception"]["more_cameras"] = ["down"]
    # A name that could be taken for another area.
    document["world"]["areas"] = [{"id": "yard", "corners": ring}, {"id": "area", "corners": ring[::-1]}]
    document["world"]["roads"] = [{"id": "north-road", "points": ring[:2], "width_m": 7.0}]
    document["rules"]["geofence"] = document["world"]["area"]
    document["rules"]["no_fly"] = [
        {"id": "clinic", "area": {"corners": ring}},
        {"id": "school", "area": {"corners": ring}, "from_s": 5.0, "until_s": 9.0},
    ]
    return SimSpec.model_validate(document)


def recorded(path: Path, spec: SimSpec, *, spoilt: bool = False) -> Path:
    """A recording of the made run, with pictures and boxes of two cameras, and an agent that writes control characters."""
    name, topics = spec.vehicle.name, VehicleTopics(spec.vehicle.name)
    mounts = tuple(
        TransformStamped(
            Header(Time(), f"{name}/base_{carrier}"),
            f"{name}/camera_{camera}_optical",
            Transform(Vector3(), Quaternion(*MOUNT)),
        )
        for camera, carrier in (("front", "level"), ("down", "link"))
    )
    pictures = [
        (step / 10, CompressedImage(Header(Time.of(step * 100_000_000)), "jpeg", bytes([step]) * 50))
        for step in range(0, 100, 20)
    ]
    extra = [
        Record(at_s(0.0), TF_STATIC, TFMessage.TYPE, encode(TFMessage(mounts))),
        *(
            # Published a tenth of a second after the exposure.
            Record(at_s(time_s + 0.1), topics.image_compressed("down"), picture.TYPE, encode(picture))
            for time_s, picture in pictures
        ),
        *(
            detections(time_s, topics.camera_detections("down"), "truck", 0.5, OTHER_BOX)
            for time_s in (3.1, 7.1)
        ),
        text_record(4.05, topics.decisions, Decision(4.0, "go", "first", "at once\x1b[2J\u202e")),
        *(text_record(time_s, topics.status, AgentStatus(time_s, "searching")) for time_s in (1.05, 2.05)),
    ]
    if spoilt:
        extra.append(Record(at_s(2.0), TRUTH_ACTORS, "geometry_msgs/msg/PoseArray", b"nothing"))
    with open_recording(path, simspec=spec, versions={}) as recorder:
        for record in records(spec, seconds=10.0, extra=extra):
            recorder(record)
    return path


class Export:
    """The rows of an export by the path of their entity: each with its time (s; None for always) and components."""

    def __init__(self, source: Path, target: Path) -> None:
        from rerun.chunk import RrdReader

        export_for_rerun(source, target, OBSERVATIONS)
        self.tape: Tape = read_tape(source)
        reader = RrdReader(target)
        self.blueprints = reader.blueprints()
        self.rows: dict[str, list[tuple[float | None, dict[str, Any]]]] = defaultdict(list)
        for chunk in reader.stream().to_chunks():
            assert chunk.is_static or chunk.timeline_names == ["simulated_time"]
            for row in chunk.to_record_batch().to_pylist():
                time = row.pop("simulated_time", None)
                values = {
                    key.split(":")[1]: value for key, value in row.items() if ":" in key and value is not None
                }
                self.rows[chunk.entity_path].append((None if time is None else time.value / 1e9, values))
        for rows in self.rows.values():
            rows.sort(key=lambda row: -1.0 if row[0] is None else row[0])

    def values(self, path: str, component: str) -> list[Any]:
        return [values[component] for _, values in self.rows[path] if component in values]

    def times(self, path: str, component: str) -> list[float | None]:
        return [time for time, values in self.rows[path] if component in values]


@pytest.fixture(scope="module", params=["vehicle_1", "scout_2"])
def export(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Export:
    folder = tmp_path_factory.mktemp(request.param)
    return Export(recorded(folder / "recording.mcap", situation(request.param)), folder / "run.rrd")


def test_actors_and_vehicle_are_where_the_truth_says(export: Export) -> None:
    tape, members = export.tape, cast(situation("vehicle_1"))
    centers = np.array(export.values("/world/actors", "centers"))
    halves = np.array([(member.length_m, member.width_m, member.height_m) for member in members]) / 2.0
    assert export.times("/world/actors", "centers") == pytest.approx(list(tape.actor_time_s))
    assert centers == pytest.approx(tape.actor_position_enu_m + halves * (0.0, 0.0, 1.0), rel=1e-6)
    assert np.array(export.values("/world/actors", "half_sizes"))[0] == pytest.approx(halves)
    labels = [f"{member.id} ({member.class_label})" for member in members]
    assert export.values("/world/actors", "labels")[-1] == labels
    # Of one role, one colour.
    colors = dict(zip(labels, export.values("/world/actors", "colors")[0], strict=True))
    by_role: dict[str, set[int]] = defaultdict(set)
    for member, label in zip(members, labels, strict=True):
        by_role[member.role].add(colors[label])
    assert [len(colors) for colors in by_role.values()] == [1, 1, 1]
    assert len(set.union(*by_role.values())) == 3
    moved = np.array(export.values("/world/vehicle", "translation"))[:, 0]
    assert moved == pytest.approx(tape.vehicle_position_enu_m, rel=1e-6)
    (path,) = export.values("/world/path", "strips")[0]
    assert np.array(path) == pytest.approx(tape.vehicle_position_enu_m, rel=1e-6)
    assert [height for (height,) in export.values("/plots/height", "scalars")] == pytest.approx([60.0] * 100)
    assert {charge for (charge,) in export.values("/plots/battery", "scalars")} == {90.0}
    # It faces north all the time, and leans nowhere.
    north = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]
    for frame in ("vehicle", "level"):
        assert np.array(export.values(f"/world/{frame}", "quaternion"))[:, 0] == pytest.approx(
            np.tile(north, (100, 1))
        )


def test_areas_are_there_for_as_long_as_they_hold(export: Export) -> None:
    ring = [[east, north, 0.0] for east, north in (*CORNERS, CORNERS[0])]
    (labels,), (strips,) = export.values("/world/areas", "labels"), export.values("/world/areas", "strips")
    assert labels == ["area", "yard", "area", "geofence"]
    assert strips[1] == ring
    assert strips[2] == [*ring[2::-1], ring[2]]
    assert strips[0] == strips[3]
    assert export.values("/world/roads", "strips") == [[ring[:2]]]
    for name, times in (("clinic", [0.0]), ("school", [5.0, 9.0])):
        path = f"/world/no_fly/{name}"
        assert [time for time, _ in export.rows[path]] == times
        assert export.values(path, "strips") == [[ring]]


def test_pictures_and_boxes_stand_at_their_exposures(export: Export) -> None:
    """Two cameras: one that stays level, one that leans with the vehicle."""
    tape = export.tape
    assert export.values("/world/vehicle/down", "blob") == [
        [list(bytes([step]) * 50)] for step in range(0, 100, 20)
    ]
    assert export.times("/world/vehicle/down", "blob") == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert not export.values("/world/level/front", "blob")
    for path, size in (("level/front", (640, 480)), ("vehicle/down", (320, 200))):
        assert export.values(f"/world/{path}", "resolution") == [[list(map(float, size))]]
        assert export.values(f"/world/{path}", "quaternion") == [[list(MOUNT)]]
    lens = export.values("/world/level/front", "image_from_camera")[0][0]
    assert lens == pytest.approx([320.0, 0.0, 0.0, 0.0, 320.0, 0.0, 320.0, 240.0, 1.0])
    for path, camera, labels in (
        ("level/front", "", ["civilian 0.75 t1"]),
        ("vehicle/down", "down", ["truck 0.50 t1"]),
    ):
        frames = [frame for frame in tape.detections if frame.camera == camera]
        assert len(frames) > 1
        assert export.times(f"/world/{path}/detections", "labels") == pytest.approx(
            [frame.exposed.s for frame in frames]
        )
        assert export.values(f"/world/{path}/detections", "labels") == [labels] * len(frames)
        counts = export.values(f"/plots/detections/{camera or 'front'}", "scalars")
        assert counts == [[1.0]] * len(frames)
    for path, box in (
        ("level/front/detections", BOX),
        ("level/front/truth", BOX),
        ("vehicle/down/detections", OTHER_BOX),
    ):
        (center,), (half,) = (export.values(f"/world/{path}", name)[0] for name in ("centers", "half_sizes"))
        corners = [center[0] - half[0], center[1] - half[1], center[0] + half[0], center[1] + half[1]]
        assert corners == pytest.approx(box)
    assert set(map(tuple, export.values("/world/level/front/truth", "labels"))) == {("walker-1",)}


def test_words_reports_and_tracks_show_every_character(export: Export) -> None:
    said = dict(zip(export.times("/log/agent", "text"), export.values("/log/agent", "text"), strict=True))
    assert said[4.05] == ["go first: at once\\x1b[2J\\u202e"]
    assert said[5.0] == ["marks mobile_radar r5"]
    # Said twice, told once.
    assert [text for text in said.values() if "phase" in text[0]] == [["phase searching"]]
    assert ["link down"] in export.values("/log/operator", "text")
    assert ["order hold: hold"] in export.values("/log/operator", "text")
    assert export.values("/log/session", "text") == [["begun"]]
    assert export.times("/world/agent/reports", "positions") == [5.0]
    assert export.values("/world/agent/reports", "positions") == [[[101.0, 99.0, 0.0]]]
    assert export.values("/world/agent/reports", "labels") == [["marks mobile_radar"]]
    assert export.values("/world/agent/tracks", "positions") == [[[120.0, 100.0, 0.0]]] * 10
    assert len(export.blueprints) == 1


def test_moments_of_what_was_measured_below_one_stand_in_the_log(export: Export) -> None:
    assert export.times("/log/observables/OBS-1", "text") == [2.0, 7.5]
    assert export.values("/log/observables/OBS-1", "text") == [
        ["OBS-1 0.25: first\\x1b[2J"],
        ["OBS-1 0.25: then"],
    ]
    assert export.values("/log/observables/OBS-2", "text") == [["OBS-2 0.999: nearly"]]
    assert not {"/log/observables/OBS-3", "/log/observables/OBS-4"} & set(export.rows)


def test_what_cannot_be_decoded_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And of a recording that was cut off, what is before the cut."""
    command = EntryPoint("export-rerun", "rebar_rerun._command:export_rerun", "rebar.commands")
    monkeypatch.setitem(plugins("rebar.commands"), command.name, command)
    source = recorded(tmp_path / "recording.mcap", situation("vehicle_1"), spoilt=True)
    assert run(["export-rerun", str(source), "--out", str(tmp_path / "run.rrd")]) == 0
    printed = capsys.readouterr().out
    assert f"not shown: {TRUTH_ACTORS} (1)" in printed
    # Nothing is left but the SimSpec.
    source.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
    assert run(["export-rerun", str(tmp_path), "--out", str(tmp_path / "cut.rrd")]) == 0
    assert "not shown: recording (1)" in capsys.readouterr().out
    assert run(["export-rerun", str(tmp_path), "--out", str(tmp_path / "cut.rrd")]) == 2
    assert "exists already (give another name with --out, or delete it)" in capsys.readouterr().err
    assert run(["export-rerun", str(tmp_path), "--out", str(tmp_path / "no" / "such.rrd")]) == 2
    stranger = tmp_path / "notes.mcap"
    stranger.write_text("no recording")
    with pytest.raises(SetupError, match="is not an MCAP recording"):
        export_for_rerun(stranger, tmp_path / "stranger.rrd")
    left = ["cut.rrd", "notes.mcap", "recording.mcap", "run.rrd"]
    assert sorted(path.name for path in tmp_path.iterdir()) == left
