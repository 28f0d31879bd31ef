"""Keeps agents from asking a board for more than its line carries; they are answered in its name, with the reason."""

from __future__ import annotations

import struct
from collections.abc import Callable

from ..controller.links._enums import MAV_CMD
from ..controller.links._frames import Packer, message_id, sender
from ._line_budget import LineBudget

_PARAM_SET = 23
# By these an agent could make the next start one that drives real motors.
_BOARD_PARAMETERS = (b"SYS_HITL", b"SYS_AUTOSTART", b"SYS_AUTOCONFIG", b"HIL_ACT_", b"PWM_MAIN_", b"PWM_AUX_")
_NAME_AT = 6
_COMMAND_INT, _COMMAND_LONG, _COMMAND_ACK, _REQUEST_DATA_STREAM, _STATUSTEXT = 75, 76, 77, 66, 253
_AUTOPILOT_COMPONENT = 1
_SEVERITY_WARNING = 4
_MAV_RESULT_DENIED = 2
_TEXT_BYTES = 50
_COMMANDS = {_COMMAND_LONG: struct.Struct("<7fH"), _COMMAND_INT: struct.Struct("<4fiifH")}


class BoardGate:
    """Refuses what does not fit. `system` is the board's system id."""

    def __init__(self, budget: LineBudget, system: Callable[[], int]) -> None:
        self._budget, self._system = budget, system
        self._answers: list[bytes] = []
        self._sequence = 0
        self.refused = 0

    def admits(self, frame: bytes) -> bool:
        """Whether a whole frame may go to the board."""
        number = message_id(frame)
        if number == _REQUEST_DATA_STREAM:
            # Old, and in groups whose rates nobody can plan.
            return self._refuse(frame, None, "REQUEST_DATA_STREAM: ask by SET_MESSAGE_INTERVAL")
        if number == _PARAM_SET:
            at = (10 if frame[0] == 0xFD else 6) + _NAME_AT
            name = frame[at : at + 16].split(b"\0")[0]
            if name.startswith(_BOARD_PARAMETERS):
                return self._refuse(
                    frame, None, f"{name.decode('ascii', 'replace')} is not set over the bench"
                )
        layout = _COMMANDS.get(number)
        if layout is None:
            return True
        head = 10 if frame[0] == 0xFD else 6
        payload = frame[head : head + frame[1]][: layout.size].ljust(layout.size, b"\0")
        message, interval_us, *_, command = layout.unpack(payload)
        if command != MAV_CMD.SET_MESSAGE_INTERVAL or interval_us < 0.0:
            return True
        # An interval of 0 asks for the default, which PX4 chooses by the rate of the link.
        reason = self._budget.refusal(int(message), 1e6 / interval_us) if interval_us > 0.0 else None
        return reason is None or self._refuse(frame, int(command), reason)

    def take_answers(self) -> list[bytes]:
        """Answers for whoever asked, which look like the board's own."""
        answers, self._answers = self._answers, []
        return answers

    def _refuse(self, frame: bytes, command: int | None, reason: str) -> bool:
        self.refused += 1
        system, component = sender(frame)
        if command is not None:
            self._answer(_COMMAND_ACK, (command, _MAV_RESULT_DENIED, 0, 0, system, component))
        self._answer(_STATUSTEXT, (_SEVERITY_WARNING, reason.encode()[:_TEXT_BYTES], 0, 0))
        return False

    def _answer(self, number: int, values: tuple[object, ...]) -> None:
        packer = Packer(self._system(), _AUTOPILOT_COMPONENT)
        self._answers.append(packer.pack(number, self._sequence, values))
        self._sequence = (self._sequence + 1) & 0xFF
