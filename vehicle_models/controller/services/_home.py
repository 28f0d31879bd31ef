"""Home and the origin of the local frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ..links._enums import MAV_CMD
from ..links._frames import KINDS
from ..policies._commands import CommandPolicy
from ..state._flight_state import FlightState, ReferencePoint
from ..state._service import (
    Command,
    CommandHandler,
    CommandResult,
    MessageHandler,
    MessageSender,
    Stream,
    Values,
)
from ..state._service_context import ServiceContext
from ..telemetry._attitude import attitude_quaternion

_HOME_POSITION, _GPS_GLOBAL_ORIGIN = KINDS["HOME_POSITION"].id, KINDS["GPS_GLOBAL_ORIGIN"].id
_NO_ATTITUDE = (math.nan,) * 4
# Both autopilots send zeros here (source), not the NaN that MAVLink has for an unknown approach.
_NO_APPROACH = (0.0,) * 3


class HomeKeeper:
    """Sets home when the position is first known, at every arming, and by DO_SET_HOME."""

    def __init__(
        self, context: ServiceContext, policy: CommandPolicy, knows_position: Callable[[FlightState], bool]
    ) -> None:
        self._context = context
        self._policy = policy
        self._knows_position = knows_position

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.DO_SET_HOME: self._set_home, MAV_CMD.GET_HOME_POSITION: self._send_home}

    def streams(self) -> Mapping[str, Stream]:
        flight = self._context.flight
        return {
            "HOME_POSITION": lambda: self._home_values(flight.home) if flight.home else None,
            "GPS_GLOBAL_ORIGIN": lambda: self._origin_values() if flight.home else None,
        }

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"SET_GPS_GLOBAL_ORIGIN": self._confirm_origin} if self._policy.confirms_origin else {}

    def tick(self) -> None:
        if self._context.flight.home is None and self._knows_position(self._context.flight):
            self.set_here()
            if not self._policy.origin_with_home:
                self._send_origin()

    def set_here(self) -> None:
        """Set home to the estimated position; on the ground to the ground's height."""
        flight = self._context.flight
        # The estimated height is noisy; on the ground the ground's own height is better.
        down = flight.down_m if flight.flying else 0.0
        place = (flight.latitude_e7, flight.longitude_e7, flight.origin.altitude_m - down)
        self._set(*place, flight.north_m, flight.east_m)
        if self._policy.origin_with_home:
            self._send_origin()

    def _send_origin(self) -> None:
        self._context.radio.broadcast_values(_GPS_GLOBAL_ORIGIN, self._origin_values())

    def _confirm_origin(self, message: Any, sender: MessageSender) -> None:
        """Answer with the origin; it stays where it is."""
        sender.channel.send(_GPS_GLOBAL_ORIGIN, self._origin_values())

    def _set(
        self, latitude_e7: int, longitude_e7: int, altitude_m: float, north_m: float, east_m: float
    ) -> None:
        flight = self._context.flight
        down_m = flight.origin.altitude_m - altitude_m
        yaw_rad = flight.yaw_rad if self._policy.home_has_heading else math.nan
        flight.home = ReferencePoint(latitude_e7, longitude_e7, altitude_m, north_m, east_m, down_m, yaw_rad)
        self._context.radio.broadcast_values(_HOME_POSITION, self._home_values(flight.home))

    def _set_home(self, command: Command) -> CommandResult | None:
        flight = self._context.flight
        refusal = self._policy.refuse_home(flight, command)
        if refusal:
            return refusal.result
        latitude, longitude, altitude = command.params[4:7]
        at_zero = latitude == 0.0 and longitude == 0.0
        if command.params[0] == 1.0 or (at_zero and self._policy.home_at_zero_is_here):
            self.set_here()
            return CommandResult.ACCEPTED
        on_earth = abs(latitude) <= 90 and abs(longitude) <= 180
        if not on_earth or not abs(altitude) < 1e5:
            return self._policy.bad_home
        self.set_at((latitude, longitude), self._policy.altitude_amsl_m(flight, command.frame, altitude))
        return CommandResult.ACCEPTED

    def set_at(self, degrees: tuple[float, float], altitude_m: float) -> None:
        """Set home to a latitude, longitude and altitude above sea level."""
        north_m, east_m = self._context.frame.to_local_m(*degrees)
        latitude_e7, longitude_e7 = (round(angle * 1e7) for angle in degrees)
        self._set(latitude_e7, longitude_e7, altitude_m, north_m, east_m)

    def _send_home(self, command: Command) -> CommandResult | None:
        home = self._context.flight.home
        if home is None:
            return CommandResult.FAILED
        command.sender.channel.send(_HOME_POSITION, self._home_values(home))
        return CommandResult.ACCEPTED

    def _home_values(self, home: ReferencePoint) -> Values:
        place = (*_geodetic(home), home.north_m, home.east_m, home.down_m)
        return (*place, *_home_attitude(home), *_NO_APPROACH, self._context.flight.time_us)

    def _origin_values(self) -> Values:
        return (*_geodetic(self._context.flight.origin), self._context.flight.time_us)


def _geodetic(point: ReferencePoint) -> tuple[int, int, int]:
    """1e-7 degrees and millimetres."""
    return point.latitude_e7, point.longitude_e7, round(point.altitude_m * 1000.0)


def _home_attitude(home: ReferencePoint) -> tuple[float, ...]:
    """The heading at home as w, x, y, z; NaN, which means unknown, without one."""
    return attitude_quaternion(0.0, 0.0, home.yaw_rad) if math.isfinite(home.yaw_rad) else _NO_ATTITUDE
