"""What of an agent's MAVLink never reaches a real autopilot: what would change the simulation, or end the program. And what of
the autopilot's never reaches an agent: the truth that only a simulation knows.

The imitated flight controller refuses the same (docs/flight-controller.md). An agent whose program could be ended by a
message could drop a session that goes badly. Nor what would read files of the host through it.
"""

from __future__ import annotations

import struct

from ..controller.links._enums import MAV_CMD
from ..controller.links._frames import message_id, payload_of
from ._file_guard import FILE_TRANSFER_PROTOCOL, file_refusal, host_refusal

PARAM_SET, COMMAND_INT, COMMAND_LONG, _SERIAL_CONTROL = 23, 75, 76, 126
# HIL_STATE, HIL_CONTROLS, HIL_RC_INPUTS_RAW, HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_GPS, HIL_OPTICAL_FLOW,
# HIL_STATE_QUATERNION.
_SIMULATOR_MESSAGES = frozenset({90, 91, 92, 93, 107, 113, 114, 115})
# HIL_STATE, SIM_STATE, HIL_STATE_QUATERNION, SIMSTATE: PX4 sends its ground truth on request, ArduPilot with ATTITUDE.
_TRUTH_MESSAGES = frozenset({90, 108, 115, 164})
_SIMULATION_PARAMETERS = (b"SIM_", b"SIH_", b"SYS_FAILURE_EN", b"SYS_HITL")
# The first parameter of PREFLIGHT_STORAGE. Others load or reset all parameters, those of the simulation too.
_SAVE_PARAMETERS = 1.0
# In the payload: the command behind seven parameters, the name behind value, system and component.
_COMMAND_AT, _NAME_AT, _NAME_BYTES = 28, 6, 16


class Gate:
    """Counts what it withholds. With `simulation_control` only the end of the program and files of the host are withheld."""

    def __init__(self, simulation_control: bool) -> None:
        self._simulation_control = simulation_control
        self._answers: list[bytes] = []
        self.refused = 0

    def admits(self, frame: bytes) -> bool:
        """Whether a whole frame may go to the autopilot."""
        withheld = _ends_program(frame) or self._reads_host(frame)
        withheld = withheld or (not self._simulation_control and self._changes_simulation(frame))
        self.refused += withheld
        return not withheld

    def states_truth(self, frame: bytes) -> bool:
        """Whether a frame of the autopilot states the true motion, which the imitation does not tell either."""
        return not self._simulation_control and message_id(frame) in _TRUTH_MESSAGES

    def take_answers(self) -> list[bytes]:
        """What the asking client is to hear in the autopilot's place. Clients of other messages do without an answer, as on
        a radio, but a file transfer would be asked for again and again.
        """
        answers, self._answers = self._answers, []
        return answers

    def _reads_host(self, frame: bytes) -> bool:
        if message_id(frame) == FILE_TRANSFER_PROTOCOL and (answer := host_refusal(frame)):
            self._answers.append(answer)
            return True
        return False

    def _changes_simulation(self, frame: bytes) -> bool:
        number = message_id(frame)
        if number in (COMMAND_LONG, COMMAND_INT):
            return command_of(frame) == MAV_CMD.INJECT_FAILURE or replaces_parameters(frame)
        if number == PARAM_SET:
            # ArduPilot finds the end of a name in either case.
            return parameter_name(frame).upper().startswith(_SIMULATION_PARAMETERS)
        if number == FILE_TRANSFER_PROTOCOL and (answer := file_refusal(frame)):
            self._answers.append(answer)
            return True
        return number in _SIMULATOR_MESSAGES


def command_of(frame: bytes) -> int:
    """The MAV_CMD in a COMMAND_LONG or COMMAND_INT."""
    command: int
    (command,) = struct.unpack_from("<H", payload_of(frame, _COMMAND_AT + 2), _COMMAND_AT)
    return command


def replaces_parameters(frame: bytes) -> bool:
    """Whether a COMMAND_LONG or COMMAND_INT loads or resets all parameters."""
    (action,) = struct.unpack("<f", payload_of(frame, 4))
    return bool(command_of(frame) == MAV_CMD.PREFLIGHT_STORAGE and action != _SAVE_PARAMETERS)


def parameter_name(frame: bytes) -> bytes:
    """The name in a PARAM_SET."""
    return payload_of(frame, _NAME_AT + _NAME_BYTES)[_NAME_AT:].split(b"\0")[0]


def _ends_program(frame: bytes) -> bool:
    number = message_id(frame)
    if number in (COMMAND_LONG, COMMAND_INT):
        return bool(command_of(frame) == MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN)
    # A shell on the autopilot can do all of this.
    return number == _SERIAL_CONTROL
