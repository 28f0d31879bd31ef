"""The one state of the vehicle that every service of the flight controller reads, and what it wants of the airframe."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum, auto
from typing import Protocol

from bench.contracts import Vector


class Landed(IntEnum):
    """Values of MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKING_OFF = 3
    LANDING = 4


class Behaviour(Enum):
    """What a mode makes the vehicle do, whatever an autopilot calls it."""

    HOLD = auto()
    TAKEOFF = auto()
    LAND = auto()
    RETURN = auto()
    FOLLOW = auto()  # setpoints of a companion: offboard, guided
    MISSION = auto()
    PILOT = auto()  # needs sticks, which nobody holds here


@dataclass(frozen=True, slots=True)
class Mode:
    """One mode as an autopilot shows it. `base` are the flags of HEARTBEAT.base_mode without ARMED."""

    name: str
    custom: int
    base: int
    behaviour: Behaviour
    armable: bool = True
    label: str = ""


@dataclass(frozen=True, slots=True)
class Target:
    """Where the airframe shall go: local NED metres around the flight's origin, as the vehicle itself estimates them.

    A position of None on an axis pair means that the velocity alone is meant; beside a position, velocity is feed-forward.
    `yaw_rad` None keeps the heading, turned by `yawrate_radps`.
    """

    north_east_m: tuple[float, float] | None = None
    down_m: float | None = None
    velocity_ned_mps: Vector = (0.0, 0.0, 0.0)
    yaw_rad: float | None = None
    yawrate_radps: float = 0.0
    speed_max_mps: float = 5.0
    climb_max_mps: float = 3.0
    descent_max_mps: float = 1.5


@dataclass(frozen=True, slots=True)
class Home:
    """A place on the ground: degrees and metres above mean sea level, and where that is in the local frame."""

    latitude_e7: int
    longitude_e7: int
    altitude_m: float
    north_m: float = 0.0
    east_m: float = 0.0
    down_m: float = 0.0


class Airframe(Protocol):
    """What the flight controller may ask of the aircraft that it flies."""

    def arm(self) -> None:
        """Let the rotors turn at idle."""

    def disarm(self) -> None:
        """Stop the rotors, wherever that is."""

    def fly(self, target: Target) -> None:
        """Steer towards `target` during the next step; lifts off when it must."""

    def rest(self) -> None:
        """Stay on the ground at idle."""

    def outputs(self) -> list[float]:
        """Speed of each rotor, 0 to 1."""

    def specific_force_mps2(self) -> Vector:
        """What the accelerometer feels, body FRD."""

    def to_geodetic_e7(self, north_m: float, east_m: float) -> tuple[int, int]:
        """Latitude and longitude of a local place, in 1e-7 degree."""

    def to_local_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east of a geodetic place in the local frame."""


@dataclass(slots=True)
class Flight:
    """The vehicle at the present step: its own estimate of motion, and everything about it that is not motion."""

    step_s: float
    origin: Home
    mode: Mode
    home: Home | None = None
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
    latitude_e7: int = 0
    longitude_e7: int = 0
    altitude_m: float = 0.0  # above mean sea level
    fix_e7: tuple[int, int] = (0, 0)  # the receiver's last fix
    fix_altitude_m: float = 0.0
    airspeed_mps: float = 0.0
    on_ground: bool = True  # the feet touch
    # Everything else.
    armed: bool = False
    landed: Landed = Landed.ON_GROUND
    crashed: bool = False
    failsafe: str = ""
    target: Target = field(default_factory=Target)
    battery_fraction: float = 1.0
    battery_v: float = 16.0
    battery_a: float = 0.0
    battery_used_wh: float = 0.0
    armed_since_ns: int = 0
    gps_epoch: int = 0

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
        return self.landed is not Landed.ON_GROUND
