"""The wall between what every autopilot does and how one of them does it: data and policy, no service of its own."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import ClassVar, Literal

from ._flight import Behaviour, Flight, Mode
from ._service import Command, Result
from .files._files import Content
from .files._metadata import Metadata
from .missions._policy import MissionPolicy
from .parameters._store import Parameter, ParameterStore, ParameterStyle
from .safety._failsafe_policy import Failsafes
from .safety._fence_policy import FencePolicy
from .telemetry._event_names import EventName

Seconds = float


class Event(Enum):
    """Moments at which an autopilot may have something to say."""

    ARMED = auto()
    DISARMED = auto()
    DISARMED_BY_LANDING = auto()
    DISARMED_IDLE = auto()
    TAKEOFF_DEFAULT = auto()
    TAKEOFF_DETECTED = auto()
    LANDING_DETECTED = auto()
    LANDING = auto()
    RETURNING = auto()
    TERMINATED = auto()
    PILOT_TOOK_OVER = auto()
    CRASHED = auto()


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why something is not done: the result for the acknowledgement (None: no answer at all), and texts to say."""

    result: Result | None
    texts: tuple[tuple[int, str], ...] = ()


@dataclass(frozen=True, slots=True)
class StickLimits:
    """What a full stick means."""

    tilt_rad: float
    speed_mps: float
    climb_mps: float
    descent_mps: float
    yaw_radps: float
    rates_radps: float  # roll and pitch of acrobatics
    dead: float  # share of a stick's way around its middle that means nothing
    lost_after_s: Seconds
    # A pilot takes over from these by moving a stick faster than a share of its way in a second.
    overrides: frozenset[Behaviour] = frozenset()
    overrides_from: float = math.inf


@dataclass(frozen=True, slots=True)
class ChaseLimits:
    """How somebody is followed: above home, away from them, at an angle to their course."""

    height_m: float
    distance_m: float
    angle_rad: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Answer:
    """Results of a command that does nothing else here: the first at once, the others a second apart; and texts.

    `first_time` are the results when the command comes for the first time, where that makes a difference.
    """

    results: tuple[Result, ...]
    texts: tuple[tuple[int, str], ...] = ()
    first_time: tuple[Result, ...] = ()


@dataclass(frozen=True, slots=True)
class Limits:
    """Numbers by which the vehicle is flown, as the present parameters give them."""

    cruise_mps: float  # positions flown on the autopilot's own account
    speed_max_mps: float  # setpoints of a companion
    setpoint_climb_mps: float  # likewise
    setpoint_descent_mps: float
    climb_mps: float
    descent_mps: float
    takeoff_mps: float
    takeoff_spool_s: Seconds  # rotors turn, nothing moves
    takeoff_ramp_s: Seconds  # the climb grows to its full speed
    takeoff_height_m: float  # when a takeoff command gives none
    land_mps: float
    land_slow_below_m: float  # full slowness below, full descent above `land_fast_above_m`, linear between
    land_fast_above_m: float
    return_height_m: float  # above home
    return_near_m: float  # nearer to home than this no climb is made
    return_climbs_by_m: float | None  # climb at least so much, where an autopilot does not climb to a fixed height
    landed_disarm_s: Seconds | None
    idle_disarm_s: Seconds | None
    setpoint_timeout_s: Seconds
    sticks: StickLimits
    chase: ChaseLimits
    goto_mps: float  # positions that a companion gives
    faces_beyond_m: float | None  # nose to the place of a reposition that is farther away; None: wherever it moves
    return_faces_home: bool
    return_waits_s: Seconds  # above home, before landing
    orbit_radius_max_m: float
    circle_radius_m: float
    circle_radps: float  # clockwise
    thrust_is_climb: bool  # thrust of attitude setpoints: 0.5 holds the height


@dataclass(frozen=True, slots=True)
class BatteryPlan:
    """A battery that is made up: from full to empty in `empties_s` of being armed, but never below `least_fraction`."""

    empties_s: Seconds
    least_fraction: float


@dataclass(frozen=True, slots=True)
class GpsFields:
    """What GPS_RAW_INT says of the receiver's quality."""

    fix_type: int
    eph: int
    epv: int
    h_acc_mm: int
    v_acc_mm: int


@dataclass(frozen=True, slots=True)
class SensorBits:
    """present, enabled, health of SYS_STATUS."""

    present: int
    enabled: int
    health: int


class Personality(ABC):
    """One autopilot's way. Class attributes are data; methods are policy and change nothing themselves."""

    name: ClassVar[str]
    autopilot: ClassVar[int]  # MAV_AUTOPILOT
    vehicle_type: ClassVar[int] = 2  # MAV_TYPE; a quadrotor
    modes: ClassVar[tuple[Mode, ...]]
    first_mode: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    parameter_style: ClassVar[ParameterStyle]
    missions: ClassVar[MissionPolicy]
    fence: ClassVar[FencePolicy]
    stream_sets: ClassVar[Mapping[str, Mapping[str, float]]]  # set name -> message -> Hz
    stream_parameters: ClassVar[Mapping[str, int]] = {}  # end of SR0_, SR1_... (a link each) -> id of its group
    promised_messages: ClassVar[frozenset[int]] = frozenset()  # accepted when requested, but they never come
    load_permille: ClassVar[int] = 130  # SYS_STATUS.load
    battery_type: ClassVar[int] = 3  # MAV_BATTERY_TYPE; lithium polymer
    stream_groups: ClassVar[Mapping[int, tuple[str, ...]]]  # REQUEST_DATA_STREAM id -> messages
    messages: ClassVar[frozenset[str]]  # everything that may be streamed or requested
    unknown_interval: ClassVar[Result]
    unknown_interval_text: ClassVar[tuple[int, str] | None]
    unknown_get_interval: ClassVar[Result]
    unknown_request: ClassVar[Result]
    bad_interval_us: ClassVar[int]  # intervals below this are refused; 0 refuses none
    text_ending: ClassVar[str]
    speaks_when_spoken_to: ClassVar[bool]
    feels_loose_sticks: ClassVar[bool]  # a radio whose throttle lies at its lowest, when nobody else holds sticks
    takes_radio_overrides: ClassVar[bool]
    pilot_modes: ClassVar[tuple[str, str] | None] = None  # of a pilot who takes over: with a position, and without
    loiter_mode: ClassVar[str | None]  # of NAV_LOITER_UNLIM, where it is a command
    orbit_mode: ClassVar[str | None]  # of DO_ORBIT
    orbit_text: ClassVar[tuple[int, str]]  # for a circle that is too small or too large
    yaw_command: ClassVar[bool]  # CONDITION_YAW
    pause_command: ClassVar[bool]  # DO_PAUSE_CONTINUE
    altitude_command: ClassVar[bool]  # DO_CHANGE_ALTITUDE
    roi_has_kind: ClassVar[bool]  # DO_SET_ROI means a place where its first parameter says so; else wherever it names one
    piloted_landing_disarms: ClassVar[bool]  # landing by sticks is a landing like any other
    any_component: ClassVar[bool]  # hears what is addressed to components that do not exist
    axis_groups: ClassVar[bool]  # a masked axis masks its group; else each axis is for itself
    speed_command_binds_setpoints: ClassVar[bool]  # DO_CHANGE_SPEED holds for positions of a companion
    setpoints_face_motion: ClassVar[bool]  # without a heading of their own
    echo_modes: ClassVar[tuple[Behaviour, ...] | None]  # POSITION_TARGET_* are said in these alone; None: in all
    echo_position_mask: ClassVar[int | None]  # type_mask of the echo of a position; None: bits of what is NaN
    echo_velocity_mask: ClassVar[int | None]
    mount_commands: ClassVar[bool] = False  # DO_MOUNT_CONFIGURE, DO_MOUNT_CONTROL and their messages turn a gimbal
    gimbal_needs_control: ClassVar[bool]  # a gimbal is turned by its primary or secondary controller alone
    gimbal_streams: ClassVar[Mapping[str, float]]  # message -> Hz, for a vehicle with a gimbal
    failure_parameter: ClassVar[str | None]  # that allows INJECT_FAILURE, where that command exists
    lost_fix_type: ClassVar[int]  # GPS_RAW_INT without fixes
    texts: ClassVar[Mapping[Event, tuple[int, str]]]
    clear_texts: ClassVar[tuple[tuple[int, str], ...]] = ()  # said when the vehicle has risen clear of the ground
    touch_text: ClassVar[tuple[int, str] | None] = None  # said when it meets the ground, with {} for the speed
    motor_order: ClassVar[tuple[int, ...]] = ()  # rotors as DO_MOTOR_TEST counts them; empty: no such command
    slowest_hz: ClassVar[Mapping[str, float]] = {}  # message -> the rate that its stream never exceeds
    fixed_results: ClassVar[Mapping[int, Result | None]]  # commands that are answered and do nothing
    capabilities: ClassVar[int]
    flight_sw_version: ClassVar[int]
    flight_custom_version: ClassVar[bytes]
    uid: ClassVar[int]
    board_version: ClassVar[int]
    uid2: ClassVar[bytes] = b""
    system_parameter: ClassVar[str]  # the parameter that holds the system id, read at the start
    protocol_versions: ClassVar[tuple[int, int, int] | None] = None  # spoken, least, most; None: it does not say
    standard_modes: ClassVar[Mapping[str, int]] = {}  # MAV_STANDARD_MODE by name; empty: modes are not listed
    event_names: ClassVar[tuple[EventName, ...]] = ()  # empty: it has no events
    metadata: ClassVar[Metadata | None] = None
    file_sessions: ClassVar[int] = 1  # files open at once
    files_writable: ClassVar[bool] = False  # clients may keep files of their own, as long as the process lasts
    answers_after_ack: ClassVar[bool] = False  # REQUEST_MESSAGE: the message comes behind the acknowledgement
    vtol_state: ClassVar[int]
    no_mission_total: ClassVar[int]  # MISSION_CURRENT.total without a mission
    gps_fields: ClassVar[GpsFields]
    mode_after_landing: ClassVar[str | None]
    checks_when_armed: ClassVar[Result]  # RUN_PREARM_CHECKS of an armed vehicle
    mode_acks_twice: ClassVar[bool]  # DO_SET_MODE: accepted at once, then the verdict
    set_mode_message_acks: ClassVar[bool]
    answers_ping: ClassVar[bool]
    takeoff_mode: ClassVar[str | None]  # None: taking off is part of the guided mode
    returns_to_setpoints: ClassVar[bool]  # goes back by itself when lost setpoints come again
    position_setpoints_lapse: ClassVar[bool]
    hold_mode: ClassVar[str]
    land_mode: ClassVar[str]
    reposition_mode: ClassVar[str]  # what DO_REPOSITION flies in
    return_mode: ClassVar[str]
    follow_mode: ClassVar[str]
    heartbeat_on_mode_change: ClassVar[bool]
    local_frames: ClassVar[Mapping[int, Literal["local", "offset", "body", "body-velocity"]]]
    global_frames: ClassVar[Mapping[int, Literal["amsl", "home", "ground"]]]
    bad_local_frame: ClassVar[str]  # complaint, with {} for the frame
    bad_global_frame: ClassVar[tuple[int, str]]
    bad_speed: ClassVar[Result]  # DO_CHANGE_SPEED without a speed
    setpoint_complaints: ClassVar[bool]  # texts for setpoints that make no sense

    @abstractmethod
    def limits(self, parameters: ParameterStore) -> Limits:
        """The numbers to fly by; called again whenever a parameter has changed."""

    @abstractmethod
    def failsafes(self, parameters: ParameterStore) -> Failsafes:
        """What is done about losses, as the present parameters have it."""

    def prearm(self, flight: Flight, parameters: ParameterStore) -> tuple[str, ...]:
        """Checks that keep the vehicle from being armed, where the autopilot says them of its own accord."""
        return ()

    def estimator_flags(self, flight: Flight) -> int:
        """EKF_STATUS_REPORT.flags."""
        return 0

    def battery_volts(self, flight: Flight, parameters: ParameterStore) -> float:
        """What the battery's voltage is said to be."""
        return flight.battery_v

    def pretended_battery(self, parameters: ParameterStore) -> BatteryPlan | None:
        """The battery that the autopilot's own simulation makes up, when its parameters ask for one."""
        return None

    def wind(self, flight: Flight) -> tuple[float, float, float] | None:
        """Degrees that the wind comes from, its speed and its speed downwards, as the estimator has them, if it has."""
        return None

    @abstractmethod
    def ready(self, flight: Flight) -> bool:
        """Whether the vehicle could be armed in its present mode."""

    @abstractmethod
    def knows_place(self, flight: Flight) -> bool:
        """Whether navigation has found the position, so that home can be set."""

    @abstractmethod
    def heartbeat(self, flight: Flight, has_setpoints: bool) -> tuple[int, int]:
        """base_mode and system_status."""

    @abstractmethod
    def sensors(self, flight: Flight) -> SensorBits:
        """Health of SYS_STATUS."""

    @abstractmethod
    def refuse_arming(self, flight: Flight, parameters: ParameterStore, forced: bool, has_setpoints: bool) -> Refusal | None:
        """Why the vehicle may not be armed now; None when it may."""

    @abstractmethod
    def refuse_disarming(self, flight: Flight, forced: bool) -> Refusal | None:
        """Why the vehicle may not be disarmed now."""

    @abstractmethod
    def refuse_arm_value(self, value: float) -> Refusal | None:
        """Why the first parameter of ARM_DISARM makes no sense."""

    @abstractmethod
    def refuse_mode(self, flight: Flight, wanted: Mode | None, number: int, has_setpoints: bool) -> Refusal | None:
        """Why the mode may not be entered; `wanted` is None for a number that is no mode."""

    @abstractmethod
    def mode_number(self, command: Command) -> int | None:
        """The custom mode that a DO_SET_MODE asks for, or None when it is not one."""

    @abstractmethod
    def refuse_takeoff(self, flight: Flight, command: Command) -> Refusal | None:
        """Why the takeoff command is refused."""

    @abstractmethod
    def takeoff_altitude_m(self, flight: Flight, command: Command, limits: Limits) -> float | None:
        """AMSL altitude that a takeoff command asks for; None for the default height."""

    @abstractmethod
    def refuse_reposition(self, flight: Flight, command: Command) -> Refusal | None:
        """Why a DO_REPOSITION is refused."""

    @abstractmethod
    def altitude_amsl_m(self, flight: Flight, frame: int | None, altitude_m: float) -> float:
        """AMSL altitude that a command's seventh parameter means."""

    @abstractmethod
    def is_station(self, system: int, parameters: ParameterStore) -> bool:
        """Whether heartbeats of this system count as the ground station's."""

    @abstractmethod
    def refuse_home(self, flight: Flight, command: Command) -> Refusal | None:
        """Why a DO_SET_HOME is refused."""

    def answer(self, flight: Flight, command: Command) -> Answer | None:
        """Result and texts of a command that nobody carries out but that depends on the state; None: `fixed_results`."""
        return None

    def mode(self, name: str) -> Mode:
        """The mode of that name; KeyError when there is none."""
        for mode in self.modes:
            if mode.name == name:
                return mode
        raise KeyError(name)

    def mode_of(self, custom: int) -> Mode | None:
        return next((mode for mode in self.modes if mode.custom == custom), None)

    def files(self, parameters: ParameterStore) -> Mapping[str, Content]:
        """What MAVLink FTP serves."""
        return self.metadata.contents() if self.metadata else {}

    def boot_texts(self, flight: Flight) -> Sequence[tuple[Seconds, int, str]]:
        """What is said while starting: seconds, severity, text; in order."""
        return ()
