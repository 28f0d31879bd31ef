"""A small world for the reference agent: a kinematic multicopter with PX4's answers, and a camera."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import groupby
from typing import Any, TypeVar

import numpy as np
from air_documents import valid
from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import MavlinkFrame, Moment
from agent_adapters.reference import Settings
from agent_adapters.reference._agent import Agent, AgentParts
from agent_adapters.reference._settings import PolicyName
from bench import contracts, simspec, streams
from bench.contracts import MissionOrder, SimTime, VehicleTopics, document_text

ORIGIN = valid(contracts.Origin, simspec.Origin().model_dump())
NAME = "vehicle_1"
Document = TypeVar("Document")
STEP_S = 0.1
METRES_PER_DEGREE = 6378137.0 * math.pi / 180.0  # near enough for a place this close to the origin
WIDTH_PX, HEIGHT_PX = 1280, 720
FOCAL_PX = WIDTH_PX / 2 / math.tan(math.radians(35.0))
TILT_RAD = math.radians(60.0)
HOLD, TAKEOFF, RTL, LAND, OFFBOARD = (4, 3), (4, 2), (4, 5), (4, 6), (6, 0)
"""PX4's main and sub modes."""
DEFAULT_HZ = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
}
POSITION_VELOCITY_AND_YAW = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)
"""The type mask of setpoints with a position, a velocity and a yaw."""
DISARMED_MODE = (
    mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
    | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
)
ARMED_MODE = DISARMED_MODE | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS


def camera_info() -> streams.CameraInfo:
    return streams.CameraInfo(
        header=streams.Header(streams.Time(), "optical"), height=HEIGHT_PX, width=WIDTH_PX,
        k=(FOCAL_PX, 0.0, WIDTH_PX / 2, 0.0, FOCAL_PX, HEIGHT_PX / 2, 0.0, 0.0, 1.0),
    )  # fmt: skip


def mount_quaternion() -> streams.Quaternion:
    """From optical axes to body axes: looking ahead, then pitched down by the tilt."""
    c, s = math.cos(TILT_RAD / 2), math.sin(TILT_RAD / 2)
    return streams.Quaternion(x=-(c + s) / 2, y=(c + s) / 2, z=(s - c) / 2, w=(c - s) / 2)


def mount(parent: str = f"{NAME}/base_level") -> streams.TFMessage:
    header = streams.Header(streams.Time(), parent)
    return streams.TFMessage(
        (
            streams.TransformStamped(
                header, f"{NAME}/camera_front_optical", streams.Transform(rotation=mount_quaternion())
            ),
        )
    )


def pixel_of(east_m: float, north_m: float, up_m: float, vehicle: Multicopter) -> tuple[float, float] | None:
    """The pixel of a place in the image of a level camera; deliberately independent of the agent's model."""
    de, dn, du = east_m - vehicle.east_m, north_m - vehicle.north_m, up_m - vehicle.height_m
    forward = de * math.sin(vehicle.yaw_rad) + dn * math.cos(vehicle.yaw_rad)
    right = de * math.cos(vehicle.yaw_rad) - dn * math.sin(vehicle.yaw_rad)
    depth = forward * math.cos(TILT_RAD) - du * math.sin(TILT_RAD)
    down = -forward * math.sin(TILT_RAD) - du * math.cos(TILT_RAD)
    if depth <= 1.0:
        return None
    u, v = WIDTH_PX / 2 + FOCAL_PX * right / depth, HEIGHT_PX / 2 + FOCAL_PX * down / depth
    return (u, v) if 0 <= u < WIDTH_PX and 0 <= v < HEIGHT_PX else None


@dataclass(slots=True)
class Actor:
    label: str
    east_m: float
    north_m: float
    leaves_s: float = math.inf  # the actor disappears at this time


class Multicopter:
    """Flies straight to its setpoints with bounded speed; modes, acknowledgements and refusals follow PX4."""

    def __init__(self, east_m: float = 0.0, north_m: float = 0.0) -> None:
        self.east_m, self.north_m, self.height_m, self.yaw_rad = east_m, north_m, 0.0, 0.0
        self.home = (east_m, north_m)
        self.armed, self.mode, self.battery, self.mute = False, HOLD, 100, False
        self.refuse_offboard = False
        self.gps, self.failsafe = True, False
        self.position_error_m = (0.0, 0.0)  # of the position that it states and steers by, east and north
        self.speed_mps = 0.0
        self.time_s = 0.0
        self.peak_m = 0.0
        self.commands: list[int] = []
        self.sent: dict[int, int] = {}
        self._velocity = [0.0, 0.0]
        self._setpoint: tuple[float, float, float, float] | None = None
        self._feedforward_mps = (0.0, 0.0)
        self._setpoint_s = -9.0
        self._rates = dict(DEFAULT_HZ)
        self._due = dict.fromkeys(DEFAULT_HZ, 0.0)
        self._heartbeat_s = 0.0
        self._limit_mps = 12.0
        self._landed_s: float | None = None
        self._outbox: list[bytes] = []
        self._mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._parser = mavlink.MAVLink(None)

    @property
    def last_setpoint_s(self) -> float:
        """When the latest setpoint came."""
        return self._setpoint_s

    # What the agent sends.

    def send(self, frame: bytes) -> bool:
        message = self._parser.decode(bytearray(frame))
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            self.commands.append(message.command)
            self._command(message)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            assert message.type_mask == POSITION_VELOCITY_AND_YAW
            self._setpoint = (message.y + self.home[0], message.x + self.home[1], -message.z, message.yaw)
            self._feedforward_mps = (message.vy, message.vx)
            self._setpoint_s = self.time_s
        elif kind == "PARAM_SET" and message.param_id == "MPC_XY_VEL_MAX":
            self._limit_mps = message.param_value
        return True

    def _command(self, message: mavlink.MAVLink_command_long_message) -> None:
        command, result = message.command, mavlink.MAV_RESULT_ACCEPTED
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            stream = int(message.param1)
            self._rates[stream] = 0.0 if message.param2 < 0 else 1e6 / message.param2
            self._due.setdefault(stream, self.time_s)
        elif command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = self.time_s >= 4.2
            result = result if self.armed else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        elif command == mavlink.MAV_CMD_NAV_TAKEOFF:
            self.mode = TAKEOFF
            self._takeoff_m = message.param7 - ORIGIN.altitude_m
        elif command == mavlink.MAV_CMD_DO_SET_MODE:
            self._ack(command, result)  # PX4 first acknowledges every mode change as accepted
            mode = (int(message.param2), int(message.param3))
            if mode == OFFBOARD and (self.refuse_offboard or self.time_s - self._setpoint_s > 1.0):
                result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            else:
                self.mode = mode
        self._ack(command, result)

    def _ack(self, command: int, result: int) -> None:
        self._post(mavlink.MAVLink_command_ack_message(command, result))

    # How it moves.

    def step(self, span_s: float) -> None:
        self.time_s = round(self.time_s + span_s, 9)
        if self.armed:
            if self.mode == OFFBOARD and self.time_s - self._setpoint_s > 1.0:
                self.mode = RTL
            self._move(span_s)
        self.peak_m = max(self.peak_m, self.height_m)

    def _move(self, span_s: float) -> None:
        previous = self.east_m, self.north_m
        self._go(span_s)
        self.speed_mps = math.dist(previous, (self.east_m, self.north_m)) / span_s

    def _go(self, span_s: float) -> None:
        if self.mode == OFFBOARD and self._setpoint:
            east_m, north_m, height_m, yaw_rad = self._setpoint
            off_east_m, off_north_m = self.position_error_m
            self._fly_to(east_m - off_east_m, north_m - off_north_m, height_m, yaw_rad, span_s)
        elif self.mode == TAKEOFF:
            self.height_m = min(self.height_m + 1.5 * span_s, self._takeoff_m)
        elif self.mode == RTL and math.dist((self.east_m, self.north_m), self.home) > 1.0:
            self._fly_to(*self.home, max(self.height_m, 20.0), self.yaw_rad, span_s)
        elif self.mode in (RTL, LAND):
            self._velocity = [0.0, 0.0]
            self.height_m = max(0.0, self.height_m - (1.5 if self.height_m > 10.0 else 0.7) * span_s)
            if self.height_m == 0.0:
                self._landed_s = self.time_s if self._landed_s is None else self._landed_s
                if self.time_s - self._landed_s >= 2.0:
                    self.armed, self.mode = False, HOLD
        else:
            self._velocity = [0.0, 0.0]

    def _fly_to(self, east_m: float, north_m: float, height_m: float, yaw_rad: float, span_s: float) -> None:
        away = (east_m - self.east_m, north_m - self.north_m)
        distance = math.hypot(*away)
        speed = min(self._limit_mps, 0.95 * distance)
        target = [speed * component / distance if distance > 1e-6 else 0.0 for component in away]
        if self.mode == OFFBOARD:
            target = [w + f for w, f in zip(target, self._feedforward_mps, strict=True)]
            excess = max(1.0, math.hypot(*target) / self._limit_mps)
            target = [w / excess for w in target]
        change = [w - v for w, v in zip(target, self._velocity, strict=True)]
        size = math.hypot(*change)
        scale = min(1.0, 4.0 * span_s / size) if size > 0 else 0.0
        self._velocity = [v + scale * c for v, c in zip(self._velocity, change, strict=True)]
        self.east_m += self._velocity[0] * span_s
        self.north_m += self._velocity[1] * span_s
        self.height_m += max(-1.5 * span_s, min(3.0 * span_s, height_m - self.height_m))
        turn = math.remainder(yaw_rad - self.yaw_rad, 2.0 * math.pi)
        self.yaw_rad += max(-1.2 * span_s, min(1.2 * span_s, turn))

    # What it says.

    def frames(self) -> tuple[MavlinkFrame, ...]:
        if self.mute:
            return ()
        now_ms = round(self.time_s * 1000)
        if self.time_s >= self._heartbeat_s:
            self._heartbeat_s += 1.0
            custom = self.mode[1] << 24 | self.mode[0] << 16
            state = mavlink.MAV_STATE_CRITICAL if self.failsafe else mavlink.MAV_STATE_ACTIVE
            self._post(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_QUADROTOR,
                    mavlink.MAV_AUTOPILOT_PX4,
                    ARMED_MODE if self.armed else DISARMED_MODE,
                    custom,
                    state if self.armed else mavlink.MAV_STATE_STANDBY,
                    3,
                )
            )
        makers: dict[int, Callable[[], mavlink.MAVLink_message]] = {
            mavlink.MAVLINK_MSG_ID_ATTITUDE: lambda: mavlink.MAVLink_attitude_message(now_ms, 0.1, -0.2, self.yaw_rad, 0, 0, 0),
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: lambda: mavlink.MAVLink_local_position_ned_message(
                now_ms, self.north_m + self.position_error_m[1] - self.home[1],
                self.east_m + self.position_error_m[0] - self.home[0], -self.height_m,
                self._velocity[1], self._velocity[0], 0.0,
            ),
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: lambda: mavlink.MAVLink_sys_status_message(
                GPS, GPS, GPS * self.gps + (mavlink.MAV_SYS_STATUS_PREARM_CHECK if self.time_s > 4.2 else 0), 100, 16200, -100, self.battery, 0, 0, 0, 0, 0, 0
            ),
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda: mavlink.MAVLink_extended_sys_state_message(
                0, mavlink.MAV_LANDED_STATE_IN_AIR if self.height_m > 0.1 else mavlink.MAV_LANDED_STATE_ON_GROUND
            ),
            mavlink.MAVLINK_MSG_ID_VFR_HUD: lambda: mavlink.MAVLink_vfr_hud_message(0, 0, 0, 0, 0, 0),
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: lambda: mavlink.MAVLink_highres_imu_message(0, *(0.0,) * 13, 0),
        }  # fmt: skip
        for stream, make in makers.items():
            if self._rates[stream] > 0.0 and self.time_s >= self._due[stream] - 1e-9:
                self._due[stream] = self.time_s + 1.0 / self._rates[stream]
                self._post(make())
        out, self._outbox = self._outbox, []
        return tuple(MavlinkFrame(int.from_bytes(f[7:10], "little"), f[5], f[6], f) for f in out)

    def _global(self) -> mavlink.MAVLink_message:
        latitude = ORIGIN.latitude_deg + self.north_m / METRES_PER_DEGREE
        longitude = ORIGIN.longitude_deg + self.east_m / METRES_PER_DEGREE / math.cos(
            math.radians(ORIGIN.latitude_deg)
        )
        return mavlink.MAVLink_global_position_int_message(
            round(self.time_s * 1000), round(latitude * 1e7), round(longitude * 1e7),
            round((ORIGIN.altitude_m + self.height_m) * 1000), round(self.height_m * 1000), 0, 0, 0, 0,
        )  # fmt: skip

    def _post(self, message: mavlink.MAVLink_message) -> None:
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        self.sent[message.get_msgId()] = self.sent.get(message.get_msgId(), 0) + 1
        self._outbox.append(frame)


@dataclass(frozen=True, slots=True)
class FakeSample:
    """A sample whose message is at hand."""

    topic: str
    published: object

    def message(self) -> object:
        return self.published


@cache
def grey_jpeg() -> bytes:
    """A small picture of nothing."""
    # Most worlds have no pictures, and need no OpenCV.
    from bench.camera import encode_jpeg

    return encode_jpeg(np.full((8, 8, 3), 128, np.uint8))


def mission_order(**changes: object) -> MissionOrder:
    corners = tuple(
        contracts.Point(east_m=e, north_m=n) for e, n in ((-300, -300), (300, -300), (300, 300), (-300, 300))
    )
    document: dict[str, object] = {
        "kind": "search_and_report", "origin": ORIGIN, "area": corners, "home": contracts.Point(east_m=0, north_m=0),
        "altitude_m": 60.0, "speed_mps": 12.0, "time_limit_s": 300.0, "return_home": True, "no_mark_within_m": 50.0,
        "min_report_confidence": 0.6, "max_altitude_m": 120.0,
        "target_classes": ("mobile_radar", "military_vehicle"), "bystander_classes": ("civilian",),
    }  # fmt: skip
    return valid(MissionOrder, document | changes)


def intelligence(
    name: str, label: str, east_m: float, north_m: float, priority: int = 1, **changes: float
) -> contracts.IntelligenceDocument:
    details = {"uncertainty_m": 60.0, "observed_s": -20.0} | changes
    document = {"id": name, "class_label": label, "east_m": east_m, "north_m": north_m, "priority": priority}
    return valid(contracts.IntelligenceDocument, document | details)


def order_document(name: str, kind: str, intelligence_id: str | None = None) -> contracts.OrderDocument:
    document = {"id": name, "kind": kind, "issued_s": 0.0, "within_s": 10.0}
    return valid(contracts.OrderDocument, document | {"intelligence_id": intelligence_id})


RADAR, TRUCK = Actor("mobile_radar", 130.0, 70.0), Actor("military_vehicle", -60.0, 120.0)
NEAR_RADAR = Actor("civilian", 140.0, 90.0)
BOTH = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0),
    intelligence("bravo", "military_vehicle", -80.0, 110.0, 2),
)
"""What is told of the radar and the truck."""


@cache
def _phase_of(status: str) -> str:
    """It is asked for in every step, and stated once a second."""
    return valid(contracts.AgentStatus, status).phase


@dataclass(slots=True)
class World:
    """Runs an agent through a mission without a network and records what it publishes, and where the vehicle is."""

    actors: list[Actor]
    reports_at: dict[float, contracts.IntelligenceDocument | tuple[contracts.IntelligenceDocument, ...]]
    orders_at: dict[float, contracts.OrderDocument] = field(default_factory=dict)
    consents: Mapping[str, tuple[bool, float]] = field(default_factory=dict)  # granted, after how long
    link_down: tuple[float, float] | None = None  # from, until
    blind: tuple[float, float] | None = None
    mission: MissionOrder | None = field(default_factory=mission_order)
    score: float = 0.9
    # With a detector the agent gets pictures, all of them grey, and no detections.
    open_detector: Callable[[World], contracts.PixelDetector] | None = None
    vehicle: Multicopter = field(default_factory=Multicopter)
    published: list[tuple[str, str]] = field(default_factory=list)
    each_step: Callable[[World], None] = lambda world: None
    # By the time in tenths of a second: east, north and height, and the speed over ground.
    at: dict[float, tuple[float, float, float]] = field(default_factory=dict)
    speed_mps: dict[float, float] = field(default_factory=dict)
    # What is published, by the last part of the topic: phase and requests for consent are looked at in every step.
    _texts: defaultdict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def _publish(self, topic: str, text: str) -> None:
        self.published.append((topic, text))
        self._texts[topic.rpartition("/")[2]].append(text)

    def fly(self, policy: PolicyName, until_s: float = 320.0, **options: float) -> World:
        vehicle, settings = self.vehicle, Settings.of(options, policy)
        detector = self.open_detector(self) if self.open_detector is not None else None
        agent = Agent(NAME, AgentParts.of(NAME, vehicle, self._publish, policy, settings, detector))
        number = 0
        while vehicle.time_s < until_s and self.phase not in ("complete", "aborted"):
            now = SimTime(round(vehicle.time_s * 1e9))
            agent.act(Moment(now, tuple(self._samples(number)), {"onboard": vehicle.frames()}))  # type: ignore[arg-type]
            for _ in range(5):
                vehicle.step(STEP_S / 5)
            time_s = round(vehicle.time_s, 1)
            self.at[time_s] = vehicle.east_m, vehicle.north_m, vehicle.height_m
            self.speed_mps[time_s] = vehicle.speed_mps
            self.each_step(self)
            number += 1
        return self

    def _samples(self, number: int) -> Iterator[FakeSample]:
        topics, now_s = VehicleTopics(NAME), self.vehicle.time_s

        def sample(topic: str, document: Any) -> FakeSample:
            return FakeSample(topic, streams.String(document_text(document)))

        def is_due(at_s: float) -> bool:
            return abs(at_s - now_s) < STEP_S / 2

        if number == 0:
            yield FakeSample(contracts.TF_STATIC, mount())
            yield FakeSample(topics.camera_info("front"), camera_info())
            if self.mission is not None:
                yield sample(topics.mission, self.mission)
        for due_s in filter(is_due, sorted(self.reports_at)):
            reports = self.reports_at[due_s]
            for report in reports if isinstance(reports, tuple) else (reports,):
                yield sample(topics.intelligence, report)
        for due_s in filter(is_due, sorted(self.orders_at)):
            yield sample(topics.orders, self.orders_at[due_s])
        for request in self.consent_requests:
            granted, after_s = self.consents.get(request.intelligence_id, (False, math.inf))
            if is_due(request.time_s + after_s):
                yield sample(topics.consents, contracts.ConsentAnswer(request.id, granted, now_s))
        for due_s, up in ((0.0, True), *zip(self.link_down or (), (False, True), strict=False)):
            if is_due(due_s):
                yield sample(topics.operator_link, contracts.OperatorLinkDocument(up=up))
        blind = self.blind is not None and self.blind[0] <= now_s < self.blind[1]
        if number % 2 == 0 and not blind:
            frame = self.frame()
            if self.open_detector is None:
                yield FakeSample(topics.detections, frame)
            else:
                picture = streams.CompressedImage(frame.header, "bgr8; jpeg compressed bgr8", grey_jpeg())
                yield FakeSample(topics.image_compressed("front"), picture)

    def frame(self) -> streams.Detection2DArray:
        """What the camera shows now."""
        header = streams.Header(streams.Time.of(round(self.vehicle.time_s * 1e9)), "optical")
        detections = []
        for actor in self.actors:
            pixel = pixel_of(actor.east_m, actor.north_m, 0.9, self.vehicle)
            if pixel is not None and self.vehicle.time_s < actor.leaves_s:
                best = streams.ObjectHypothesisWithPose(streams.ObjectHypothesis(actor.label, self.score))
                box = streams.BoundingBox2D(streams.Pose2D(streams.Point2D(*pixel)), 20.0, 30.0)
                detections.append(streams.Detection2D(header, (best,), box))
        return streams.Detection2DArray(header, tuple(detections))

    @property
    def phases(self) -> list[str]:
        """The phases in order, without repeats of the same phase."""
        return [phase for phase, _ in groupby(self._said("status", contracts.AgentStatus), lambda s: s.phase)]

    @property
    def phase(self) -> str:
        texts = self._texts["status"]
        return _phase_of(texts[-1]) if texts else ""

    @property
    def home_m(self) -> float:
        """How far the vehicle is from home, which lies at the origin."""
        return math.hypot(self.vehicle.east_m, self.vehicle.north_m)

    @property
    def reports(self) -> list[contracts.TargetReport]:
        return self._said("reports", contracts.TargetReport)

    @property
    def reported(self) -> list[str | None]:
        """What the reports are about."""
        return [report.intelligence_id for report in self.reports]

    @property
    def decisions(self) -> list[contracts.Decision]:
        return self._said("decisions", contracts.Decision)

    @property
    def answers(self) -> list[contracts.OrderAnswer]:
        return self._said("answers", contracts.OrderAnswer)

    @property
    def consent_requests(self) -> list[contracts.ConsentRequest]:
        return self._said("consent_requests", contracts.ConsentRequest)

    @property
    def tracks(self) -> contracts.AgentTracks:
        return self._said("tracks", contracts.AgentTracks)[-1]

    def decisions_to(self, action: str, subject: str | None = None) -> list[contracts.Decision]:
        return [d for d in self.decisions if d.action == action and subject in (None, d.subject)]

    def _said(self, topic: str, kind: type[Document]) -> list[Document]:
        return [valid(kind, text) for text in self._texts[topic]]


def world(*actors: Actor, **changes: Any) -> World:
    """The radar and the truck, told of before the flight; other actors in their place if given."""
    return World(list(actors or (RADAR, TRUCK)), {0.0: BOTH}, **changes)


def changing(from_s: float, **state: Any) -> Callable[[World], None]:
    """For `each_step`: from a moment on the vehicle has such a state."""

    def step(now: World) -> None:
        if now.vehicle.time_s > from_s:
            for name, value in state.items():
                setattr(now.vehicle, name, value)

    return step
