"""Keeps agents from asking a board for more than its line carries, and from changing what it keeps."""

from __future__ import annotations

import struct
from collections.abc import Callable

from vehicle_models.firmware import (
    MAV_CMD,
    Packer,
    file_refusal,
    message_id,
    parameter_name,
    payload_of,
    replaces_parameters,
    sender,
)

from ._board_line import PARAM_SET
from ._line_budget import LineBudget

# By these an agent could make the next start one that drives real motors.
_BOARD_PARAMETERS = (b"SYS_HITL", b"SYS_AUTOSTART", b"SYS_AUTOCONFIG", b"HIL_ACT_", b"PWM_MAIN_", b"PWM_AUX_")
# What the board would keep after the session, and its owner fly with.
_KEPT_BY_BOARD = frozenset(
    {
        MAV_CMD.PREFLIGHT_CALIBRATION,
        MAV_CMD.PREFLIGHT_SET_SENSOR_OFFSETS,
        MAV_CMD.PREFLIGHT_UAVCAN,
        MAV_CMD.CONFIGURE_ACTUATOR,
        MAV_CMD.FIXED_MAG_CAL_YAW,
        MAV_CMD.DO_START_MAG_CAL,
        MAV_CMD.DO_ACCEPT_MAG_CAL,
        MAV_CMD.FLASH_BOOTLOADER,
    }
)
_COMMAND_INT, _COMMAND_LONG, _FILE_TRANSFER_PROTOCOL = 75, 76, 110
_COMMAND_ACK, _REQUEST_DATA_STREAM, _STATUSTEXT, _SETUP_SIGNING = 77, 66, 253, 256
_AUTOPILOT_COMPONENT = 1
_SEVERITY_WARNING = 4
_MAV_RESULT_DENIED = 2
_TEXT_BYTES = 50
_COMMANDS = {_COMMAND_LONG: struct.Struct("<7fH"), _COMMAND_INT: struct.Struct("<4fiifH")}


class BoardGate:
    """Refuses what does not fit, or would stay. `system` is the board's system id."""

    def __init__(self, budget: LineBudget, system: Callable[[], int]) -> None:
        self._budget, self._system = budget, system
        self._answers: list[bytes] = []
        self._packer = Packer(0, _AUTOPILOT_COMPONENT)
        self.refused = 0

    def admits(self, frame: bytes) -> bool:
        """Whether a whole frame may go to the board."""
        number = message_id(frame)
        if number == _REQUEST_DATA_STREAM:
            # Old, and in groups whose rates nobody can plan.
            return self.refuse("REQUEST_DATA_STREAM: ask by SET_MESSAGE_INTERVAL")
        if number == _SETUP_SIGNING:
            # The board would obey nobody without the agent's key any more.
            return self.refuse("SETUP_SIGNING is not done over the bench")
        if number == PARAM_SET and (name := parameter_name(frame)).startswith(_BOARD_PARAMETERS):
            return self.refuse(f"{name.decode('ascii', 'replace')} is not set over the bench")
        # Also where clients may control the simulation: these are files of a board that somebody owns.
        if number == _FILE_TRANSFER_PROTOCOL and (answer := file_refusal(frame)):
            self.refused += 1
            self._answers.append(answer)
            return False
        if number in _COMMANDS:
            return self._admits_command(frame, _COMMANDS[number])
        return True

    def take_answers(self) -> list[bytes]:
        """Answers for whoever asked, which look like the board's own."""
        answers, self._answers = self._answers, []
        return answers

    def refuse(self, reason: str) -> bool:
        """Tell agents by a text why a message did not go to the board; False."""
        self.refused += 1
        self._answer(_STATUSTEXT, (_SEVERITY_WARNING, reason.encode()[:_TEXT_BYTES], 0, 0))
        return False

    def _admits_command(self, frame: bytes, layout: struct.Struct) -> bool:
        message, interval_us, *_, command = layout.unpack(payload_of(frame, layout.size))
        if command in _KEPT_BY_BOARD or replaces_parameters(frame):
            return self._deny(frame, command, f"command {command}: the board would keep what it changes")
        if command != MAV_CMD.SET_MESSAGE_INTERVAL or interval_us < 0.0:
            return True
        # An interval of 0 asks for the default, which PX4 chooses by the rate of the link.
        reason = self._budget.refusal(int(message), 1e6 / interval_us) if interval_us > 0.0 else None
        return reason is None or self._deny(frame, command, reason)

    def _deny(self, frame: bytes, command: int, reason: str) -> bool:
        self._answer(_COMMAND_ACK, (command, _MAV_RESULT_DENIED, 0, 0, *sender(frame)))
        return self.refuse(reason)

    def _answer(self, number: int, values: tuple[object, ...]) -> None:
        self._packer.system = self._system()
        self._answers.append(self._packer.pack_next(number, values))
