"""PX4 boards in hardware-in-the-loop mode for the bench: a firmware that joins from outside, by one entry point.

TAKE THE PROPELLERS OFF. What to set up on a board: docs/hardware.md of the bench.
"""

from __future__ import annotations

from ._options import BoardOptions as BoardOptions
from ._px4_board import Px4BoardKind as Px4BoardKind
from ._real_time import LineClock as LineClock

PX4_BOARD = Px4BoardKind()
