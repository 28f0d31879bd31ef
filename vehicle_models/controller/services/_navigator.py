"""Commands that move the vehicle: takeoff, land, return, reposition, speed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from .._flight import Behaviour
from .._personality import Event, Refusal
from .._service import Command, CommandHandler, Handler, Result, Sender
from .._service_context import ServiceContext
from ..guidance._guidance import FixedHeading, Guidance, HeadingTo
from ..guidance._manoeuvres import Circle, Hold, Manoeuvre
from ..payload._gimbal import names_place
from ._modes import Modes

TAKEOFF, LAND, RETURN, LOITER = 22, 21, 20, 17
CHANGE_SPEED, REPOSITION, YAW = 178, 192, 115
ORBIT, CHANGE_ALTITUDE, PAUSE, TERMINATION = 34, 186, 193, 185
ROI_LOCATION, ROI_OFFSET, ROI_NONE, ROI_SYSTEM, ROI = 195, 196, 197, 198, 201
_FAR_M = 100_000.0
_ORBIT_MPS2 = 2.0  # towards the centre, at most

_WAYPOINT = 16


class Navigator:
    """Whatever flies somewhere by command; which of these commands exist is the personality's."""

    def __init__(self, board: ServiceContext, modes: Modes, guidance: Guidance) -> None:
        self._board = board
        self._modes = modes
        self._guidance = guidance
        self._paused: Manoeuvre | None = None
        self._pausing: Manoeuvre | None = None

    def handlers(self) -> Mapping[str, Handler]:
        return {"MISSION_ITEM": self._guided_item} if self._board.personality.missions.guided_items else {}

    def _guided_item(self, m: Any, sender: Sender) -> None:
        """A waypoint that is flown at once and belongs to no mission, which is how older clients go somewhere."""
        if m.current != 2:
            return
        there = Command(m.command, (math.nan, 0.0, math.nan, math.nan, m.x, m.y, m.z), m.frame, sender)
        guided = self._board.flight.mode.name == self._board.personality.reposition_mode
        taken = guided and m.command == _WAYPOINT and self._reposition(there) is Result.ACCEPTED
        sender.channel.tell(
            "MISSION_ACK",
            type=0 if taken else 1,  # MAV_MISSION_ACCEPTED, MAV_MISSION_ERROR
            target_system=sender.system,
            target_component=sender.component,
            mission_type=m.mission_type,
        )

    def commands(self) -> Mapping[int, CommandHandler]:
        personality = self._board.personality
        optional: dict[int, tuple[bool, CommandHandler]] = {
            LOITER: (personality.loiter_mode is not None, self._loiter),
            ORBIT: (personality.orbit_mode is not None, self._orbit),
            YAW: (personality.yaw_command, self._yaw),
            PAUSE: (personality.pause_command, self._pause),
            CHANGE_ALTITUDE: (personality.altitude_command, self._altitude),
            TERMINATION: (any(mode.behaviour is Behaviour.TERMINATE for mode in personality.modes), self._terminate),
        }
        return {
            TAKEOFF: self._takeoff,
            LAND: lambda _: self._go(Behaviour.LAND),
            RETURN: lambda _: self._go(Behaviour.RETURN),
            REPOSITION: self._reposition,
            CHANGE_SPEED: self._speed,
            ROI_LOCATION: self._look,
            ROI: self._look,
            ROI_OFFSET: lambda _: Result.ACCEPTED,
            ROI_SYSTEM: lambda _: Result.ACCEPTED,
            ROI_NONE: self._look_ahead,
            **{number: handler for number, (exists, handler) in optional.items() if exists},
        }

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
        if not board.allows(*(place or (flight.north_m, flight.east_m)), flight.down_m if down is None else down):
            return self._refused(Refusal(*board.personality.fence.outside))
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
        if not math.isfinite(yaw) and isinstance(self._guidance.manoeuvre, Hold):
            self._guidance.manoeuvre.face_ahead()
        return Result.ACCEPTED

    def _speed(self, command: Command) -> Result | None:
        speed = command.params[1]
        if not math.isfinite(speed) or speed <= 0.0:
            return self._board.personality.bad_speed
        guidance, kind = self._guidance, command.params[0]
        if kind in (2.0, 3.0):
            if kind == 2.0:
                guidance.limits = replace(guidance.limits, climb_mps=speed, setpoint_climb_mps=speed)
            else:
                guidance.limits = replace(guidance.limits, descent_mps=speed, setpoint_descent_mps=speed)
            return Result.ACCEPTED
        self._guidance.speed_mps = min(speed, self._guidance.limits.speed_max_mps)
        if isinstance(self._guidance.manoeuvre, Hold):
            self._guidance.manoeuvre.change_speed(self._guidance.speed_mps)
        return Result.ACCEPTED

    def _loiter(self, command: Command) -> Result:
        personality = self._board.personality
        assert personality.loiter_mode is not None
        self._modes.switch(personality.mode(personality.loiter_mode))
        return Result.ACCEPTED

    def _orbit(self, command: Command) -> Result | None:
        """Around a place, or around here; a radius below zero is anticlockwise. Too small or large a circle is not flown."""
        board, flight, limits = self._board, self._board.flight, self._guidance.limits
        radius, speed, looks, _, latitude, longitude, altitude = command.params
        radius = radius if math.isfinite(radius) else limits.circle_radius_m
        speed = speed if math.isfinite(speed) else 1.0
        centre = (flight.north_m, flight.east_m)
        if math.isfinite(latitude) and math.isfinite(longitude):
            if abs(latitude) > 90.0 or abs(longitude) > 180.0:
                return Result.DENIED
            centre = board.airframe.to_local_m(latitude, longitude)
        if not 1.0 <= abs(radius) <= limits.orbit_radius_max_m:
            board.texts.say(*board.personality.orbit_text)
            return Result.ACCEPTED
        down = flight.down_m
        if math.isfinite(altitude):
            down = flight.origin.altitude_m - board.personality.altitude_amsl_m(flight, command.frame, altitude)
        assert board.personality.orbit_mode is not None
        self._modes.switch(board.personality.mode(board.personality.orbit_mode))
        fastest = min(limits.speed_max_mps, math.sqrt(_ORBIT_MPS2 * abs(radius)))
        speed = math.copysign(min(abs(speed), fastest), radius * (speed or 1.0))
        look: Literal["in", "ahead", "kept"] = "in" if not math.isfinite(looks) or looks == 0.0 else "kept"
        self._guidance.manoeuvre = Circle(centre, down, abs(radius), speed, "ahead" if looks == 3.0 else look)
        return Result.ACCEPTED

    def orbit_status(self) -> tuple[int | float, ...] | None:
        """ORBIT_EXECUTION_STATUS in wire order; None while nothing circles by command."""
        flight, manoeuvre = self._board.flight, self._guidance.manoeuvre
        if flight.mode.name != self._board.personality.orbit_mode or not isinstance(manoeuvre, Circle):
            return None
        latitude, longitude = self._board.airframe.to_geodetic_e7(*manoeuvre.centre)
        radius = math.copysign(manoeuvre.radius_m, manoeuvre.speed_mps)
        return (flight.time_us, radius, latitude, longitude, flight.origin.altitude_m - manoeuvre.down_m, 5)

    def _yaw(self, command: Command) -> Result:
        """CONDITION_YAW: degrees, degrees per second, direction, relative."""
        angle, speed, direction, relative = command.params[:4]
        if not 0.0 <= angle <= 360.0:
            return Result.FAILED
        flight = self._board.flight
        yaw = math.radians(angle)
        if relative == 1.0:
            yaw = flight.yaw_rad + math.copysign(yaw, direction)
        rate = math.radians(speed) if math.isfinite(speed) and speed > 0.0 else 1.0
        self._guidance.heading = FixedHeading(yaw, rate)
        return Result.ACCEPTED

    def _pause(self, command: Command) -> Result:
        """Stop where it is, and go on with what was being flown."""
        guidance = self._guidance
        if command.params[0] == 0.0 and self._paused is None:
            self._paused = guidance.manoeuvre
            guidance.manoeuvre = self._pausing = guidance.manoeuvres.hold(self._board.flight)
        elif command.params[0] == 1.0 and self._paused is not None:
            if guidance.manoeuvre is self._pausing:
                guidance.manoeuvre = self._paused
            self._paused = None
        return Result.ACCEPTED

    def _altitude(self, command: Command) -> Result:
        """DO_CHANGE_ALTITUDE: above sea level, at the place that is held."""
        flight, manoeuvre = self._board.flight, self._guidance.manoeuvre
        altitude = command.params[0]
        if math.isfinite(altitude) and flight.mode.behaviour is Behaviour.HOLD and isinstance(manoeuvre, Hold):
            manoeuvre.change_down(flight.origin.altitude_m - altitude)
        return Result.ACCEPTED

    def _terminate(self, command: Command) -> Result:
        if not command.params[0] > 0.5:
            return Result.DENIED
        personality = self._board.personality
        self._modes.switch(next(mode for mode in personality.modes if mode.behaviour is Behaviour.TERMINATE))
        return Result.ACCEPTED

    def _look(self, command: Command) -> Result:
        latitude, longitude = command.params[4:6]
        known = abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and (latitude != 0.0 or longitude != 0.0)
        if names_place(self._board.personality, command) and known:
            self._guidance.heading = HeadingTo(self._board.airframe.to_local_m(latitude, longitude))
            return Result.ACCEPTED
        return self._look_ahead(command)

    def _look_ahead(self, command: Command) -> Result:
        if isinstance(self._guidance.heading, HeadingTo):
            self._guidance.heading = None
        return Result.ACCEPTED

    def _refused(self, refusal: Refusal) -> Result | None:
        for text in refusal.texts:
            self._board.texts.say(*text)
        return refusal.result
