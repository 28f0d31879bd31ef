"""Records made into a `Tape`, live or from a recording by one builder: a measure cannot tell which."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np

from bench.arrays import Floats
from bench.contracts import (
    SESSION_EVENTS,
    TF,
    TRUTH_ACTORS,
    TRUTH_CAST,
    TRUTH_ODOMETRY,
    TRUTH_VEHICLE,
    TRUTH_VIEW,
    AgentStatus,
    AgentTracks,
    CameraFrame,
    CastDocument,
    ConsentAnswer,
    ConsentRequest,
    Decision,
    Detection,
    DetectionFrame,
    EventDocument,
    IntelligenceDocument,
    OperatorLinkDocument,
    OrderAnswer,
    OrderDocument,
    Record,
    Sighting,
    SimTime,
    Tape,
    TargetReport,
    Timed,
    VehicleDocument,
    VehicleTopics,
    ViewDocument,
    is_mavlink_from_agent,
    parse_document,
)
from bench.simspec import SimSpec
from bench.streams import (
    Detection2D,
    Detection2DArray,
    Odometry,
    String,
    TFMessage,
    UInt8MultiArray,
    decode,
    decode_pose_array,
)

from ._control_messages import moving_messages

M = TypeVar("M")


class TapeBuilder:
    """Takes records in order of time, one call each, and keeps what measures need. A `Tap`: it never raises.

    Records on other topics (MAVLink, /clock) cost a dictionary lookup. What a needed topic carries and cannot
    be decoded is counted in `Tape.malformed` by topic and left out.
    """

    def __init__(self, simspec: SimSpec) -> None:
        topics = VehicleTopics(simspec.vehicle.name)
        self._motion = _MotionColumns()
        self._actors = _ActorColumns()
        self._estimate = _EstimateColumns(f"{simspec.vehicle.name}/base_link")
        self._cast: list[Timed[CastDocument]] = []
        self._frames: list[CameraFrame] = []
        self._detections: list[DetectionFrame] = []
        # Reading the agent's MAVLink takes time that only measures of handing over need.
        self._reads_control = any(order.kind == "hand_over" for order in simspec.orders)
        self._moving: list[Timed[str]] = []
        self._malformed: Counter[str] = Counter()
        # By the field of the tape that has them.
        documents: dict[str, tuple[str, type[Any]]] = {
            "condition": (TRUTH_VEHICLE, VehicleDocument),
            "events": (SESSION_EVENTS, EventDocument),
            "intelligence": (topics.intelligence, IntelligenceDocument),
            "reports": (topics.reports, TargetReport),
            "decisions": (topics.decisions, Decision),
            "status": (topics.status, AgentStatus),
            "tracks": (topics.tracks, AgentTracks),
            "orders": (topics.orders, OrderDocument),
            "answers": (topics.answers, OrderAnswer),
            "consent_requests": (topics.consent_requests, ConsentRequest),
            "consents": (topics.consents, ConsentAnswer),
            "operator_link": (topics.operator_link, OperatorLinkDocument),
        }
        self._documents: dict[str, list[Timed[Any]]] = {field: [] for field in documents}
        self._takers: dict[str, Callable[[Record], bool]] = {
            TRUTH_ODOMETRY: self._motion.take,
            TRUTH_ACTORS: self._actors.take,
            TF: self._estimate.take,
            TRUTH_CAST: _documents(CastDocument, self._cast),
            TRUTH_VIEW: self._take_view,
            topics.detections: self._take_detections,
            **{
                topics.camera_detections(name): partial(self._take_detections, camera=name)
                for name in simspec.perception.more_cameras
            },
            **{topic: _documents(kind, self._documents[field]) for field, (topic, kind) in documents.items()},
        }

    def __call__(self, record: Record) -> None:
        """Take in one record."""
        take = self._takers.get(record.topic)
        if take is None and self._reads_control and is_mavlink_from_agent(record.topic):
            take = self._take_control
        if take is not None and not take(record):
            self.note(record.topic)

    def note(self, topic: str) -> None:
        """Count one thing under `topic` that could not be understood."""
        self._malformed[topic] += 1

    def tape(self) -> Tape:
        """The tape of the records so far; the builder may go on taking."""
        cast = self._cast[-1].value.members if self._cast else ()
        actor_times, actor_positions, strangers = self._actors.arrays(len(cast))
        malformed = self._malformed + Counter({TRUTH_ACTORS: strangers})
        times, positions, velocities, tilts = self._motion.arrays()
        estimate_times, estimates = self._estimate.arrays()
        return Tape(
            cast=cast,
            vehicle_time_s=times,
            vehicle_position_enu_m=positions,
            vehicle_velocity_enu_mps=velocities,
            actor_time_s=actor_times,
            actor_position_enu_m=actor_positions,
            frames=tuple(self._frames),
            detections=tuple(self._detections),
            malformed=dict(sorted(malformed.items())),
            moving=tuple(self._moving),
            vehicle_tilt_rad=tilts,
            estimate_time_s=estimate_times,
            estimate_position_enu_m=estimates,
            **{field: tuple(timed) for field, timed in self._documents.items()},
        )

    def _take_control(self, record: Record) -> bool:
        message = _message(UInt8MultiArray, record)
        if message is None:
            return False
        self._moving += (Timed(record.time, name) for name in moving_messages(bytes(message.data)))
        return True

    def _take_view(self, record: Record) -> bool:
        view = _document(ViewDocument, record)
        if view is None:
            return False
        sightings = tuple(
            Sighting(sighting.actor, sighting.range_m, sighting.height_px, sighting.visible, sighting.box)
            for sighting in view.sightings
        )
        self._frames.append(CameraFrame(view.frame, view.camera, record.time, sightings))
        return True

    def _take_detections(self, record: Record, camera: str = "") -> bool:
        message = _message(Detection2DArray, record)
        if message is None:
            return False
        # The stamp is the moment of exposure, the time of the record that of publication.
        stamp = message.header.stamp
        detections = tuple(_detection(detection) for detection in message.detections if detection.results)
        self._detections.append(
            DetectionFrame(
                SimTime(stamp.sec * 1_000_000_000 + stamp.nanosec), record.time, detections, camera
            )
        )
        return True


class _MotionColumns:
    """Truth odometry as flat columns: time, position (3), quaternion x y z w (4), velocity in the body's axes (3)."""

    WIDTH = 11

    def __init__(self) -> None:
        self._values: list[float] = []

    def take(self, record: Record) -> bool:
        message = _message(Odometry, record)
        if message is None:
            return False
        pose, velocity = message.pose.pose, message.twist.twist.linear
        at, turn = pose.position, pose.orientation
        self._values += (
            record.time.s,
            *(at.x, at.y, at.z),
            *(turn.x, turn.y, turn.z, turn.w),
            *(velocity.x, velocity.y, velocity.z),
        )
        return True

    def arrays(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Times (n,), ENU positions (n, 3), ENU velocities (n, 3), tilts (n,)."""
        table = np.array(self._values, dtype=np.float64).reshape(-1, self.WIDTH)
        # The twist of nav_msgs/Odometry is in the child frame, here base_link (FLU).
        turns = table[:, 4:8]
        return table[:, 0].copy(), table[:, 1:4].copy(), _rotated(turns, table[:, 8:11]), _tilts(turns)


class _EstimateColumns:
    """Where the vehicle believes to be: map -> base_link of /tf as flat columns, time and position (3)."""

    def __init__(self, base: str) -> None:
        self._base = base
        self._values: list[float] = []

    def take(self, record: Record) -> bool:
        message = _message(TFMessage, record)
        if message is None:
            return False
        for transform in message.transforms:
            if transform.child_frame_id == self._base:
                place = transform.transform.translation
                self._values += (record.time.s, place.x, place.y, place.z)
        return True

    def arrays(self) -> tuple[Floats, Floats]:
        """Times (e,), ENU positions (e, 3)."""
        table = np.array(self._values, dtype=np.float64).reshape(-1, 4)
        return table[:, 0].copy(), table[:, 1:].copy()


class _ActorColumns:
    """Truth positions of the cast."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._positions: list[Floats] = []

    def take(self, record: Record) -> bool:
        decoded = decode_pose_array(record.data)
        if decoded is None:
            return False
        self._times.append(record.time.s)
        self._positions.append(decoded[1])
        return True

    def arrays(self, members: int) -> tuple[Floats, Floats, int]:
        """Times (m,), positions (m, k, 3), and how many samples were left out because they are of another cast."""
        # A pose array has no ids: only its length says whether it is of this cast.
        fitting = [index for index, positions in enumerate(self._positions) if len(positions) == members]
        times = np.array([self._times[index] for index in fitting], dtype=np.float64)
        positions = np.array([self._positions[index] for index in fitting], dtype=np.float64)
        return times, positions.reshape(len(fitting), members, 3), len(self._positions) - len(fitting)


def _message(kind: type[M], record: Record) -> M | None:
    """The message of a record: as the bench made it, or decoded from the bytes."""
    return record.value if isinstance(record.value, kind) else decode(kind, record.data)


def _document(kind: type[Any], record: Record) -> Any:
    """The document of a record: as the bench made it, or read from the bytes."""
    if isinstance(record.value, kind):
        return record.value
    message = decode(String, record.data)
    return None if message is None else parse_document(kind, message.data)


def _documents(kind: type[Any], documents: list[Any]) -> Callable[[Record], bool]:
    """A taker that keeps the documents of one topic with the moment of their arrival."""

    def take(record: Record) -> bool:
        value = _document(kind, record)
        if value is not None:
            documents.append(Timed(record.time, value))
        return value is not None

    return take


def _detection(message: Detection2D) -> Detection:
    best = message.results[0].hypothesis
    centre, half_x, half_y = (
        message.bbox.center.position,
        message.bbox.size_x / 2.0,
        message.bbox.size_y / 2.0,
    )
    box = (centre.x - half_x, centre.y - half_y, centre.x + half_x, centre.y + half_y)
    return Detection(best.class_id, best.score, box, message.id)


def _rotated(quaternions: Floats, vectors: Floats) -> Floats:
    """(n, 3) vectors turned by (n, 4) unit quaternions x y z w: v + 2w(u x v) + 2u x (u x v)."""
    axis, real = quaternions[:, :3], quaternions[:, 3:]
    once = np.cross(axis, vectors)
    turned: Floats = vectors + 2.0 * (real * once + np.cross(axis, once))
    return turned


def _tilts(quaternions: Floats) -> Floats:
    """(n,) angles between the body's up axis and the vertical, for (n, 4) unit quaternions x y z w."""
    # By half the angle, sin^2 = x^2 + y^2: the arc cosine would lose small angles to rounding.
    across = np.hypot(quaternions[:, 0], quaternions[:, 1])
    along = np.hypot(quaternions[:, 2], quaternions[:, 3])
    tilts: Floats = 2.0 * np.arctan2(across, along)
    return tilts
