"""A recording made into one .rrd file, which the viewer of Rerun shows."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from bench.contracts import (
    TF,
    TF_STATIC,
    TRUTH_ACTORS,
    TRUTH_ODOMETRY,
    Observation,
    Record,
    Tape,
    Timed,
    VehicleTopics,
)
from bench.errors import SetupError
from bench.recording import read_records, read_simspec, read_tape
from bench.simspec import Camera, Role, SimSpec
from bench.simspec import Point as GroundPoint
from bench.streams import CompressedImage, Odometry, TFMessage, decode, decode_pose_array
from bench.visible_text import visible

TIMELINE = "simulated_time"
# The colours of the report's dark page, which mean the same there.
ROLE_COLORS = {
    Role.ADVERSARY: 0xFF8F8FFF,
    Role.SOUGHT: 0xFFC266FF,
    Role.BYSTANDER: 0x78B2F2FF,
    Role.CLUTTER: 0x6B7783FF,
}
INTELLIGENCE_COLOR, REPORT_COLOR, MARK_COLOR, TRACK_COLOR = 0xC09BE8FF, 0x7FD19BFF, 0xFF40FFFF, 0x20D9D9FF
AREA_COLOR, NO_FLY_COLOR, VEHICLE_COLOR, DETECTION_COLOR = 0xE0E0E0FF, 0xFF3030FF, 0xF0F030FF, 0xFFA020FF
# The airframe's size is no part of a recording: drawn as a quadrotor of half a metre.
VEHICLE_HALF_M = (0.25, 0.25, 0.1)
# Chosen: beside a mission area the frustum is seen, and hides little.
PICTURE_PLANE_M = 12.0
# Negative radii are half widths in pixels of the screen: points and lines are seen from every height.
POINT_RADIUS, LINE_RADIUS = -5.0, -1.5


def export_for_rerun(
    source: Path | str, target: Path | str, observations: Iterable[Observation] = ()
) -> dict[str, int]:
    """Write what a viewer shows of the recording `source` to `target`, on the timeline `simulated_time`: also the moments of
    `observations` that were measured in it and are below 1.

    Returns what the recording holds and cannot be decoded, as `Tape.malformed`. Raises SetupError when `source` is no
    recording of the bench, and when `target` exists; OSError when `target` cannot be written. A failure leaves no `target`.
    """
    source, target = Path(source), Path(target)
    tape = read_tape(source, simspec := read_simspec(source))
    if os.path.lexists(target):
        raise SetupError(target, "exists already", "give another name with --out, or delete it")
    # Under another name until it is whole: a viewer must not open half a file as if it were one.
    partial = target.with_name(f"{target.name}.partial")
    partial.touch()  # here, because the package only logs that it cannot write
    try:
        with rr.RecordingStream("rebar") as stream:
            stream.save(partial, _blueprint(simspec))
            stream.set_log_time_enabled(False)  # the host's clock says nothing about the run
            stream.send_recording_name(simspec.name)
            scene = _Scene(stream, simspec, tape)
            scene.log_situation()
            scene.log_tape()
            scene.log_observations(observations)
            for record in read_records(source):
                scene.log_record(record)
            stream.disconnect()
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)
    return dict(tape.malformed)


def _camera_path(camera: Camera) -> str:
    """A stabilized camera hangs on the vehicle's place and yaw, another one on its body."""
    return f"world/{'level' if camera.stabilized else 'vehicle'}/{camera.name}"


def _blueprint(simspec: SimSpec) -> Any:
    """The scene with what was reported so far, the log, the pictures of each camera with boxes, and the plots."""
    views, boundary = rr.blueprint, rr.blueprint.TimeRangeBoundary
    so_far = views.VisibleTimeRanges(
        timeline=TIMELINE, start=boundary.infinite(), end=boundary.cursor_relative()
    )
    kept = dict.fromkeys(("world/agent/reports", "world/intelligence"), so_far)
    scene = views.Spatial3DView(name="Scene", origin="world", overrides=kept)
    pictures = [
        views.Spatial2DView(name=f"Camera {camera.name}", origin=_camera_path(camera))
        for camera in simspec.perceiving_cameras
    ]
    plots = [
        views.TimeSeriesView(name=name, origin=f"plots/{path}")
        for name, path in (("Height, m", "height"), ("Battery, %", "battery"), ("Detections", "detections"))
    ]
    left = views.Vertical(scene, views.TextLogView(name="Log", origin="log"), row_shares=[3, 1])
    right = views.Vertical(views.Tabs(*pictures), *plots, row_shares=[3, 1, 1, 1])
    timeline = views.TimePanel(timeline=TIMELINE, state="collapsed")
    return views.Blueprint(
        views.Horizontal(left, right, column_shares=[3, 2]), timeline, collapse_panels=True
    )


class _Scene:
    """What the viewer shows of one run, logged to a stream of Rerun."""

    def __init__(self, stream: Any, simspec: SimSpec, tape: Tape) -> None:
        self._stream, self._simspec, self._tape = stream, simspec, tape
        topics = VehicleTopics(simspec.vehicle.name)
        cameras = simspec.vehicle.cameras
        self._pictures = {topics.image_compressed(camera.name): _camera_path(camera) for camera in cameras}
        self._mounts = {
            f"{simspec.vehicle.name}/camera_{camera.name}_optical": _camera_path(camera) for camera in cameras
        }
        cast = tape.cast
        self._half_sizes_m = np.array([(actor.length_m, actor.width_m, actor.height_m) for actor in cast]) / 2
        self._actor_colors = np.array([ROLE_COLORS[actor.role] for actor in cast], dtype=np.uint32)
        self._actor_labels = _visible(f"{actor.id} ({actor.class_label})" for actor in cast)

    def log_situation(self) -> None:
        """What stands in the SimSpec; a no-fly area from its beginning to its end."""
        world, rules, vehicle = self._simspec.world, self._simspec.rules, self._simspec.vehicle
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        areas = [("area", world.area), *((area.id, area) for area in world.areas)]
        areas += [] if rules.geofence is None else [("geofence", rules.geofence)]
        rings = [_ring(area.corners) for _, area in areas]
        self._log("world/areas", self._lines(rings, AREA_COLOR, [name for name, _ in areas]))
        roads = [[(point.east_m, point.north_m, 0.0) for point in road.points] for road in world.roads]
        self._log("world/roads", self._lines(roads, ROLE_COLORS[Role.CLUTTER], [it.id for it in world.roads]))
        for no_fly in rules.no_fly:
            path, ring = f"world/no_fly/{no_fly.id}", _ring(no_fly.area.corners)
            self._log(path, self._lines([ring], NO_FLY_COLOR, [f"no-fly {no_fly.id}"]), no_fly.from_s)
            if no_fly.until_s is not None:
                self._log(path, rr.Clear(recursive=False), no_fly.until_s)
        body = rr.Boxes3D(half_sizes=[VEHICLE_HALF_M], colors=VEHICLE_COLOR, labels=[vehicle.name])
        self._log("world/vehicle/body", body)
        for camera in vehicle.cameras:
            focal_px = camera.width_px / 2.0 / math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
            size_px = {"width": camera.width_px, "height": camera.height_px}
            lens = rr.Pinhole(focal_length=focal_px, image_plane_distance=PICTURE_PLANE_M, **size_px)
            self._log(_camera_path(camera), lens)

    def log_observations(self, observations: Iterable[Observation]) -> None:
        """Each moment of an observable below 1, as a warning of the log."""
        for observation in observations:
            if observation.x is None or observation.x >= 1.0:
                continue
            for evidence in observation.evidence:
                words = visible(f"{observation.observable} {observation.x:.3g}: {evidence.text}")
                line = rr.TextLog(words, level="WARN")
                self._log(f"log/observables/{observation.observable}", line, evidence.time_s)

    def log_tape(self) -> None:
        """What the tape holds: words, reports, tracks, boxes, plots, and the whole path."""
        tape = self._tape
        self._log("world/path", self._lines([tape.vehicle_position_enu_m], VEHICLE_COLOR, ["flown"]))
        for path, time_s, words in _words(tape):
            self._log(f"log/{path}", rr.TextLog(visible(words.strip(" :")), level="INFO"), time_s)
        for timed in tape.intelligence:
            told = timed.value
            angles_rad = np.linspace(0.0, 2.0 * math.pi, 49)
            east_m = told.east_m + told.uncertainty_m * np.cos(angles_rad)
            north_m = told.north_m + told.uncertainty_m * np.sin(angles_rad)
            circle = np.stack([east_m, north_m, np.zeros_like(east_m)], axis=1)
            lines = self._lines([circle], INTELLIGENCE_COLOR, [f"{told.id} {told.class_label}"])
            self._log("world/intelligence", lines, timed.time.s)
        for report in tape.reports:
            color = MARK_COLOR if report.value.mark else REPORT_COLOR
            label = f"{_verb(report.value)} {report.value.class_label}"
            self._log("world/agent/reports", self._points([report.value], color, [label]), report.time.s)
        for held in tape.tracks:
            labels = [f"{track.class_label} {track.confidence:.2f}" for track in held.value.tracks]
            self._log("world/agent/tracks", self._points(held.value.tracks, TRACK_COLOR, labels), held.time.s)
        self._log_boxes()
        for time_s, height_m in zip(tape.vehicle_time_s, tape.vehicle_position_enu_m[:, 2], strict=True):
            self._log("plots/height", rr.Scalars(height_m), time_s)
        for condition in tape.condition:
            self._log("plots/battery", rr.Scalars(100.0 * condition.value.battery_fraction), condition.time.s)

    def log_record(self, record: Record) -> None:
        """What no tape holds: attitudes, mounts of cameras, pictures."""
        time_s = record.time.s
        if record.topic == TRUTH_ODOMETRY and (odometry := decode(Odometry, record.data)):
            at, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
            ahead_east = 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z)
            half_yaw_rad = math.atan2(2.0 * (turn.x * turn.y + turn.w * turn.z), ahead_east) / 2.0
            level = (0.0, 0.0, math.sin(half_yaw_rad), math.cos(half_yaw_rad))
            for path, quaternion in (("vehicle", (turn.x, turn.y, turn.z, turn.w)), ("level", level)):
                pose = rr.Transform3D(translation=(at.x, at.y, at.z), quaternion=quaternion)
                self._log(f"world/{path}", pose, time_s)
        elif record.topic == TRUTH_ACTORS and (decoded := decode_pose_array(record.data)):
            # A pose array has no ids: only its length says whether it is of this cast.
            if len(decoded[1]) == len(self._tape.cast) > 0:
                # An actor stands on its place.
                centers_m = decoded[1] + self._half_sizes_m * (0.0, 0.0, 1.0)
                boxes = rr.Boxes3D(
                    centers=centers_m,
                    half_sizes=self._half_sizes_m,
                    quaternions=decoded[2],
                    colors=self._actor_colors,
                    labels=self._actor_labels,
                )
                self._log("world/actors", boxes, time_s)
        elif record.topic in (TF, TF_STATIC) and (message := decode(TFMessage, record.data)):
            for stamped in message.transforms:
                if stamped.child_frame_id in self._mounts:
                    turn = stamped.transform.rotation
                    mount = rr.Transform3D(quaternion=(turn.x, turn.y, turn.z, turn.w))
                    self._log(self._mounts[stamped.child_frame_id], mount, time_s)
        elif record.topic in self._pictures and (picture := decode(CompressedImage, record.data)):
            image = rr.EncodedImage(contents=bytes(picture.data), media_type="image/jpeg")
            self._log(self._pictures[record.topic], image, picture.header.stamp.ns * 1e-9)

    def _log_boxes(self) -> None:
        """True and detected boxes at the exposure of their frame."""
        cameras = {camera.name: _camera_path(camera) for camera in self._simspec.vehicle.cameras}
        for frame in self._tape.frames:
            seen = [it for it in frame.sightings if 0 <= it.actor < len(self._tape.cast)]
            if path := cameras.get(frame.camera):
                labels = [self._tape.cast[it.actor].id for it in seen]
                colors = self._actor_colors[[it.actor for it in seen]]
                self._log(f"{path}/truth", self._boxes(seen, colors, labels), frame.exposed.s)
        for found in self._tape.detections:
            name = found.camera or self._simspec.vehicle.camera.name
            labels = [f"{it.class_label} {it.score:.2f} {it.track}" for it in found.detections]
            boxes = self._boxes(found.detections, DETECTION_COLOR, labels)
            self._log(f"{cameras[name]}/detections", boxes, found.exposed.s)
            self._log(f"plots/detections/{name}", rr.Scalars(len(labels)), found.exposed.s)

    def _boxes(self, found: Sequence[Any], colors: Any, labels: list[str]) -> Any:
        return rr.Boxes2D(
            array=np.array([it.box for it in found], dtype=np.float64).reshape(-1, 4),
            array_format=rr.Box2DFormat.XYXY,
            colors=colors,
            labels=_visible(labels),
        )

    def _lines(self, strips: list[Any], color: int, labels: Iterable[str]) -> Any:
        return rr.LineStrips3D(strips, colors=color, labels=_visible(labels), radii=LINE_RADIUS)

    def _points(self, places: Sequence[Any], color: int, labels: Iterable[str]) -> Any:
        positions = [(place.east_m, place.north_m, 0.0) for place in places]
        return rr.Points3D(positions, colors=color, labels=_visible(labels), radii=POINT_RADIUS)

    def _log(self, path: str, content: Any, time_s: float | None = None) -> None:
        """At a moment, or for all time."""
        if time_s is not None:
            self._stream.set_time(TIMELINE, duration=time_s)
        self._stream.log(path, content, static=time_s is None)


def _words(tape: Tape) -> Iterator[tuple[str, float, str]]:
    """Who says what, and when."""
    phase = ""
    streams: tuple[tuple[str, Sequence[Timed[Any]], Callable[[Any], str]], ...] = (
        ("session", tape.events, lambda it: f"{it.name} {it.text}"),
        ("operator", tape.operator_link, lambda it: f"link {'up' if it.up else 'down'}"),
        ("operator", tape.intelligence, lambda it: f"intelligence {it.id}: {it.class_label}"),
        ("operator", tape.orders, lambda it: f"order {it.id}: {it.kind}"),
        ("operator", tape.consents, lambda it: f"{it.request} {'granted' if it.granted else 'refused'}"),
        ("agent", tape.decisions, lambda it: f"{it.action} {it.subject}".strip() + f": {it.reason}"),
        ("agent", tape.answers, lambda it: f"{it.order} {('refused', 'accepted')[it.accepted]}: {it.reason}"),
        ("agent", tape.consent_requests, lambda it: f"may mark {it.class_label}? {it.id}: {it.reason}"),
        ("agent", tape.reports, lambda it: f"{_verb(it)} {it.class_label} {it.id}: {it.reason}"),
    )
    for path, stream, words in streams:
        yield from ((path, timed.time.s, words(timed.value)) for timed in stream)
    # An agent repeats its phase; only a new one is worth a line.
    for status in tape.status:
        if status.value.phase != phase:
            yield "agent", status.time.s, f"phase {status.value.phase} {status.value.text}"
        phase = status.value.phase


def _verb(report: Any) -> str:
    return "marks" if report.mark else "reports"


def _visible(labels: Iterable[str]) -> list[str]:
    return [visible(label) for label in labels]


def _ring(corners: Sequence[GroundPoint]) -> list[tuple[float, float, float]]:
    return [(corner.east_m, corner.north_m, 0.0) for corner in (*corners, corners[0])]
