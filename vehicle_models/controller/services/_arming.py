"""Arming and disarming, by command and by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .._flight import Behaviour, Landed
from .._personality import Event, Refusal
from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext
from ..guidance._guidance import Guidance
from ._home import HomeKeeper
from ._modes import Modes

ARM_DISARM = 400
_FORCE = 21196.0


class Arming:
    """COMPONENT_ARM_DISARM, and the disarming that follows a landing or idling on the ground."""

    def __init__(
        self, board: ServiceContext, modes: Modes, guidance: Guidance, home: HomeKeeper, has_setpoints: Callable[[], bool]
    ) -> None:
        self._board = board
        self._modes = modes
        self._guidance = guidance
        self._home = home
        self._has_setpoints = has_setpoints
        self._landed_ns: int | None = None

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {ARM_DISARM: self._command}

    def tick(self) -> None:
        """Disarm after a landing, or when armed and left standing."""
        flight, limits = self._board.flight, self._guidance.limits
        if not flight.armed or flight.landed is not Landed.ON_GROUND:
            return
        piloted = flight.mode.behaviour is Behaviour.PILOT and not self._board.personality.piloted_landing_disarms
        if piloted:
            self._disarm_after(max(self._landed_ns or 0, flight.armed_since_ns), limits.idle_disarm_s, Event.DISARMED_IDLE)
        elif self._landed_ns is not None:
            self._disarm_after(self._landed_ns, limits.landed_disarm_s, Event.DISARMED_BY_LANDING)
        else:
            self._disarm_after(flight.armed_since_ns, limits.idle_disarm_s, Event.DISARMED_IDLE)

    def landed(self) -> None:
        """The vehicle has come down."""
        self._landed_ns = self._board.flight.time_ns

    def lifted(self) -> None:
        self._landed_ns = None

    def disarm(self, event: Event) -> None:
        """Stop the rotors, whatever the reason."""
        board = self._board
        board.flight.armed = False
        board.flight.landed = Landed.ON_GROUND if board.flight.on_ground else board.flight.landed
        board.airframe.disarm()
        self._landed_ns = None
        if event in board.personality.texts:
            board.texts.say(*board.personality.texts[event])
        if board.personality.mode_after_landing and event is not Event.CRASHED:
            self._modes.switch(board.personality.mode(board.personality.mode_after_landing))

    def _disarm_after(self, since_ns: int, span_s: float | None, event: Event) -> None:
        if span_s is not None and self._board.flight.time_ns - since_ns >= round(span_s * 1e9):
            self.disarm(event)

    def _command(self, command: Command) -> Result | None:
        value, force = command.params[0], command.params[1] == _FORCE
        personality, flight = self._board.personality, self._board.flight
        nonsense = personality.refuse_arm_value(value)
        if nonsense:
            return self._refused(nonsense)
        if value >= 0.5:
            if flight.armed:
                return Result.ACCEPTED
            refusal = personality.refuse_arming(flight, self._board.parameters, force, self._has_setpoints())
            return self._refused(refusal) if refusal else self._arm()
        if not flight.armed:
            return Result.ACCEPTED
        refusal = personality.refuse_disarming(flight, force)
        if refusal:
            return self._refused(refusal)
        self.disarm(Event.DISARMED)
        return Result.ACCEPTED

    def arm(self) -> bool:
        """Arm if that may be; whether it could."""
        personality, flight = self._board.personality, self._board.flight
        refusal = personality.refuse_arming(flight, self._board.parameters, False, self._has_setpoints())
        if refusal:
            self._refused(refusal)
            return False
        self._arm()
        return True

    def _arm(self) -> Result:
        board = self._board
        board.flight.armed = True
        board.flight.armed_since_ns = board.flight.time_ns
        self._landed_ns = None
        self._home.set_here()
        board.airframe.arm()
        board.texts.say(*board.personality.texts[Event.ARMED])
        # What was chosen on the ground begins now, from here.
        self._modes.switch(board.flight.mode)
        return Result.ACCEPTED

    def _refused(self, refusal: Refusal) -> Result | None:
        for text in refusal.texts:
            self._board.texts.say(*text)
        return refusal.result
