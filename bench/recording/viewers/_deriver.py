"""What viewers show, computed from one record after the other."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import TypeVar

import numpy as np
import pymap3d

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
    CastDocument,
    CastMember,
    ConsentAnswer,
    ConsentRequest,
    Decision,
    EventDocument,
    IntelligenceDocument,
    OperatorLinkDocument,
    OrderAnswer,
    OrderDocument,
    Record,
    TargetReport,
    VehicleDocument,
    VehicleTopics,
    ViewDocument,
    parse_document,
)
from bench.simspec import PROTECTED_ROLES, SimSpec
from bench.streams import (
    CameraInfo,
    Detection2DArray,
    Header,
    NavSatFix,
    Odometry,
    Point,
    RosMessage,
    String,
    TFMessage,
    Time,
    decode,
    decode_pose_array,
)

from ._attitude import heading_deg, rotated, tilt_deg
from ._ground import ground_map, ground_scene
from ._messages import GeoJSON, Log, LogLevel, ViewerState
from ._pictures import detection_boxes, empty_picture, truth_boxes
from ._scene import AgentScene, actor_scene, vehicle_scene

# Every topic that an export adds lies under this name.
VIEWER_PREFIX = "/viewer/"
GROUND = "/viewer/ground"
GROUND_MAP = "/viewer/ground_map"
ACTORS = "/viewer/actors"
VEHICLE = "/viewer/vehicle"
AGENT = "/viewer/agent"
FIX = "/viewer/fix"
ESTIMATE_FIX = "/viewer/estimate_fix"
DETECTIONS = "/viewer/detections"
STATE = "/viewer/state"
LOG = "/viewer/log"
OBSERVATIONS = "/viewer/observations"
EMPTY_PICTURE = "/viewer/empty_picture"


def detections_topic(camera: str) -> str:
    """The topic of the detections in the frames of a further camera."""
    return f"/viewer/{camera}/detections"


def empty_picture_topic(camera: str) -> str:
    """The topic of empty pictures of a further camera."""
    return f"/viewer/{camera}/empty_picture"


def truth_boxes_topic(camera: str) -> str:
    """The topic of the true boxes in the frames of one camera."""
    return f"/viewer/{camera}/truth_boxes"


Derived = tuple[str, RosMessage]
D = TypeVar("D")


class ViewerDeriver:
    """Call it with each record in order of time; it gives the messages that viewers show from then on.

    `pictures` names the cameras of which the recording has pictures; each frame of the others that has boxes gets an empty
    one. What cannot be decoded is counted by topic in `malformed` and left out. The memory that it needs does not grow with the recording.
    """

    def __init__(self, simspec: SimSpec, *, pictures: Collection[str]) -> None:
        self._simspec = simspec
        self._vehicle = simspec.vehicle.name
        self._base = f"{self._vehicle}/base_link"
        self._cast: tuple[CastMember, ...] = ()
        self._bystanders_m: Floats = np.empty((0, 3))
        self._agent = AgentScene()
        self._estimate: Point | None = None
        self._condition: VehicleDocument | None = None
        self._phase = ""
        self._operator_link_up = True
        self._detections = self._tracks = self._reports = 0
        self.malformed: Counter[str] = Counter()
        topics = VehicleTopics(self._vehicle)
        self._derivations: dict[str, Callable[[Record], Iterator[Derived] | None]] = {
            TRUTH_ACTORS: self._from_actors,
            TRUTH_ODOMETRY: _of(Odometry, self._from_odometry),
            TRUTH_CAST: _of(CastDocument, self._from_cast),
            TRUTH_VIEW: _of(ViewDocument, self._from_view),
            TRUTH_VEHICLE: _of(VehicleDocument, self._from_condition),
            TF: _of(TFMessage, self._from_transforms),
            topics.detections: _of(Detection2DArray, self._from_detections),
            topics.intelligence: _of(IntelligenceDocument, self._from_intelligence),
            topics.tracks: _of(AgentTracks, self._from_tracks),
            topics.reports: _of(TargetReport, self._from_report),
            topics.status: _of(AgentStatus, self._from_status),
            topics.operator_link: _of(OperatorLinkDocument, self._from_operator_link),
            SESSION_EVENTS: _of(EventDocument, _logged(lambda event: f"{event.name} {event.text}")),
            topics.decisions: _of(
                Decision,
                _logged(
                    lambda decision: f"decision: {decision.action} {decision.subject}: {decision.reason}"
                ),
            ),
            topics.orders: _of(OrderDocument, _logged(lambda order: f"order {order.id}: {order.kind}")),
            topics.answers: _of(
                OrderAnswer,
                _logged(
                    lambda answer: (
                        f"order {answer.order} {'accepted' if answer.accepted else 'refused'}: {answer.reason}"
                    )
                ),
            ),
            topics.consent_requests: _of(
                ConsentRequest,
                _logged(
                    lambda request: f"asks to mark {request.class_label}, {_place(request)} ({request.id})"
                ),
            ),
            topics.consents: _of(
                ConsentAnswer,
                _logged(
                    lambda answer: f"request {answer.request} {'granted' if answer.granted else 'refused'}"
                ),
            ),
        }
        # Of the cameras alone that have boxes in their frames.
        for camera in simspec.perceiving_cameras:
            is_main = camera.name == simspec.vehicle.camera.name
            if camera.name not in pictures:
                topic = EMPTY_PICTURE if is_main else empty_picture_topic(camera.name)
                self._derivations[topics.camera_info(camera.name)] = partial(
                    self._from_camera_info, topic=topic
                )
            if not is_main:
                self._derivations[topics.camera_detections(camera.name)] = _of(
                    Detection2DArray, partial(_boxes, topic=detections_topic(camera.name))
                )

    def ground(self, time: Time) -> Iterator[Derived]:
        """What never moves, once and first."""
        yield GROUND, ground_scene(self._simspec, time)
        yield GROUND_MAP, GeoJSON(ground_map(self._simspec))

    def __call__(self, record: Record) -> Iterator[Derived]:
        """The messages that follow from one record, all of its time."""
        derive = self._derivations.get(record.topic)
        if derive is None:
            return
        derived = derive(record)
        if derived is None:
            self.malformed[record.topic] += 1
            return
        yield from derived

    def _from_odometry(self, record: Record, odometry: Odometry) -> Iterator[Derived]:
        yield VEHICLE, vehicle_scene(self._vehicle, odometry)
        yield FIX, self._fix(odometry.header.stamp, odometry.pose.pose.position)
        yield STATE, self._state(odometry)

    def _from_transforms(self, record: Record, message: TFMessage) -> Iterator[Derived]:
        for transform in message.transforms:
            if transform.child_frame_id == self._base:
                place = transform.transform.translation
                self._estimate = Point(place.x, place.y, place.z)
                yield ESTIMATE_FIX, self._fix(transform.header.stamp, self._estimate)

    def _from_cast(self, record: Record, cast: CastDocument) -> Iterator[Derived]:
        self._cast = cast.members
        return iter(())

    def _from_actors(self, record: Record) -> Iterator[Derived] | None:
        decoded = decode_pose_array(record.data)
        # A pose array has no ids: only its length says whether it is of this cast.
        if decoded is None or len(decoded[1]) != len(self._cast):
            return None
        stamp_ns, positions_m, quaternions = decoded
        protected = [member.role in PROTECTED_ROLES for member in self._cast]
        self._bystanders_m = positions_m[np.array(protected, dtype=bool)]
        return iter(((ACTORS, actor_scene(self._cast, positions_m, quaternions, Time.of(stamp_ns))),))

    def _from_view(self, record: Record, view: ViewDocument) -> Iterator[Derived]:
        yield truth_boxes_topic(view.camera), truth_boxes(view, self._cast, Time.of(record.time.ns))

    def _from_camera_info(self, record: Record, topic: str) -> Iterator[Derived] | None:
        info = decode(CameraInfo, record.data)
        picture = None if info is None else empty_picture(info)
        return None if picture is None else iter(((topic, picture),))

    def _from_detections(self, record: Record, message: Detection2DArray) -> Iterator[Derived]:
        self._detections = len(message.detections)
        return _boxes(record, message, DETECTIONS)

    def _from_condition(self, record: Record, condition: VehicleDocument) -> Iterator[Derived]:
        previous, self._condition = self._condition, condition
        if previous is not None and condition.failsafe and condition.failsafe != previous.failsafe:
            yield _log(record, f"failsafe: {condition.failsafe}", LogLevel.WARNING)

    def _from_tracks(self, record: Record, tracks: AgentTracks) -> Iterator[Derived]:
        self._tracks = len(tracks.tracks)
        self._agent.replace_tracks(tracks)
        yield self._agent_scene(record)

    def _from_intelligence(self, record: Record, intelligence: IntelligenceDocument) -> Iterator[Derived]:
        self._agent.add_intelligence(intelligence)
        yield self._agent_scene(record)
        place = _place(intelligence)
        yield _log(record, f"intelligence {intelligence.id}: {intelligence.class_label}, {place}")

    def _from_report(self, record: Record, report: TargetReport) -> Iterator[Derived]:
        self._reports += 1
        self._agent.add_report(report)
        yield self._agent_scene(record)
        text = f"confidence {report.confidence:.2f}{', marked' if report.mark else ''}. {report.reason}"
        yield _log(record, f"report {report.id}: {report.class_label}, {_place(report)}, {text}")

    def _from_status(self, record: Record, status: AgentStatus) -> Iterator[Derived]:
        # An agent repeats its phase; only a new one is worth a line.
        if status.phase != self._phase:
            yield _log(record, f"phase: {status.phase} {status.text}")
        self._phase = status.phase

    def _from_operator_link(self, record: Record, link: OperatorLinkDocument) -> Iterator[Derived]:
        self._operator_link_up = link.up
        level = LogLevel.INFO if link.up else LogLevel.WARNING
        yield _log(record, f"operator link {'up' if link.up else 'down'}", level)

    def _agent_scene(self, record: Record) -> Derived:
        return AGENT, self._agent.update(Time.of(record.time.ns))

    def _fix(self, stamp: Time, place: Point) -> NavSatFix:
        origin = self._simspec.world.origin
        latitude_deg, longitude_deg, altitude_m = pymap3d.enu2geodetic(
            place.x, place.y, place.z, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
        )
        header = Header(stamp, self._base)
        return NavSatFix(
            header, latitude=float(latitude_deg), longitude=float(longitude_deg), altitude=float(altitude_m)
        )

    def _state(self, odometry: Odometry) -> ViewerState:
        pose = odometry.pose.pose
        place, turn = pose.position, pose.orientation
        home = self._simspec.vehicle.home
        velocity = rotated(turn, odometry.twist.twist.linear)
        condition = self._condition
        return ViewerState(
            header=Header(odometry.header.stamp, self._base),
            height_m=place.z,
            ground_speed_mps=math.hypot(velocity.x, velocity.y),
            climb_mps=velocity.z,
            heading_deg=heading_deg(turn),
            tilt_deg=tilt_deg(turn),
            home_distance_m=math.hypot(place.x - home.east_m, place.y - home.north_m),
            estimate_error_m=_distance_m(place, self._estimate),
            nearest_bystander_m=self._nearest_bystander_m(place),
            battery_percent=math.nan if condition is None else 100.0 * condition.battery_fraction,
            detections=self._detections,
            tracks=self._tracks,
            reports=self._reports,
            armed=condition is not None and condition.armed,
            landed=condition is not None and condition.landed,
            crashed=condition is not None and condition.crashed,
            operator_link_up=self._operator_link_up,
            mode="" if condition is None else condition.mode,
            failsafe="" if condition is None else condition.failsafe,
            phase=self._phase,
        )

    def _nearest_bystander_m(self, place: Point) -> float:
        if not len(self._bystanders_m):
            return math.nan
        away = self._bystanders_m - (place.x, place.y, place.z)
        return float(np.sqrt((away * away).sum(axis=1).min()))


def _of(
    kind: type[D], derive: Callable[[Record, D], Iterator[Derived]]
) -> Callable[[Record], Iterator[Derived] | None]:
    """What derives messages from a record that carries a message or a document of this kind; None where it does not."""

    def derive_from(record: Record) -> Iterator[Derived] | None:
        value = decode(kind, record.data) if hasattr(kind, "TYPE") else _document(kind, record)
        return None if value is None else derive(record, value)

    return derive_from


def _document(kind: type[D], record: Record) -> D | None:
    message = decode(String, record.data)
    return None if message is None else parse_document(kind, message.data)


def _logged(text: Callable[[D], str]) -> Callable[[Record, D], Iterator[Derived]]:
    """What derives one line of the log."""
    return lambda record, value: iter((_log(record, text(value)),))


def _log(record: Record, text: str, level: LogLevel = LogLevel.INFO) -> Derived:
    return LOG, Log(Time.of(record.time.ns), level, text.strip(" :"), record.topic)


def _boxes(record: Record, message: Detection2DArray, topic: str) -> Iterator[Derived]:
    yield topic, detection_boxes(message)


def _place(document: TargetReport | ConsentRequest | IntelligenceDocument) -> str:
    return f"east {document.east_m:.0f} m, north {document.north_m:.0f} m"


def _distance_m(place: Point, other: Point | None) -> float:
    return math.nan if other is None else math.dist((place.x, place.y, place.z), (other.x, other.y, other.z))
