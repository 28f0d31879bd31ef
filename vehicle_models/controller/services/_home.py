"""Home and the origin of the local frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .._flight import Home
from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext

DO_SET_HOME, GET_HOME_POSITION = 179, 410


class HomeKeeper:
    """Where home is: set when the position is first known, at every arming, and by DO_SET_HOME."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {DO_SET_HOME: self._set, GET_HOME_POSITION: self._get}

    def tick(self) -> None:
        if self._board.flight.home is None and self._board.personality.knows_place(self._board.flight):
            self.set_here()
            self._board.radio.broadcast("GPS_GLOBAL_ORIGIN", **origin_fields(self._board))

    def set_here(self) -> None:
        """Home is where the vehicle believes to stand; on the ground at the ground's height."""
        flight = self._board.flight
        down = flight.down_m if flight.flying else 0.0
        self._keep(flight.latitude_e7, flight.longitude_e7, flight.origin.altitude_m - down, flight.north_m, flight.east_m)

    def _keep(self, latitude_e7: int, longitude_e7: int, altitude_m: float, north_m: float, east_m: float) -> None:
        flight = self._board.flight
        down_m = flight.origin.altitude_m - altitude_m
        flight.home = Home(latitude_e7, longitude_e7, altitude_m, north_m, east_m, down_m)
        self._board.radio.broadcast("HOME_POSITION", **home_fields(self._board))

    def _set(self, command: Command) -> Result | None:
        refusal = self._board.personality.refuse_home(self._board.flight, command)
        if refusal:
            return refusal.result
        if command.params[0] == 1.0:
            self.set_here()
            return Result.ACCEPTED
        latitude, longitude, altitude = command.params[4:7]
        if not (abs(latitude) <= 90 and abs(longitude) <= 180 and math.isfinite(altitude) and abs(altitude) < 1e5):
            return Result.DENIED
        north, east = self._board.airframe.to_local_m(latitude, longitude)
        altitude = self._board.personality.altitude_amsl_m(self._board.flight, command.frame, altitude)
        self._keep(round(latitude * 1e7), round(longitude * 1e7), altitude, north, east)
        return Result.ACCEPTED

    def _get(self, command: Command) -> Result | None:
        if self._board.flight.home is None:
            return Result.FAILED
        command.sender.channel.tell("HOME_POSITION", **home_fields(self._board))
        return Result.ACCEPTED


def home_fields(board: ServiceContext) -> dict[str, Any]:
    """Fields of HOME_POSITION. The attitude at home and the way in are not known, which NaN and zeros say."""
    home = board.flight.home or board.flight.origin
    return {
        "latitude": home.latitude_e7,
        "longitude": home.longitude_e7,
        "altitude": round(home.altitude_m * 1000),
        "x": home.north_m,
        "y": home.east_m,
        "z": home.down_m,
        "q": (math.nan,) * 4,
        "approach_x": math.nan,
        "approach_y": math.nan,
        "approach_z": math.nan,
        "time_usec": board.flight.time_us,
    }


def origin_fields(board: ServiceContext) -> dict[str, Any]:
    """Fields of GPS_GLOBAL_ORIGIN."""
    origin = board.flight.origin
    return {
        "latitude": origin.latitude_e7,
        "longitude": origin.longitude_e7,
        "altitude": round(origin.altitude_m * 1000),
        "time_usec": board.flight.time_us,
    }
