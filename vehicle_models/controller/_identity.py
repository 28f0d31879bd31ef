"""Who the autopilot is: AUTOPILOT_VERSION, on request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ._board import Board, Command, CommandHandler, Handler, Result

REQUEST_CAPABILITIES = 520


class Identity:
    """AUTOPILOT_VERSION by REQUEST_MESSAGE and by the old REQUEST_AUTOPILOT_CAPABILITIES."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {REQUEST_CAPABILITIES: self._old}

    def answers(self) -> Mapping[str, Any]:
        return {"AUTOPILOT_VERSION": lambda command: self._fields()}

    def tick(self) -> None:
        pass

    def _old(self, command: Command) -> Result | None:
        command.sender.channel.tell("AUTOPILOT_VERSION", **self._fields())
        return Result.ACCEPTED

    def _fields(self) -> dict[str, Any]:
        personality = self._board.personality
        return {
            "capabilities": personality.capabilities,
            "uid": personality.uid,
            "flight_sw_version": personality.flight_sw_version,
            "board_version": personality.board_version,
            "flight_custom_version": list(personality.flight_custom_version),
        }
