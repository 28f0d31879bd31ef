"""PREFLIGHT_REBOOT_SHUTDOWN, and what one flight controller leaves to the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..links._enums import MAV_CMD
from ..links._signing import Signing
from ..policies._commands import CommandPolicy
from ..state._plan_store import MissionItem
from ..state._service import Command, CommandHandler, CommandResult
from ..state._service_context import ServiceContext

# Reboot; reboot and stay in the bootloader, where the autopilot accepts that.
_REBOOTS = (1.0, 3.0)


@dataclass(frozen=True, slots=True)
class PersistentState:
    """What one flight controller leaves to the next: its flash memory, and the counts of a session."""

    parameters: Mapping[str, float]
    plans: Mapping[int, tuple[MissionItem, ...]]
    signing: Signing
    counts: Mapping[str, int]


class Restart:
    """Answers the command as the policy has it; an accepted restart happens as the step ends."""

    def __init__(self, context: ServiceContext, policy: CommandPolicy) -> None:
        self._context = context
        self._policy = policy
        self.requested = False

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN: self._restart}

    def _restart(self, command: Command) -> CommandResult | None:
        answer = self._policy.answer(self._context.flight, command)
        fixed = self._policy.fixed_results.get(MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN, CommandResult.UNSUPPORTED)
        result = answer.results[0] if answer else fixed
        self.requested |= result is CommandResult.ACCEPTED and command.params[0] in _REBOOTS
        return result
