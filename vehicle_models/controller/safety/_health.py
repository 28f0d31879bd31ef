"""Checks before arming: requested by RUN_PREARM_CHECKS, and sent now and then while they fail."""

from __future__ import annotations

from collections.abc import Mapping

from ..links._enums import MAV_CMD
from ..policies._modes import ModePolicy
from ..state._service import Command, CommandHandler, CommandResult
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL

_CHECK_NS = 1_000_000_000
_REPEAT_NS, _REPEAT_AFTER_RECOVERY_NS = 30_000_000_000, 4_000_000_000


class Health:
    """Sends `PreArm: ...` for each failing check: every 30 s while disarmed, sooner after none had failed."""

    def __init__(self, context: ServiceContext, policy: ModePolicy) -> None:
        self._context = context
        self._policy = policy
        self._check_ns = 0
        self._sent_ns = 0
        self._recovered = False

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.RUN_PREARM_CHECKS: self._run_checks}

    def tick(self) -> None:
        flight = self._context.flight
        if flight.time_ns < self._check_ns:
            return
        self._check_ns = flight.time_ns + _CHECK_NS
        if flight.armed:
            return
        failures = self._failures()
        age_ns = flight.time_ns - self._sent_ns
        # ArduPilot repeats failing checks every 30 s, and soon after one that had passed in between.
        if failures and (age_ns > _REPEAT_NS or (self._recovered and age_ns > _REPEAT_AFTER_RECOVERY_NS)):
            self._sent_ns = flight.time_ns
            self._recovered = False
            self._send(failures)
        elif not failures:
            self._recovered = True

    def _run_checks(self, command: Command) -> CommandResult:
        if self._context.flight.armed:
            return self._policy.checks_when_armed
        self._send(self._failures())
        return CommandResult.ACCEPTED

    def _failures(self) -> tuple[str, ...]:
        return self._policy.prearm_failures(self._context.flight, self._context.parameters)

    def _send(self, failures: tuple[str, ...]) -> None:
        for text in failures:
            self._context.texts.send(CRITICAL, f"PreArm: {text}")
