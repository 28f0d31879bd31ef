"""MAV_CMD_INJECT_FAILURE, where the autopilot knows it and its parameter allows it."""

from __future__ import annotations

from collections.abc import Mapping

from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext
from ..payload._equipment import BreakPart

INJECT_FAILURE = 420
_UNITS = {4: "gps_off", 101: "motor_off", 105: "link_loss"}  # FAILURE_UNIT; a battery cannot be put back, and is left alone
_WORKS, _OFF = 0, 1  # FAILURE_TYPE


class FailureInjection:
    """Breaks and repairs what can be broken here; the other units and types are UNSUPPORTED."""

    def __init__(self, board: ServiceContext, break_part: BreakPart) -> None:
        self._board = board
        self._break = break_part

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {INJECT_FAILURE: self._inject} if self._board.personality.failure_parameter else {}

    def _inject(self, command: Command) -> Result | None:
        allowed = self._board.personality.failure_parameter
        if allowed is None or not self._board.parameters[allowed]:
            return Result.DENIED
        unit, kind, instance = command.params[:3]
        if unit not in _UNITS or kind not in (_WORKS, _OFF) or not 0 <= instance <= 16:
            return Result.UNSUPPORTED
        done = self._break(_UNITS[int(unit)], int(instance), kind == _OFF)
        return Result.ACCEPTED if done else Result.UNSUPPORTED
