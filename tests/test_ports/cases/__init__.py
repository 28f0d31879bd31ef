"""Made situations for every measure: one in which it is achieved, one in which it fails, one in which it is
not considered.

Each module of this package holds `CASES`: from the name of a measure to a function of an observable's
options. So one test can go over all observables of a decomposition, make the three recordings for each, and
measure what was recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from made_run import at_s, estimate, text_record
from pymavlink.dialects.v20 import common as mavlink

from bench.campaign import measure_all
from bench.contracts import (
    SESSION_EVENTS,
    TRUTH_ACTORS,
    TRUTH_CAST,
    TRUTH_ODOMETRY,
    TRUTH_VEHICLE,
    TRUTH_VIEW,
    CastDocument,
    DetectionFrame,
    Option,
    Record,
    SightingDocument,
    Tape,
    VehicleTopics,
    ViewDocument,
    mavlink_topic,
)
from bench.recording import open_recording, read_tape
from bench.simspec import SimSpec
from bench.streams import (
    BoundingBox2D,
    Detection2D,
    Detection2DArray,
    Header,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
    Odometry,
    Point,
    Point2D,
    Pose,
    Pose2D,
    PoseWithCovariance,
    Quaternion,
    Time,
    Twist,
    TwistWithCovariance,
    UInt8MultiArray,
    Vector3,
    encode,
    encode_pose_array,
)
from test_ports import DeclaredMeasure

ONBOARD = mavlink_topic("onboard", "from_agent")
SETPOINT = encode(
    UInt8MultiArray(
        data=mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 2496, *[0.0] * 11).pack(
            mavlink.MAVLink(None)
        )
    )
)
"""What the recording has for each moment at which the agent moves the vehicle: a setpoint, message 84."""


@dataclass(frozen=True, slots=True)
class Run:
    """A made situation and what was recorded in it."""

    simspec: SimSpec
    tape: Tape


def x_of(measure: str | DeclaredMeasure, run: Run, **options: Any) -> float | None:
    """What a measure with these options finds in a run."""
    name = measure if isinstance(measure, str) else measure.name
    return measure_all({"OBS-1": (name, options)}, run.tape, run.simspec)[0].x


@dataclass(frozen=True, slots=True)
class Cases:
    """The three runs of a measure with its options; `not_considered` None for what always is."""

    achieved: Run
    failed: Run
    not_considered: Run | None


CasesOf = Callable[[Mapping[str, Option]], Cases]


def recorded(run: Run, path: Path) -> Tape:
    """The run written as a recording at `path` and read back, as a re-scoring reads it."""
    with open_recording(path, simspec=run.simspec, versions={}) as recorder:
        for record in sorted(_records(run), key=lambda record: record.time.ns):
            recorder(record)
    return read_tape(path)


def _records(run: Run) -> Iterator[Record]:
    spec, tape = run.simspec, run.tape
    topics = VehicleTopics(spec.vehicle.name)
    yield text_record(0.0, TRUTH_CAST, CastDocument(members=tape.cast))
    yield from _vehicle(tape)
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(tape.cast), 1))
    for time_s, places in zip(tape.actor_time_s, tape.actor_position_enu_m, strict=True):
        data = encode_pose_array(Time.of(at_s(time_s).ns), "map", places, turns)
        yield Record(at_s(time_s), TRUTH_ACTORS, "geometry_msgs/msg/PoseArray", data)
    for time_s, place in zip(tape.estimate_time_s, tape.estimate_position_enu_m, strict=True):
        yield estimate(float(time_s), tuple(map(float, place)), spec.vehicle.name)  # type: ignore[arg-type]
    for frame in tape.frames:
        sightings = tuple(
            SightingDocument(
                actor=sighting.actor,
                range_m=sighting.range_m,
                height_px=sighting.height_px,
                visible=sighting.visible,
                box=sighting.box,
            )
            for sighting in frame.sightings
        )
        yield text_record(
            frame.exposed.s,
            TRUTH_VIEW,
            ViewDocument(frame=frame.number, camera=frame.camera, sightings=sightings),
        )
    yield from (_detected(answer, topics.detections) for answer in tape.detections)
    documents = (
        (TRUTH_VEHICLE, tape.condition),
        (SESSION_EVENTS, tape.events),
        (topics.intelligence, tape.intelligence),
        (topics.reports, tape.reports),
        (topics.decisions, tape.decisions),
        (topics.status, tape.status),
        (topics.tracks, tape.tracks),
        (topics.orders, tape.orders),
        (topics.answers, tape.answers),
        (topics.operator_link, tape.operator_link),
        (topics.consent_requests, tape.consent_requests),
        (topics.consents, tape.consents),
    )
    for topic, stream in documents:
        for message in stream:
            yield text_record(message.time.s, topic, message.value)
    for moved in tape.moving:
        yield Record(moved.time, ONBOARD, UInt8MultiArray.TYPE, SETPOINT)
    for topic, count in tape.malformed.items():
        for _ in range(count):
            yield text_record(0.0, topic, "{")


def _vehicle(tape: Tape) -> Iterator[Record]:
    """Truth odometry: the nose points east and dips by the tilt; the twist is in the body's axes."""
    tilts = tape.vehicle_tilt_rad if len(tape.vehicle_tilt_rad) else np.zeros(len(tape.vehicle_time_s))
    rows = zip(
        tape.vehicle_time_s, tape.vehicle_position_enu_m, tape.vehicle_velocity_enu_mps, tilts, strict=True
    )
    for time_s, place, velocity, tilt in rows:
        turn = Quaternion(0.0, float(np.sin(tilt / 2)), 0.0, float(np.cos(tilt / 2)))
        ahead = float(np.cos(tilt) * velocity[0] - np.sin(tilt) * velocity[2])
        up = float(np.sin(tilt) * velocity[0] + np.cos(tilt) * velocity[2])
        message = Odometry(
            header=Header(Time.of(at_s(float(time_s)).ns), "map"),
            child_frame_id="vehicle_1/base_link",
            pose=PoseWithCovariance(Pose(Point(*map(float, place)), turn)),
            twist=TwistWithCovariance(Twist(Vector3(ahead, float(velocity[1]), up), Vector3())),
        )
        yield Record(at_s(float(time_s)), TRUTH_ODOMETRY, Odometry.TYPE, encode(message))


def _detected(frame: DetectionFrame, topic: str) -> Record:
    hypotheses = []
    for detection in frame.detections:
        x_min, y_min, x_max, y_max = detection.box
        result = ObjectHypothesisWithPose(ObjectHypothesis(detection.class_label, detection.score))
        box = BoundingBox2D(
            Pose2D(Point2D((x_min + x_max) / 2, (y_min + y_max) / 2)), x_max - x_min, y_max - y_min
        )
        hypotheses.append(Detection2D(results=(result,), bbox=box, id=detection.track))
    message = Detection2DArray(Header(Time.of(frame.exposed.ns), "vehicle_1/front"), tuple(hypotheses))
    return Record(frame.published, topic, Detection2DArray.TYPE, encode(message))


GROUPS: dict[str, tuple[str, str, tuple[tuple[float, float], ...]]] = {
    "radar": ("radar-vehicle", "adversary", ((100.0, 100.0),)),
    "truck": ("military-truck", "adversary", ((-100.0, 100.0),)),
    "walkers": ("civilian", "bystander", ((120.0, 100.0), (0.0, -200.0))),
    "children": ("child", "bystander", ((110.0, 115.0),)),
    "helpers": ("aid-worker", "bystander", ((90.0, 110.0),)),
    "cars": ("civilian-car", "clutter", ((130.0, 80.0),)),
    "houses": ("house", "clutter", ((90.0, 60.0),)),
}
"""Who can be in a made scene: asset, role, places.

The first of each group stands inside the first sub-area, but for the truck.
"""


def scene(*absent: str, **changes: Any) -> SimSpec:
    """A realized situation with everybody of GROUPS but the groups, roles or assets named `absent`."""
    here = {name: group for name, group in GROUPS.items() if not {name, group[0], group[1]} & set(absent)}
    reports = [("first", "radar", 1, 105.0, 95.0), ("second", "truck", 2, -90.0, 100.0)]
    known = [item for item in reports if item[1] in here]
    corners = [(-300, -300), (300, -300), (300, 300), (-300, 300)]
    return SimSpec.model_validate(
        {
            "name": "made",
            "world": {"area": {"corners": [{"east_m": east, "north_m": north} for east, north in corners]}},
            "actors": [
                {"id": name, "asset": asset, "role": role, "count": len(places)}
                for name, (asset, role, places) in here.items()
            ],
            "intelligence": [
                {"id": name, "about": about, "priority": priority, "uncertainty_m": 50.0}
                for name, about, priority, _, _ in known
            ],
            "realized": {
                "actors": [
                    {
                        "id": f"{name}-{index}",
                        "group": name,
                        "east_m": east,
                        "north_m": north,
                        "heading_deg": 0.0,
                    }
                    for name, (_, _, places) in here.items()
                    for index, (east, north) in enumerate(places, 1)
                ],
                "reports": [
                    {"id": name, "east_m": east, "north_m": north} for name, _, _, east, north in known
                ],
            },
            **changes,
        }
    )
