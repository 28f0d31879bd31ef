"""Failsafes: what happens when setpoints, ground station, sticks, battery, position or radio are lost.

`trigger` with a cause and its reaction is the one place where a failsafe acts; `clear` ends it when the cause
is gone. The fence comes here as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..links._enums import MAV_TYPE
from ..policies._safety import AidingTexts, BatteryStep, FailsafeSettings, Reaction, SafetyPolicy
from ..services._modes import Modes
from ..services._setpoints import Setpoints
from ..state._flight_state import Behaviour, Cause, FlightMode, FlightState
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..state._texts import StatusText
from ..telemetry._battery_monitor import BatteryMonitor

_STRENGTH = {Behaviour.HOLD: 1, Behaviour.RETURN: 2, Behaviour.LAND: 3, Behaviour.TERMINATE: 4}
# Looked up once, because every step compares with them.
_OFFBOARD, _EXTERNAL, _PILOT = Behaviour.OFFBOARD, Behaviour.EXTERNAL, Behaviour.PILOT
# MAV_BATTERY_CHARGE_STATE
_BATTERY_OK = 1


@dataclass(eq=False)
class Failsafe:
    """Watches links, sticks, battery, position; acts through the modes, shows the cause in the flight."""

    _context: ServiceContext
    _policy: SafetyPolicy
    _modes: Modes
    _setpoints: Setpoints
    _battery: BatteryMonitor
    _terminate_mode: FlightMode | None
    _disarm: Callable[[], None]
    _active: dict[Cause, Reaction] = field(default_factory=dict)  # oldest first
    _previous_mode: FlightMode | None = None  # which the first of them ended
    # When the Hold before an action ends, and for which cause
    _hold: tuple[int, Cause] | None = None
    _acting: bool = False
    _station_ns: int | None = None  # last heartbeat
    _station_lost: bool = False
    _battery_step: int = 0  # steps passed
    _low_since_ns: int | None = None
    _radio_lost_ns: int | None = None
    _position_lost: bool = False
    _position_changed_ns: int | None = None  # to the opposite of that
    _aiding_lost: bool = False

    def __post_init__(self) -> None:
        self._settings: FailsafeSettings = self._policy.failsafes(self._context.parameters)
        self._context.parameters.on_change(self._parameters_changed)
        self._modes.on_change.append(self._mode_changed)

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"HEARTBEAT": self._take_heartbeat}

    def tick(self) -> None:
        flight = self._context.flight
        if not flight.armed:
            if self._settings.latched and (self._active or flight.failsafe):
                self._clear_all()
            if self._battery_step and not self._is_low(flight, self._settings.battery[0]):
                self._battery_step = 0  # the battery has been charged
                self.clear(Cause.BATTERY)
            self._watch_radio(flight)
            self._watch_position(flight)
            return
        self._watch_setpoints(flight)
        self._watch_sticks(flight)
        self._watch_station(flight)
        self._watch_battery(flight)
        self._watch_radio(flight)
        self._watch_position(flight)
        if self._hold and flight.time_ns >= self._hold[0]:
            reaction, self._hold = self._active[self._hold[1]], None
            self._act(reaction)

    def trigger(self, cause: Cause, reaction: Reaction) -> None:
        """Carry out the reaction to a cause, which `flight.failsafe` shows."""
        flight, settings = self._context.flight, self._settings
        if not flight.armed:
            return
        active_strength = max((_strength(active) for active in self._active.values()), default=0)
        if reaction.shows:
            # Inserted again, it becomes the latest cause, which heartbeat and recording show.
            self._active.pop(cause, None)
            self._active[cause] = reaction
            flight.failsafe = cause
        if settings.disarms_on_ground and reaction.action is not None and not flight.flying:
            self._send((severity, text + settings.disarm_suffix) for severity, text in reaction.texts)
            self._disarm()
            return
        self._send(reaction.texts)
        if reaction.action is None or (settings.strongest and _strength(reaction) <= active_strength):
            return
        self._react(cause, reaction, active_strength)

    def _react(self, cause: Cause, reaction: Reaction, active_strength: int) -> None:
        flight, settings = self._context.flight, self._settings
        if reaction.action is Behaviour.TERMINATE:
            self._hold = None  # a termination does not wait for the Hold of another cause
        # The Hold that runs already ends for this cause.
        if self._hold:
            self._hold = (self._hold[0], cause)
            return
        self._previous_mode = self._previous_mode or flight.mode
        if reaction.hold_s > 0.0 and not active_strength:
            self._send(settings.hold_texts)
            self._enter(Behaviour.HOLD)
            self._hold = (flight.time_ns + round(reaction.hold_s * 1e9), cause)
        else:
            self._act(reaction)

    def clear(self, cause: Cause) -> None:
        """End the failsafe of a cause that is gone; a Hold, or a reaction that resumes, leads back."""
        reaction = self._active.get(cause)
        if reaction is None:
            return
        held = self._hold is not None and self._hold[1] == cause
        if self._settings.latched and not (held or reaction.resumes):
            return
        del self._active[cause]
        flight = self._context.flight
        flight.failsafe = next(reversed(self._active), None)
        remaining = [other for other, active in self._active.items() if active.action is not None]
        if held and self._hold is not None and remaining:
            # The Hold goes on for the cause that is left with the strongest action, or it would end for none.
            strongest = max(remaining, key=lambda other: _strength(self._active[other]))
            self._hold = (self._hold[0], strongest)
        if (held or reaction.resumes) and not remaining:
            self._resume(flight)

    def _resume(self, flight: FlightState) -> None:
        previous, self._previous_mode, self._hold = self._previous_mode, None, None
        if previous is not None and flight.flying:
            self._acting = True
            self._modes.switch(previous, by_failsafe=True)
            self._acting = False
            if previous.behaviour in (_OFFBOARD, _EXTERNAL):
                self._setpoints.resume()

    def charge_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE."""
        step = self._battery_step
        return self._settings.battery[step - 1].charge_state if step else _BATTERY_OK

    def _take_heartbeat(self, m: Any, sender: MessageSender) -> None:
        parameters = self._context.parameters
        if m.type != MAV_TYPE.GCS or not self._policy.is_ground_station(sender.system, parameters):
            return
        self._station_ns = self._context.flight.time_ns
        if self._station_lost:
            self._station_lost = False
            if Cause.GROUND_STATION in self._active:
                self._send(self._settings.station_back_texts)
            self.clear(Cause.GROUND_STATION)

    def _watch_setpoints(self, flight: FlightState) -> None:
        if self._active and Cause.SETPOINTS in self._active:
            asked = flight.asked_mode
            external = asked is not None and asked.behaviour is _EXTERNAL
            if flight.flying and (flight.runs(asked) if asked and external else self._setpoints.fresh()):
                self.clear(Cause.SETPOINTS)
            return
        reaction = None
        if flight.mode.behaviour is _OFFBOARD and not self._setpoints.fresh():
            reaction = self._settings.setpoints
        elif flight.mode.behaviour is _EXTERNAL and not flight.runs(flight.mode):
            reaction = self._settings.external_mode
        if reaction:
            self.trigger(Cause.SETPOINTS, reaction)

    def _watch_sticks(self, flight: FlightState) -> None:
        reaction = self._settings.sticks
        if reaction is None:
            return
        if self._active and Cause.STICKS in self._active:
            if flight.sticks is not None:
                self.clear(Cause.STICKS)
        elif flight.sticks is None and flight.mode.behaviour is _PILOT and flight.flying:
            self.trigger(Cause.STICKS, reaction)

    def _watch_station(self, flight: FlightState) -> None:
        settings = self._settings
        if self._station_ns is None or self._station_lost:
            return
        if flight.time_ns - self._station_ns >= round(settings.station_timeout_s * 1e9):
            self._station_lost = True
            if settings.station_lost_event:
                self._context.texts.notify(*settings.station_lost_event)
            if settings.station is not None:
                self.trigger(Cause.GROUND_STATION, settings.station)

    def _watch_battery(self, flight: FlightState) -> None:
        steps = self._settings.battery
        if self._battery_step >= len(steps):
            return
        step = steps[self._battery_step]
        if not self._is_low(flight, step):
            self._low_since_ns = None
            return
        if self._low_since_ns is None:
            self._low_since_ns = flight.time_ns
        if flight.time_ns - self._low_since_ns >= round(step.lasts_s * 1e9):
            self._low_since_ns = None
            self._battery_step += 1
            self.trigger(Cause.BATTERY, step.reaction)

    def _is_low(self, flight: FlightState, step: BatteryStep) -> bool:
        # Most autopilots go by one of the two.
        return flight.battery_fraction < step.fraction or (
            step.volts > 0.0 and self._battery.volts() < step.volts
        )

    def _watch_position(self, flight: FlightState) -> None:
        """End a mode that needs a position when the estimate of it has been given up."""
        settings = self._settings
        lost = not flight.position_ok
        if lost is self._position_lost:
            self._position_changed_ns = None
        elif self._position_changed_ns is None:
            self._position_changed_ns = flight.time_ns
        elif flight.time_ns - self._position_changed_ns >= round(settings.position_confirmed_s * 1e9):
            self._position_lost, self._position_changed_ns = lost, None
            if lost:
                self._send(settings.position_lost_texts)
            else:
                self._end_blind_flight()
        if self._position_lost and settings.position and self._flies_blind(flight):
            self.trigger(Cause.POSITION, settings.position)
        if settings.aiding:
            self._watch_aiding(flight, settings.aiding)

    def _flies_blind(self, flight: FlightState) -> bool:
        """Whether the present mode needs a position, and no failsafe lands already."""
        if Cause.POSITION in self._active or not flight.flying or not flight.mode.needs_position:
            return False
        return not (self._active and flight.mode.behaviour is Behaviour.LAND)

    def _end_blind_flight(self) -> None:
        if Cause.POSITION in self._active:
            self._send(self._settings.position_back_texts)
            self.clear(Cause.POSITION)

    def _watch_aiding(self, flight: FlightState, aiding: AidingTexts) -> None:
        since_ns = flight.gps_lost_ns
        lost = since_ns is not None and flight.time_ns - since_ns >= round(aiding.after_s * 1e9)
        if lost is not self._aiding_lost and (lost or since_ns is None):
            self._aiding_lost = lost
            self._send(aiding.lost if lost else aiding.back)

    def _watch_radio(self, flight: FlightState) -> None:
        settings = self._settings
        if settings.radio is None:
            return
        if not settings.radio_silent:
            self._radio_lost_ns = None
            if Cause.RADIO in self._active:
                self._send(settings.radio_back_texts)
                self.clear(Cause.RADIO)
            return
        if self._radio_lost_ns is None:
            self._radio_lost_ns = flight.time_ns
        waited = flight.time_ns - self._radio_lost_ns >= round(settings.radio_timeout_s * 1e9)
        if waited and Cause.RADIO not in self._active:
            self.trigger(Cause.RADIO, settings.radio)

    def _act(self, reaction: Reaction) -> None:
        self._send(reaction.action_texts)
        if reaction.action is not None:
            self._enter(reaction.action, reaction.land_delay_s)

    def _enter(self, behaviour: Behaviour, land_delay_s: float = 0.0) -> None:
        """Change the mode, marked as the failsafe's own change and not the operator's."""
        flight = self._context.flight
        # Neither a return nor a hold can be flown without a position.
        lost = flight.home is None or not flight.position_ok
        if lost and behaviour in (Behaviour.RETURN, Behaviour.HOLD):
            behaviour = Behaviour.LAND
        self._acting = True
        if behaviour is not Behaviour.TERMINATE:
            self._modes.switch_to(behaviour, land_delay_s, by_failsafe=True)
        elif self._terminate_mode:
            self._modes.switch(self._terminate_mode, by_failsafe=True)
        else:
            self._disarm()
        self._acting = False

    def _mode_changed(self) -> None:
        """Drop what the failsafe was about to do: the operator has chosen another mode."""
        if self._acting:
            return
        self._hold = self._previous_mode = None
        if self._settings.latched:
            self._clear_all()

    def _clear_all(self) -> None:
        self._active.clear()
        self._context.flight.failsafe, self._hold, self._previous_mode = None, None, None

    def _parameters_changed(self) -> None:
        self._settings = self._policy.failsafes(self._context.parameters)
        # A parameter may have removed a step that was passed already.
        self._battery_step = min(self._battery_step, len(self._settings.battery))

    def _send(self, texts: Iterable[StatusText]) -> None:
        for severity, text in texts:
            if "{" in text:
                text = text.format(volts=self._battery.volts(), used_mah=self._battery.used_mah())
            self._context.texts.send(severity, text)


def _strength(reaction: Reaction) -> int:
    return _STRENGTH.get(reaction.action, 0) if reaction.action else 0
