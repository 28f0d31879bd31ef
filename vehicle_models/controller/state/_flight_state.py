"""The state of the vehicle that all services share, and the target that the airframe flies to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum, StrEnum, auto
from typing import Protocol

from bench.contracts import Vector
from bench.values import value_class

from ._shaping import UNSHAPED, MotionShaping

NorthEast = tuple[float, float]
"""A place or a velocity in the local frame: north, east."""


class LandedState(IntEnum):
    """Values of MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


# Looked up once, because `flying` is read many times in a step.
_ON_GROUND = LandedState.ON_GROUND


class Behaviour(Enum):
    """What a mode makes the vehicle do, under whatever name the autopilot has for it."""

    HOLD = auto()
    TAKEOFF = auto()
    LAND = auto()
    RETURN = auto()
    OFFBOARD = auto()  # setpoints of a companion: offboard, guided
    EXTERNAL = auto()  # likewise, in a mode that the companion has registered
    MISSION = auto()
    PILOT = auto()  # sticks, of a radio or a joystick
    CIRCLE = auto()
    FOLLOW_TARGET = auto()  # at a distance from a leader that reports its position
    TERMINATE = auto()  # rotors off, for good


class Cause(StrEnum):
    """Why a failsafe acts. Recordings hold these values."""

    GROUND_STATION = "link"
    SETPOINTS = "setpoints"
    STICKS = "sticks"
    BATTERY = "battery"
    POSITION = "position"
    RADIO = "radio"
    FENCE = "fence"


class StickControl(Enum):
    """What the sticks control in a mode."""

    RATES = auto()
    ATTITUDE = auto()  # tilt, and thrust
    ALTITUDE = auto()  # tilt, and climb
    POSITION = auto()  # speed, and climb; the place is held without


@dataclass(frozen=True, slots=True)
class FlightMode:
    """One mode as an autopilot shows it. `base` are the flags of HEARTBEAT.base_mode without ARMED; a mode that
    `needs_position` cannot be flown without an estimate of it.
    """

    name: str
    custom: int
    base: int
    behaviour: Behaviour
    armable: bool = True
    label: str = ""
    stick: StickControl | None = None
    needs_position: bool = False


@dataclass(frozen=True, slots=True)
class ExternalMode:
    """A mode that a companion has registered: whether it can be flown now, and whether the vehicle can be armed in it."""

    label: str
    runs: bool
    armable: bool
    selectable: bool  # by a user


@dataclass(frozen=True, slots=True)
class StickPositions:
    """Stick positions, -1 to 1: right, forward (nose down), clockwise, up."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    throttle: float = 0.0


@value_class(frozen=True, slots=True)
class TargetAttitude:
    """Attitude or body rates; `thrust` is a share of full, None leaves climbing to the target's velocity."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    thrust: float | None = None
    rates_radps: Vector | None = None  # instead of the attitude


@value_class(frozen=True, slots=True)
class FlightTarget:
    """Where the airframe flies to: local NED metres around the flight's origin, as the vehicle itself
    estimates them.

    A position of None on an axis pair means that the velocity alone counts; beside a position, velocity is
    feed-forward. `yaw_rad` None keeps the heading, turned by `yawrate_radps`. `attitude` takes the place of
    all horizontal motion.
    """

    north_east_m: NorthEast | None = None
    down_m: float | None = None
    velocity_ned_mps: Vector = (0.0, 0.0, 0.0)
    yaw_rad: float | None = None
    yawrate_radps: float = 0.0
    speed_max_mps: float = 5.0
    climb_max_mps: float = 3.0
    descent_max_mps: float = 1.5
    acceleration_ned_mps2: Vector = (0.0, 0.0, 0.0)  # feed-forward
    attitude: TargetAttitude | None = None
    faces_motion: bool = False  # nose where the vehicle goes, as long as it goes somewhere
    turn_max_radps: float = 1.0
    shaping: MotionShaping = UNSHAPED


@dataclass(frozen=True, slots=True)
class ReferencePoint:
    """A place on the ground: degrees and metres above mean sea level, where that is in the local frame, and the
    vehicle's heading when home was set there; NaN without one.
    """

    latitude_e7: int
    longitude_e7: int
    altitude_m: float
    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0
    yaw_rad: float = math.nan


class Airframe(Protocol):
    """What the flight controller needs of the aircraft that it flies."""

    def arm(self) -> None:
        """Let the rotors turn at idle."""

    def disarm(self) -> None:
        """Stop the rotors, wherever that is."""

    def fly(self, target: FlightTarget) -> None:
        """Steer towards `target` during the next step; lifts off when it must."""

    def rest(self) -> None:
        """Stay on the ground at idle."""

    def commanded_attitude(self) -> tuple[float, float, float, float]:
        """Commanded roll, pitch and yaw in radians, and thrust as a share of full thrust."""

    def test_rotor(self, number: int, share: float) -> None:
        """Turn one rotor at a share of its full speed, 0 to 1, disarmed on the ground; 0 stops it."""

    def outputs(self) -> list[float]:
        """Speed of each rotor, 0 to 1."""

    def specific_force_mps2(self) -> Vector:
        """What the accelerometer measures, body FRD."""


@dataclass(slots=True)
class FlightState:
    """The vehicle at the present step: its own estimate of motion, and all that is not motion."""

    step_s: float
    origin: ReferencePoint
    mode: FlightMode
    home: ReferencePoint | None = None
    time_ns: int = 0
    unix_start_us: int = 0
    # Estimate: local NED around the origin, attitude of body FRD, rates in the body.
    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0
    vn_mps: float = 0.0
    ve_mps: float = 0.0
    vd_mps: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    p_radps: float = 0.0
    q_radps: float = 0.0
    r_radps: float = 0.0
    halfway: tuple[
        float, ...
    ] = ()  # attitude, its heading 0 to 2 pi, and rates in the middle of the last step
    latitude_e7: int = 0
    longitude_e7: int = 0
    altitude_m: float = 0.0  # above mean sea level
    fix_e7: tuple[int, int] = (0, 0)  # the receiver's last fix
    fix_altitude_m: float = 0.0
    fix_us: int = 0  # when the receiver took it
    airspeed_mps: float = 0.0
    on_ground: bool = True  # the feet touch
    # Everything else.
    armed: bool = False
    tests_motors: bool = False
    mission_ready: bool = False  # there is a mission, and it can be flown
    landed: LandedState = LandedState.ON_GROUND
    crashed: bool = False
    calibration_failures: tuple[str, ...] = ()  # why calibrations keep the vehicle from being armed
    failsafe: Cause | None = None  # the failsafe that acts, for the latest of its causes
    target: FlightTarget = field(default_factory=FlightTarget)
    charge_fraction: float = 1.0  # of the battery that the vehicle has
    simulated_fraction: float | None = None  # of the battery that the autopilot's simulation makes up
    battery_v: float = 16.0
    battery_a: float = 0.0
    battery_used_wh: float = 0.0
    armed_since_ns: int = 0
    disarmed_by_landing: bool = False  # in the present mode
    gps_epoch: int = 0
    gps_lost_ns: int | None = None  # when the receiver stopped giving fixes
    dead_reckoning_ns: int = 0  # for so long without fixes the estimate of position is continued
    # Where a gimbal holds the camera: clockwise from the nose, and below the horizon. None without a gimbal.
    camera_pan_rad: float | None = None
    camera_tilt_rad: float | None = None
    hover_thrust: float = 0.5  # share of full thrust that carries the vehicle
    sticks: StickPositions | None = None  # None: no pilot
    asked_mode: FlightMode | None = None  # the last that no failsafe has entered
    had_setpoints: bool = False  # a companion has given some since the start
    external_modes: Mapping[str, ExternalMode] = field(default_factory=dict)  # by name of the FlightMode
    companion_objects: bool = False  # to arming, whatever the mode
    rc_us: tuple[int, ...] = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)  # of the radio

    def runs(self, mode: FlightMode) -> bool:
        """Whether an external mode can be flown now."""
        external = self.external_modes.get(mode.name)
        return external is not None and external.runs

    @property
    def battery_fraction(self) -> float:
        """Charge as the autopilot knows it, 0 to 1."""
        return self.charge_fraction if self.simulated_fraction is None else self.simulated_fraction

    @property
    def gps_ok(self) -> bool:
        """Whether the receiver gives fixes."""
        return self.gps_lost_ns is None

    @property
    def position_ok(self) -> bool:
        """Whether the estimate of position counts: without fixes dead reckoning continues it for a while."""
        return self.gps_lost_ns is None or self.time_ns - self.gps_lost_ns < self.dead_reckoning_ns

    @property
    def time_s(self) -> float:
        return self.time_ns * 1e-9

    @property
    def time_ms(self) -> int:
        return self.time_ns // 1_000_000

    @property
    def time_us(self) -> int:
        return self.time_ns // 1000

    @property
    def height_m(self) -> float:
        """Above home, or above the origin while there is no home."""
        return (self.home.down_m if self.home else 0.0) - self.down_m

    @property
    def flying(self) -> bool:
        return self.landed is not _ON_GROUND


@dataclass(frozen=True, slots=True)
class GpsQuality:
    """The fields of GPS_RAW_INT about the quality of a fix."""

    fix_type: int
    eph: int
    epv: int
    h_acc_mm: int
    v_acc_mm: int
    satellites: int = 10
