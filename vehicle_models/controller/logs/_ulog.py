"""ULog, the format of PX4's flight logs (docs.px4.io, "ULog File Format").

A file describes its own topics, so each has the fields that the vehicle knows, under the names and types of PX4's
messages of 1.17, and no others (`ulog.csv`).
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..._read_table import read_table
from ..links._enums import MAV_TYPE
from ..state._flight_state import ReferencePoint
from ..state._log_records import FlightSample, LogEncoder, LoggedHome, LoggedText, LogOpening, Note
from ..state._parameter_store import REAL32, Parameter
from ..telemetry._attitude import attitude_quaternion

_MAGIC = b"ULog\x01\x12\x35\x01"
_HEAD = struct.Struct("<HB")
# Flag bits: the first compatible one says that there are default parameters.
_FLAGS = struct.pack("<40B", 1, *bytes(39))
# Values that hold for the system, and for the present configuration.
_SYSTEM_DEFAULT, _SETUP_DEFAULT = 1, 2
_CODES = {"uint64_t": "Q", "uint32_t": "I", "uint8_t": "B", "bool": "?", "float": "f", "double": "d"}
_STATUS_PERIOD_US, _LANDED_PERIOD_US, _BATTERY_PERIOD_US = 500_000, 1_000_000, 500_000
_DISARMED, _ARMED = 1, 2
_ROTARY_WING, _FIXED_WING = 1, 2
_LOW, _CRITICAL, _EMERGENCY = 1, 2, 3
_CELLS = 4


@dataclass(frozen=True, slots=True)
class _Topic:
    """A topic's fields as ULog types and names; an array counts as one field."""

    name: str
    fields: tuple[str, ...]

    @property
    def definition(self) -> str:
        return f"{self.name}:uint64_t timestamp;" + "".join(f"{field};" for field in self.fields)

    @property
    def packing(self) -> struct.Struct:
        return struct.Struct("<HQ" + "".join(_code(field) for field in self.fields))


def _code(field: str) -> str:
    kind, _, count = field.partition(" ")[0].partition("[")
    return _CODES[kind] * int(count.rstrip("]") or 1)


_ROWS = read_table(Path(__file__).with_name("ulog.csv"))
_TOPICS = tuple(
    _Topic(topic, tuple(f"{row['type']} {row['field']}" for row in rows))
    for topic, rows in itertools.groupby(_ROWS, key=lambda row: row["topic"])
)
_PACKINGS = {topic.name: topic.packing for topic in _TOPICS}
_NUMBERS = {topic.name: number for number, topic in enumerate(_TOPICS)}


@dataclass(frozen=True, slots=True, kw_only=True)
class UlogIdentity:
    """What a ULog says about the autopilot: versions, and `nav_state` by FlightMode.custom.

    `thresholds` are the parameters below which the battery is low, critical and an emergency.
    """

    system: str
    hardware: str
    release: int
    git_hash: str
    system_uuid: str
    nav_states: Mapping[int, int]
    thresholds: tuple[str, str, str]


class UlogEncoder(LogEncoder):
    """One ULog file."""

    def __init__(self, identity: UlogIdentity, opening: LogOpening) -> None:
        self._identity = identity
        self._opening = opening
        self._values = {
            parameter.name: value for parameter, value in zip(opening.parameters, opening.values, strict=True)
        }
        self._gps_epoch = -1
        self._armed_us = self._mode_us = 0
        self._status: tuple[object, ...] = ()
        self._landed: tuple[bool, bool] | None = None
        self._status_us = self._landed_us = self._battery_us = -math.inf

    def head(self) -> bytes:
        opening = self._opening
        parts = [_MAGIC + struct.pack("<Q", opening.time_us), _message("B", _FLAGS)]
        parts += (_message("I", entry) for entry in self._information())
        parts += (_message("F", topic.definition.encode()) for topic in _TOPICS)
        for parameter, value in zip(opening.parameters, opening.values, strict=True):
            parts.append(_parameter(parameter, value))
            if value != parameter.default:
                parts.append(_default(parameter))
        parts += (
            _message("A", struct.pack("<BH", 0, number) + name.encode()) for name, number in _NUMBERS.items()
        )
        return b"".join(parts)

    def sample(self, sample: FlightSample) -> bytes:
        return b"".join(self._topics(sample))

    def note(self, note: Note) -> bytes:
        if isinstance(note, LoggedText):
            level = ord("0") + note.severity
            return _message(
                "L", struct.pack("<BQ", level, note.time_us) + note.text.encode("ascii", "replace")
            )
        if isinstance(note, LoggedHome):
            return self._home(note.time_us, note.home)
        self._values[note.parameter.name] = note.value
        return _parameter(note.parameter, note.value)

    def _information(self) -> Iterator[bytes]:
        identity = self._identity
        for key, text in (
            ("sys_name", identity.system),
            ("ver_hw", identity.hardware),
            ("ver_sw", identity.git_hash),
            ("sys_os_name", "Linux"),
            ("sys_uuid", identity.system_uuid),
        ):
            yield _keyed(f"char[{len(text)}] {key}", text.encode())
        yield _keyed("uint32_t ver_sw_release", struct.pack("<I", identity.release))
        yield _keyed("int32_t time_ref_utc", struct.pack("<i", 0))

    def _topics(self, s: FlightSample) -> Iterator[bytes]:
        origin = self._opening.origin
        at, ok, reckoned = s.time_us, s.position_ok, not s.gps_ok
        yield _data(at, "vehicle_attitude", *attitude_quaternion(s.roll_rad, s.pitch_rad, s.yaw_rad))
        yield _data(at, "vehicle_angular_velocity", s.p_radps, s.q_radps, s.r_radps)
        place = (s.north_m, s.east_m, s.down_m, s.vn_mps, s.ve_mps, s.vd_mps, s.yaw_rad)
        reference = (origin.latitude_e7 * 1e-7, origin.longitude_e7 * 1e-7, origin.altitude_m)
        valid = (ok, True, ok, True, ok, True, reckoned)
        yield _data(at, "vehicle_local_position", *place, *reference, *valid)
        if s.flying:
            target = (s.target_north_m, s.target_east_m, s.target_down_m)
            velocity = (s.target_vn_mps, s.target_ve_mps, s.target_vd_mps)
            yield _data(at, "vehicle_local_position_setpoint", *target, *velocity, s.target_yaw_rad)
        degrees = (s.latitude_e7 * 1e-7, s.longitude_e7 * 1e-7)
        yield _data(at, "vehicle_global_position", *degrees, s.altitude_m, ok, True, reckoned)
        if s.gps_ok and s.gps_epoch != self._gps_epoch:
            self._gps_epoch = s.gps_epoch
            fix = self._fix(s)
            yield _data(at, "vehicle_gps_position", *fix)
            yield _data(at, "sensor_gps", *fix)
        yield from self._states(s)

    def _states(self, s: FlightSample) -> Iterator[bytes]:
        """Topics that come on a change, and now and then without one."""
        nav_state = self._identity.nav_states[s.mode]
        status = (s.armed, nav_state, s.cause > 0)
        if status != self._status or s.time_us - self._status_us >= _STATUS_PERIOD_US:
            if self._status[1:2] != (nav_state,):
                self._mode_us = s.time_us
            if not s.armed:
                self._armed_us = 0
            elif not self._armed_us:
                self._armed_us = s.time_us
            self._status, self._status_us = status, s.time_us
            vehicle_type = self._opening.vehicle_type
            family = _FIXED_WING if vehicle_type == MAV_TYPE.FIXED_WING else _ROTARY_WING
            values = (self._armed_us, self._mode_us, _ARMED if s.armed else _DISARMED, nav_state)
            yield _data(s.time_us, "vehicle_status", *values, family, vehicle_type, s.cause > 0)
        landed = (not s.flying, s.on_ground)
        if landed != self._landed or s.time_us - self._landed_us >= _LANDED_PERIOD_US:
            self._landed, self._landed_us = landed, s.time_us
            yield _data(s.time_us, "vehicle_land_detected", *landed)
        if s.time_us - self._battery_us >= _BATTERY_PERIOD_US:
            self._battery_us = s.time_us
            charge = (s.battery_v, s.battery_a, s.battery_used_mah, s.battery_fraction)
            yield _data(s.time_us, "battery_status", *charge, _CELLS, self._warning(s.battery_fraction), True)

    def _warning(self, fraction: float) -> int:
        low, critical, emergency = (self._values[name] for name in self._identity.thresholds)
        if fraction < emergency:
            return _EMERGENCY
        if fraction < critical:
            return _CRITICAL
        return _LOW if fraction < low else 0

    def _fix(self, s: FlightSample) -> tuple[float, ...]:
        gps = self._opening.gps
        course_rad = math.atan2(s.ve_mps, s.vn_mps)
        return (
            s.fix_latitude_e7 * 1e-7,
            s.fix_longitude_e7 * 1e-7,
            # Height above the ellipsoid is not modelled: the same, as in the receiver of PX4's own simulation.
            s.fix_altitude_m,
            s.fix_altitude_m,
            gps.h_acc_mm * 1e-3,
            gps.v_acc_mm * 1e-3,
            gps.eph * 1e-2,
            gps.epv * 1e-2,
            math.hypot(s.vn_mps, s.ve_mps),
            s.vn_mps,
            s.ve_mps,
            s.vd_mps,
            course_rad,
            self._opening.boot_utc_us + s.time_us,
            gps.fix_type,
            gps.satellites,
            True,
        )

    def _home(self, time_us: int, home: ReferencePoint) -> bytes:
        degrees = (home.latitude_e7 * 1e-7, home.longitude_e7 * 1e-7)
        local = (home.altitude_m, home.north_m, home.east_m, home.down_m, home.yaw_rad)
        return _data(time_us, "home_position", *degrees, *local, True, True, True)


def message_starts(data: bytes) -> list[int]:
    """Where the messages begin in a run of whole messages."""
    starts, place = [], 0
    while place < len(data):
        starts.append(place)
        place += _HEAD.size + _HEAD.unpack_from(data, place)[0]
    return starts


HEADER_BYTES = len(_MAGIC) + 8
"""In front of the first message of a file."""


def _message(kind: str, content: bytes) -> bytes:
    return _HEAD.pack(len(content), ord(kind)) + content


def _data(time_us: int, topic: str, *values: float) -> bytes:
    return _message("D", _PACKINGS[topic].pack(_NUMBERS[topic], time_us, *values))


def _keyed(key: str, value: bytes) -> bytes:
    return bytes([len(key)]) + key.encode() + value


def _parameter(parameter: Parameter, value: float) -> bytes:
    return _message("P", _parameter_entry(parameter, value))


def _default(parameter: Parameter) -> bytes:
    kinds = bytes([_SYSTEM_DEFAULT | _SETUP_DEFAULT])
    return _message("Q", kinds + _parameter_entry(parameter, float(parameter.default)))


def _parameter_entry(parameter: Parameter, value: float) -> bytes:
    if parameter.kind == REAL32:
        return _keyed(f"float {parameter.name}", struct.pack("<f", value))
    return _keyed(f"int32_t {parameter.name}", struct.pack("<i", int(value)))
