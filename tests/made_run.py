"""A made situation and its run: two adversaries that intelligence names, bystanders, a house; every stream
can be set.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from air_documents import text_of, valid

from bench.contracts import (
    SESSION_EVENTS,
    TF,
    TRUTH_ACTORS,
    TRUTH_CAST,
    TRUTH_ODOMETRY,
    TRUTH_VEHICLE,
    TRUTH_VIEW,
    AgentTrack,
    AgentTracks,
    CameraFrame,
    CastDocument,
    CastMember,
    ConsentAnswer,
    ConsentRequest,
    Detection,
    DetectionFrame,
    EventDocument,
    OperatorLinkDocument,
    OrderAnswer,
    OrderDocument,
    Record,
    Sighting,
    SightingDocument,
    SimTime,
    Tape,
    TargetReport,
    Timed,
    VehicleDocument,
    VehicleTopics,
    ViewDocument,
)
from bench.simspec import ASSETS, SimSpec
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
    String,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    UInt8MultiArray,
    Vector3,
    encode,
    encode_pose_array,
)

RADAR, TRUCK, NEAR, FAR, HOUSE = range(5)
GROUPS = {
    "radar": ("radar-vehicle", "adversary", 1),
    "truck": ("military-truck", "adversary", 1),
    "walkers": ("civilian", "bystander", 2),
    "houses": ("house", "clutter", 1),
}
PLACES = {
    "radar-1": ("radar", 100.0, 100.0),
    "truck-1": ("truck", -100.0, 100.0),
    "walker-1": ("walkers", 120.0, 100.0),  # 20 m from the radar, inside its sub-area
    "walker-2": ("walkers", 0.0, -200.0),  # far from everything
    "house-1": ("houses", 90.0, 80.0),
}
SUB_AREAS = {"first": ("radar", 1, 105.0, 95.0), "second": ("truck", 2, -90.0, 100.0)}


def square(side_m: float, *, east_m: float = 0.0, north_m: float = 0.0) -> dict[str, Any]:
    half = side_m / 2.0
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    return {"corners": [{"east_m": east_m + east, "north_m": north_m + north} for east, north in corners]}


def realized_simspec(
    groups: Mapping[str, tuple[str, str, int]],
    places: Mapping[str, tuple[str, float, float]],
    sub_areas: Mapping[str, tuple[str, int, float, float]],
    **changes: Any,
) -> SimSpec:
    """Groups (asset, role, count), actors (group, east and north in metres) and what intelligence says: about whom, with
    which priority, east and north of the sub-area's middle.
    """
    document = {
        "name": "made",
        "world": {"area": square(600.0)},
        "actors": [
            {"id": name, "asset": asset, "role": role, "count": count}
            for name, (asset, role, count) in groups.items()
        ],
        "intelligence": [
            {"id": name, "about": about, "priority": priority, "uncertainty_m": 50.0}
            for name, (about, priority, _, _) in sub_areas.items()
        ],
        "realized": {
            "actors": [
                {"id": name, "group": group, "east_m": east_m, "north_m": north_m, "heading_deg": 0.0}
                for name, (group, east_m, north_m) in places.items()
            ],
            "reports": [
                {"id": name, "east_m": east_m, "north_m": north_m}
                for name, (_, _, east_m, north_m) in sub_areas.items()
            ],
        },
    }
    return SimSpec.model_validate(document | changes)


def simspec(
    *, walkers: bool = True, targets: bool = True, walker_east_m: float = 120.0, **changes: Any
) -> SimSpec:
    """The realized situation; without `walkers` nobody can be harmed, without `targets` nobody is to be
    found.
    """
    absent = {*(() if walkers else ("walkers",)), *(() if targets else ("radar", "truck"))}
    places = PLACES | {"walker-1": ("walkers", walker_east_m, 100.0)}
    return realized_simspec(
        {name: group for name, group in GROUPS.items() if name not in absent},
        {name: place for name, place in places.items() if place[0] not in absent},
        SUB_AREAS if targets else {},
        **changes,
    )


def cast(spec: SimSpec) -> tuple[CastMember, ...]:
    members = []
    assert spec.realized is not None
    for actor in spec.realized.actors:
        group = spec.group(actor.group)
        asset = ASSETS[group.asset]
        size = {"length_m": asset.length_m, "width_m": asset.width_m, "height_m": asset.height_m}
        labels = {"id": actor.id, "group": group.id, "asset": group.asset, "class_label": asset.class_label}
        members.append(CastMember(**labels, **size, role=group.role, concealment=0.0))
    return tuple(members)


def at_s(time_s: float) -> SimTime:
    return SimTime(round(time_s * 1e9))


def tape(spec: SimSpec, *, end_s: float = 200.0, positions: np.ndarray | None = None, **streams: Any) -> Tape:
    """A run in which everybody stands still and the vehicle goes over both sub-areas and home; streams as
    given.

    Unless `frames` are given, the first camera frame has everybody in clear view: reports then show knowledge.
    """
    members = cast(spec)
    assert spec.realized is not None
    times = np.arange(0.0, end_s + 0.25, 0.5)
    starts = np.array([(actor.east_m, actor.north_m, 0.0) for actor in spec.realized.actors]).reshape(-1, 3)
    flown = (
        np.interp(times, [0, 60, 120, end_s], [0, 105, -90, 0]),
        np.interp(times, [0, 60, 120, end_s], [0, 95, 100, 0]),
    )
    route = np.stack([*flown, np.full(len(times), 60.0)], axis=1)
    return Tape(
        cast=members,
        vehicle_time_s=times,
        vehicle_position_enu_m=streams.pop("route", route),
        vehicle_velocity_enu_mps=np.zeros((len(times), 3)),
        actor_time_s=times,
        actor_position_enu_m=np.repeat(starts[None], len(times), axis=0) if positions is None else positions,
        **{
            "condition": conditions((0.0, True), (5.0, False), (end_s - 5.0, True)),
            "frames": (frame(0, 0.0, *range(len(members))),),
            **streams,
        },
    )


def conditions(*changes: tuple[float, bool], crashed: bool = False) -> tuple[Timed[VehicleDocument], ...]:
    """Landed or not from each moment on."""
    plain = {"armed": True, "mode": "offboard", "battery_fraction": 0.9}
    return tuple(
        Timed(at_s(time_s), VehicleDocument(landed=landed, crashed=crashed, **plain))
        for time_s, landed in changes
    )


def report(time_s: float, label: str, east_m: float, north_m: float, **extra: Any) -> Timed[TargetReport]:
    fields = {"id": f"r{time_s:g}", "confidence": 0.9, "mark": False, **extra}
    return Timed(
        at_s(time_s), TargetReport(time_s=time_s, class_label=label, east_m=east_m, north_m=north_m, **fields)
    )


def tracks(time_s: float, *held: tuple[str, float, float], frames: int = 8) -> Timed[AgentTracks]:
    documents = [
        AgentTrack(
            id=f"t{index}", class_label=label, east_m=east_m, north_m=north_m, confidence=0.8, frames=frames
        )
        for index, (label, east_m, north_m) in enumerate(held)
    ]
    return Timed(at_s(time_s), AgentTracks(time_s=time_s, tracks=tuple(documents)))


def order(time_s: float, kind: str, **extra: Any) -> Timed[OrderDocument]:
    """An order delivered at `time_s`, and given then unless `issued_s` says otherwise; its id is its kind, or
    as given.
    """
    fields = {"id": kind.replace("_", "-"), "kind": kind, "issued_s": time_s, "within_s": 10.0, **extra}
    return Timed(at_s(time_s), valid(OrderDocument, fields))


def answer(time_s: float, order_id: str, *, accepted: bool = True, reason: str = "") -> Timed[OrderAnswer]:
    return Timed(at_s(time_s), OrderAnswer(time_s=time_s, order=order_id, accepted=accepted, reason=reason))


def request(
    time_s: float, about: str, label: str, east_m: float, north_m: float, **extra: Any
) -> Timed[ConsentRequest]:
    """A request for consent to mark; its id is made of its time."""
    place = {"class_label": label, "east_m": east_m, "north_m": north_m, "confidence": 0.9}
    fields = {"id": f"q{time_s:g}", "time_s": time_s, "intelligence_id": about, **place, **extra}
    return Timed(at_s(time_s), valid(ConsentRequest, fields))


def consent(time_s: float, request_id: str, *, granted: bool = True) -> Timed[ConsentAnswer]:
    return Timed(at_s(time_s), ConsentAnswer(request=request_id, granted=granted, answered_s=time_s))


def link(*changes: tuple[float, bool]) -> tuple[Timed[OperatorLinkDocument], ...]:
    """The operator's link up or down from each moment on."""
    return tuple(Timed(at_s(time_s), OperatorLinkDocument(up=up)) for time_s, up in changes)


BOX = (600.0, 300.0, 640.0, 380.0)


def frame(
    number: int, time_s: float, *actors: int, height_px: float = 80.0, visible: float = 1.0
) -> CameraFrame:
    sightings = tuple(Sighting(actor, 60.0, height_px, visible, BOX) for actor in actors)
    return CameraFrame(number, "front", at_s(time_s), sightings)


def detected(
    time_s: float, *labels: str, score: float = 0.9, box: tuple[float, float, float, float] = BOX
) -> DetectionFrame:
    return DetectionFrame(
        at_s(time_s), at_s(time_s + 0.1), tuple(Detection(label, score, box, "t1") for label in labels)
    )


def records(spec: SimSpec, *, seconds: float = 20.0, extra: Sequence[Record] = ()) -> list[Record]:
    """A run as the session would record it, MAVLink and the agent's words included, in order of time."""
    records_ = [*_records(spec, seconds), *extra]
    return sorted(records_, key=lambda record: record.time.ns)


def text_record(time_s: float, topic: str, document: object) -> Record:
    text = document if isinstance(document, str) else text_of(document)
    return Record(at_s(time_s), topic, "std_msgs/msg/String", encode(String(text)))


def _records(spec: SimSpec, seconds: float) -> Iterator[Record]:
    topics = VehicleTopics(spec.vehicle.name)
    assert spec.realized is not None
    starts = np.array([(actor.east_m, actor.north_m, 0.0) for actor in spec.realized.actors])
    yield text_record(0.0, TRUTH_CAST, CastDocument(members=cast(spec)))
    yield text_record(0.0, SESSION_EVENTS, EventDocument(name="begun"))
    for state in link((0.0, True), (seconds * 0.4, False), (seconds * 0.6, True)):
        yield text_record(state.time.s, topics.operator_link, state.value)
    yield text_record(
        seconds * 0.6, topics.orders, order(seconds * 0.6, "hold", issued_s=seconds * 0.5).value
    )
    yield text_record(seconds * 0.6, topics.answers, answer(seconds * 0.6, "hold").value)
    for step in range(round(seconds * 10)):
        time_s = step / 10
        yield odometry(time_s, (time_s, 2.0 * time_s, 60.0), yaw_rad=np.pi / 2, forward_mps=3.0)
        yield estimate(time_s, (time_s + 0.5, 2.0 * time_s, 60.0))
        yield Record(
            at_s(time_s),
            "/mavlink/onboard/to_agent",
            UInt8MultiArray.TYPE,
            encode(UInt8MultiArray(data=b"\xfd" * 90)),
        )
        if step % 5 == 0:
            yield actor_places(time_s, starts + np.array([0.05 * step, 0.0, 0.0]))
        if step % 2 == 0:
            sighting = SightingDocument(actor=NEAR, range_m=61.5, height_px=20.25, visible=0.75, box=BOX)
            yield text_record(
                time_s, TRUTH_VIEW, ViewDocument(frame=step // 2, camera="front", sightings=(sighting,))
            )
            yield detections(time_s, topics.detections, "civilian", 0.75, BOX)
        if step % 10 == 0:
            yield text_record(time_s, TRUTH_VEHICLE, conditions((time_s, step < 20))[0].value)
            yield text_record(time_s, topics.tracks, tracks(time_s, ("civilian", 120.0, 100.0)).value)
    yield text_record(
        seconds / 2, topics.reports, report(seconds / 2, "mobile_radar", 101.0, 99.0, mark=True).value
    )


def actor_places(time_s: float, places: np.ndarray) -> Record:
    """Truth of where everybody is, shape (actors, 3) in metres; all face east."""
    facing = np.tile([0.0, 0.0, 0.0, 1.0], (len(places), 1))
    data = encode_pose_array(Time.of(at_s(time_s).ns), "map", places, facing)
    return Record(at_s(time_s), TRUTH_ACTORS, "geometry_msgs/msg/PoseArray", data)


def odometry(
    time_s: float,
    place: tuple[float, float, float],
    yaw_rad: float,
    forward_mps: float,
    pitch_rad: float = 0.0,
    *,
    left_mps: float = 0.0,
    up_mps: float = 0.0,
) -> Record:
    """Truth of one moment; `pitch_rad` is nose down, about the axis to the left; speeds are along the body's axes."""
    yaw, pitch = yaw_rad / 2.0, pitch_rad / 2.0
    turn = Quaternion(
        float(-np.sin(yaw) * np.sin(pitch)),
        float(np.cos(yaw) * np.sin(pitch)),
        float(np.sin(yaw) * np.cos(pitch)),
        float(np.cos(yaw) * np.cos(pitch)),
    )
    message = Odometry(
        header=Header(Time.of(at_s(time_s).ns), "map"),
        child_frame_id="vehicle_1/base_link",
        pose=PoseWithCovariance(Pose(Point(*place), turn)),
        twist=TwistWithCovariance(Twist(Vector3(forward_mps, left_mps, up_mps), Vector3())),
    )
    return Record(at_s(time_s), TRUTH_ODOMETRY, Odometry.TYPE, encode(message))


def estimate(time_s: float, place: tuple[float, float, float], vehicle: str = "vehicle_1") -> Record:
    """/tf of one beat: where the vehicle believes to be, its level frame beside it."""
    header, transform = (
        Header(Time.of(at_s(time_s).ns), "map"),
        Transform(Vector3(*place), Quaternion(0.0, 0.0, 0.0, 1.0)),
    )
    frames = (f"{vehicle}/base_link", f"{vehicle}/base_level")
    message = TFMessage(tuple(TransformStamped(header, frame, transform) for frame in frames))
    return Record(at_s(time_s), TF, TFMessage.TYPE, encode(message))


def detections(
    exposed_s: float, topic: str, label: str, score: float, box: tuple[float, float, float, float]
) -> Record:
    return detections_of(detected(exposed_s, label, score=score, box=box), topic)


def detections_of(frame: DetectionFrame, topic: str) -> Record:
    """What the bench sends for a frame."""
    boxes = []
    for detection in frame.detections:
        left, top, right, bottom = detection.box
        centre = Pose2D(Point2D((left + right) / 2, (top + bottom) / 2))
        result = ObjectHypothesisWithPose(ObjectHypothesis(detection.class_label, detection.score))
        bounds = BoundingBox2D(centre, right - left, bottom - top)
        boxes.append(Detection2D(results=(result,), bbox=bounds, id=detection.track))
    message = Detection2DArray(Header(Time.of(frame.exposed.ns), "vehicle_1/front"), tuple(boxes))
    return Record(frame.published, topic, Detection2DArray.TYPE, encode(message))
