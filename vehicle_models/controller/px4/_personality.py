"""PX4: policy. Numbers and texts are those that its SITL was seen to give."""

from __future__ import annotations

import math
from pathlib import Path

from .._flight import Behaviour, Flight, Mode
from .._personality import (
    Answer,
    BatteryPlan,
    ChaseLimits,
    Event,
    GpsFields,
    Limits,
    Personality,
    Refusal,
    SensorBits,
    StickLimits,
)
from .._service import Command, Result
from ..files._metadata import Metadata
from ..parameters._store import ParameterStore, ParameterStyle
from ..parameters._table import read_parameters
from ..safety._failsafe_policy import Failsafes
from ..telemetry._texts import CRITICAL, INFO
from ._failsafes import failsafes
from ._fence import Px4Fence
from ._identity import EVENTS, STANDARD_MODES
from ._missions import Px4Missions
from ._modes import MODES
from ._parameters import PARAMETERS

READY_S = 4.2  # "Resolve system health failures first" until then
PLACE_S = READY_S  # home is set; a client that waits for it is not refused the arming
_AUTOMATIC = frozenset({Behaviour.TAKEOFF, Behaviour.HOLD, Behaviour.MISSION, Behaviour.RETURN, Behaviour.LAND})
_NOT_READY = "Arming denied: Resolve system health failures first"
_PREARM = 0x10000000
# 3D gyro, accelerometer, magnetometer, pressure, GPS, rate and attitude and yaw and z and xy control, motors, AHRS, battery.
_SENSORS = 0x1 | 0x2 | 0x4 | 0x8 | 0x20 | 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000 | 0x200000 | 0x2000000
_GPS_AND_POSITION = 0x20 | 0x4000
_ARMED = 128
_SITL_BATTERY = (60.0, 50.0)  # SIM_BAT_DRAIN and SIM_BAT_MIN_PCT as they come
_STANDBY, _ACTIVE, _CRITICAL, _TERMINATED, _UNABLE = 3, 4, 5, 8, 0

_COMMON_STREAMS = {
    "ATTITUDE_QUATERNION": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "SCALED_PRESSURE": 1.0,
    "MISSION_CURRENT": 1.0,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "CURRENT_MODE": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "LINK_NODE_STATUS": 1.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
}
_ONBOARD = {
    **_COMMON_STREAMS,
    "ATTITUDE": 100.0,
    "LOCAL_POSITION_NED": 30.0,
    "ODOMETRY": 30.0,
    "HIGHRES_IMU": 50.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "ATTITUDE_TARGET": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "GPS_RAW_INT": 8.0,
    "VFR_HUD": 10.0,
    "ALTITUDE": 10.0,
    "DISTANCE_SENSOR": 10.0,
    "TIMESYNC": 10.0,
    "SYS_STATUS": 5.0,
    "EXTENDED_SYS_STATE": 5.0,
    "SYSTEM_TIME": 1.0,
    "PING": 1.0,
    "ESTIMATOR_STATUS": 1.0,
    "ORBIT_EXECUTION_STATUS": 5.0,
    "VIBRATION": 0.5,
}
_GCS = {
    **_COMMON_STREAMS,
    "ATTITUDE": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "ATTITUDE_TARGET": 50.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "POSITION_TARGET_GLOBAL_INT": 1.0,
    "GPS_RAW_INT": 5.0,
    "VFR_HUD": 4.0,
    "ALTITUDE": 1.0,
    "DISTANCE_SENSOR": 0.5,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "PING": 0.1,
    "ESTIMATOR_STATUS": 0.5,
    "ORBIT_EXECUTION_STATUS": 2.0,
    "VIBRATION": 0.1,
}
# Accepted and without effect here, as in section 3.3 of what was observed.
_ACCEPTED = (187, 191, 241, 245, 246, 310, 401, 2510, 2511)
# No module owns these: no answer at all.
_SILENT = (202, 203, 204, 205, 206, 500, 521, 530, 1000, 1001, 2003, 3000, 42600)


class Px4(Personality):
    name = "px4"
    autopilot = 12
    modes = MODES
    first_mode = hold_mode = reposition_mode = mode_after_landing = "AUTO_LOITER"
    takeoff_mode, land_mode, return_mode, follow_mode = "AUTO_TAKEOFF", "AUTO_LAND", "AUTO_RTL", "OFFBOARD"
    parameters = read_parameters(Path(__file__).with_name("parameters.csv"), PARAMETERS, by_name=True)
    missions = Px4Missions()
    fence = Px4Fence()
    parameter_style = ParameterStyle(
        bytewise=True,
        hash_first=True,
        unknown="error",
        index_in_replies=True,
        any_case=False,
        changes_twice=True,
        checks_type=True,
    )
    stream_sets = {"onboard": _ONBOARD, "gcs": _GCS, "none": {}}
    stream_groups = {}
    messages = frozenset({*_ONBOARD, *_GCS, "HEARTBEAT", "GPS_GLOBAL_ORIGIN"})
    unknown_interval = Result.FAILED
    unknown_interval_text = None
    unknown_get_interval = Result.ACCEPTED
    unknown_request = Result.DENIED
    bad_interval_us = 0
    text_ending = "\t"
    speaks_when_spoken_to = False
    texts = {
        Event.ARMED: (INFO, "Armed by external command"),
        Event.DISARMED: (INFO, "Disarmed by external command"),
        Event.DISARMED_BY_LANDING: (INFO, "Disarmed by landing"),
        Event.DISARMED_IDLE: (INFO, "Disarmed by auto preflight disarming"),
        Event.TAKEOFF_DEFAULT: (INFO, "Using default takeoff altitude: {:.1f} m"),
        Event.TAKEOFF_DETECTED: (INFO, "Takeoff detected"),
        Event.LANDING_DETECTED: (INFO, "Landing detected"),
        Event.LANDING: (INFO, "Landing at current position"),
        Event.RETURNING: (INFO, "Returning to launch"),
        Event.PILOT_TOOK_OVER: (INFO, "Pilot took over using sticks"),
        Event.TERMINATED: (CRITICAL, "Preflight Fail: Flight termination active"),
        Event.CRASHED: (CRITICAL, "Disarmed by failure detector"),
    }
    fixed_results = {**dict.fromkeys(_ACCEPTED, Result.ACCEPTED), **dict.fromkeys(_SILENT), 189: Result.CANCELLED}
    capabilities = 59647
    flight_sw_version = 0x01110080
    flight_custom_version = b"\0" * 8
    uid = 5283920058631409231
    system_parameter = "MAV_SYS_ID"
    protocol_versions = (200, 100, 203)
    standard_modes = STANDARD_MODES
    event_names = EVENTS
    metadata = Metadata(parameters, EVENTS)
    files_writable = True
    board_version = 1
    vtol_state = 0
    no_mission_total = 65535
    gps_fields = GpsFields(fix_type=3, eph=70, epv=110, h_acc_mm=900, v_acc_mm=1780)
    checks_when_armed = Result.ACCEPTED
    gimbal_needs_control = True
    gimbal_streams = {"GIMBAL_DEVICE_ATTITUDE_STATUS": 5.0, "GIMBAL_MANAGER_STATUS": 0.5}
    failure_parameter = "SYS_FAILURE_EN"
    lost_fix_type = 0
    mode_acks_twice = True
    set_mode_message_acks = True
    answers_ping = True
    returns_to_setpoints = True
    position_setpoints_lapse = True
    heartbeat_on_mode_change = False
    local_frames = {1: "local", 8: "body-velocity"}
    global_frames = {5: "amsl", 6: "home", 11: "ground"}
    bad_local_frame = "SET_POSITION_TARGET_LOCAL_NED coordinate frame {} unsupported"
    bad_global_frame = (CRITICAL, "SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {}")
    feels_loose_sticks = False
    takes_radio_overrides = False
    pilot_modes = ("POSCTL", "ALTCTL")
    loiter_mode = None
    orbit_mode = "POSCTL_ORBIT"
    orbit_text = (CRITICAL, "Orbit radius limit exceeded")
    yaw_command = pause_command = False
    altitude_command = True
    roi_has_kind = True
    piloted_landing_disarms = True
    any_component = False
    axis_groups = False
    setpoints_face_motion = speed_command_binds_setpoints = False
    echo_modes = None
    echo_position_mask = echo_velocity_mask = None
    bad_speed = Result.ACCEPTED
    setpoint_complaints = True

    def limits(self, parameters: ParameterStore) -> Limits:
        p = parameters
        return Limits(
            cruise_mps=max(p["MPC_XY_CRUISE"], 0.5),
            speed_max_mps=max(p["MPC_XY_VEL_MAX"], 0.5),
            setpoint_climb_mps=max(p["MPC_Z_VEL_MAX_UP"], 0.2),
            setpoint_descent_mps=max(p["MPC_Z_VEL_MAX_DN"], 0.2),
            climb_mps=max(p["MPC_Z_V_AUTO_UP"], 0.2),
            descent_mps=max(p["MPC_Z_V_AUTO_DN"], 0.2),
            takeoff_mps=max(p["MPC_TKO_SPEED"], 0.2),
            takeoff_spool_s=0.6,
            takeoff_ramp_s=5.5,
            takeoff_height_m=max(p["MIS_TAKEOFF_ALT"], 0.5),
            land_mps=max(p["MPC_LAND_SPEED"], 0.2),
            land_slow_below_m=p["MPC_LAND_ALT2"],
            land_fast_above_m=p["MPC_LAND_ALT1"],
            return_height_m=p["RTL_RETURN_ALT"],
            return_near_m=p["RTL_MIN_DIST"],
            return_climbs_by_m=None,
            landed_disarm_s=p["COM_DISARM_LAND"] if p["COM_DISARM_LAND"] > 0 else None,
            idle_disarm_s=p["COM_DISARM_PRFLT"] if p["COM_DISARM_PRFLT"] > 0 else None,
            setpoint_timeout_s=max(p["COM_OF_LOSS_T"], 0.1),
            sticks=StickLimits(
                tilt_rad=math.radians(min(max(p["MPC_MAN_TILT_MAX"], 1.0), 45.0)),
                speed_mps=max(p["MPC_VEL_MANUAL"], 0.5),
                climb_mps=max(p["MPC_Z_VEL_MAX_UP"], 0.2),
                descent_mps=max(p["MPC_Z_VEL_MAX_DN"], 0.2),
                yaw_radps=math.radians(max(p["MPC_MAN_Y_MAX"], 0.0)),
                rates_radps=math.radians(100.0),
                dead=0.1,
                lost_after_s=max(p["COM_RC_LOSS_T"], 0.1),
                overrides=_overrides(int(p["COM_RC_OVERRIDE"])),
                overrides_from=min(max(p["COM_RC_STICK_OV"], 5.0), 80.0) / 100.0,
            ),
            chase=ChaseLimits(
                height_m=max(p["FLW_TGT_HT"], 1.0),
                distance_m=max(p["FLW_TGT_DST"], 1.0),
                angle_rad=math.radians(p["FLW_TGT_FA"]),
                speed_mps=max(p["FLW_TGT_MAX_VEL"], 0.5),
            ),
            goto_mps=max(p["MPC_XY_VEL_MAX"], 0.5),
            faces_beyond_m=max(p["NAV_ACC_RAD"], 0.5) if p["MPC_YAW_MODE"] == 0 else math.inf,
            return_faces_home=True,
            return_waits_s=0.0,
            orbit_radius_max_m=max(p["MC_ORBIT_RAD_MAX"], 1.0),
            circle_radius_m=20.0,
            circle_radps=0.05,
            thrust_is_climb=False,
        )

    def failsafes(self, parameters: ParameterStore) -> Failsafes:
        return failsafes(parameters)

    def pretended_battery(self, parameters: ParameterStore) -> BatteryPlan | None:
        """Asked for by a drain or a least charge other than the defaults, of which the vehicle's own battery knows nothing."""
        drain_s, least_pct = parameters["SIM_BAT_DRAIN"], parameters["SIM_BAT_MIN_PCT"]
        asked = (drain_s, least_pct) != _SITL_BATTERY and parameters["SIM_BAT_ENABLE"] == 1.0
        return BatteryPlan(max(drain_s, 1.0), min(max(least_pct, 0.0), 100.0) / 100.0) if asked else None

    def battery_volts(self, flight: Flight, parameters: ParameterStore) -> float:
        if flight.pretended_fraction is None:
            return flight.battery_v
        empty, full = parameters["BAT1_V_EMPTY"], parameters["BAT1_V_CHARGED"]
        return max(parameters["BAT1_N_CELLS"], 1.0) * (empty + (full - empty) * flight.pretended_fraction)

    def ready(self, flight: Flight) -> bool:
        return flight.time_s >= READY_S and _armable(flight) and not flight.crashed

    def knows_place(self, flight: Flight) -> bool:
        return flight.time_s >= PLACE_S

    def heartbeat(self, flight: Flight, has_setpoints: bool) -> tuple[int, int]:
        base = flight.mode.base
        if flight.mode.behaviour is Behaviour.FOLLOW and not has_setpoints and not flight.armed:
            base = 1
        if flight.mode.behaviour is Behaviour.TERMINATE:
            return base | (_ARMED if flight.armed else 0), _TERMINATED
        if flight.armed:
            return base | _ARMED, _CRITICAL if flight.failsafe else _ACTIVE
        armable = self.ready(flight) and not (flight.mode.behaviour is Behaviour.FOLLOW and not has_setpoints)
        return base, _STANDBY if armable else _UNABLE

    def sensors(self, flight: Flight) -> SensorBits:
        health = _SENSORS if self.knows_place(flight) else _SENSORS & ~_GPS_AND_POSITION
        return SensorBits(_SENSORS, _SENSORS, health | (_PREARM if flight.armed or self.ready(flight) else 0))

    def refuse_arm_value(self, value: float) -> Refusal | None:
        if value in (0.0, 1.0) or 0.5 <= value < 1.5:
            return None
        return Refusal(None, ((CRITICAL, f"Unsupported ARM_DISARM param: {value:.3f}"),))

    def refuse_arming(self, flight: Flight, parameters: ParameterStore, forced: bool, has_setpoints: bool) -> Refusal | None:
        if forced and flight.time_s >= READY_S and not flight.crashed:
            return None
        lacks_setpoints = flight.mode.behaviour is Behaviour.FOLLOW and not has_setpoints
        if self.ready(flight) and not lacks_setpoints and flight.battery_fraction > parameters["BAT_CRIT_THR"]:
            return None
        return Refusal(Result.TEMPORARILY_REJECTED, ((CRITICAL, _NOT_READY),))

    def refuse_disarming(self, flight: Flight, forced: bool) -> Refusal | None:
        if forced or not flight.flying:
            return None
        return Refusal(Result.TEMPORARILY_REJECTED, ((CRITICAL, "Disarming denied: not landed"),))

    def refuse_mode(self, flight: Flight, wanted: Mode | None, number: int, has_setpoints: bool) -> Refusal | None:
        if wanted is None or wanted.behaviour is Behaviour.TERMINATE:
            return Refusal(Result.TEMPORARILY_REJECTED, ((CRITICAL, "Unsupported auto mode"),))
        if not flight.armed or (wanted.behaviour is Behaviour.MISSION and flight.mission_ready):
            return None
        lacks = wanted.behaviour in (Behaviour.MISSION, Behaviour.CIRCLE) or wanted.name.startswith("EXTERNAL")
        lacks = lacks or (wanted.behaviour is Behaviour.PILOT and flight.sticks is None)
        if lacks or (wanted.behaviour is Behaviour.FOLLOW and not has_setpoints):
            text = f"Switching to {wanted.label} is currently not available"
            return Refusal(Result.TEMPORARILY_REJECTED, ((CRITICAL, text),))
        return None

    def mode_number(self, command: Command) -> int | None:
        """param1 bit 0: a custom mode, given as main and sub mode."""
        main, sub = command.params[1:3]
        if not (command.flag(0, 1) and 0 <= main < 256 and 0 <= sub < 256):
            return None
        return int(sub) << 24 | int(main) << 16

    def answer(self, flight: Flight, command: Command) -> Answer | None:
        """Section 3.3 of what was observed."""
        match command.number:
            case 211:
                return Answer((Result.ACCEPTED,), first_time=(Result.IN_PROGRESS, Result.ACCEPTED))
            case 241 | 245 if flight.armed:
                return Answer((Result.TEMPORARILY_REJECTED,))
            case 310 if flight.armed:
                return Answer((Result.DENIED,))
            case 246 if command.params[0] != 0.0 and (flight.armed or command.params[0] != 1.0):
                return Answer((Result.DENIED,))
            case 300:
                return Answer((Result.DENIED,), ((CRITICAL, "Mission start denied! No valid mission"),))
            case 2600:
                return Answer((Result.FAILED,), ((CRITICAL, "Control high latency failed! Telemetry unavailable"),))
        return None

    def refuse_takeoff(self, flight: Flight, command: Command) -> Refusal | None:
        return None

    def takeoff_altitude_m(self, flight: Flight, command: Command, limits: Limits) -> float | None:
        """All zero and all NaN alike mean the default; else the altitude above sea level."""
        altitude = command.params[6]
        return altitude if math.isfinite(altitude) and altitude != 0.0 else None

    def refuse_reposition(self, flight: Flight, command: Command) -> Refusal | None:
        return None if command.flag(1, 1) else Refusal(Result.UNSUPPORTED)

    def altitude_amsl_m(self, flight: Flight, frame: int | None, altitude_m: float) -> float:
        """Above sea level whatever the frame says: so did every release that was seen, and MAVSDK relies on it."""
        return altitude_m

    def is_station(self, system: int, parameters: ParameterStore) -> bool:
        return True

    def refuse_home(self, flight: Flight, command: Command) -> Refusal | None:
        return None


def _overrides(bits: int) -> frozenset[Behaviour]:
    """COM_RC_OVERRIDE: bit 0 the automatic modes, bit 1 offboard."""
    return (_AUTOMATIC if bits & 1 else frozenset()) | (frozenset({Behaviour.FOLLOW}) if bits & 2 else frozenset())


def _armable(flight: Flight) -> bool:
    behaviour = flight.mode.behaviour
    if behaviour is Behaviour.MISSION:
        return flight.mission_ready and flight.position_ok
    piloted = behaviour is Behaviour.PILOT and flight.sticks is not None
    return piloted or (flight.mode.armable and flight.position_ok)
