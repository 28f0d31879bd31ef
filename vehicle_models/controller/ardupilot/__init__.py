"""ArduCopter as observed on its SITL, as far as it is filled in (docs/flight-controller.md)."""

from __future__ import annotations

from ..policies import Autopilot
from ._commands import COMMANDS, SETPOINTS
from ._identity import IDENTITY
from ._missions import MISSIONS
from ._modes import MODES
from ._parameters import PARAMETERS
from ._safety import SAFETY
from ._telemetry import TELEMETRY

ARDUPILOT = Autopilot(
    identity=IDENTITY,
    parameters=PARAMETERS,
    modes=MODES,
    commands=COMMANDS,
    setpoints=SETPOINTS,
    telemetry=TELEMETRY,
    missions=MISSIONS,
    safety=SAFETY,
)
