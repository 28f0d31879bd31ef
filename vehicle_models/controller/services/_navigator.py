"""Commands that move the vehicle: takeoff, land, return, reposition, orbit, speed, heading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..guidance._fence_boundary import FenceBoundary
from ..guidance._guidance import Guidance, HeadingCommand
from ..guidance._manoeuvres import Hold, Manoeuvre
from ..guidance._sticks import Circle
from ..links._enums import MAV_CMD
from ..policies._commands import CommandPolicy
from ..policies._missions import MissionResult
from ..policies._modes import ModePolicy
from ..state._flight_state import Behaviour, NorthEast
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
from ..state._texts import FlightEvent
from ._modes import Modes

# Towards the centre.
_MAX_ORBIT_MPS2 = 2.0
# SPEED_TYPE
_CLIMB_SPEED, _DESCENT_SPEED = 2.0, 3.0
# MAV_FRAME_GLOBAL_INT
_ORBIT_FRAME = 5
# ORBIT_YAW_BEHAVIOUR
_FRONT_TANGENT_TO_CIRCLE = 3.0
_TO_CENTRE = 0.0


@dataclass(eq=False)
class Navigator:
    """Commands that fly somewhere; the policies define which exist, and when they are refused."""

    _context: ServiceContext
    _policy: CommandPolicy
    _mode_policy: ModePolicy
    _modes: Modes
    _guidance: Guidance
    _fence: FenceBoundary
    _guided_items: bool
    _paused: Manoeuvre | None = None
    _pausing: Manoeuvre | None = None

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"MISSION_ITEM": self._take_guided_item} if self._guided_items else {}

    def _take_guided_item(self, m: Any, sender: MessageSender) -> None:
        """Fly a waypoint at once that belongs to no mission, which is how older clients go somewhere."""
        if m.current != 2:
            return
        command = Command(m.command, (math.nan, 0.0, math.nan, math.nan, m.x, m.y, m.z), m.frame, sender)
        guided = self._context.flight.mode is self._mode_policy.reposition
        possible = guided and m.command == MAV_CMD.NAV_WAYPOINT
        accepted = possible and self._reposition(command) is CommandResult.ACCEPTED
        verdict = MissionResult.ACCEPTED if accepted else MissionResult.ERROR
        sender.answer("MISSION_ACK", type=verdict, mission_type=m.mission_type)

    def commands(self) -> Mapping[int, CommandHandler]:
        policy, modes = self._policy, self._mode_policy
        handlers: dict[int, CommandHandler] = {
            MAV_CMD.NAV_TAKEOFF: self._take_off,
            MAV_CMD.NAV_LAND: lambda _: self._switch_to(Behaviour.LAND),
            MAV_CMD.NAV_RETURN_TO_LAUNCH: lambda _: self._switch_to(Behaviour.RETURN),
            MAV_CMD.DO_REPOSITION: self._reposition,
            MAV_CMD.DO_CHANGE_SPEED: self._change_speed,
            MAV_CMD.DO_SET_ROI_LOCATION: self._look_at_roi,
            MAV_CMD.DO_SET_ROI: self._look_at_roi,
            MAV_CMD.DO_SET_ROI_WPNEXT_OFFSET: lambda _: CommandResult.ACCEPTED,
            MAV_CMD.DO_SET_ROI_SYSID: lambda _: CommandResult.ACCEPTED,
            MAV_CMD.DO_SET_ROI_NONE: self._look_ahead,
        }
        if modes.loiter:
            handlers[MAV_CMD.NAV_LOITER_UNLIM] = self._loiter
        if modes.orbit:
            handlers[MAV_CMD.DO_ORBIT] = self._orbit
        if modes.termination:
            handlers[MAV_CMD.DO_FLIGHTTERMINATION] = self._terminate
        optional: dict[int, CommandHandler] = {
            MAV_CMD.CONDITION_YAW: self._turn,
            MAV_CMD.DO_PAUSE_CONTINUE: self._pause_or_continue,
            MAV_CMD.DO_CHANGE_ALTITUDE: self._change_altitude,
        }
        return {
            **handlers,
            **{number: handler for number, handler in optional.items() if number in policy.optional},
        }

    def streams(self) -> Mapping[str, Stream]:
        return {"ORBIT_EXECUTION_STATUS": self._orbit_status}

    def _take_off(self, command: Command) -> CommandResult | None:
        context, flight, guidance = self._context, self._context.flight, self._guidance
        refusal = self._policy.refuse_takeoff(flight, command)
        if refusal:
            return self._context.texts.refuse(refusal)
        altitude = self._policy.takeoff_altitude_m(flight, command, guidance.limits)
        if altitude is None:
            context.texts.announce(FlightEvent.TAKEOFF_DEFAULT, guidance.limits.takeoff_height_m)
        elif self._policy.raises_low_takeoffs:
            altitude = self._raised_takeoff_m(altitude)
        if self._mode_policy.takeoff and (refusal := self._modes.enter(self._mode_policy.takeoff)):
            return refusal.result
        if altitude is not None:
            guidance.manoeuvre = guidance.manoeuvres.takeoff(flight, flight.origin.altitude_m - altitude)
        elif not self._mode_policy.takeoff:
            guidance.begin(Behaviour.TAKEOFF, flight)
        return CommandResult.ACCEPTED

    def _raised_takeoff_m(self, altitude_m: float) -> float:
        """Altitude of a takeoff: at least the default height above home and the vehicle; with a text."""
        context, flight = self._context, self._context.flight
        height_m = self._guidance.limits.takeoff_height_m
        least_m = (flight.home or flight.origin).altitude_m + height_m
        if altitude_m < least_m:
            # A tenth of a metre is within the rounding of MAVLink's floats, and not worth a text.
            if altitude_m < least_m - 0.1:
                context.texts.announce(FlightEvent.TAKEOFF_RAISED, height_m)
            altitude_m = least_m
        if altitude_m < flight.altitude_m:
            context.texts.announce(FlightEvent.TAKEOFF_BELOW)
            altitude_m = flight.altitude_m
        return altitude_m

    def _switch_to(self, behaviour: Behaviour) -> CommandResult | None:
        refusal = self._modes.enter_for(behaviour)
        return refusal.result if refusal else CommandResult.ACCEPTED

    def _reposition(self, command: Command) -> CommandResult | None:
        flight, guidance = self._context.flight, self._guidance
        refusal = self._policy.refuse_reposition(flight, command)
        if refusal:
            return self._context.texts.refuse(refusal)
        speed, _, radius, yaw, latitude, longitude, altitude = command.params
        if _is_off_earth(latitude, longitude):
            return CommandResult.DENIED
        place, down = self._place(latitude, longitude), self._down_m(command, altitude)
        goal = place or (flight.north_m, flight.east_m)
        if not self._fence.allows(*goal, flight.down_m if down is None else down):
            return self._context.texts.refuse(self._fence.policy.outside)
        # Entering the mode resets the speed.
        previous_speed = guidance.speed_mps
        if refusal := self._modes.enter(self._mode_policy.reposition):
            return refusal.result
        guidance.manoeuvre = guidance.manoeuvres.hold(
            flight,
            place,
            down,
            yaw_rad=yaw if math.isfinite(yaw) else None,
            speed_mps=speed if math.isfinite(speed) and speed > 0.0 else previous_speed,
            radius_m=radius if math.isfinite(radius) and radius != 0.0 else None,
        )
        if isinstance(guidance.manoeuvre, Hold):
            if not math.isfinite(yaw):
                guidance.manoeuvre.face_ahead()
            if guidance.limits.reposition_delay_s:
                guidance.manoeuvre.delay(flight, guidance.limits.reposition_delay_s)
        return CommandResult.ACCEPTED

    def _place(self, latitude: float, longitude: float) -> NorthEast | None:
        """The place of a command in the local frame; None where it gives none."""
        given = math.isfinite(latitude) and math.isfinite(longitude)
        return self._context.frame.to_local_m(latitude, longitude) if given else None

    def _down_m(self, command: Command, altitude_m: float) -> float | None:
        """The height of a command in the local frame; None where it gives none."""
        flight = self._context.flight
        if not math.isfinite(altitude_m):
            return None
        return flight.origin.altitude_m - self._policy.altitude_amsl_m(flight, command.frame, altitude_m)

    def _change_speed(self, command: Command) -> CommandResult | None:
        speed = command.params[1]
        if not math.isfinite(speed) or speed <= 0.0:
            return self._policy.result_without_speed
        guidance, kind = self._guidance, command.params[0]
        if kind == _CLIMB_SPEED:
            guidance.limits = replace(guidance.limits, climb_mps=speed, setpoint_climb_mps=speed)
            return CommandResult.ACCEPTED
        if kind == _DESCENT_SPEED:
            guidance.limits = replace(guidance.limits, descent_mps=speed, setpoint_descent_mps=speed)
            return CommandResult.ACCEPTED
        guidance.speed_mps = min(speed, guidance.limits.speed_max_mps)
        if isinstance(guidance.manoeuvre, Hold):
            guidance.manoeuvre.change_speed(guidance.speed_mps)
        return CommandResult.ACCEPTED

    def _loiter(self, command: Command) -> CommandResult | None:
        assert self._mode_policy.loiter
        refusal = self._modes.enter(self._mode_policy.loiter)
        return refusal.result if refusal else CommandResult.ACCEPTED

    def _orbit(self, command: Command) -> CommandResult | None:
        """Circle a place, by default here; a negative radius is anticlockwise, an impossible one not flown."""
        context, flight, limits = self._context, self._context.flight, self._guidance.limits
        radius, speed, yaw_behaviour, _, latitude, longitude, altitude = command.params
        radius = radius if math.isfinite(radius) else limits.circle_radius_m
        speed = speed if math.isfinite(speed) else 1.0
        if _is_off_earth(latitude, longitude):
            return CommandResult.DENIED
        centre = self._place(latitude, longitude) or (flight.north_m, flight.east_m)
        if not 1.0 <= abs(radius) <= limits.orbit_radius_max_m:
            context.texts.report(self._policy.bad_orbit_text)
            return CommandResult.ACCEPTED
        down = self._down_m(command, altitude)
        assert self._mode_policy.orbit
        if refusal := self._modes.enter(self._mode_policy.orbit):
            return refusal.result
        # The centripetal acceleration bounds the speed on a small circle.
        max_speed = min(limits.speed_max_mps, math.sqrt(_MAX_ORBIT_MPS2 * abs(radius)))
        speed = math.copysign(min(abs(speed), max_speed), radius * (speed or 1.0))
        down = flight.down_m if down is None else down
        self._guidance.manoeuvre = Circle(centre, down, abs(radius), speed, _facing(yaw_behaviour))
        return CommandResult.ACCEPTED

    def _orbit_status(self) -> Values | None:
        """ORBIT_EXECUTION_STATUS; None while no orbit is flown by command."""
        flight, manoeuvre = self._context.flight, self._guidance.manoeuvre
        if flight.mode is not self._mode_policy.orbit or not isinstance(manoeuvre, Circle):
            return None
        latitude, longitude = self._context.frame.to_geodetic_e7(*manoeuvre.centre)
        radius = math.copysign(manoeuvre.radius_m, manoeuvre.speed_mps)
        altitude = flight.origin.altitude_m - manoeuvre.down_m
        return (flight.time_us, radius, latitude, longitude, altitude, _ORBIT_FRAME)

    def _turn(self, command: Command) -> CommandResult:
        """CONDITION_YAW: degrees, degrees per second, direction, relative."""
        angle, speed, direction, relative = command.params[:4]
        if not 0.0 <= angle <= 360.0:
            return CommandResult.FAILED
        yaw = math.radians(angle)
        if relative == 1.0:
            yaw = self._context.flight.yaw_rad + math.copysign(yaw, direction)
        rate = math.radians(speed) if math.isfinite(speed) and speed > 0.0 else 1.0
        self._guidance.heading = HeadingCommand(yaw, turn_max_radps=rate)
        return CommandResult.ACCEPTED

    def _pause_or_continue(self, command: Command) -> CommandResult:
        """Stop here, and later continue with what was being flown."""
        guidance = self._guidance
        if command.params[0] == 0.0 and self._paused is None:
            self._paused = guidance.manoeuvre
            guidance.manoeuvre = self._pausing = guidance.manoeuvres.hold(self._context.flight)
        elif command.params[0] == 1.0 and self._paused is not None:
            if guidance.manoeuvre is self._pausing:
                guidance.manoeuvre = self._paused
            self._paused = None
        return CommandResult.ACCEPTED

    def _change_altitude(self, command: Command) -> CommandResult:
        """DO_CHANGE_ALTITUDE: above sea level, at the place that is held."""
        flight, manoeuvre = self._context.flight, self._guidance.manoeuvre
        altitude, holds = command.params[0], flight.mode.behaviour is Behaviour.HOLD
        if math.isfinite(altitude) and holds and isinstance(manoeuvre, Hold):
            manoeuvre.change_down(flight.origin.altitude_m - altitude)
        return CommandResult.ACCEPTED

    def _terminate(self, command: Command) -> CommandResult:
        if not command.params[0] > 0.5:
            return CommandResult.DENIED
        assert self._mode_policy.termination
        self._modes.switch(self._mode_policy.termination)
        return CommandResult.ACCEPTED

    def _look_at_roi(self, command: Command) -> CommandResult:
        latitude, longitude = command.params[4:6]
        # 0, 0 means that the command gives no place.
        valid = abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and (latitude != 0.0 or longitude != 0.0)
        if valid and self._policy.roi_names_place(command):
            place = self._context.frame.to_local_m(latitude, longitude)
            self._guidance.heading = HeadingCommand(place=place)
            return CommandResult.ACCEPTED
        return self._look_ahead(command)

    def _look_ahead(self, command: Command) -> CommandResult:
        if self._guidance.heading and self._guidance.heading.place:
            self._guidance.heading = None
        return CommandResult.ACCEPTED


def _is_off_earth(latitude: float, longitude: float) -> bool:
    """Whether a command gives a place that is not on Earth; NaN gives none."""
    given = math.isfinite(latitude) and math.isfinite(longitude)
    return given and (abs(latitude) > 90.0 or abs(longitude) > 180.0)


def _facing(yaw_behaviour: float) -> Literal["in", "ahead", "kept"]:
    if not math.isfinite(yaw_behaviour) or yaw_behaviour == _TO_CENTRE:
        return "in"
    return "ahead" if yaw_behaviour == _FRONT_TANGENT_TO_CIRCLE else "kept"
