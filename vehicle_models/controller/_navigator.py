"""Commands that move the vehicle: takeoff, land, return, reposition, speed."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ._board import Board, Command, CommandHandler, Handler, Result
from ._flight import Behaviour
from ._guidance import Guidance, Hold
from ._modes import Modes
from ._personality import Event, Refusal

TAKEOFF, LAND, RETURN, LOITER = 22, 21, 20, 17
CHANGE_SPEED, REPOSITION, YAW = 178, 192, 115
_FAR_M = 100_000.0


class Navigator:
    """NAV_TAKEOFF, NAV_LAND, NAV_RETURN_TO_LAUNCH, DO_REPOSITION, DO_CHANGE_SPEED."""

    def __init__(self, board: Board, modes: Modes, guidance: Guidance) -> None:
        self._board = board
        self._modes = modes
        self._guidance = guidance

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {
            TAKEOFF: self._takeoff,
            LAND: lambda _: self._go(Behaviour.LAND),
            RETURN: lambda _: self._go(Behaviour.RETURN),
            REPOSITION: self._reposition,
            CHANGE_SPEED: self._speed,
        }

    def tick(self) -> None:
        pass

    def _takeoff(self, command: Command) -> Result | None:
        board, flight = self._board, self._board.flight
        refusal = board.personality.refuse_takeoff(flight, command)
        if refusal:
            return self._refused(refusal)
        altitude = board.personality.takeoff_altitude_m(flight, command, self._guidance.limits)
        if altitude is None and Event.TAKEOFF_DEFAULT in board.personality.texts:
            severity, text = board.personality.texts[Event.TAKEOFF_DEFAULT]
            board.texts.say(severity, text.format(self._guidance.limits.takeoff_height_m))
        if board.personality.takeoff_mode:
            self._modes.switch(board.personality.mode(board.personality.takeoff_mode))
        if altitude is not None:
            self._guidance.manoeuvre = self._guidance.manoeuvres.takeoff(flight, flight.origin.altitude_m - altitude)
        elif not board.personality.takeoff_mode:
            self._guidance.begin(Behaviour.TAKEOFF, flight)
        return Result.ACCEPTED

    def _go(self, behaviour: Behaviour) -> Result:
        self._modes.to(behaviour)
        return Result.ACCEPTED

    def _reposition(self, command: Command) -> Result | None:
        board, flight = self._board, self._board.flight
        refusal = board.personality.refuse_reposition(flight, command)
        if refusal:
            return self._refused(refusal)
        speed, _, radius, yaw, latitude, longitude, altitude = command.params
        place = None
        if math.isfinite(latitude) and math.isfinite(longitude):
            if abs(latitude) > 90.0 or abs(longitude) > 180.0:
                return Result.DENIED
            place = board.airframe.to_local_m(latitude, longitude)
            if math.hypot(place[0] - flight.north_m, place[1] - flight.east_m) > _FAR_M:
                return Result.DENIED
        down = None
        if math.isfinite(altitude):
            down = flight.origin.altitude_m - board.personality.altitude_amsl_m(flight, command.frame, altitude)
        keep = self._guidance.speed_mps
        self._modes.switch(board.personality.mode(board.personality.reposition_mode))
        self._guidance.manoeuvre = self._guidance.manoeuvres.hold(
            flight,
            place,
            down,
            yaw_rad=yaw if math.isfinite(yaw) else None,
            speed_mps=speed if math.isfinite(speed) and speed > 0.0 else keep,
            radius_m=radius if math.isfinite(radius) and radius != 0.0 else None,
        )
        return Result.ACCEPTED

    def _speed(self, command: Command) -> Result | None:
        speed = command.params[1]
        if not math.isfinite(speed) or speed <= 0.0:
            return self._board.personality.bad_speed
        self._guidance.speed_mps = min(speed, self._guidance.limits.speed_max_mps)
        if isinstance(self._guidance.manoeuvre, Hold):
            self._guidance.manoeuvre.change_speed(self._guidance.speed_mps)
        return Result.ACCEPTED

    def _refused(self, refusal: Refusal) -> Result | None:
        for text in refusal.texts:
            self._board.texts.say(*text)
        return refusal.result
