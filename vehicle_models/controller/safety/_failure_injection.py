"""MAV_CMD_INJECT_FAILURE, where the autopilot knows it and its parameter allows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..links._enums import MAV_CMD
from ..state._parameter_store import ParameterStore
from ..state._service import Command, CommandHandler, CommandResult

# FAILURE_UNIT. A battery cannot be repaired, so FAILURE_UNIT_SYSTEM_BATTERY is not offered.
_UNITS = {4: "gps_off", 101: "motor_off", 105: "link_loss"}
# FAILURE_TYPE
_OK, _OFF = 0, 1
_MAX_INSTANCE = 16

BreakPart = Callable[[str, int, bool], bool]
"""Breaks (True) or repairs a kind of SimSpec failure, by instance (0: all); False without such a part."""


@dataclass(eq=False)
class FailureInjection:
    """Breaks and repairs what can be broken here; other units and types are UNSUPPORTED.

    `allowed_by` is the parameter that allows it; None: there is no such command. Without `simulation_control`
    every attempt is DENIED, as by an autopilot whose parameter forbids it.
    """

    _parameters: ParameterStore
    _allowed_by: str | None
    _break_part: BreakPart
    _simulation_control: bool
    refused: int = 0
    """Attempts to inject a failure where the bench does not allow it."""

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.INJECT_FAILURE: self._inject} if self._allowed_by else {}

    def _inject(self, command: Command) -> CommandResult | None:
        if not self._simulation_control:
            self.refused += 1
            return CommandResult.DENIED
        if self._allowed_by is None or not self._parameters[self._allowed_by]:
            return CommandResult.DENIED
        unit, kind, instance = command.params[:3]
        if unit not in _UNITS or kind not in (_OK, _OFF) or not 0 <= instance <= _MAX_INSTANCE:
            return CommandResult.UNSUPPORTED
        done = self._break_part(_UNITS[int(unit)], int(instance), kind == _OFF)
        return CommandResult.ACCEPTED if done else CommandResult.UNSUPPORTED
