"""COMMAND_LONG and COMMAND_INT: from the client to the service, and the acknowledgement back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..links._enums import MAV_CMD
from ..policies._commands import CommandAnswer, CommandPolicy
from ..state._service import Command, CommandHandler, CommandResult, MessageHandler, MessageSender
from ..state._service_context import ServiceContext

_RESULT_SPACING_NS = 1_000_000_000
# X or y of COMMAND_INT: left out.
_NO_COORDINATE = 2**31 - 1


class Commands:
    """Finds each command's service: an unknown one is UNSUPPORTED, a result of None not acknowledged."""

    def __init__(self, context: ServiceContext, policy: CommandPolicy) -> None:
        self._context = context
        self._policy = policy
        self._table: dict[int, CommandHandler] = {}
        self._answered: set[int] = set()  # numbers that came before
        self._pending: list[tuple[int, Command, CommandResult]] = []  # later acknowledgements, by due time

    def add(self, commands: Mapping[int, CommandHandler]) -> None:
        self._table.update(commands)

    def carried_out(self) -> frozenset[int]:
        """Numbers of the commands that were added."""
        return frozenset(self._table)

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"COMMAND_LONG": self._run_long, "COMMAND_INT": self._run_int, "COMMAND_CANCEL": self._cancel}

    def tick(self) -> None:
        while self._pending and self._pending[0][0] <= self._context.flight.time_ns:
            _, command, result = self._pending.pop(0)
            self._acknowledge(command, result)

    def _run_long(self, m: Any, sender: MessageSender) -> None:
        params = (m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._run(Command(m.command, params, None, sender))

    def _run_int(self, m: Any, sender: MessageSender) -> None:
        x = math.nan if m.x == _NO_COORDINATE else m.x * 1e-7
        y = math.nan if m.y == _NO_COORDINATE else m.y * 1e-7
        self._run(Command(m.command, (m.param1, m.param2, m.param3, m.param4, x, y, m.z), m.frame, sender))

    def _cancel(self, m: Any, sender: MessageSender) -> None:
        """End a command in progress and acknowledge that to its sender; anything else is not answered."""
        if m.target_system == 0:
            # The specification forbids to broadcast a COMMAND_CANCEL.
            return
        for pending in [pending for pending in self._pending if pending[1].number == m.command]:
            self._pending.remove(pending)
            self._acknowledge(pending[1], CommandResult.CANCELLED)

    def _run(self, command: Command) -> None:
        if command.number == MAV_CMD.DO_SET_MODE and self._policy.accepts_mode_first:
            self._acknowledge(command, CommandResult.ACCEPTED)
        self.run(command)

    def run(self, command: Command) -> None:
        """Carry a command out and acknowledge its result."""
        policy = self._policy
        handler = self._table.get(command.number)
        answer = None if handler else policy.answer(self._context.flight, command)
        if answer:
            self.answer(command, answer)
            return
        fixed = policy.fixed_results.get(command.number, CommandResult.UNSUPPORTED)
        result = handler(command) if handler else fixed
        if result is not None:
            self._acknowledge(command, result)

    def answer(self, command: Command, answer: CommandAnswer) -> None:
        """Send the texts and the first acknowledgement of `answer` now, and the others a second apart."""
        self._context.texts.send_all(answer.texts)
        now_ns = self._context.flight.time_ns
        # Only the first of some commands is answered in two steps.
        results = answer.results if command.number in self._answered else answer.first_time or answer.results
        self._answered.add(command.number)
        self._acknowledge(command, results[0])
        for count, result in enumerate(results[1:], start=1):
            self._pending.append((now_ns + count * _RESULT_SPACING_NS, command, result))

    def _acknowledge(self, command: Command, result: CommandResult) -> None:
        command.sender.answer("COMMAND_ACK", command=command.number, result=result)
