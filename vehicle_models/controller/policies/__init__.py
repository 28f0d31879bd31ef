"""What an autopilot must define: eight policies, each a frozen value that is given to the services that ask it.

`px4/` and `ardupilot/` hold the same eight file names. What is plain data stands in tables here, with a column for each
autopilot: `choices.csv` (fields of the policies), `commands.csv` and `messages.csv`. Another autopilot is another folder,
and another column.
"""

from __future__ import annotations

from dataclasses import dataclass

from ._commands import CommandPolicy
from ._identity import IdentityPolicy
from ._missions import MissionPolicy
from ._modes import ModePolicy
from ._parameters import ParameterPolicy
from ._safety import SafetyPolicy
from ._setpoints import SetpointPolicy
from ._telemetry import TelemetryPolicy


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """The eight policies of one autopilot. The controller gives each to the services that ask it."""

    identity: IdentityPolicy
    parameters: ParameterPolicy
    modes: ModePolicy
    commands: CommandPolicy
    setpoints: SetpointPolicy
    telemetry: TelemetryPolicy
    missions: MissionPolicy
    safety: SafetyPolicy
