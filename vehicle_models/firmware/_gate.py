"""What of an agent's MAVLink never reaches a real autopilot: what would change the simulation, or end the program.

The imitated flight controller refuses the same (docs/flight-controller.md). An agent whose program could be ended by a
message could drop a session that goes badly.
"""

from __future__ import annotations

import struct

from ..controller.files._ftp import FtpOpcode
from ..controller.links._frames import Packer, message_id, sender

_PARAM_SET, _COMMAND_INT, _COMMAND_LONG, _FILE_TRANSFER_PROTOCOL, _SERIAL_CONTROL = 23, 75, 76, 110, 126
_PREFLIGHT_REBOOT_SHUTDOWN, _INJECT_FAILURE = 246, 420
# HIL_STATE, HIL_CONTROLS, HIL_RC_INPUTS_RAW, HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_GPS, HIL_OPTICAL_FLOW,
# HIL_STATE_QUATERNION.
_SIMULATOR_MESSAGES = frozenset({90, 91, 92, 93, 107, 113, 114, 115})
_SIMULATION_PARAMETERS = (b"SIM_", b"SIH_", b"SYS_FAILURE_EN", b"SYS_HITL")
# Where they stand in the payload: the command behind seven parameters, the name behind value, system and component, the
# file transfer behind network, system and component.
_COMMAND_AT, _NAME_AT, _TRANSFER_AT = 28, 6, 3
# MAVLink FTP: sequence, session, opcode, size, requested opcode, burst complete, padding, offset; then data.
_TRANSFER = struct.Struct("<HBBBBBBI")
_TRANSFER_BYTES = 251
# By these an agent could set any parameter (ArduPilot: @PARAM/param.pck; PX4: the file of its parameters) or put a start
# script in place. A session to write begins with one of them; plans are uploaded to virtual files of ArduPilot.
_WRITING = frozenset(
    {
        FtpOpcode.CREATE,
        FtpOpcode.REMOVE,
        FtpOpcode.MAKE_FOLDER,
        FtpOpcode.REMOVE_FOLDER,
        FtpOpcode.OPEN_WRITE,
        FtpOpcode.TRUNCATE,
        FtpOpcode.RENAME,
    }
)
_PLANS = (b"@MISSION/", b"@FENCE/", b"@RALLY/")
_FILE_PROTECTED = 9
_AUTOPILOT_COMPONENT = 1


class Gate:
    """Counts what it withholds. With `simulation_control` only the end of the program is withheld."""

    def __init__(self, simulation_control: bool) -> None:
        self._simulation_control = simulation_control
        self._answers: list[bytes] = []
        self.refused = 0

    def admits(self, frame: bytes) -> bool:
        """Whether a whole frame may go to the autopilot."""
        number = message_id(frame)
        head = 10 if frame[0] == 0xFD else 6
        if number in (_COMMAND_LONG, _COMMAND_INT):
            (command,) = struct.unpack(
                "<H", frame[head + _COMMAND_AT : head + _COMMAND_AT + 2].ljust(2, b"\0")
            )
            withheld = command == _PREFLIGHT_REBOOT_SHUTDOWN or (
                command == _INJECT_FAILURE and not self._simulation_control
            )
        elif number == _SERIAL_CONTROL:
            # A shell on the autopilot can do all of the above.
            withheld = True
        elif number == _PARAM_SET:
            name = frame[head + _NAME_AT : head + _NAME_AT + 16]
            withheld = name.startswith(_SIMULATION_PARAMETERS) and not self._simulation_control
        elif number == _FILE_TRANSFER_PROTOCOL:
            withheld = not self._simulation_control and self._writes(frame, head)
        else:
            withheld = number in _SIMULATOR_MESSAGES and not self._simulation_control
        self.refused += withheld
        return not withheld

    def take_answers(self) -> list[bytes]:
        """What the asking client is to hear in the autopilot's place. Clients of other messages do without an answer, as on
        a radio, but a file transfer would be asked for again and again.
        """
        answers, self._answers = self._answers, []
        return answers

    def _writes(self, frame: bytes, head: int) -> bool:
        """Whether a file transfer changes files of the autopilot that are no plans; it is answered then."""
        payload = frame[head : head + frame[1]].ljust(_TRANSFER_AT + _TRANSFER_BYTES, b"\0")
        sequence, session, opcode, size, *_ = _TRANSFER.unpack_from(payload, _TRANSFER_AT)
        data_at = _TRANSFER_AT + _TRANSFER.size
        if opcode not in _WRITING or payload[data_at : data_at + size].startswith(_PLANS):
            return False
        refusal = _TRANSFER.pack((sequence + 1) & 0xFFFF, session, FtpOpcode.NAK, 1, opcode, 0, 0, 0)
        content = (refusal + bytes([_FILE_PROTECTED])).ljust(_TRANSFER_BYTES, b"\0")
        system, component = sender(frame)
        # The autopilot that was asked: its system stands behind the network in the payload.
        packer = Packer(payload[1] or 1, _AUTOPILOT_COMPONENT)
        self._answers.append(packer.pack(_FILE_TRANSFER_PROTOCOL, 0, (0, system, component, *content)))
        return True
