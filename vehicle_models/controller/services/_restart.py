"""Restarting: PREFLIGHT_REBOOT_SHUTDOWN, and what of a flight controller outlives it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext
from ..links._signing import Signing
from ..missions._store import Item

REBOOT = 246
_AGAIN = (1.0, 3.0)  # restart; restart and stay in a bootloader, where the autopilot accepts that


@dataclass(frozen=True, slots=True)
class Kept:
    """What one controller leaves to the next: what it has in its flash, and the counts of a session."""

    parameters: Mapping[str, float]
    plans: Mapping[int, tuple[Item, ...]]
    signing: Signing
    counts: Mapping[str, int]


class Restart:
    """Acknowledges the command by the personality's own answer; what is accepted is done once the step is over."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self.wanted = False

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {REBOOT: self._restart}

    def _restart(self, command: Command) -> Result | None:
        personality = self._board.personality
        answer = personality.answer(self._board.flight, command)
        result = answer.results[0] if answer else personality.fixed_results.get(REBOOT, Result.UNSUPPORTED)
        self.wanted = self.wanted or (result is Result.ACCEPTED and command.params[0] in _AGAIN)
        return result
