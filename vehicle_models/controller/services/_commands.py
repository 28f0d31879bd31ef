"""Commands: COMMAND_LONG and COMMAND_INT to the service that carries them out, and the acknowledgement back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .._personality import Answer
from .._service import Command, CommandHandler, Handler, Result, Sender
from .._service_context import ServiceContext
from ._modes import DO_SET_MODE

_APART_NS = 1_000_000_000
_NOWHERE = 2**31 - 1  # x or y of COMMAND_INT: not given


class Commands:
    """Looks up who carries a command out. What nobody knows is UNSUPPORTED; None as a result is not acknowledged."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self._table: dict[int, CommandHandler] = {}
        self._come: set[int] = set()  # numbers answered so far
        self._later: list[tuple[int, Command, Result]] = []  # second acknowledgements, by when

    def add(self, commands: Mapping[int, CommandHandler]) -> None:
        self._table.update(commands)

    def handlers(self) -> Mapping[str, Handler]:
        return {"COMMAND_LONG": self._long, "COMMAND_INT": self._int, "COMMAND_CANCEL": self._cancel}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        while self._later and self._later[0][0] <= self._board.flight.time_ns:
            _, command, result = self._later.pop(0)
            self._acknowledge(command, result)

    def _long(self, m: Any, sender: Sender) -> None:
        params = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._run(Command(m.command, params, None, sender))

    def _int(self, m: Any, sender: Sender) -> None:
        x = math.nan if m.x == _NOWHERE else m.x * 1e-7
        y = math.nan if m.y == _NOWHERE else m.y * 1e-7
        self._run(Command(m.command, (m.param1, m.param2, m.param3, m.param4, x, y, m.z), m.frame, sender))

    def _cancel(self, m: Any, sender: Sender) -> None:
        """What is still in progress ends, and whoever gave the command hears that; for anything else there is no answer."""
        if m.target_system == 0:
            return  # must not be broadcast
        for one in [one for one in self._later if one[1].number == m.command]:
            self._later.remove(one)
            self._acknowledge(one[1], Result.CANCELLED)

    def _run(self, command: Command) -> None:
        personality = self._board.personality
        if command.number == DO_SET_MODE and personality.mode_acks_twice:
            self._acknowledge(command, Result.ACCEPTED)
        handler = self._table.get(command.number)
        answer = None if handler else personality.answer(self._board.flight, command)
        if answer:
            self._answer(command, answer)
            return
        fixed = personality.fixed_results.get(command.number, Result.UNSUPPORTED)
        result = handler(command) if handler is not None else fixed
        if result is not None:
            self._acknowledge(command, result)

    def _answer(self, command: Command, answer: Answer) -> None:
        for text in answer.texts:
            self._board.texts.say(*text)
        now = self._board.flight.time_ns
        results = answer.results if command.number in self._come else answer.first_time or answer.results
        self._come.add(command.number)
        for place, result in enumerate(results):
            if place == 0:
                self._acknowledge(command, result)
            else:
                self._later.append((now + place * _APART_NS, command, result))

    def _acknowledge(self, command: Command, result: Result) -> None:
        command.sender.channel.tell(
            "COMMAND_ACK",
            command=command.number,
            result=result,
            target_system=command.sender.system,
            target_component=command.sender.component,
        )
