"""Modes: which one is active, how it is asked for, and when it is refused."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import Land, Takeoff
from ..guidance._return import Return
from ..links._enums import MAV_CMD
from ..policies._modes import ModePolicy
from ..state._flight_state import Behaviour, FlightMode
from ..state._service import Command, CommandHandler, CommandResult, MessageHandler, MessageSender, Refusal
from ..state._service_context import ServiceContext
from ..state._texts import FlightEvent

# Looked up once, because every step compares with it.
_TAKEOFF = Behaviour.TAKEOFF
# Of commands; a request for the mode, or a failsafe, sends none.
_EVENTS = {Behaviour.LAND: FlightEvent.LANDING, Behaviour.RETURN: FlightEvent.RETURNING}
# Position of a switch in DO_AUX_FUNCTION.
_SWITCH_HIGH = 2.0


@dataclass(eq=False)
class Modes:
    """DO_SET_MODE and the old SET_MODE message. Every change of mode goes through `switch`."""

    _context: ServiceContext
    _policy: ModePolicy
    _guidance: Guidance
    _has_setpoints: Callable[[], bool]
    on_change: list[Callable[[], None]] = field(default_factory=list)
    on_taken_off: list[Callable[[], None]] = field(default_factory=list)
    """When a takeoff that is a mode of its own has reached its height."""

    def __post_init__(self) -> None:
        self._by_behaviour = {
            Behaviour.HOLD: self._policy.hold,
            Behaviour.LAND: self._policy.land,
            Behaviour.RETURN: self._policy.return_home,
            Behaviour.OFFBOARD: self._policy.offboard,
        }

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"SET_MODE": self._set_mode_message}

    def commands(self) -> Mapping[int, CommandHandler]:
        handlers: dict[int, CommandHandler] = {MAV_CMD.DO_SET_MODE: self._set_mode}
        if self._policy.auxiliary_modes:
            handlers[MAV_CMD.DO_AUX_FUNCTION] = self._run_auxiliary
        return handlers

    def tick(self) -> None:
        """Hold when a takeoff has reached its height, where taking off is a mode of its own."""
        flight = self._context.flight
        if flight.mode.behaviour is _TAKEOFF and flight.armed and self._guidance.manoeuvre.done(flight):
            takeoff = self._guidance.manoeuvre
            self.switch(self._policy.hold)
            if isinstance(takeoff, Takeoff):
                self._guidance.manoeuvre = takeoff.hold(flight)
            for listener in self.on_taken_off:
                listener()

    @property
    def terminated(self) -> bool:
        """Whether the flight has been terminated, which no mode undoes."""
        return self._context.flight.armed and self._context.flight.mode.behaviour is Behaviour.TERMINATE

    def switch(self, mode: FlightMode, by_failsafe: bool = False) -> None:
        """Enter a mode without asking the policy. What a failsafe enters nobody has asked for."""
        flight, texts = self._context.flight, self._context.texts
        if self.terminated:
            return
        changed = mode is not flight.mode
        flight.mode, flight.disarmed_by_landing = mode, False
        if not by_failsafe:
            flight.asked_mode = mode
        self._guidance.begin(mode.behaviour, flight)
        if not changed:
            return
        if mode.behaviour is Behaviour.TERMINATE:
            texts.announce(FlightEvent.TERMINATED)
        manoeuvre = self._guidance.manoeuvre
        if flight.armed and isinstance(manoeuvre, Return):
            cruise_m, above_m = manoeuvre.heights_m(flight.origin.altitude_m)
            texts.announce(FlightEvent.RETURN_BEGINS, math.ceil(cruise_m), math.ceil(above_m))
        for listener in self.on_change:
            listener()

    def switch_to(self, behaviour: Behaviour, land_delay_s: float = 0.0, by_failsafe: bool = False) -> None:
        """Enter the autopilot's mode for a behaviour; a landing begins its descent after `land_delay_s`."""
        self.switch(self._by_behaviour[behaviour], by_failsafe)
        if land_delay_s > 0.0 and isinstance(self._guidance.manoeuvre, Land):
            self._guidance.manoeuvre.delay(self._context.flight, land_delay_s)

    def enter(self, mode: FlightMode, event: FlightEvent | None = None) -> Refusal | None:
        """Enter a mode for a command, with the text of `event`; or send why not, and return it."""
        refusal = self._refusal_without_position(mode)
        if refusal is None:
            if event:
                self._context.texts.announce(event)
            self.switch(mode)
        else:
            self._context.texts.refuse(refusal)
        return refusal

    def enter_for(self, behaviour: Behaviour) -> Refusal | None:
        """Likewise the autopilot's mode for a behaviour."""
        return self.enter(self._by_behaviour[behaviour], _EVENTS.get(behaviour))

    def request(self, number: int) -> Refusal | None:
        """Enter the mode with a custom number, or return why not."""
        policy, flight = self._policy, self._context.flight
        mode = policy.numbered(number)
        if mode and mode is policy.orbit and not flight.armed:
            # Only DO_ORBIT gives the orbit mode its circle; before, PX4 enters the main mode alone.
            mode = policy.numbered(number & 0xFFFFFF)
        if self.terminated:
            return Refusal(CommandResult.TEMPORARILY_REJECTED)
        refusal = policy.refuse_mode(flight, mode, number, self._has_setpoints())
        if refusal is None and mode is not None:
            refusal = self._refusal_without_position(mode)
        if refusal is None and mode is not None:
            # Entering the present mode again would restart its manoeuvre.
            if mode is not flight.mode:
                self.switch(mode)
            return None
        refusal = refusal or Refusal(CommandResult.DENIED)
        self._context.texts.refuse(refusal)
        return refusal

    def _refusal_without_position(self, mode: FlightMode) -> Refusal | None:
        flight = self._context.flight
        if flight.armed and mode.needs_position and not flight.position_ok:
            return self._policy.refuse_without_position(mode)
        return None

    def _set_mode(self, command: Command) -> CommandResult | None:
        number = self._policy.number_of_command(command.params)
        if number is None:
            return self._policy.result_without_mode
        refusal = self.request(number)
        return refusal.result if refusal else CommandResult.ACCEPTED

    def _run_auxiliary(self, command: Command) -> CommandResult | None:
        """DO_AUX_FUNCTION, a switch of the radio: functions that enter a mode, by their upper position."""
        return self.run_auxiliary(*command.params[:2])

    def run_auxiliary(self, function: float, position: float) -> CommandResult:
        """The same for a mission."""
        mode = self._policy.auxiliary_modes.get(function)
        if mode is None:
            shown = f"{function:.0f}" if math.isfinite(function) else "0"
            self._context.texts.report(self._policy.no_auxiliary_text, shown)
            return CommandResult.FAILED
        if position not in (0.0, 1.0, 2.0):
            return CommandResult.DENIED
        if position == _SWITCH_HIGH:
            # The switch was moved, whatever becomes of the mode.
            self.request(mode)
        return CommandResult.ACCEPTED

    def _set_mode_message(self, message: Any, sender: MessageSender) -> None:
        refusal = self.request(message.custom_mode)
        result = refusal.result if refusal else CommandResult.ACCEPTED
        if self._policy.acknowledges_set_mode and result is not None:
            sender.answer("COMMAND_ACK", command=MAV_CMD.DO_SET_MODE, result=result)
