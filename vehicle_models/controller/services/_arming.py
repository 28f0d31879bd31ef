"""Arming and disarming, by command and automatically."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import Takeoff
from ..links._enums import MAV_CMD
from ..policies._modes import ModePolicy
from ..state._flight_state import Behaviour, LandedState
from ..state._service import Command, CommandHandler, CommandResult
from ..state._service_context import ServiceContext
from ..state._texts import FlightEvent
from ._home import HomeKeeper
from ._modes import Modes

# Second parameter of COMPONENT_ARM_DISARM, as MAVLink defines it.
_FORCE = 21196.0
# A mode of these that was asked for last is shown again after a landing, whatever landed.
_KEPT = (Behaviour.OFFBOARD, Behaviour.PILOT)


@dataclass(eq=False)
class Arming:
    """COMPONENT_ARM_DISARM, and the disarming that follows a landing or idling on the ground."""

    _context: ServiceContext
    _policy: ModePolicy
    _modes: Modes
    _guidance: Guidance
    _home: HomeKeeper
    _has_setpoints: Callable[[], bool]
    _landed_ns: int | None = None

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.COMPONENT_ARM_DISARM: self._arm_or_disarm}

    def tick(self) -> None:
        """Disarm after a landing, and after idling on the ground."""
        flight, limits = self._context.flight, self._guidance.limits
        if not flight.armed or flight.flying:
            return
        # Source: ArduCopter counts no idle time while its rotors spool up.
        if self._policy.spools_up_armed and isinstance(self._guidance.manoeuvre, Takeoff):
            return
        # After a landing by sticks ArduPilot waits for the idle time, not for the short time after a landing.
        if flight.mode.behaviour is Behaviour.PILOT and not self._policy.manual_landing_disarms:
            idle_since_ns = max(self._landed_ns or 0, flight.armed_since_ns)
            self._disarm_after(idle_since_ns, limits.idle_disarm_s, FlightEvent.DISARMED_IDLE)
        elif self._landed_ns is not None:
            self._disarm_after(self._landed_ns, limits.landed_disarm_s, FlightEvent.DISARMED_BY_LANDING)
        else:
            self._disarm_after(flight.armed_since_ns, limits.idle_disarm_s, FlightEvent.DISARMED_IDLE)

    def record_landing(self) -> None:
        """The vehicle has come down."""
        self._landed_ns = self._context.flight.time_ns

    def record_liftoff(self) -> None:
        self._landed_ns = None

    def disarm(self, event: FlightEvent) -> None:
        """Stop the rotors, for whatever reason."""
        context, flight = self._context, self._context.flight
        flight.armed = False
        flight.disarmed_by_landing = event is FlightEvent.DISARMED_BY_LANDING
        # Disarmed by force in the air it falls, and lands later.
        flight.landed = LandedState.ON_GROUND if flight.on_ground else flight.landed
        context.airframe.disarm()
        self._landed_ns = None
        context.texts.announce(event)
        if self._policy.after_landing and event is not FlightEvent.CRASHED:
            asked = flight.asked_mode
            kept = asked and (asked.behaviour in _KEPT or flight.runs(asked))
            self._modes.switch(asked if asked and kept else self._policy.after_landing)

    def _disarm_after(self, since_ns: int, span_s: float | None, event: FlightEvent) -> None:
        if span_s is not None and self._context.flight.time_ns - since_ns >= round(span_s * 1e9):
            self.disarm(event)

    def _arm_or_disarm(self, command: Command) -> CommandResult | None:
        value, forced = command.params[0], command.params[1] == _FORCE
        flight = self._context.flight
        refusal = self._policy.refuse_arm_value(value)
        if refusal:
            return self._context.texts.refuse(refusal)
        if value >= 0.5:
            return CommandResult.ACCEPTED if flight.armed else self._try_to_arm(forced)
        if not flight.armed:
            return CommandResult.ACCEPTED
        refusal = self._policy.refuse_disarming(flight, forced)
        if refusal:
            return self._context.texts.refuse(refusal)
        self.disarm(FlightEvent.DISARMED)
        return CommandResult.ACCEPTED

    def arm(self) -> bool:
        """Arm if that is allowed; whether it was."""
        return self._try_to_arm(forced=False) is CommandResult.ACCEPTED

    def _try_to_arm(self, forced: bool) -> CommandResult | None:
        context, flight = self._context, self._context.flight
        refusal = self._policy.refuse_arming(flight, context.parameters, forced, self._has_setpoints())
        if refusal:
            return self._context.texts.refuse(refusal)
        flight.armed = True
        flight.armed_since_ns = flight.time_ns
        self._landed_ns = None
        self._home.set_here()
        context.airframe.arm()
        context.texts.announce(FlightEvent.ARMED)
        # A mode that was chosen on the ground begins now, from here.
        self._modes.switch(flight.mode)
        return CommandResult.ACCEPTED
