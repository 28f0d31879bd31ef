"""PX4's topics as a companion sees them over ROS 2 (`/fmu/...`): another face of the services that speak MAVLink."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.contracts import CompanionSample

from ..links._enums import MAV_CMD, MAV_TYPE
from ..links._radio import Channel
from ..policies import Autopilot
from ..services._commands import Commands
from ..services._modes import Modes
from ..services._setpoints import Setpoints
from ..state._flight_state import Behaviour, FlightMode
from ..state._service import Command, CommandResult, MessageSender
from ..state._service_context import ServiceContext
from ..telemetry._attitude import quaternion
from ..telemetry._battery_monitor import BatteryMonitor
from . import _topic_fields as fields_of
from ._external_modes import ExternalModes
from ._modes import MODES, NAV_STATES

_Sample = Mapping[str, Any]

# Flags of OffboardControlMode: the first that is set is the level, and decides which setpoint is flown. Thrust, torque and
# actuators are not flown here, so they are no sign of life.
_LEVELS = (
    "position",
    "velocity",
    "acceleration",
    "attitude",
    "body_rate",
    "thrust_and_torque",
    "direct_actuator",
)
_TRAJECTORY_LEVELS, _FLOWN_LEVELS = _LEVELS[:3], _LEVELS[:5]
_GOTO_LIMITS = ("horizontal_speed", "vertical_speed", "heading_rate")
_LANDING, _TAKEOFF = (Behaviour.LAND, Behaviour.RETURN), NAV_STATES["AUTO_TAKEOFF"]
# Of VehicleCommand alone: param1 is a nav_state.
_SET_NAV_STATE = 100001
# Those that PX4's commander and navigator take; the others that are carried out belong to its MAVLink.
_COMMANDS = frozenset(
    (
        *(MAV_CMD.NAV_RETURN_TO_LAUNCH, MAV_CMD.NAV_LAND, MAV_CMD.NAV_TAKEOFF, MAV_CMD.DO_ORBIT),
        *(MAV_CMD.DO_SET_MODE, MAV_CMD.DO_CHANGE_SPEED, MAV_CMD.DO_SET_HOME, MAV_CMD.DO_FLIGHTTERMINATION),
        *(MAV_CMD.DO_CHANGE_ALTITUDE, MAV_CMD.DO_REPOSITION, MAV_CMD.DO_SET_ROI_LOCATION, MAV_CMD.DO_SET_ROI),
        *(MAV_CMD.DO_SET_ROI_NONE, MAV_CMD.MISSION_START, MAV_CMD.COMPONENT_ARM_DISARM),
        MAV_CMD.RUN_PREARM_CHECKS,
    )
)
# Commander says at least so often what has not changed (source); the land detector and, over uXRCE-DDS, the battery
# once a second.
_STATUS_NS, _SLOW_NS = 500_000_000, 1_000_000_000
_CUSTOM_BY_NAV_STATE = {NAV_STATES[mode.name]: mode.custom for mode in MODES.modes}


class _Acknowledgements(Channel):
    """Where answers to a VehicleCommand go; none of `_COMMANDS` answers with anything else."""

    def __init__(self, publish: Callable[[str, _Sample], None]) -> None:
        self._publish = publish

    def send_message(self, name: str, **fields: Any) -> None:
        assert name == "COMMAND_ACK", name
        self._publish("vehicle_command_ack", fields)


@dataclass(eq=False)
class Px4Topics:
    """`inbox` holds what the companion has published and no step has taken."""

    _context: ServiceContext
    _autopilot: Autopilot
    _system: int
    _modes: Modes
    _setpoints: Setpoints
    _commands: Commands
    _battery: BatteryMonitor
    _charge_state: Callable[[], int]
    inbox: list[CompanionSample] = field(default_factory=list)
    _published: list[CompanionSample] = field(default_factory=list)
    _told: dict[str, tuple[_Sample, int]] = field(default_factory=dict)  # what a topic said last, and when
    _level: str = _LEVELS[0]
    _fix: int = 0
    _mode: FlightMode | None = None
    _mode_us: int = 0
    _armed_us: int = 0
    _takeoff_us: int = 0
    _flew: bool = False

    def __post_init__(self) -> None:
        self._flight = self._context.flight
        self._channel = _Acknowledgements(self._publish)
        self._wing = self._autopilot.identity.vehicle_type == MAV_TYPE.FIXED_WING
        self._external = ExternalModes(self._context, self._modes, self._wing, self._publish)
        self._modes.on_taken_off.append(lambda: self._complete(_TAKEOFF))
        self._handlers: Mapping[str, Callable[[_Sample], bool]] = {
            "/fmu/in/offboard_control_mode": self._take_level,
            "/fmu/in/trajectory_setpoint": self._take_trajectory,
            "/fmu/in/vehicle_attitude_setpoint": self._take_attitude,
            "/fmu/in/vehicle_rates_setpoint": self._take_rates,
            "/fmu/in/goto_setpoint": self._take_goto,
            "/fmu/in/mode_completed": self._take_completed,
            "/fmu/in/vehicle_command": self._take_command,
            **self._external.handlers(),
        }

    def handle(self) -> None:
        """Act on the inbox."""
        samples, self.inbox = self.inbox, []
        for topic, sample in samples:
            if not self._handlers[topic](sample):
                self._setpoints.ignored += 1
        self._external.tick()

    def take_published(self) -> list[CompanionSample]:
        """What was published since the last call."""
        published, self._published = self._published, []
        return published

    def publish(self) -> None:
        """Publish what is due at the present moment."""
        flight, telemetry = self._flight, self._autopilot.telemetry
        body, force_mps2 = quaternion(flight), self._context.airframe.specific_force_mps2()
        # MAV_BATTERY_CHARGE_STATE begins one higher than BatteryStatus.warning.
        warning = max(self._charge_state() - 1, 0)
        alive = self._setpoints.fresh()
        if self._flew and flight.armed and not flight.flying and flight.mode.behaviour in _LANDING:
            self._complete(NAV_STATES[flight.mode.name])
        self._flew = flight.flying
        self._publish_state("vehicle_status", _STATUS_NS, self._status(alive))
        shown = fields_of.control_mode(flight, self._controlled, self._wing)
        self._publish_state("vehicle_control_mode", _STATUS_NS, shown)
        flags = fields_of.failsafe_flags(flight, alive, warning, self._external.requirements())
        self._publish_state("failsafe_flags", _STATUS_NS, flags)
        self._publish_state("vehicle_land_detected", _SLOW_NS, fields_of.land_detected(flight))
        self._publish("vehicle_attitude", fields_of.attitude(body))
        self._publish("vehicle_local_position", fields_of.local_position(flight, body, force_mps2))
        self._publish("vehicle_odometry", fields_of.odometry(flight, body))
        if flight.home is not None:
            self._publish("vehicle_global_position", fields_of.global_position(flight))
            self._publish_state("home_position", None, fields_of.home_position(flight.home))
        self._publish("sensor_combined", fields_of.sensor_combined(flight, force_mps2))
        if flight.gps_epoch != self._fix:
            self._fix = flight.gps_epoch
            fix = fields_of.gps_position(flight, telemetry.gps_quality, telemetry.lost_fix_type)
            self._publish("vehicle_gps_position", fix)
        if flight.time_ns % _SLOW_NS < round(flight.step_s * 1e9):
            volts, used_mah = self._battery.volts(), self._battery.used_mah()
            self._publish("battery_status", fields_of.battery_status(flight, volts, used_mah, warning))

    # From the companion. False: the sample could not be used.

    def _take_level(self, m: _Sample) -> bool:
        level = next((level for level in _LEVELS if m[level]), "")
        # One that cannot be controlled ends the offboard mode at once, as one without a flag does (source).
        self._setpoints.keep_alive(level in _FLOWN_LEVELS)
        self._level = level or self._level
        return level in _FLOWN_LEVELS

    def _take_trajectory(self, m: _Sample) -> bool:
        vectors = m["position"], m["velocity"], m["acceleration"]
        return self._controlled in _TRAJECTORY_LEVELS and self._setpoints.take_trajectory(
            *vectors, m["yaw"], m["yawspeed"]
        )

    def _take_attitude(self, m: _Sample) -> bool:
        rate = m["yaw_sp_move_rate"]
        return self._controlled == "attitude" and self._setpoints.take_attitude(
            m["q_d"], 0.0 if math.isnan(rate) else rate, -m["thrust_body"][2]
        )

    def _take_rates(self, m: _Sample) -> bool:
        return self._controlled == "body_rate" and self._setpoints.take_rates(
            (m["roll"], m["pitch"], m["yaw"]), -m["thrust_body"][2]
        )

    def _take_goto(self, m: _Sample) -> bool:
        most = [m[f"max_{name}"] if m[f"flag_set_max_{name}"] else math.inf for name in _GOTO_LIMITS]
        heading = m["heading"] if m["flag_control_heading"] else math.nan
        return self._controlled == "position" and self._setpoints.take_goto(m["position"], heading, *most)

    def _take_completed(self, m: _Sample) -> bool:
        """Inside PX4 it is one topic, so whoever waits for a mode hears of the companion's too."""
        self._complete(m["nav_state"], m["result"])
        return True

    def _take_command(self, m: _Sample) -> bool:
        if m["target_system"] in (0, self._system) and m["target_component"] in (0, 1):
            params = tuple(m[f"param{index}"] for index in range(1, 8))
            sender = MessageSender(m["source_system"], m["source_component"], self._channel)
            self._run(Command(m["command"], params, None, sender))
        return True

    def _run(self, command: Command) -> None:
        if command.number == _SET_NAV_STATE:
            result = self._set_nav_state(command.params[0])
        elif command.number in self._commands.carried_out() - _COMMANDS:
            result = CommandResult.UNSUPPORTED
        else:
            self._commands.run(command)
            return
        command.sender.answer("COMMAND_ACK", command=command.number, result=result)

    def _set_nav_state(self, nav_state: float) -> CommandResult:
        custom = _CUSTOM_BY_NAV_STATE.get(nav_state)  # type: ignore[call-overload]
        if custom is None:
            return CommandResult.DENIED
        refusal = self._modes.request(custom)
        return refusal.result or CommandResult.DENIED if refusal else CommandResult.ACCEPTED

    @property
    def _controlled(self) -> str:
        """The level at which the companion controls, in the mode that is flown."""
        return self._external.level if self._flight.mode.behaviour is Behaviour.EXTERNAL else self._level

    # To the companion.

    def _complete(self, nav_state: int, result: int = 0) -> None:
        self._publish("mode_completed", {"nav_state": nav_state, "result": result})

    def _publish(self, topic: str, fields: _Sample) -> None:
        stamps = dict.fromkeys(("timestamp", "timestamp_sample"), self._flight.time_us)
        self._published.append((f"/fmu/out/{topic}", {**stamps, **fields}))

    def _publish_state(self, topic: str, period_ns: int | None, fields: _Sample) -> None:
        """Publish what has changed, or was last said a period ago."""
        now_ns = self._flight.time_ns
        said, said_ns = self._told.get(topic, (None, 0))
        if fields != said or (period_ns is not None and now_ns - said_ns >= period_ns):
            self._told[topic] = fields, now_ns
            self._publish(topic, fields)

    def _status(self, alive: bool) -> _Sample:
        """VehicleStatus."""
        flight, policy, now_us = self._flight, self._autopilot.modes, self._flight.time_us
        mode = flight.mode
        if mode is not self._mode:
            self._mode, self._mode_us = mode, now_us
        self._armed_us = (self._armed_us or now_us) if flight.armed else 0
        self._takeoff_us = (self._takeoff_us or now_us) if flight.flying else 0
        refusal = policy.refuse_arming(flight, self._context.parameters, False, alive)
        return {
            "armed_time": self._armed_us,
            "takeoff_time": self._takeoff_us,
            "arming_state": 2 if flight.armed else 1,
            "nav_state_timestamp": self._mode_us,
            "nav_state_user_intention": NAV_STATES[(flight.asked_mode or mode).name],
            "nav_state": NAV_STATES[mode.name],
            "nav_state_display": NAV_STATES[mode.name],
            "accepts_offboard_setpoints": mode.behaviour is Behaviour.OFFBOARD,
            **fields_of.status_masks(flight),
            "vehicle_type": 2 if self._wing else 1,
            "failsafe": flight.failsafe is not None,
            "system_type": int(self._autopilot.identity.vehicle_type),
            "system_id": self._system,
            "component_id": 1,
            "power_input_valid": True,
            "pre_flight_checks_pass": refusal is None,
        }
