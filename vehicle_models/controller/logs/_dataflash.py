"""DataFlash, the format of ArduPilot's flight logs (ardupilot.org, "Diagnosing problems using Logs").

A file describes its own messages (FMT, FMTU, UNIT, MULT). Each has the columns that the vehicle knows, under the
names of ArduCopter 4.6 and with its units, and no others (`dataflash.csv`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..._read_table import read_table
from ..state._flight_state import Cause, ReferencePoint
from ..state._log_records import CAUSES, FlightSample, LogEncoder, LoggedHome, LoggedText, LogOpening, Note

_MARK = b"\xa3\x95"
_FMT_NUMBER = 128
_FMT = struct.Struct("<BB4s16s64s")
_CODES = {
    "B": "B",
    "c": "h",
    "C": "H",
    "d": "d",
    "b": "b",
    "e": "i",
    "f": "f",
    "H": "H",
    "I": "I",
    "L": "i",
    "M": "B",
    "N": "16s",
    "Q": "Q",
    "Z": "64s",
}
# By the letters of FMTU; what is not here has no unit or multiplier.
_UNITS = {
    "s": "s",
    "d": "deg",
    "D": "deglatitude",
    "U": "deglongitude",
    "m": "m",
    "n": "m/s",
    "v": "V",
    "A": "A",
    "a": "Ah",
    "J": "W.s",
    "h": "degheading",
    "E": "rad/s",
    "S": "satellites",
    "#": "instance",
    "%": "%",
}
_MULTIPLIERS = {"F": 1e-6, "C": 1e-3, "B": 1e-2, "G": 1e-7, "0": 1.0, "!": 3.6e3}

# Seconds between the epochs of UTC and GPS time, and the leap seconds that GPS time has not taken (since 2017).
_GPS_EPOCH_S, _LEAP_S, _WEEK_S = 315_964_800, 18, 604_800
_EKF3 = 3
_BATTERY_PERIOD_US = 100_000

# LogEvent of EV
_EV_ARMED, _EV_DISARMED, _EV_LAND_COMPLETE, _EV_NOT_LANDED, _EV_SET_HOME = 10, 11, 18, 28, 25
# LogErrorSubsystem of ERR, and its codes
_ERR_SUBSYSTEMS = {
    Cause.RADIO: 5,
    Cause.STICKS: 5,
    Cause.BATTERY: 6,
    Cause.GROUND_STATION: 8,
    Cause.FENCE: 9,
    Cause.POSITION: 17,
}
_ERR_RESOLVED, _ERR_FAILSAFE = 0, 1
_ORIGIN_OF_EKF, _ORIGIN_HOME = 0, 1


@dataclass(frozen=True, slots=True)
class _Message:
    """A message: one letter for each column's type, unit and multiplier."""

    name: str
    types: str
    columns: str
    units: str
    multipliers: str

    @property
    def packing(self) -> struct.Struct:
        return struct.Struct("<" + "".join(_CODES[letter] for letter in self.types))


_MESSAGES = tuple(
    _Message(row["message"], row["types"], row["columns"], row["units"], row["multipliers"])
    for row in read_table(Path(__file__).with_name("dataflash.csv"))
)
_NUMBERS = {message.name: number for number, message in enumerate(_MESSAGES, start=1)}
_PACKINGS = {message.name: message.packing for message in _MESSAGES}


class DataflashEncoder(LogEncoder):
    """One DataFlash file. `banner` are texts about version and frame, by which readers tell the vehicle."""

    def __init__(self, banner: tuple[str, ...], opening: LogOpening) -> None:
        self._banner = banner
        self._opening = opening
        self._home_m = opening.origin.altitude_m
        self._gps_epoch = -1
        self._mode: int | None = None
        self._armed = self._flying = False
        self._cause = 0
        self._battery_us = -math.inf

    def head(self) -> bytes:
        time_us = self._opening.time_us
        parts = [_format("FMT", _FMT_NUMBER, "BBnNZ", "Type,Length,Name,Format,Columns", 3 + _FMT.size)]
        for message in _MESSAGES:
            number, length = _NUMBERS[message.name], 3 + message.packing.size
            parts.append(_format(message.name, number, message.types, message.columns, length))
        for letter, unit in _UNITS.items():
            parts.append(_row("UNIT", time_us, ord(letter), unit.encode()))
        for letter, factor in _MULTIPLIERS.items():
            parts.append(_row("MULT", time_us, ord(letter), factor))
        for message in _MESSAGES:
            number = _NUMBERS[message.name]
            parts.append(_row("FMTU", time_us, number, message.units.encode(), message.multipliers.encode()))
        for parameter, value in zip(self._opening.parameters, self._opening.values, strict=True):
            parts.append(_row("PARM", time_us, parameter.name.encode(), value, parameter.default))
        parts += (_row("MSG", time_us, text.encode()) for text in self._banner)
        parts.append(_origin(time_us, _ORIGIN_OF_EKF, self._opening.origin))
        return b"".join(parts)

    def sample(self, sample: FlightSample) -> bytes:
        return b"".join((*self._events(sample), *self._rows(sample)))

    def note(self, note: Note) -> bytes:
        if isinstance(note, LoggedText):
            return _row("MSG", note.time_us, note.text.encode("ascii", "replace"))
        if isinstance(note, LoggedHome):
            self._home_m = note.home.altitude_m
            return _row("EV", note.time_us, _EV_SET_HOME) + _origin(note.time_us, _ORIGIN_HOME, note.home)
        parameter = note.parameter
        return _row("PARM", note.time_us, parameter.name.encode(), note.value, parameter.default)

    def _events(self, s: FlightSample) -> Iterator[bytes]:
        at = s.time_us
        if s.armed != self._armed:
            self._armed = s.armed
            yield _row("EV", at, _EV_ARMED if s.armed else _EV_DISARMED)
        if s.mode != self._mode:
            self._mode = s.mode
            yield _row("MODE", at, s.mode, s.mode, 0)
        if s.flying != self._flying:
            self._flying = s.flying
            yield _row("EV", at, _EV_NOT_LANDED if s.flying else _EV_LAND_COMPLETE)
        if s.cause != self._cause:
            for cause, code in ((self._cause, _ERR_RESOLVED), (s.cause, _ERR_FAILSAFE)):
                subsystem = _ERR_SUBSYSTEMS.get(CAUSES[cause - 1]) if cause else None
                if subsystem is not None:
                    yield _row("ERR", at, subsystem, code)
            self._cause = s.cause

    def _rows(self, s: FlightSample) -> Iterator[bytes]:
        at, origin_m = s.time_us, self._opening.origin.altitude_m
        degrees = (math.degrees(s.roll_rad), math.degrees(s.pitch_rad), math.degrees(s.yaw_rad) % 360.0)
        yield _row("ATT", at, *degrees, _EKF3)
        yield _row("RATE", at, *(math.degrees(rate) for rate in (s.p_radps, s.q_radps, s.r_radps)))
        if s.position_ok:
            heights = (s.altitude_m, s.altitude_m - self._home_m, s.altitude_m - origin_m)
            yield _row("POS", at, s.latitude_e7, s.longitude_e7, *heights)
        velocity, place = (s.vn_mps, s.ve_mps, s.vd_mps), (s.north_m, s.east_m, s.down_m)
        yield _row("XKF1", at, 0, *velocity, *place)
        if s.gps_ok and s.gps_epoch != self._gps_epoch:
            self._gps_epoch = s.gps_epoch
            yield self._fix(s)
        if at - self._battery_us >= _BATTERY_PERIOD_US:
            self._battery_us = at
            used = (s.battery_used_mah, s.battery_used_wh)
            percent = min(max(round(100.0 * s.battery_fraction), 0), 100)
            yield _row("BAT", at, 0, s.battery_v, s.battery_a, *used, percent)

    def _fix(self, s: FlightSample) -> bytes:
        gps = self._opening.gps
        gps_ms = (self._opening.boot_utc_us + s.time_us) // 1000 + (_LEAP_S - _GPS_EPOCH_S) * 1000
        week, week_ms = divmod(gps_ms, _WEEK_S * 1000)
        head = (0, gps.fix_type, week_ms, week & 0xFFFF, gps.satellites, gps.eph * 1e-2)
        place = (s.fix_latitude_e7, s.fix_longitude_e7, s.fix_altitude_m)
        course_deg = math.degrees(math.atan2(s.ve_mps, s.vn_mps)) % 360.0
        return _row("GPS", s.time_us, *head, *place, math.hypot(s.vn_mps, s.ve_mps), course_deg, s.vd_mps)


def _format(name: str, number: int, types: str, columns: str, length: int) -> bytes:
    entry = _FMT.pack(number, length, name.encode(), types.encode(), columns.encode())
    return _MARK + bytes([_FMT_NUMBER]) + entry


def _row(name: str, *values: float | bytes) -> bytes:
    return _MARK + bytes([_NUMBERS[name]]) + _PACKINGS[name].pack(*values)


def _origin(time_us: int, kind: int, place: ReferencePoint) -> bytes:
    return _row("ORGN", time_us, kind, place.latitude_e7, place.longitude_e7, place.altitude_m)
