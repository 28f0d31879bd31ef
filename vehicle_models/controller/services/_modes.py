"""Modes: which one, how it is asked for, and when it may not be had."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .._flight import Behaviour, Mode
from .._personality import Event, Refusal
from .._service import Command, CommandHandler, Handler, Result, Sender
from .._service_context import ServiceContext
from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import Takeoff

DO_SET_MODE = 176
_SAID = {Behaviour.LAND: Event.LANDING, Behaviour.RETURN: Event.RETURNING, Behaviour.TERMINATE: Event.TERMINATED}


class Modes:
    """DO_SET_MODE and the old SET_MODE; the one door by which a mode changes."""

    def __init__(self, board: ServiceContext, guidance: Guidance, has_setpoints: Callable[[], bool]) -> None:
        self._board = board
        self._guidance = guidance
        self._has_setpoints = has_setpoints
        self.on_change: list[Callable[[], None]] = []

    def handlers(self) -> Mapping[str, Handler]:
        return {"SET_MODE": self._old_message}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {DO_SET_MODE: self._command}

    def tick(self) -> None:
        """A takeoff that has reached its height hands over to holding, where it is a mode of its own."""
        flight = self._board.flight
        if flight.mode.behaviour is Behaviour.TAKEOFF and flight.armed and self._guidance.manoeuvre.done(flight):
            risen = self._guidance.manoeuvre
            self.switch(self._board.personality.mode(self._board.personality.hold_mode))
            if isinstance(risen, Takeoff):
                self._guidance.manoeuvre = risen.hold(flight)

    @property
    def terminated(self) -> bool:
        """Whether the flight has been ended, which no mode undoes."""
        return self._board.flight.armed and self._board.flight.mode.behaviour is Behaviour.TERMINATE

    def switch(self, mode: Mode) -> None:
        """Enter a mode, whoever wants it."""
        board = self._board
        if self.terminated:
            return
        changed = mode is not board.flight.mode
        board.flight.mode = mode
        self._guidance.begin(mode.behaviour, board.flight)
        event = _SAID.get(mode.behaviour)
        if changed and event and event in board.personality.texts:
            board.texts.say(*board.personality.texts[event])
        if changed:
            for listener in self.on_change:
                listener()

    def to(self, behaviour: Behaviour) -> None:
        """Enter the personality's mode for a behaviour."""
        personality = self._board.personality
        names = {
            Behaviour.HOLD: personality.hold_mode,
            Behaviour.LAND: personality.land_mode,
            Behaviour.RETURN: personality.return_mode,
            Behaviour.FOLLOW: personality.follow_mode,
        }
        self.switch(personality.mode(names[behaviour]))

    def ask(self, number: int) -> Refusal | None:
        """Enter the mode of a number, or say why not."""
        personality = self._board.personality
        wanted = personality.mode_of(number)
        if wanted and wanted.name == personality.orbit_mode and not self._board.flight.armed:
            wanted = personality.mode_of(number & 0xFFFFFF)  # a mode that only a command can fill ends in its main mode
        if self.terminated:
            return Refusal(Result.TEMPORARILY_REJECTED)
        refusal = personality.refuse_mode(self._board.flight, wanted, number, self._has_setpoints())
        if refusal is None and wanted is not None:
            if wanted is not self._board.flight.mode:
                self.switch(wanted)
            return None
        refusal = refusal or Refusal(Result.DENIED)
        for text in refusal.texts:
            self._board.texts.say(*text)
        return refusal

    def _command(self, command: Command) -> Result | None:
        number = self._board.personality.mode_number(command)
        if number is None:
            return Result.DENIED
        refusal = self.ask(number)
        return refusal.result if refusal else Result.ACCEPTED

    def _old_message(self, message: Any, sender: Sender) -> None:
        refusal = self.ask(message.custom_mode)
        if self._board.personality.set_mode_message_acks:
            result = refusal.result if refusal else Result.ACCEPTED
            if result is not None:
                sender.channel.tell(
                    "COMMAND_ACK",
                    command=DO_SET_MODE,
                    result=result,
                    target_system=sender.system,
                    target_component=sender.component,
                )
