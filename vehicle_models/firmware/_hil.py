"""The messages of PX4's simulator link (module simulator_mavlink), in the units and masks that PX4 takes.

Fields and units: MAVLink's common.xml; what PX4 makes of them: docs/real-autopilots.md.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from bench.contracts import Vector

from ..controller.links._frames import Packer
from ._sensors import AirReading

HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_GPS, HIL_STATE_QUATERNION = 93, 107, 113, 115
COMMAND_LONG, SET_MESSAGE_INTERVAL = 76, 511
# HIL_SENSOR.fields_updated. PX4 takes a group of fields only where all its bits are set.
IMU_FIELDS, MAGNETOMETER_FIELDS, BAROMETER_FIELDS = 0x007 | 0x038, 0x1C0, 0x1A00
# System and component of the simulator; PX4 reads neither.
_SYSTEM, _COMPONENT = 1, 51
# Accuracy that the receiver states, in cm: PX4 refuses to fly with more than 3 m and 5 m.
_EPH_CM, _EPV_CM = 90, 120
_FIX_3D, _SATELLITES = 3, 14
_MILLI_G_PER_MPS2 = 1000.0 / 9.80665
_CONTROLS = struct.Struct("<QQ16fB")
_COMMAND = struct.Struct("<7fHBBB")
_ARMED = 0x80


# Not frozen: they are made two hundred times a second, and a frozen one takes thrice the time.
@dataclass(slots=True)
class Place:
    """A place with velocity: 1e-7 degrees, metres above mean sea level, m/s north, east, down."""

    latitude_e7: int
    longitude_e7: int
    altitude_m: float
    velocity_ned_mps: Vector


@dataclass(slots=True)
class ActuatorControls:
    """HIL_ACTUATOR_CONTROLS: outputs 1 to 16, motors 0 to 1; `time_us` is that of the sample it answers."""

    time_us: int
    outputs: tuple[float, ...]
    armed: bool


class HilEncoder:
    """Packs messages of the simulator, with one sequence of numbers for all."""

    def __init__(self) -> None:
        self._pack = Packer(_SYSTEM, _COMPONENT).pack_next

    def sensor(
        self,
        time_us: int,
        imu: tuple[float, ...],
        magnetometer: tuple[float, ...] | None = None,
        air: AirReading | None = None,
    ) -> bytes:
        """HIL_SENSOR of IMU 0, which sets PX4's clock to `time_us` (from the start of the flight)."""
        mask = IMU_FIELDS | (MAGNETOMETER_FIELDS if magnetometer else 0)
        pressure = (0.0, 0.0, 0.0, 0.0)
        if air:
            mask |= BAROMETER_FIELDS
            pressure = (air.pressure_hpa, 0.0, air.pressure_altitude_m, air.temperature_degc)
        return self._pack(HIL_SENSOR, (time_us, *imu, *(magnetometer or (0.0, 0.0, 0.0)), *pressure, mask, 0))

    def gps(self, time_us: int, fix: Place) -> bytes:
        """HIL_GPS of receiver 0."""
        north, east, _ = fix.velocity_ned_mps
        course_cdeg = round(math.degrees(math.atan2(east, north)) % 360.0 * 100.0) % 36000
        speeds = (_uint16(math.hypot(north, east) * 100.0), *_cmps(fix.velocity_ned_mps))
        place = (fix.latitude_e7, fix.longitude_e7, round(fix.altitude_m * 1000.0))
        quality = (course_cdeg, _FIX_3D, _SATELLITES, 0, 0)
        return self._pack(HIL_GPS, (time_us, *place, _EPH_CM, _EPV_CM, *speeds, *quality))

    def state(
        self,
        time_us: int,
        attitude: tuple[float, float, float, float],
        rates_radps: Vector,
        place: Place,
        airspeed_mps: float,
        specific_force_mps2: Vector,
    ) -> bytes:
        """HIL_STATE_QUATERNION: the truth, for PX4's log. What 16 bits do not hold is cut: an impact has more than 32.7 g."""
        airspeed_cmps = _uint16(airspeed_mps * 100.0)
        x, y, z = specific_force_mps2
        forces = (_int16(x * _MILLI_G_PER_MPS2), _int16(y * _MILLI_G_PER_MPS2), _int16(z * _MILLI_G_PER_MPS2))
        head = (time_us, *attitude, *rates_radps, place.latitude_e7, place.longitude_e7)
        motion = (round(place.altitude_m * 1000.0), *_cmps(place.velocity_ned_mps))
        return self._pack(HIL_STATE_QUATERNION, (*head, *motion, airspeed_cmps, airspeed_cmps, *forces))


def actuator_controls(frame: bytes) -> ActuatorControls:
    """Decode a whole MAVLink 2 frame of HIL_ACTUATOR_CONTROLS."""
    time_us, _, *rest = _unpacked(_CONTROLS, frame)
    return ActuatorControls(int(time_us), tuple(rest[:16]), bool(int(rest[16]) & _ARMED))


def truth_interval_us(frame: bytes) -> int | None:
    """The interval in which a COMMAND_LONG asks for HIL_STATE_QUATERNION; None where it asks for something else."""
    message, interval_us, *_, command, _, _, _ = _unpacked(_COMMAND, frame)
    return int(interval_us) if (command, message) == (SET_MESSAGE_INTERVAL, HIL_STATE_QUATERNION) else None


def _unpacked(layout: struct.Struct, frame: bytes) -> tuple[float, ...]:
    # MAVLink 2 leaves out zeros at the end.
    return layout.unpack(frame[10 : 10 + frame[1]][: layout.size].ljust(layout.size, b"\0"))


def _cmps(velocity_mps: Vector) -> tuple[int, int, int]:
    north, east, down = velocity_mps
    return _int16(north * 100.0), _int16(east * 100.0), _int16(down * 100.0)


def _int16(value: float) -> int:
    whole = round(value)
    return whole if -32768 <= whole <= 32767 else -32768 if whole < 0 else 32767


def _uint16(value: float) -> int:
    return min(round(value), 65535)
