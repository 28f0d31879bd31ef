"""Remote identification: the messages of Open Drone ID."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..state._service import Stream, Values
from ..state._service_context import ServiceContext

# 2019-01-01, from which Open Drone ID counts.
_EPOCH_US = 1_546_300_800_000_000
_NO_ID = (0,) * 20
# MAV_ODID_STATUS
_ON_GROUND, _AIRBORNE = 1, 2
# MAV_ODID_HEIGHT_REF
_OVER_TAKEOFF = 0
# Within 1 m, 3 m and (pressure) 3 m; 1 m/s; 0.1 s.
_ACCURACIES = (12, 5, 5, 3, 1)
_NO_ALTITUDE_M = -1000.0


class RemoteIdentification:
    """Values in wire order; None until home is known."""

    def __init__(self, context: ServiceContext) -> None:
        self._flight = context.flight

    def streams(self) -> Mapping[str, Stream]:
        return {"OPEN_DRONE_ID_LOCATION": self._location, "OPEN_DRONE_ID_SYSTEM": self._system}

    def _location(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        utc_us = f.unix_start_us + f.time_us
        past_hour_s = utc_us / 1e6 % 3600.0
        course = round(math.degrees(math.atan2(f.ve_mps, f.vn_mps)) * 100.0) % 36000
        speed = min(round(math.hypot(f.vn_mps, f.ve_mps) * 100.0), 25425)
        climb = min(max(round(-f.vd_mps * 100.0), -6200), 6200)
        heights = (f.altitude_m, f.altitude_m, f.height_m)
        motion = (past_hour_s, course, speed, climb)
        status = (_AIRBORNE if f.flying else _ON_GROUND, _OVER_TAKEOFF, *_ACCURACIES)
        return (f.latitude_e7, f.longitude_e7, *heights, *motion, 0, 0, *_NO_ID, *status)

    def _system(self) -> Values | None:
        f = self._flight
        if f.home is None:
            return None
        seconds = max((f.unix_start_us + f.time_us - _EPOCH_US) // 1_000_000, 0)
        home = f.home
        place = (home.latitude_e7, home.longitude_e7, _NO_ALTITUDE_M, _NO_ALTITUDE_M, home.altitude_m)
        return (*place, seconds & 0xFFFFFFFF, 1, 0, 0, 0, *_NO_ID, 0, 0, 0, 0)
