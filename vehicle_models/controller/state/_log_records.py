"""What a flight log is made of: samples at a steady rate, and notes between them."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple, Protocol

from ._flight_state import Cause, FlightState, GpsQuality, ReferencePoint
from ._parameter_store import Parameter

CAUSES = tuple(Cause)
_NUMBER_OF_CAUSE: dict[Cause | None, int] = {
    None: 0,
    **{cause: number for number, cause in enumerate(CAUSES, start=1)},
}


class FlightSample(NamedTuple):
    """The vehicle at one moment, as its flight controller knows it: local NED in metres, m/s and radians; degrees
    times 1e7; altitudes above mean sea level. Targets are NaN where nothing is controlled.
    """

    time_us: int
    mode: int
    """FlightMode.custom."""
    armed: bool
    flying: bool
    on_ground: bool
    gps_ok: bool
    position_ok: bool
    cause: int
    """0, or the number of the failsafe's cause in `CAUSES`, counted from 1."""
    gps_epoch: int
    north_m: float
    east_m: float
    down_m: float
    vn_mps: float
    ve_mps: float
    vd_mps: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    p_radps: float
    q_radps: float
    r_radps: float
    latitude_e7: int
    longitude_e7: int
    altitude_m: float
    fix_latitude_e7: int
    fix_longitude_e7: int
    fix_altitude_m: float
    battery_v: float
    battery_a: float
    battery_used_mah: float
    battery_used_wh: float
    battery_fraction: float
    target_north_m: float
    target_east_m: float
    target_down_m: float
    target_vn_mps: float
    target_ve_mps: float
    target_vd_mps: float
    target_yaw_rad: float


SAMPLE = struct.Struct("<QI5?BI12f2if2if5f7f")
_NOWHERE = (math.nan, math.nan)
# Fields that the state has under the same names; and `mode`, which has its number.
_STATE = attrgetter("time_us", "mode.custom", "armed", "flying", "on_ground", "gps_ok", "position_ok")
_FIELDS = FlightSample._fields
_MOTION = attrgetter(*_FIELDS[_FIELDS.index("gps_epoch") : _FIELDS.index("fix_latitude_e7")])


def pack_sample(f: FlightState, battery_v: float, used_mah: float) -> bytes:
    """A `FlightSample` of the present moment, as its bytes: 142 of them, where the tuple would take a kilobyte."""
    target = f.target
    north_m, east_m = target.north_east_m or _NOWHERE
    return SAMPLE.pack(
        *_STATE(f),
        _NUMBER_OF_CAUSE[f.failsafe],
        *_MOTION(f),
        *f.fix_e7,
        f.fix_altitude_m,
        battery_v,
        f.battery_a,
        used_mah,
        f.battery_used_wh,
        f.battery_fraction,
        north_m,
        east_m,
        math.nan if target.down_m is None else target.down_m,
        *target.velocity_ned_mps,
        math.nan if target.yaw_rad is None else target.yaw_rad,
    )


@dataclass(frozen=True, slots=True)
class LoggedText:
    """A STATUSTEXT."""

    time_us: int
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class LoggedParameter:
    """A parameter's new value."""

    time_us: int
    parameter: Parameter
    value: float


@dataclass(frozen=True, slots=True)
class LoggedHome:
    """Home, whenever it is set; at the beginning of a log the one that holds."""

    time_us: int
    home: ReferencePoint


Note = LoggedText | LoggedParameter | LoggedHome


@dataclass(frozen=True, slots=True)
class LogOpening:
    """What holds when a log begins. Times are microseconds; `boot_utc_us` is when the autopilot started, and
    `values` are those of `parameters`.
    """

    time_us: int
    boot_utc_us: int
    origin: ReferencePoint
    vehicle_type: int
    gps: GpsQuality
    parameters: tuple[Parameter, ...]
    values: tuple[float, ...]


class LogEncoder(Protocol):
    """Writes one log in the format of an autopilot, from its beginning on. The bytes depend on what is recorded
    alone, not on when they are asked for.
    """

    def head(self) -> bytes:
        """Everything in front of the first sample."""

    def sample(self, sample: FlightSample) -> bytes: ...

    def note(self, note: Note) -> bytes: ...
