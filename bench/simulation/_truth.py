"""The bench network: the truth, in records that leave the session's process only in the recording."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from bench.contracts import (
    SESSION_EVENTS,
    TRUTH_ACTORS,
    TRUTH_CAST,
    TRUTH_ODOMETRY,
    TRUTH_PICTURES,
    TRUTH_VEHICLE,
    TRUTH_VIEW,
    CameraFrame,
    CastDocument,
    EventDocument,
    PictureDocument,
    Record,
    Scene,
    SightingDocument,
    SimTime,
    Tap,
    TruthDocument,
    Vehicle,
    VehicleCondition,
    VehicleDocument,
    VehicleState,
    ViewDocument,
    mavlink_topic,
)
from bench.documents import Document
from bench.simspec import SimSpec
from bench.streams import (
    CompressedImage,
    Header,
    MultiArrayLayout,
    Odometry,
    Point,
    Pose,
    PoseArray,
    PoseWithCovariance,
    String,
    Time,
    Twist,
    TwistWithCovariance,
    UInt8MultiArray,
    Vector3,
    encode,
    encode_pose_array,
)

from ._allowance import MAVLINK_FROM_AGENT_BYTES, MAVLINK_TO_AGENT_BYTES
from ._frames import body_in_map, velocity_in_body

# Rates of the truth, in whole simulated hertz. Chosen, not measured.
ODOMETRY_HZ = 10
ACTORS_HZ = 2
CONDITION_HZ = 1
_SECOND_NS = 1_000_000_000
_UNKNOWN_COVARIANCE = (0.0,) * 36
# A UInt8MultiArray without dimensions up to the count of its octets: the same in every step.
_OCTETS_HEAD = encode(UInt8MultiArray(layout=MultiArrayLayout(dim=(), data_offset=0), data=b""))[:-4]


def truth_of(simspec: SimSpec, scene: Scene) -> TruthDocument:
    """What an agent is given whose manifest asks for the truth. Advances the scene to the time limit."""
    every_s = 1.0 / ACTORS_HZ
    rows = []
    for number in range(math.ceil(simspec.mission.time_limit_s / every_s) + 1):
        scene.advance(SimTime(round(number * every_s * 1e9)))
        # Millimetres: no measure looks closer.
        rows.append(tuple((round(east, 3), round(north, 3)) for east, north, _ in scene.positions().tolist()))
    return TruthDocument(
        simspec=_without_honeypots(simspec), cast=scene.cast, every_s=every_s, places_m=tuple(rows)
    )


def _without_honeypots(simspec: SimSpec) -> SimSpec:
    # An agent that is given the truth is no cheat for having it.
    if simspec.realized is None or not simspec.realized.honeypots:
        return simspec
    realized = simspec.realized.model_copy(update={"honeypots": ()})
    return simspec.model_copy(update={"realized": realized})


class TruthRecorder:
    """Writes the truth about one session as records."""

    def __init__(self, vehicle_name: str, tap: Tap) -> None:
        self._tap = tap
        self._base = f"{vehicle_name}/base_link"
        self._next_ns = {"odometry": 0, "actors": 0, "condition": 0}
        self._condition_shape: tuple[object, ...] | None = None
        self._failures: tuple[str, ...] = ()
        # By direction and link.
        self._wire: dict[tuple[str, str], bytes] = {}
        self._wire_bytes: Counter[tuple[str, str]] = Counter()
        self._grown = False
        self.unrecorded_bytes = 0
        """MAVLink to the agent that was sent and not recorded."""

    def write_event(self, time: SimTime, name: str, text: str = "") -> None:
        """Write one line of the session's log."""
        self._document(time, SESSION_EVENTS, EventDocument(name=name, text=text))

    def write_cast(self, time: SimTime, scene: Scene) -> None:
        """Write who the actors are."""
        self._document(time, TRUTH_CAST, CastDocument(members=scene.cast))

    def write_frame(self, frame: CameraFrame) -> None:
        """Write what could be seen in one exposure.

        Numbers are rounded: a hundredth of a pixel carries no information.
        """
        sightings = tuple(
            SightingDocument(
                actor=sighting.actor,
                range_m=round(sighting.range_m, 3),
                height_px=round(sighting.height_px, 2),
                visible=round(sighting.visible, 4),
                box=(
                    round(sighting.box[0], 2),
                    round(sighting.box[1], 2),
                    round(sighting.box[2], 2),
                    round(sighting.box[3], 2),
                ),
            )
            for sighting in frame.sightings
        )
        self._document(
            frame.exposed,
            TRUTH_VIEW,
            ViewDocument(frame=frame.number, camera=frame.camera, sightings=sightings),
        )

    def write_picture(self, exposed: SimTime, picture: PictureDocument) -> None:
        """Write which pixels one exposure gave."""
        self._document(exposed, TRUTH_PICTURES, picture)

    def write_pixels(self, exposed: SimTime, topic: str, pixels: CompressedImage) -> None:
        """Write the truth about the pixels of one exposure: a mask, or depths."""
        self._tap(Record(exposed, topic, CompressedImage.TYPE, encode(pixels)))

    def keep_mavlink(self, link: str, direction: str, frames: bytes) -> None:
        """Keep raw MAVLink of the present step for `write_mavlink`."""
        key = direction, link
        self._wire[key] = self._wire[key] + frames if key in self._wire else frames

    def write_mavlink(self, began: SimTime, ended: SimTime) -> None:
        """Write a step's MAVLink: the agent's at its beginning, what went to it at its end."""
        if not self._wire:
            return
        # What came from the agent sorts before what went to it.
        for direction, link in sorted(self._wire):
            time = began if direction == "from_agent" else ended
            if self._admits(time, link, direction):
                frames = self._wire[direction, link]
                data = _OCTETS_HEAD + len(frames).to_bytes(4, "little") + frames
                self._tap(Record(time, mavlink_topic(link, direction), UInt8MultiArray.TYPE, data))
        self._wire.clear()

    def _admits(self, time: SimTime, link: str, direction: str) -> bool:
        """Count what one link carried in one step. False: it is not recorded.

        What comes from the agent always is: it flies the vehicle, and measures read it. `flooded_link` bounds it.
        """
        size = len(self._wire[direction, link])
        if direction == "to_agent" and MAVLINK_TO_AGENT_BYTES.reached(
            self._wire_bytes[link, direction] + size, time
        ):
            if not self.unrecorded_bytes:
                self.write_event(time, "dropping", mavlink_topic(link, direction))
            self.unrecorded_bytes += size
            return False
        self._wire_bytes[link, direction] += size
        self._grown = True
        return True

    def flooded_link(self, time: SimTime) -> str | None:
        """A link on which the agent has sent more than is recorded of one."""
        # Asked in every step: only what has grown can be too much, and `at_once` is compared first.
        if not self._grown:
            return None
        self._grown = False
        most = max(self._wire_bytes.values(), default=0)
        if most <= MAVLINK_FROM_AGENT_BYTES.at_once:
            return None
        return next(
            (
                link
                for (link, direction), size in sorted(self._wire_bytes.items())
                if direction == "from_agent" and MAVLINK_FROM_AGENT_BYTES.reached(size, time)
            ),
            None,
        )

    def write_due(self, time: SimTime, vehicle: Vehicle, scene: Scene) -> None:
        """Write whatever is due at `time`; the vehicle's condition also whenever it has changed."""
        if self._due(time, "odometry", ODOMETRY_HZ):
            self._odometry(time, vehicle.truth())
        condition = vehicle.condition()
        if condition.failures != self._failures:
            self._failure_events(time, condition.failures)
        shape = _shape(condition)
        if self._due(time, "condition", CONDITION_HZ) or shape != self._condition_shape:
            self._condition_shape = shape
            self._document(time, TRUTH_VEHICLE, _vehicle_document(condition))
        if self._due(time, "actors", ACTORS_HZ):
            scene.advance(time)
            self._actors(time, scene)

    def _failure_events(self, time: SimTime, failures: tuple[str, ...]) -> None:
        """What broke and what works again since the sample before, in the session's log."""
        for failure in failures:
            if failure not in self._failures:
                self.write_event(time, "failure", failure)
        for failure in self._failures:
            if failure not in failures:
                self.write_event(time, "repaired", failure)
        self._failures = failures

    def _due(self, time: SimTime, name: str, rate_hz: int) -> bool:
        if time.ns < self._next_ns[name]:
            return False
        self._next_ns[name] += _SECOND_NS // rate_hz
        return True

    def _odometry(self, time: SimTime, state: VehicleState) -> None:
        east, north, up = state.position_enu_m
        forward, leftward, upward = velocity_in_body(state)
        roll, pitch, yaw = state.rates_body_radps
        message = Odometry(
            header=Header(stamp=Time.of(time.ns), frame_id="map"),
            child_frame_id=self._base,
            pose=PoseWithCovariance(
                pose=Pose(
                    position=Point(x=east, y=north, z=up),
                    orientation=body_in_map(state.roll_rad, state.pitch_rad, state.yaw_rad),
                ),
                covariance=_UNKNOWN_COVARIANCE,
            ),
            twist=TwistWithCovariance(
                twist=Twist(
                    linear=Vector3(x=forward, y=leftward, z=upward), angular=Vector3(x=roll, y=-pitch, z=-yaw)
                ),
                covariance=_UNKNOWN_COVARIANCE,
            ),
        )
        self._tap(Record(time, TRUTH_ODOMETRY, Odometry.TYPE, encode(message), message))

    def _actors(self, time: SimTime, scene: Scene) -> None:
        positions = scene.positions()
        half = (np.pi / 2.0 - scene.headings()) / 2.0
        quaternions = np.zeros((len(positions), 4))
        quaternions[:, 2], quaternions[:, 3] = np.sin(half), np.cos(half)
        data = encode_pose_array(Time.of(time.ns), "map", positions, quaternions)
        self._tap(Record(time, TRUTH_ACTORS, PoseArray.TYPE, data))

    def _document(self, time: SimTime, topic: str, document: Document) -> None:
        self._tap(Record(time, topic, String.TYPE, encode(String(document.model_dump_json())), document))


def _shape(condition: VehicleCondition) -> tuple[object, ...]:
    """What makes a condition new: not the charge, which always changes, nor failures, which have events."""
    return condition.armed, condition.landed, condition.crashed, condition.mode, condition.failsafe


def _vehicle_document(condition: VehicleCondition) -> VehicleDocument:
    return VehicleDocument(
        armed=condition.armed,
        landed=condition.landed,
        crashed=condition.crashed,
        mode=condition.mode,
        battery_fraction=round(condition.battery_fraction, 6),
        failsafe=condition.failsafe,
    )
