"""What of an agent's MAVLink never reaches a real autopilot: what would change the simulation, or end the program.

The imitated flight controller refuses the same (docs/flight-controller.md). An agent whose program could be ended by a
message could drop a session that goes badly.
"""

from __future__ import annotations

import struct

from ..controller.links._frames import message_id

_PARAM_SET, _COMMAND_INT, _COMMAND_LONG, _SERIAL_CONTROL = 23, 75, 76, 126
_PREFLIGHT_REBOOT_SHUTDOWN, _INJECT_FAILURE = 246, 420
# HIL_STATE, HIL_CONTROLS, HIL_RC_INPUTS_RAW, HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_GPS, HIL_OPTICAL_FLOW,
# HIL_STATE_QUATERNION.
_SIMULATOR_MESSAGES = frozenset({90, 91, 92, 93, 107, 113, 114, 115})
_SIMULATION_PARAMETERS = (b"SIM_", b"SIH_", b"SYS_FAILURE_EN", b"SYS_HITL")
# Where they stand in the payload: the command behind seven parameters, the name behind value, system and component.
_COMMAND_AT, _NAME_AT = 28, 6


class Gate:
    """Counts what it withholds. With `simulation_control` only the end of the program is withheld."""

    def __init__(self, simulation_control: bool) -> None:
        self._simulation_control = simulation_control
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
        else:
            withheld = number in _SIMULATOR_MESSAGES and not self._simulation_control
        self.refused += withheld
        return not withheld
