"""An autopilot: the wall between what every autopilot does and how one of them does it."""

from __future__ import annotations

from dataclasses import dataclass

from .policies._commands import CommandPolicy
from .policies._identity import IdentityPolicy
from .policies._logs import LogPolicy
from .policies._missions import MissionPolicy
from .policies._modes import ModePolicy
from .policies._parameters import ParameterPolicy
from .policies._safety import SafetyPolicy
from .policies._setpoints import SetpointPolicy
from .policies._telemetry import TelemetryPolicy


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """The nine policies of one autopilot. The controller gives each to the services that ask it."""

    identity: IdentityPolicy
    parameters: ParameterPolicy
    modes: ModePolicy
    commands: CommandPolicy
    setpoints: SetpointPolicy
    telemetry: TelemetryPolicy
    missions: MissionPolicy
    safety: SafetyPolicy
    logs: LogPolicy
