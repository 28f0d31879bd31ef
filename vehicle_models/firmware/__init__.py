"""Real autopilots on the simulated aircraft: the firmware's own program flies, and the bench is its physics.

A kind from outside is an object as `FirmwareKind` says, in the entry-point group rebar.firmware. It may use what is named
here, as `examples/boards` does.
"""

from __future__ import annotations

from ..controller.links._enums import MAV_CMD as MAV_CMD
from ..controller.links._frames import KINDS
from ..controller.links._frames import MESSAGE_NAMES as MESSAGE_NAMES
from ..controller.links._frames import Packer as Packer
from ..controller.links._frames import message_id as message_id
from ..controller.links._frames import payload_of as payload_of
from ..controller.links._frames import sender as sender
from ..controller.links._serial import SequenceReader as SequenceReader
from ..controller.links._serial import SerialDevice as SerialDevice
from ..controller.links._serial import capacity_bps as capacity_bps
from ..x500 import ROTORS as ROTORS
from ._airframe import parameter_text as parameter_text
from ._airframe import px4_geometry as px4_geometry
from ._ardupilot import ArduPilotKind
from ._file_guard import file_refusal as file_refusal
from ._firmware import Budgets as Budgets
from ._firmware import FirmwareKind as FirmwareKind
from ._firmware import FirmwarePlan as FirmwarePlan
from ._firmware import RunningFirmware as RunningFirmware
from ._firmware_x500 import FirmwareX500 as FirmwareX500
from ._firmware_x500 import open_firmware_x500 as open_firmware_x500
from ._gate import parameter_name as parameter_name
from ._gate import replaces_parameters as replaces_parameters
from ._hil import HIL_ACTUATOR_CONTROLS as HIL_ACTUATOR_CONTROLS
from ._hil import actuator_controls as actuator_controls
from ._mavlink_ports import MavlinkPort as MavlinkPort
from ._program import CONSOLE_FILE as CONSOLE_FILE
from ._px4 import Px4Kind
from ._px4_samples import Px4Samples as Px4Samples

PX4: FirmwareKind = Px4Kind()
ARDUPILOT: FirmwareKind = ArduPilotKind()
MESSAGE_KINDS = KINDS
