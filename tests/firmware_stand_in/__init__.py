"""A small program in the place of real PX4 or ArduCopter: strict about the physics link, crude as a pilot.

Installed as `bin/px4` or `arducopter` (`firmware_files.install_firmware`), it speaks the autopilot's protocols with code of
its own (standard library alone) and ends with exit code 3 and a line `VIOLATION: ...` on any deviation: order, units, masks,
time, answers. It flies by the truth that the link gives: arms, takes off and lands when told over MAVLink. The
parameter STAND_IN_FAULT makes it fail.
"""

from __future__ import annotations

import sys
from pathlib import Path

from ._faults import DIES as DIES
from ._faults import ENDS_AT_ONCE as ENDS_AT_ONCE
from ._faults import FAULT_HEIGHT_M as FAULT_HEIGHT_M
from ._faults import HANGS as HANGS
from ._faults import IGNORES_SIGTERM as IGNORES_SIGTERM
from ._faults import LEAVES_CHILD as LEAVES_CHILD
from ._faults import NEVER_CONNECTS as NEVER_CONNECTS
from ._faults import TALKS_NONSENSE as TALKS_NONSENSE
from ._pilot import Pilot as Pilot
from ._pilot import State as State
from ._pilot import Vector as Vector


def main() -> None:
    """Fly as the autopilot by whose name the program was started."""
    if Path(sys.argv[0]).name == "px4":
        from ._px4 import fly_px4

        fly_px4()
    else:
        from ._ardupilot import fly_ardupilot

        fly_ardupilot()
