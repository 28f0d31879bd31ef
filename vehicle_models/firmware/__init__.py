"""Real autopilots on the simulated aircraft: the firmware's own program flies, and the bench is its physics."""

from __future__ import annotations

from ._firmware import Budgets as Budgets
from ._firmware_x500 import FirmwareX500 as FirmwareX500
from ._firmware_x500 import open_firmware_x500 as open_firmware_x500
