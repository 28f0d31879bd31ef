"""ArduPilot's topics and services as a companion sees them over ROS 2 (`/ap/...`): another face of the services that speak
MAVLink.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.contracts import CompanionSample, Vector

from ..links._enums import MAV_CMD, MAV_FRAME
from ..links._frames import KINDS
from ..links._radio import Channel
from ..policies import Autopilot
from ..services._commands import Commands
from ..services._manual_control import ManualControl
from ..services._modes import Modes
from ..services._setpoints import Setpoints
from ..state._flight_state import Behaviour
from ..state._service import Command, CommandResult, MessageSender
from ..state._service_context import ServiceContext
from ..telemetry._attitude import quaternion, turned_to_ned
from ..telemetry._battery_monitor import BatteryMonitor
from . import _topic_fields as fields_of

_Sample = Mapping[str, Any]

_BODY, _EARTH = "base_link", "map"
# Of GlobalPosition: the altitude frames that are flown, and the mask's bits that leave out the position.
_ALTITUDE_FRAMES = (
    MAV_FRAME.GLOBAL_INT,
    MAV_FRAME.GLOBAL_RELATIVE_ALT_INT,
    MAV_FRAME.GLOBAL_TERRAIN_ALT_INT,
)
_NO_POSITION = 7
# POSITION_TARGET_TYPEMASK: velocity with a rate of yaw, velocity alone, position alone.
_VELOCITY_AND_TURN, _VELOCITY, _POSITION = 0x5C7, 0xDC7, 0xDF8
_LEAST_AXES, _MOST_AXES = 4, 8
_RADIO_CENTRE_US, _RADIO_TRAVEL_US, _RELEASE_US = 1500, 500, 0
# How often a second a topic is said at most, as AP_DDS_config.h; a step says it once.
_TABLE = json.loads(Path(__file__).with_name("topics.json").read_text("utf-8"))


class _Results(Channel):
    """Keeps the result of the last command, for the answer of a service."""

    def __init__(self) -> None:
        self.result: int | None = None

    def send_message(self, name: str, **fields: Any) -> None:
        assert name == "COMMAND_ACK", name
        self.result = fields["result"]


@dataclass(eq=False)
class ApTopics:
    """`inbox` holds what the companion has published and asked, and no step has taken."""

    _context: ServiceContext
    _autopilot: Autopilot
    _system: int
    _modes: Modes
    _setpoints: Setpoints
    _commands: Commands
    _battery: BatteryMonitor
    _sticks: ManualControl
    inbox: list[CompanionSample] = field(default_factory=list)
    _published: list[CompanionSample] = field(default_factory=list)
    _told: dict[str, tuple[Any, int]] = field(default_factory=dict)  # what a topic said last, and when

    def __post_init__(self) -> None:
        self._flight = self._context.flight
        self._results = _Results()
        self._sender = MessageSender(0, 0, self._results)
        setpoint_handlers = self._setpoints.handlers()
        self._take_local = setpoint_handlers["SET_POSITION_TARGET_LOCAL_NED"]
        self._take_global = setpoint_handlers["SET_POSITION_TARGET_GLOBAL_INT"]
        self._services: Mapping[str, Callable[[_Sample], _Sample]] = {
            "/ap/prearm_check": self._check_before_arming,
            "/ap/mode_switch": self._switch_mode,
            "/ap/arm_motors": lambda m: {"result": self._run(MAV_CMD.COMPONENT_ARM_DISARM, float(m["arm"]))},
            "/ap/experimental/takeoff": lambda m: {
                "status": self._run(MAV_CMD.NAV_TAKEOFF, *(0.0,) * 6, m["alt"])
            },
        }
        self._topics: Mapping[str, Callable[[_Sample], bool]] = {
            "/ap/cmd_vel": self._take_velocity,
            "/ap/cmd_gps_pose": self._take_position,
            "/ap/joy": self._take_joystick,
        }

    def continue_from(self, previous: ApTopics) -> None:
        """Handle and publish what the previous one has not before a restart: every request has one answer, or answers would
        reach others that wait.
        """
        self.inbox, self._published = previous.inbox, previous._published

    def handle(self) -> None:
        """Act on the inbox, and answer every request in it."""
        samples, self.inbox = self.inbox, []
        for topic, sample in samples:
            if answer := self._services.get(topic):
                self._published.append((topic, answer(sample)))
            elif not self._topics[topic](sample):
                self._setpoints.ignored += 1

    def take_published(self) -> list[CompanionSample]:
        """What was published since the last call."""
        published, self._published = self._published, []
        return published

    def publish(self) -> None:
        """Publish what is due at the present moment."""
        context, flight = self._context, self._flight
        force_mps2 = context.airframe.specific_force_mps2()
        quantities = {
            **fields_of.quantities_of(flight),
            **fields_of.fix_of(flight, self._autopilot.telemetry.gps_quality),
            **fields_of.battery_of(flight, self._battery.volts(), context.parameters["BATT_CAPACITY"]),
            **fields_of.goal_of(flight, context.frame),
            **dict(zip(("force_x", "force_y", "force_z"), force_mps2, strict=True)),
        }
        for topic, row in _TABLE.items():
            if self._is_due(topic, row, quantities):
                self._published.append((topic, fields_of.filled(row["fields"], quantities)))

    # From the companion. A request gives its answer; a sample that could not be used gives False.

    def _check_before_arming(self, m: _Sample) -> _Sample:
        armable = not self._autopilot.modes.prearm_failures(self._flight, self._context.parameters)
        return {"success": armable, "message": "Vehicle is Armable" if armable else "Vehicle is Not Armable"}

    def _switch_mode(self, m: _Sample) -> _Sample:
        refusal = self._modes.request(m["mode"])
        return {"status": refusal is None, "curr_mode": self._flight.mode.custom}

    def _run(self, number: int, *params: float) -> bool:
        """Carry out a command of MAVLink; whether it was accepted."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        self._results.result = None
        self._commands.run(Command(number, padded, None, self._sender))
        return self._results.result == CommandResult.ACCEPTED

    def _take_velocity(self, m: _Sample) -> bool:
        frame, linear = m["header"].frame_id, m["twist"].linear
        yawrate_radps = -m["twist"].angular.z
        velocity: Vector
        if frame == _BODY:
            velocity = turned_to_ned(quaternion(self._flight), (linear.x, -linear.y, -linear.z))
        else:
            velocity = linear.y, linear.x, -linear.z
        # Of a fixed wing alone: NaN in y and z makes x an airspeed.
        if frame not in (_BODY, _EARTH) or not self._is_guided() or not all(map(math.isfinite, velocity)):
            return False
        if math.isinf(yawrate_radps):
            return False
        mask = _VELOCITY if math.isnan(yawrate_radps) else _VELOCITY_AND_TURN
        values = (MAV_FRAME.LOCAL_NED, mask, *(0.0,) * 3, *velocity, *(0.0,) * 4, yawrate_radps)
        self._take_local(self._message("SET_POSITION_TARGET_LOCAL_NED", *values), self._sender)
        return True

    def _take_position(self, m: _Sample) -> bool:
        place = m["latitude"], m["longitude"], m["altitude"]
        if m["header"].frame_id != _EARTH or m["coordinate_frame"] not in _ALTITUDE_FRAMES:
            return False
        if m["type_mask"] & _NO_POSITION or not self._is_guided() or not all(map(math.isfinite, place)):
            return False
        latitude, longitude, altitude_m = place
        if abs(latitude) > 90.0 or abs(longitude) > 180.0:
            return False
        values = (m["coordinate_frame"], _POSITION, round(latitude * 1e7), round(longitude * 1e7), altitude_m)
        message = self._message("SET_POSITION_TARGET_GLOBAL_INT", *values, *(0.0,) * 8)
        self._take_global(message, self._sender)
        return True

    def _take_joystick(self, m: _Sample) -> bool:
        axes = m["axes"][:_MOST_AXES]
        if len(axes) < _LEAST_AXES:
            return False
        self._sticks.override(
            _RELEASE_US
            if math.isnan(axis)
            else round(_RADIO_CENTRE_US + _RADIO_TRAVEL_US * min(max(axis, -1.0), 1.0))
            for axis in axes
        )
        return True

    def _is_guided(self) -> bool:
        return self._flight.armed and self._flight.mode.behaviour is Behaviour.OFFBOARD

    def _message(self, name: str, *values: float) -> Any:
        """A setpoint as MAVLink has it, for this vehicle, from `coordinate_frame` on."""
        return KINDS[name](self._flight.time_ms, self._system, 1, *values)

    def _is_due(self, topic: str, row: Mapping[str, Any], quantities: _Sample) -> bool:
        """Whether a period of the topic begins; and where the table says `on`, with other values than last, or with the same
        when they were last said so long ago.
        """
        now_ns, rate_hz = self._flight.time_ns, row["hz"]
        before_ns = now_ns - round(self._flight.step_s * 1e9)
        if now_ns * rate_hz // 1_000_000_000 == before_ns * rate_hz // 1_000_000_000:
            return False
        if "on" not in row:
            return True
        state = tuple(quantities[name] for name in row["on"])
        said, said_ns = self._told.get(topic, ((), 0))
        repeats = "repeats_s" in row and now_ns - said_ns >= row["repeats_s"] * 1e9
        if None in state or (state == said and not repeats):
            return False
        self._told[topic] = state, now_ns
        return True
