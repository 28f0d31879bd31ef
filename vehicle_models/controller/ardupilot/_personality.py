"""ArduCopter: policy. Numbers and texts are those that its SITL was seen to give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from .._flight import Behaviour, Flight, Landed, Mode
from .._personality import Answer, ChaseLimits, Event, GpsFields, Limits, Personality, Refusal, SensorBits, StickLimits
from .._service import Command, Result
from ..files._files import Content
from ..files._packed_parameters import packed_parameters
from ..parameters._store import ParameterStore, ParameterStyle, Push
from ..parameters._table import read_parameters
from ..safety._failsafe_policy import Failsafes
from ..telemetry._texts import CRITICAL, INFO, WARNING
from ._failsafes import failsafes
from ._fence import ArduPilotFence
from ._health import (
    GUIDED_READY_S,
    PLACE_S,
    STABILIZE_READY_S,
    STANDBY_S,
    USES_GPS_S,
    boot_texts,
    estimator_flags,
    failing,
    sensors,
    steers,
)
from ._missions import ArduPilotMissions
from ._modes import MODES, REFUSING
from ._parameters import PARAMETERS

_ARMED = 128
_BOOTING, _STANDBY, _ACTIVE, _CRITICAL = 1, 3, 4, 5
FULL_V = 16.6

_GROUPS: dict[int, tuple[str, ...]] = {
    1: ("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2"),
    2: ("SYS_STATUS", "POWER_STATUS", "MEMINFO", "NAV_CONTROLLER_OUTPUT", "MISSION_CURRENT", "GPS_RAW_INT", "FENCE_STATUS"),
    3: ("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE", "SIMSTATE", "AHRS2"),
    11: ("VFR_HUD",),
    12: (
        "AHRS",
        "SYSTEM_TIME",
        "WIND",
        "BATTERY_STATUS",
        "EKF_STATUS_REPORT",
        "VIBRATION",
        "ESC_TELEMETRY_1_TO_4",
        "TERRAIN_REQUEST",
        "TERRAIN_REPORT",
    ),
}
_RATES = {"RAW_SENS": 1, "EXT_STAT": 2, "RC_CHAN": 3, "POSITION": 6, "EXTRA1": 10, "EXTRA2": 11, "EXTRA3": 12}
# Devices that are not there: CAMERA_* and VIDEO_*, GIMBAL_*, GPS2_*, distances, RPM, EFI_STATUS.
_PROMISED = frozenset((124, 128, 132, 173, 225, 226, 259, 260, 261, 262, 263, 269, 270, 271, 280, 281, 284, 285))
_ON_REQUEST = (
    "EXTENDED_SYS_STATE",
    "ATTITUDE_QUATERNION",
    "HOME_POSITION",
    "GPS_GLOBAL_ORIGIN",
    "POSITION_TARGET_LOCAL_NED",
    "POSITION_TARGET_GLOBAL_INT",
    "HEARTBEAT",
)
# Section 5 of what was observed: accepted whatever the state, refused because there is no such device.
_ACCEPTED = (32, 181, 203, 206, 208, 216, 520, 2001, 42006)
_FAILED = (185, 204, 205, 211, 1000, 1001, 2000, 2500, 2501, 42600)


class ArduPilot(Personality):
    name = "ardupilot"
    autopilot = 3
    modes = MODES
    first_mode = "STABILIZE"
    hold_mode, land_mode, return_mode, follow_mode, reposition_mode = "BRAKE", "LAND", "RTL", "GUIDED", "GUIDED"
    takeoff_mode = None
    mode_after_landing = None
    parameters = read_parameters(Path(__file__).with_name("parameters.csv"), PARAMETERS)
    missions = ArduPilotMissions()
    fence = ArduPilotFence()
    parameter_style = ParameterStyle(
        bytewise=False,
        hash_first=False,
        unknown="silence",
        index_in_replies=False,
        any_case=True,
        changes_twice=False,
        checks_type=False,
        pushes=(
            Push("BARO1_GND_PRESS", 20.0),
            Push("BARO2_GND_PRESS", 20.0),
            Push("STAT_RUNTIME", 30.0, every_s=30.0, clock=True),
        ),
    )
    stream_sets = {"onboard": {"TIMESYNC": 0.1}, "gcs": {"TIMESYNC": 0.1}, "none": {}}
    stream_groups = _GROUPS
    stream_parameters = _RATES
    promised_messages = _PROMISED
    load_permille = battery_type = 0
    messages = frozenset({*_ON_REQUEST, *(name for group in _GROUPS.values() for name in group)})
    unknown_interval = Result.DENIED
    unknown_interval_text = (INFO, "No ap_message for mavlink id ({})")
    unknown_get_interval = Result.FAILED
    unknown_request = Result.FAILED
    bad_interval_us = 2500
    text_ending = ""
    speaks_when_spoken_to = True
    texts = {
        Event.ARMED: (INFO, "Arming motors"),
        Event.DISARMED: (INFO, "Disarming motors"),
        Event.DISARMED_BY_LANDING: (INFO, "Disarming motors"),
        Event.DISARMED_IDLE: (INFO, "Disarming motors"),
        Event.CRASHED: (CRITICAL, "Crash: Disarming"),
    }
    clear_texts = tuple((INFO, f"EKF3 IMU{unit} MAG0 in-flight yaw alignment complete") for unit in (0, 1))
    touch_text = (INFO, "SIM Hit ground at {:f} m/s")
    motor_order = (0, 3, 1, 2)  # clockwise from the front right
    slowest_hz = {"TERRAIN_REQUEST": 0.5}
    fixed_results = {
        **dict.fromkeys(_ACCEPTED, Result.ACCEPTED),
        **dict.fromkeys(_FAILED, Result.FAILED),
        189: Result.FAILED,
        224: Result.DENIED,
        245: Result.DENIED,
        300: Result.FAILED,
    }
    capabilities = 64495
    flight_sw_version = 0x040603FF
    flight_custom_version = b"92b0cd78"
    uid = 0
    system_parameter = "SYSID_THISMAV"
    uid2 = b"3a5c0f7e91d24b68a"  # the real one has its machine's id here
    file_sessions = 5
    answers_after_ack = True
    board_version = 0
    vtol_state = 3
    no_mission_total = 0
    gps_fields = GpsFields(fix_type=6, eph=121, epv=200, h_acc_mm=300, v_acc_mm=300)
    checks_when_armed = Result.TEMPORARILY_REJECTED
    gimbal_needs_control = False
    gimbal_streams = {}
    failure_parameter = None
    lost_fix_type = 1
    mode_acks_twice = False
    set_mode_message_acks = False
    answers_ping = False
    returns_to_setpoints = False
    position_setpoints_lapse = False
    heartbeat_on_mode_change = True
    local_frames = {1: "local", 7: "offset", 8: "body", 9: "body"}
    global_frames = {0: "amsl", 3: "home", 5: "amsl", 6: "home", 10: "ground", 11: "ground"}
    bad_local_frame = ""
    bad_global_frame = (INFO, "Unknown mavlink coordinate frame {}")
    feels_loose_sticks = True
    takes_radio_overrides = True
    loiter_mode = "LOITER"
    orbit_mode = None
    orbit_text = (INFO, "")
    yaw_command = pause_command = True
    altitude_command = False
    roi_has_kind = False
    mount_commands = True
    piloted_landing_disarms = False
    any_component = True
    axis_groups = True
    setpoints_face_motion = speed_command_binds_setpoints = True
    echo_modes = (Behaviour.FOLLOW,)
    echo_position_mask = 0xFDF8
    echo_velocity_mask = 0xFDC7
    bad_speed = Result.FAILED
    setpoint_complaints = False

    def limits(self, parameters: ParameterStore) -> Limits:
        p = parameters
        cruise = max(p["WPNAV_SPEED"], 20.0) / 100.0
        return Limits(
            cruise_mps=cruise,
            speed_max_mps=max(cruise, 10.0),
            setpoint_climb_mps=max(p["WPNAV_SPEED_UP"], 10.0) / 100.0,
            setpoint_descent_mps=max(p["WPNAV_SPEED_DN"], 10.0) / 100.0,
            climb_mps=max(p["WPNAV_SPEED_UP"], 10.0) / 100.0,
            descent_mps=max(p["WPNAV_SPEED_DN"], 10.0) / 100.0,
            takeoff_mps=max(p["WPNAV_SPEED_UP"], 10.0) / 100.0,
            takeoff_spool_s=2.6,
            takeoff_ramp_s=1.0,
            takeoff_height_m=2.5,
            land_mps=max(p["LAND_SPEED"], 20.0) / 100.0,
            land_slow_below_m=10.0,
            land_fast_above_m=10.0,
            return_height_m=p["RTL_ALT"] / 100.0,
            return_near_m=0.0,
            return_climbs_by_m=max(p["RTL_CLIMB_MIN"], 0.0) / 100.0,
            landed_disarm_s=0.4,
            idle_disarm_s=p["DISARM_DELAY"] if p["DISARM_DELAY"] > 0 else None,
            setpoint_timeout_s=max(p["GUID_TIMEOUT"], 0.1),
            sticks=StickLimits(
                tilt_rad=math.radians(min(max(p["ANGLE_MAX"] / 100.0, 10.0), 45.0)),
                speed_mps=max(p["LOIT_SPEED"], 20.0) / 100.0,
                climb_mps=max(p["PILOT_SPEED_UP"], 50.0) / 100.0,
                descent_mps=max(p["PILOT_SPEED_DN"] or p["PILOT_SPEED_UP"], 50.0) / 100.0,
                yaw_radps=math.radians(max(p["PILOT_Y_RATE"], 1.0)),
                rates_radps=math.radians(max(p["ACRO_RP_RATE"], 1.0)),
                dead=0.05,
                lost_after_s=p["RC_OVERRIDE_TIME"] if p["RC_OVERRIDE_TIME"] > 0 else math.inf,
            ),
            chase=ChaseLimits(height_m=8.0, distance_m=8.0, angle_rad=math.pi, speed_mps=5.0),
            goto_mps=cruise,
            faces_beyond_m=None,
            return_faces_home=False,
            return_waits_s=max(p["RTL_LOIT_TIME"], 0.0) / 1000.0,
            orbit_radius_max_m=math.inf,
            circle_radius_m=max(p["CIRCLE_RADIUS"], 100.0) / 100.0,
            circle_radps=math.radians(p["CIRCLE_RATE"]),
            thrust_is_climb=not int(p["GUID_OPTIONS"]) & 8,
        )

    def failsafes(self, parameters: ParameterStore) -> Failsafes:
        return failsafes(parameters)

    def battery_volts(self, flight: Flight, parameters: ParameterStore) -> float:
        """SIM_BATT_VOLTAGE is what a full battery has; it falls as the vehicle's own does."""
        return parameters["SIM_BATT_VOLTAGE"] * flight.battery_v / FULL_V

    def ready(self, flight: Flight) -> bool:
        placed = flight.time_s >= GUIDED_READY_S and flight.position_ok
        return (placed if steers(flight) else flight.time_s >= STABILIZE_READY_S) and not flight.crashed

    def prearm(self, flight: Flight, parameters: ParameterStore) -> tuple[str, ...]:
        return failing(flight, parameters, self.battery_volts(flight, parameters))

    def estimator_flags(self, flight: Flight) -> int:
        return estimator_flags(flight)

    def knows_place(self, flight: Flight) -> bool:
        return flight.time_s >= PLACE_S

    def wind(self, flight: Flight) -> tuple[float, float, float] | None:
        """Without an airspeed sensor the filter holds the wind at zero, which comes out as a wind from the south."""
        return (-180.0, 0.0, 0.0) if flight.time_s >= USES_GPS_S and flight.position_ok else None

    def heartbeat(self, flight: Flight, has_setpoints: bool) -> tuple[int, int]:
        base = flight.mode.base | (_ARMED if flight.armed or flight.tests_motors else 0)
        if flight.time_s < STANDBY_S:
            return 89, _BOOTING
        if flight.failsafe and flight.armed:
            return base, _CRITICAL
        return base, _ACTIVE if flight.armed and flight.flying else _STANDBY

    def sensors(self, flight: Flight) -> SensorBits:
        return sensors(flight, flight.armed or self.ready(flight))

    def refuse_arm_value(self, value: float) -> Refusal | None:
        return None if value in (0.0, 1.0) else Refusal(Result.UNSUPPORTED)

    def refuse_arming(self, flight: Flight, parameters: ParameterStore, forced: bool, has_setpoints: bool) -> Refusal | None:
        if flight.mode.behaviour is Behaviour.MISSION and not flight.mission_ready:
            return Refusal(Result.FAILED, ((CRITICAL, "Arm: Mode requires mission"),))
        if not flight.mode.armable:
            return Refusal(Result.FAILED, ((CRITICAL, f"Arm: {flight.mode.name} mode not armable"),))
        fails = self.prearm(flight, parameters)
        if forced and self.ready(flight):
            return None
        return Refusal(Result.FAILED, tuple((CRITICAL, f"Arm: {text}") for text in fails)) if fails or flight.crashed else None

    def refuse_disarming(self, flight: Flight, forced: bool) -> Refusal | None:
        return None if forced or not flight.flying else Refusal(Result.FAILED)

    def refuse_mode(self, flight: Flight, wanted: Mode | None, number: int, has_setpoints: bool) -> Refusal | None:
        if wanted is None:
            known = REFUSING.get(number)
            if known is None:
                return Refusal(Result.FAILED, ((WARNING, f"No such mode {number}"),))
            name, why = known
            texts = ((WARNING, f"Mode change to {name} failed: init failed"),)
            return Refusal(Result.FAILED, (*(((WARNING, why),) if why else ()), *texts))
        if wanted.behaviour is Behaviour.MISSION and flight.armed and not flight.mission_ready:
            return Refusal(Result.FAILED, ((WARNING, "Mode change to AUTO failed: init failed"),))
        return None

    def mode_number(self, command: Command) -> int | None:
        number = command.params[1]
        return int(number) if command.flag(0, 1) and 0 <= number < 2**24 else None

    def answer(self, flight: Flight, command: Command) -> Answer | None:
        """Section 5 of what was observed."""
        first = command.params[0]
        accepted, failed = Answer((Result.ACCEPTED,)), Answer((Result.FAILED,))
        match command.number:
            case 207:
                return accepted if first in (0.0, 1.0, 2.0) else failed
            case 183 if first in (1.0, 2.0, 3.0, 4.0):
                text = f"ServoRelayEvent: Channel {first:.0f} is already in use"
                return Answer((Result.FAILED,), ((WARNING, text),))
            case 183:
                return accepted if 5.0 <= first <= 16.0 else failed
            case 189:
                no_landing = ((WARNING, "Mode change to AUTO RTL failed: No landing sequence found"),) * 2
                return Answer((Result.FAILED,), no_landing)
            case 218:
                text = f"Invalid channel option ({first:.0f})" if math.isfinite(first) else "Invalid channel option"
                return Answer((Result.FAILED,), ((WARNING, text),))
            case 241:
                return self._calibration(flight, command)
            case 246:
                known = first in (1.0, 3.0)
                return failed if flight.armed or flight.tests_motors else accepted if known else Answer((Result.UNSUPPORTED,))
            case 2600:
                return Answer((Result.ACCEPTED,), ((5, f"Control high latency {'en' if first else 'dis'}abled"),))
            case 42428:
                banner = tuple((INFO, text) for text in ("ArduCopter V4.6.3 (92b0cd78)", "0" * 32, "Frame: QUAD/PLUS"))
                return Answer((Result.ACCEPTED,), banner)
        return None

    def _calibration(self, flight: Flight, command: Command) -> Answer:
        if flight.armed:
            return Answer((Result.FAILED,), ((CRITICAL, "Disarm to allow calibration"),))
        if command.params[2] == 1.0:
            texts = ((INFO, "Calibrating barometer"), (INFO, "Barometer 1 calibration complete"))
            return Answer((Result.IN_PROGRESS, Result.ACCEPTED), texts)
        if command.params[4] == 2.0:
            return Answer((Result.ACCEPTED,), ((INFO, "Trim OK: roll=0.00 pitch=0.00 yaw=0.00"),))
        return Answer((Result.TEMPORARILY_REJECTED if command.params[4] == 4.0 else Result.ACCEPTED,))

    def refuse_takeoff(self, flight: Flight, command: Command) -> Refusal | None:
        altitude = command.params[6]
        if command.frame not in (None, 3, 6):
            return Refusal(Result.DENIED)
        wrong = flight.mode.behaviour is not Behaviour.FOLLOW or not flight.armed or flight.landed is not Landed.ON_GROUND
        return Refusal(Result.FAILED) if wrong or not math.isfinite(altitude) or altitude <= 0.0 else None

    def takeoff_altitude_m(self, flight: Flight, command: Command, limits: Limits) -> float | None:
        return self.altitude_amsl_m(flight, 3, command.params[6])

    def refuse_reposition(self, flight: Flight, command: Command) -> Refusal | None:
        if command.frame is None:
            return Refusal(Result.UNSUPPORTED)
        if command.frame not in (0, 3, 5, 6):
            return Refusal(Result.DENIED, ((INFO, f"Unknown mavlink coordinate frame {command.frame}"),))
        latitude, longitude, altitude = command.params[4:7]
        if flight.mode.behaviour is not Behaviour.FOLLOW and not command.flag(1, 1):
            return Refusal(Result.DENIED)
        finite = math.isfinite(latitude) and math.isfinite(longitude) and math.isfinite(altitude)
        return None if finite and (latitude or longitude) else Refusal(Result.DENIED)

    def altitude_amsl_m(self, flight: Flight, frame: int | None, altitude_m: float) -> float:
        home = flight.home or flight.origin
        return altitude_m + home.altitude_m if frame in (3, 6) else altitude_m

    def is_station(self, system: int, parameters: ParameterStore) -> bool:
        return system == int(parameters["SYSID_MYGCS"])

    def refuse_home(self, flight: Flight, command: Command) -> Refusal | None:
        return None if self.knows_place(flight) else Refusal(Result.FAILED)

    def files(self, parameters: ParameterStore) -> Mapping[str, Content]:
        return {"@PARAM/param.pck": lambda query: packed_parameters(parameters, query)}

    def boot_texts(self, flight: Flight) -> tuple[tuple[float, int, str], ...]:
        return boot_texts(flight.origin.altitude_m)
