"""Commands of the autopilot itself to devices of its own system, which every client of its links sees."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..links._enums import MAV_CMD
from ..state._flight_state import Behaviour
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ._modes import Modes

# Source: PX4's MavlinkCommandSender.
_REPEAT_NS, _TRIES = 500_000_000, 4
_NAN = math.nan
# Source: PX4's Navigator. The camera's trigger pauses; the gimbal is taken, levelled (GIMBAL_MANAGER_FLAGS_NEUTRAL), given
# back.
_PAUSE_TRIGGER = (MAV_CMD.DO_TRIGGER_CONTROL, (-1.0, 0.0, 1.0))
_LEVEL_GIMBAL = (MAV_CMD.DO_GIMBAL_MANAGER_PITCHYAW, (_NAN, _NAN, _NAN, _NAN, 2.0))
_RELEASE_GIMBAL = (MAV_CMD.DO_GIMBAL_MANAGER_CONFIGURE, (-3.0, -3.0, -1.0, -1.0))


@dataclass(slots=True)
class _Unanswered:
    command: int
    params: tuple[float, ...]
    due_ns: int
    confirmation: int = 0


class OwnCommands:
    """Sends each command four times in two seconds, or until a component of the system acknowledges it.

    A return and a landing tell the gimbal to level, and so does the end of a mission. The bench's gimbal, which is no
    component of its own, does not obey.
    """

    def __init__(self, context: ServiceContext, modes: Modes, system: int) -> None:
        self._context = context
        self._system = system
        self._unanswered: list[_Unanswered] = []
        self._behaviour = context.flight.mode.behaviour
        modes.on_change.append(self._mode_changed)

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"COMMAND_ACK": self._take_acknowledgement}

    def tick(self) -> None:
        if self._unanswered:
            now_ns = self._context.flight.time_ns
            for command in self._unanswered:
                if command.due_ns <= now_ns:
                    self._send(command)
            self._unanswered = [command for command in self._unanswered if command.confirmation < _TRIES]

    def send(self, command: int, params: tuple[float, ...]) -> None:
        """Send a command to every component of the own system."""
        unanswered = _Unanswered(command, params, self._context.flight.time_ns)
        self._send(unanswered)
        self._unanswered.append(unanswered)

    def _send(self, command: _Unanswered) -> None:
        fields = {f"param{number}": param for number, param in enumerate(command.params, start=1)}
        self._context.radio.broadcast(
            "COMMAND_LONG",
            command=command.command,
            confirmation=command.confirmation,
            target_system=self._system,
            target_component=0,
            **fields,
        )
        command.confirmation += 1
        command.due_ns += _REPEAT_NS

    def _mode_changed(self) -> None:
        flight = self._context.flight
        previously, self._behaviour = self._behaviour, flight.mode.behaviour
        # A navigator at rest commands nothing.
        if not flight.armed:
            return
        if previously is Behaviour.MISSION:
            for command in (_PAUSE_TRIGGER, _LEVEL_GIMBAL, _RELEASE_GIMBAL):
                self.send(*command)
        if self._behaviour in (Behaviour.RETURN, Behaviour.LAND):
            take_gimbal = (MAV_CMD.DO_GIMBAL_MANAGER_CONFIGURE, (float(self._system), 1.0, -1.0, -1.0))
            for command in (take_gimbal, _LEVEL_GIMBAL, _RELEASE_GIMBAL):
                self.send(*command)

    def _take_acknowledgement(self, m: Any, sender: MessageSender) -> None:
        if sender.system == self._system:
            self._unanswered = [command for command in self._unanswered if command.command != m.command]
