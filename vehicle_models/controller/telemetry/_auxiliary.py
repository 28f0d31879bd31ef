"""Messages that few listen to: remote identification, link counters, and the second and third of every sensor.

SIMSTATE, which tells the truth in a real SITL, tells the estimate here: the truth is not for agents.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from .._flight import Flight
from .._service_context import ServiceContext
from ._terrain import Terrain

Values = tuple[Any, ...]
_STANDARD_GRAVITY_MPS2 = 9.80665
_ODID_EPOCH_US = 1_546_300_800_000_000  # 2019-01-01, from which remote identification counts
_NO_ID = (0,) * 20
_ROTOR_FULL_RPM = 8000.0


class MoreTelemetry:
    """Values in wire order, by name of message; `says` is made part of the telemetry."""

    def __init__(self, board: ServiceContext, imu: Callable[[], Values], pressure: Callable[[], Values]) -> None:
        self._board = board
        self._flight: Flight = board.flight
        self._imu = imu
        self._pressure = pressure
        self._terrain = Terrain(board)

    def says(self) -> Mapping[str, Callable[[], Values | None]]:
        return {
            "LINK_NODE_STATUS": self._link,
            "OPEN_DRONE_ID_LOCATION": self._drone_id_location,
            "OPEN_DRONE_ID_SYSTEM": self._drone_id_system,
            "TIME_ESTIMATE_TO_TARGET": lambda: (-1, -1, -1, -1, -1),  # nothing is estimated
            "SCALED_IMU2": self._scaled_imu,
            "SCALED_IMU3": self._scaled_imu,
            "SCALED_PRESSURE2": lambda: self._pressure(),
            "SIMSTATE": self._simstate,
            "ESC_TELEMETRY_1_TO_4": self._motors,
            "WIND": lambda: self._board.personality.wind(self._flight),
            "TERRAIN_REQUEST": self._terrain.request,
            "TERRAIN_REPORT": self._terrain.report,
        }

    def _link(self) -> Values:
        """Counts of all links together; rates and buffers are not measured."""
        channels = self._board.radio.channels
        sent, received = sum(one.link.sent for one in channels), sum(one.link.received for one in channels)
        return (self._flight.time_ms, 0, 0, sent, received, 0, 0, 0, 0, 0, 0)

    def _drone_id_location(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        utc_us = f.unix_start_us + f.time_us
        past_hour_s = utc_us / 1e6 % 3600.0
        course = round(math.degrees(math.atan2(f.ve_mps, f.vn_mps)) * 100.0) % 36000
        speed = min(round(math.hypot(f.vn_mps, f.ve_mps) * 100.0), 25425)
        climb = min(max(round(-f.vd_mps * 100.0), -6200), 6200)
        heights = (f.altitude_m, f.altitude_m, f.height_m)
        status = 2 if f.flying else 1
        # Above the takeoff; within 1 m, 3 m and (pressure) 3 m; 1 m/s; 0.1 s.
        tail = (status, 0, 12, 5, 5, 3, 1)
        return (f.latitude_e7, f.longitude_e7, *heights, past_hour_s, course, speed, climb, 0, 0, *_NO_ID, *tail)

    def _drone_id_system(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        seconds = max((f.unix_start_us + f.time_us - _ODID_EPOCH_US) // 1_000_000, 0)
        place = (f.home.latitude_e7, f.home.longitude_e7, -1000.0, -1000.0, f.home.altitude_m)
        return (*place, seconds & 0xFFFFFFFF, 1, 0, 0, 0, *_NO_ID, 0, 0, 0, 0)

    def _scaled_imu(self) -> Values:
        _, *values, _, temperature = self._imu()
        return (self._flight.time_ms, *values, temperature)

    def _simstate(self) -> Values:
        f = self._flight
        attitude = (f.roll_rad, f.pitch_rad, f.yaw_rad)
        return (*attitude, *self._board.airframe.specific_force_mps2(), f.p_radps, f.q_radps, f.r_radps, *_place(f))

    def _motors(self) -> Values:
        """Four of them, at the share of a full speed of 8000 rpm that each is given; currents in equal parts."""
        f = self._flight
        outputs = [*self._board.airframe.outputs(), 0.0, 0.0, 0.0, 0.0][:4]
        volts = self._board.personality.battery_volts(f, self._board.parameters)
        turning = sum(one > 0.0 for one in outputs) or 1
        amps = [f.battery_a / turning if one > 0.0 else 0.0 for one in outputs]
        used_mah = round(f.battery_used_wh / 14.8 * 250.0) & 0xFFFF
        count = f.time_ms // 20 & 0xFFFF
        volts_c = (min(max(round(volts * 100.0), 0), 65535),) * 4
        amps_c = [min(max(round(one * 100.0), 0), 65535) for one in amps]
        rpm = [round(max(one, 0.0) * _ROTOR_FULL_RPM) for one in outputs]
        return (*volts_c, *amps_c, *(used_mah,) * 4, *rpm, *(count,) * 4, *(25,) * 4)


def _place(f: Flight) -> tuple[int, int]:
    return f.latitude_e7, f.longitude_e7
