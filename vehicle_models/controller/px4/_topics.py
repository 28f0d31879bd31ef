"""PX4's topics as a companion sees them over ROS 2 (`/fmu/...`): another face of the services that speak MAVLink.

Fields bear the names of px4_msgs; which of them a release has is the session's to know. What is not here is zero: reset
counters, variances, and the reasons for arming, whose numbers differ between releases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from bench.contracts import Px4Sample, Vector

from ..links._enums import MAV_CMD, MAV_TYPE
from ..links._radio import Channel
from ..policies._autopilot import Autopilot
from ..services._commands import Commands
from ..services._modes import Modes
from ..services._setpoints import Setpoints
from ..state._flight_state import Behaviour, Cause, FlightMode, StickControl
from ..state._service import Command, CommandResult, MessageSender
from ..state._service_context import ServiceContext
from ..telemetry._attitude import BodyAttitude
from ..telemetry._battery_monitor import BatteryMonitor
from ._modes import MODES, NAV_STATES, knows_position

Fields = Mapping[str, Any]

# Flags of OffboardControlMode: the first that is set is the level, and decides which setpoint is flown.
_LEVELS = (
    *(
        "position",
        "velocity",
        "acceleration",
        "attitude",
        "body_rate",
        "thrust_and_torque",
        "direct_actuator",
    ),
)
_TRAJECTORY_LEVELS = _LEVELS[:3]
# Thrust, torque and actuators are not flown here, so they are no sign of life.
_FLOWN_LEVELS = _LEVELS[:5]
# Of VehicleCommand alone: param1 is a nav_state.
_SET_NAV_STATE = 100001
# Those that PX4's commander and navigator take; the others belong to its MAVLink.
_COMMANDS = frozenset(
    (
        *(
            MAV_CMD.NAV_RETURN_TO_LAUNCH,
            MAV_CMD.NAV_LAND,
            MAV_CMD.NAV_TAKEOFF,
            MAV_CMD.DO_ORBIT,
            MAV_CMD.DO_SET_MODE,
        ),
        *(
            MAV_CMD.DO_CHANGE_SPEED,
            MAV_CMD.DO_SET_HOME,
            MAV_CMD.DO_FLIGHTTERMINATION,
            MAV_CMD.DO_CHANGE_ALTITUDE,
        ),
        *(MAV_CMD.DO_REPOSITION, MAV_CMD.DO_SET_ROI_LOCATION, MAV_CMD.DO_SET_ROI, MAV_CMD.DO_SET_ROI_NONE),
        *(MAV_CMD.MISSION_START, MAV_CMD.COMPONENT_ARM_DISARM, MAV_CMD.RUN_PREARM_CHECKS),
    )
)
# Commander says at least this often what has not changed (source); the land detector once a second, the battery as
# uXRCE-DDS lets it through.
_STATUS_NS, _SLOW_NS = 500_000_000, 1_000_000_000
_GRAVITY_MPS2 = 9.80665
_NAN, _INFINITY = math.nan, math.inf
# As ESTIMATOR_STATUS over MAVLink.
_POSITION_SIGMA_M, _SPEED_SIGMA_MPS = 0.3, 0.1
_SIGMAS = {"eph": _POSITION_SIGMA_M, "epv": _POSITION_SIGMA_M}
# VehicleOdometry.POSE_FRAME_NED and VELOCITY_FRAME_NED
_NED = 1
_NO_TURN = (1.0, 0.0, 0.0, 0.0)


def _mask(holds: Callable[[FlightMode], bool]) -> int:
    """Bits of the nav_states of the modes for which something holds."""
    return sum(1 << NAV_STATES[mode.name] for mode in MODES.modes if holds(mode))


def _own(mode: FlightMode) -> bool:
    return not mode.name.startswith("EXTERNAL")


def _behaves(*behaviours: Behaviour) -> Callable[[FlightMode], bool]:
    return lambda mode: mode.behaviour in behaviours and _own(mode)


_OWN_MODES = _mask(_own)
_NEEDS_POSITION = _mask(lambda mode: mode.needs_position and _own(mode) and mode is not MODES.offboard)
# Which modes need what, as far as it follows from the table of modes.
_REQUIREMENTS = {
    "mode_req_angular_velocity": _OWN_MODES & ~_mask(_behaves(Behaviour.TERMINATE)),
    "mode_req_attitude": _mask(lambda mode: _own(mode) and mode.stick is not StickControl.RATES)
    & ~_mask(_behaves(Behaviour.TERMINATE)),
    "mode_req_local_alt": _NEEDS_POSITION
    | _mask(lambda mode: mode.stick in (StickControl.ALTITUDE, StickControl.POSITION)),
    "mode_req_local_position": _NEEDS_POSITION | _mask(lambda mode: mode.stick is StickControl.POSITION),
    "mode_req_global_position": _mask(_behaves(Behaviour.MISSION, Behaviour.RETURN)),
    "mode_req_mission": _mask(_behaves(Behaviour.MISSION)),
    "mode_req_offboard_signal": _mask(_behaves(Behaviour.OFFBOARD)),
    "mode_req_home_position": _mask(_behaves(Behaviour.RETURN)),
    "mode_req_prevent_arming": _mask(_behaves(Behaviour.RETURN, Behaviour.LAND, Behaviour.TERMINATE)),
    "mode_req_manual_control": _mask(_behaves(Behaviour.PILOT)),
}
_STATES = {
    "valid_nav_states_mask": _OWN_MODES,
    "can_set_nav_states_mask": _OWN_MODES & ~_mask(_behaves(Behaviour.TERMINATE)),
}
_BY_NAV_STATE = {NAV_STATES[mode.name]: mode.custom for mode in MODES.modes}


class _Acknowledgements(Channel):
    """Where answers to a VehicleCommand go; none of `_COMMANDS` answers with anything else."""

    def __init__(self, publish: Callable[..., None]) -> None:
        self._publish = publish

    def send_message(self, name: str, **fields: Any) -> None:
        assert name == "COMMAND_ACK", name
        self._publish("vehicle_command_ack", **fields)


class Px4Topics:
    """`inbox` holds what the companion has published and no step has taken."""

    def __init__(
        self,
        context: ServiceContext,
        autopilot: Autopilot,
        system: int,
        modes: Modes,
        setpoints: Setpoints,
        commands: Commands,
        battery: BatteryMonitor,
        charge_state: Callable[[], int],
    ) -> None:
        self.inbox: list[Px4Sample] = []
        self._context, self._flight, self._autopilot = context, context.flight, autopilot
        self._system, self._modes, self._setpoints, self._commands = system, modes, setpoints, commands
        self._battery, self._charge_state = battery, charge_state
        self._channel = _Acknowledgements(self._publish)
        self._level = _LEVELS[0]
        self._published: list[Px4Sample] = []
        self._told: dict[str, tuple[object, int]] = {}  # by topic: what it said, and when it is due again
        self._fix = 0
        self._armed_us = self._takeoff_us = self._mode_us = 0
        self._mode = self._flight.mode
        self._handlers: Mapping[str, Callable[[Fields], bool]] = {
            "/fmu/in/offboard_control_mode": self._take_level,
            "/fmu/in/trajectory_setpoint": self._take_trajectory,
            "/fmu/in/vehicle_attitude_setpoint": self._take_attitude,
            "/fmu/in/vehicle_rates_setpoint": self._take_rates,
            "/fmu/in/vehicle_command": self._take_command,
        }

    def handle(self) -> None:
        """Act on the inbox."""
        samples, self.inbox = self.inbox, []
        for topic, fields in samples:
            if not self._handlers[topic](fields):
                self._setpoints.ignored += 1

    def take_published(self) -> list[Px4Sample]:
        """What was published since the last call."""
        published, self._published = self._published, []
        return published

    def publish(self) -> None:
        """Publish what is due at the present moment, acknowledgements of this step first."""
        flight = self._flight
        body = BodyAttitude(flight)
        force = self._context.airframe.specific_force_mps2()
        self._publish_status()
        self._publish_land_detected()
        self._publish_motion(body, force)
        rates = (flight.p_radps, flight.q_radps, flight.r_radps)
        interval_us = round(flight.step_s * 1e6)
        self._publish(
            "sensor_combined",
            gyro_rad=rates,
            gyro_integral_dt=interval_us,
            accelerometer_m_s2=force,
            accelerometer_integral_dt=interval_us,
        )
        if flight.gps_epoch != self._fix:
            self._fix = flight.gps_epoch
            self._publish_fix()
        self._publish_battery()
        self._publish_home()

    # From the companion. False: the sample could not be used.

    def _take_level(self, m: Fields) -> bool:
        level = next((level for level in _LEVELS if m[level]), "")
        # One that cannot be controlled ends the offboard mode at once, as one without a flag does (source).
        self._setpoints.keep_alive(level in _FLOWN_LEVELS)
        self._level = level or self._level
        return level in _FLOWN_LEVELS

    def _take_trajectory(self, m: Fields) -> bool:
        vectors = m["position"], m["velocity"], m["acceleration"]
        return self._level in _TRAJECTORY_LEVELS and self._setpoints.take_trajectory(
            *vectors, m["yaw"], m["yawspeed"]
        )

    def _take_attitude(self, m: Fields) -> bool:
        rate = m["yaw_sp_move_rate"]
        return self._level == "attitude" and self._setpoints.take_attitude(
            m["q_d"], 0.0 if math.isnan(rate) else rate, -m["thrust_body"][2]
        )

    def _take_rates(self, m: Fields) -> bool:
        return self._level == "body_rate" and self._setpoints.take_rates(
            (m["roll"], m["pitch"], m["yaw"]), -m["thrust_body"][2]
        )

    def _take_command(self, m: Fields) -> bool:
        if m["target_system"] not in (0, self._system) or m["target_component"] not in (0, 1):
            return True
        number, params = m["command"], tuple(m[f"param{index}"] for index in range(1, 8))
        sender = MessageSender(m["source_system"], m["source_component"], self._channel)
        if number == _SET_NAV_STATE:
            custom = _BY_NAV_STATE.get(params[0])
            refusal = self._modes.request(custom) if custom is not None else None
            result = CommandResult.DENIED if custom is None else CommandResult.ACCEPTED
            if refusal and refusal.result is not None:
                result = refusal.result
            sender.answer("COMMAND_ACK", command=number, result=result)
        elif number in self._commands.carried_out() and number not in _COMMANDS:
            sender.answer("COMMAND_ACK", command=number, result=CommandResult.UNSUPPORTED)
        else:
            self._commands.run(Command(number, params, None, sender))
        return True

    # To the companion.

    def _publish(self, topic: str, **fields: Any) -> None:
        now_us = self._flight.time_us
        self._published.append(
            (f"/fmu/out/{topic}", {"timestamp": now_us, "timestamp_sample": now_us, **fields})
        )

    def _publish_on_change(self, topic: str, period_ns: int | None, fields: dict[str, Any]) -> bool:
        """Publish what has changed, or was said a period ago."""
        now_ns = self._flight.time_ns
        said, due_ns = self._told.get(topic, (None, 0))
        if fields == said and (period_ns is None or now_ns < due_ns):
            return False
        self._told[topic] = fields, now_ns + (period_ns or 0)
        self._publish(topic, **fields)
        return True

    def _publish_status(self) -> None:
        flight = self._flight
        now_us, mode = flight.time_us, flight.mode
        if mode is not self._mode:
            self._mode, self._mode_us = mode, now_us
        self._armed_us = (self._armed_us or now_us) if flight.armed else 0
        self._takeoff_us = (self._takeoff_us or now_us) if flight.flying else 0
        nav_state, wing = NAV_STATES[mode.name], self._wing
        alive = self._setpoints.fresh()
        status = {
            "armed_time": self._armed_us,
            "takeoff_time": self._takeoff_us,
            "arming_state": 2 if flight.armed else 1,
            "nav_state_timestamp": self._mode_us,
            "nav_state_user_intention": NAV_STATES[(flight.asked_mode or mode).name],
            "nav_state": nav_state,
            "nav_state_display": nav_state,
            "accepts_offboard_setpoints": mode.behaviour is Behaviour.OFFBOARD,
            **_STATES,
            "vehicle_type": 2 if wing else 1,
            "failsafe": flight.failsafe is not None,
            "system_type": int(self._autopilot.identity.vehicle_type),
            "system_id": self._system,
            "component_id": 1,
            "power_input_valid": True,
            "pre_flight_checks_pass": self._may_arm(alive),
        }
        self._publish_on_change("vehicle_status", _STATUS_NS, status)
        self._publish_on_change("vehicle_control_mode", _STATUS_NS, self._control_mode())
        self._publish_on_change("failsafe_flags", _STATUS_NS, self._failsafe_flags(alive))

    @property
    def _wing(self) -> bool:
        return self._autopilot.identity.vehicle_type == MAV_TYPE.FIXED_WING

    def _may_arm(self, alive: bool) -> bool:
        policy = self._autopilot.modes
        return policy.refuse_arming(self._flight, self._context.parameters, False, alive) is None

    def _control_mode(self) -> dict[str, Any]:
        mode = self._flight.mode
        offboard, pilot = mode.behaviour is Behaviour.OFFBOARD, mode.behaviour is Behaviour.PILOT
        # What is controlled goes down from here through `names`; in a mode of its own PX4 controls everything.
        names = ("position", "velocity", "acceleration", "attitude", "rates")
        level = self._level.replace("body_rate", "rates") if offboard else "position"
        if pilot and mode.stick is not None:
            level = {StickControl.RATES: "rates", StickControl.POSITION: "position"}.get(
                mode.stick, "attitude"
            )
        first = names.index(level) if level in names else len(names)
        controlled = {f"flag_control_{name}_enabled": index >= first for index, name in enumerate(names)}
        climbs = first <= 1 or (pilot and mode.stick is StickControl.ALTITUDE)
        terminated = mode.behaviour is Behaviour.TERMINATE
        if terminated:
            controlled = dict.fromkeys(controlled, False)
        return {
            "flag_armed": self._flight.armed,
            "flag_multicopter_position_control_enabled": not (self._wing or terminated)
            and (climbs or first <= 2),
            "flag_control_manual_enabled": pilot,
            "flag_control_auto_enabled": not (offboard or pilot or terminated),
            "flag_control_offboard_enabled": offboard,
            **controlled,
            "flag_control_altitude_enabled": climbs and not terminated,
            "flag_control_climb_rate_enabled": climbs and not terminated,
            "flag_control_allocation_enabled": not terminated,
            "flag_control_termination_enabled": terminated,
        }

    def _failsafe_flags(self, alive: bool) -> dict[str, Any]:
        flight = self._flight
        lost = not (flight.position_ok and knows_position(flight))
        return {
            **_REQUIREMENTS,
            "local_position_invalid": lost,
            "local_position_invalid_relaxed": lost,
            "local_velocity_invalid": lost,
            "global_position_invalid": lost,
            "global_position_invalid_relaxed": lost,
            "auto_mission_missing": not flight.mission_ready,
            "offboard_control_signal_lost": not alive,
            "home_position_invalid": flight.home is None,
            "manual_control_signal_lost": flight.sticks is None,
            "battery_warning": self._warning,
            "geofence_breached": flight.failsafe is Cause.FENCE,
            "gnss_lost": not flight.gps_ok,
        }

    @property
    def _warning(self) -> int:
        """BatteryStatus.warning: MAV_BATTERY_CHARGE_STATE begins one higher."""
        return max(self._charge_state() - 1, 0)

    def _publish_land_detected(self) -> None:
        flight = self._flight
        landed = not flight.flying
        names = ("maybe_landed", "landed", "at_rest", "has_low_throttle")
        moving = not landed and math.hypot(flight.vn_mps, flight.ve_mps) > 0.5
        fields = {
            **dict.fromkeys(names, landed),
            "ground_contact": landed or flight.on_ground,
            "vertical_movement": not landed and abs(flight.vd_mps) > 0.5,
            "horizontal_movement": moving,
            "close_to_ground_or_skipped_check": True,
        }
        self._publish_on_change("vehicle_land_detected", _SLOW_NS, fields)

    def _publish_motion(self, body: BodyAttitude, force: Vector) -> None:
        flight = self._flight
        self._publish("vehicle_attitude", q=body.quaternion, delta_q_reset=_NO_TURN)
        position = (flight.north_m, flight.east_m, flight.down_m)
        velocity = (flight.vn_mps, flight.ve_mps, flight.vd_mps)
        valid = flight.position_ok and knows_position(flight)
        north, east, down = body.to_ned(*force)
        origin = flight.origin
        self._publish(
            "vehicle_local_position",
            **dict.fromkeys(("xy_valid", "v_xy_valid", "xy_global"), valid),
            **dict.fromkeys(("z_valid", "v_z_valid", "z_global"), knows_position(flight)),
            **dict(zip("xyz", position, strict=True)),
            **dict(zip(("vx", "vy", "vz"), velocity, strict=True)),
            z_deriv=flight.vd_mps,
            **dict(zip(("ax", "ay", "az"), (north, east, down + _GRAVITY_MPS2), strict=True)),
            heading=flight.yaw_rad,
            unaided_heading=_NAN,
            heading_good_for_control=True,
            ref_lat=origin.latitude_e7 * 1e-7,
            ref_lon=origin.longitude_e7 * 1e-7,
            ref_alt=origin.altitude_m,
            dist_bottom=-flight.down_m,
            **_SIGMAS,
            evh=_SPEED_SIGMA_MPS,
            evv=_SPEED_SIGMA_MPS,
            dead_reckoning=not flight.gps_ok,
            **dict.fromkeys(("vxy_max", "vz_max", "hagl_min", "hagl_max_z", "hagl_max_xy"), _INFINITY),
        )
        self._publish(
            "vehicle_odometry",
            pose_frame=_NED,
            position=position if valid else (_NAN,) * 3,
            q=body.quaternion,
            velocity_frame=_NED,
            velocity=velocity if valid else (_NAN,) * 3,
            angular_velocity=(flight.p_radps, flight.q_radps, flight.r_radps),
            position_variance=(_POSITION_SIGMA_M**2,) * 3,
            velocity_variance=(_SPEED_SIGMA_MPS**2,) * 3,
        )
        if flight.home is not None:
            self._publish(
                "vehicle_global_position",
                lat=flight.latitude_e7 * 1e-7,
                lon=flight.longitude_e7 * 1e-7,
                alt=flight.altitude_m,
                alt_ellipsoid=flight.altitude_m,
                lat_lon_valid=valid,
                alt_valid=True,
                **_SIGMAS,
                terrain_alt=_NAN,
                dead_reckoning=not flight.gps_ok,
            )

    def _publish_fix(self) -> None:
        flight, quality = self._flight, self._autopilot.telemetry.gps_quality
        ok, speed_mps = flight.gps_ok, math.hypot(flight.vn_mps, flight.ve_mps)
        self._publish(
            "vehicle_gps_position",
            latitude_deg=flight.fix_e7[0] * 1e-7,
            longitude_deg=flight.fix_e7[1] * 1e-7,
            altitude_msl_m=flight.fix_altitude_m,
            altitude_ellipsoid_m=flight.fix_altitude_m,
            fix_type=quality.fix_type if ok else self._autopilot.telemetry.lost_fix_type,
            eph=quality.h_acc_mm * 1e-3,
            epv=quality.v_acc_mm * 1e-3,
            hdop=quality.eph * 1e-2,
            vdop=quality.epv * 1e-2,
            vel_m_s=speed_mps,
            vel_n_m_s=flight.vn_mps,
            vel_e_m_s=flight.ve_mps,
            vel_d_m_s=flight.vd_mps,
            cog_rad=math.atan2(flight.ve_mps, flight.vn_mps),
            vel_ned_valid=ok,
            time_utc_usec=flight.unix_start_us + flight.time_us,
            satellites_used=quality.satellites if ok else 0,
            heading=_NAN,
            heading_offset=_NAN,
        )

    def _publish_battery(self) -> None:
        flight, volts = self._flight, self._battery.volts()
        now_ns = flight.time_ns
        _, due_ns = self._told.get("battery_status", (None, 0))
        if now_ns < due_ns:
            return
        self._told["battery_status"] = None, now_ns + _SLOW_NS
        self._publish(
            "battery_status",
            connected=True,
            voltage_v=volts,
            current_a=flight.battery_a,
            current_average_a=flight.battery_a,
            discharged_mah=self._battery.used_mah(),
            remaining=flight.battery_fraction,
            scale=1.0,
            time_remaining_s=_NAN,
            temperature=_NAN,
            id=1,
            warning=self._warning,
        )

    def _publish_home(self) -> None:
        home = self._flight.home
        if home is None:
            return
        fields = {
            "lat": home.latitude_e7 * 1e-7,
            "lon": home.longitude_e7 * 1e-7,
            "alt": home.altitude_m,
            "x": home.north_m,
            "y": home.east_m,
            "z": home.down_m,
            "yaw": home.yaw_rad,
            **dict.fromkeys(("valid_alt", "valid_hpos", "valid_lpos"), True),
        }
        self._publish_on_change("home_position", None, fields)
