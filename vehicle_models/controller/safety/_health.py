"""Checks before arming: asked for by RUN_PREARM_CHECKS, and said unasked now and then while they fail."""

from __future__ import annotations

from collections.abc import Mapping

from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext
from ..telemetry._texts import CRITICAL

RUN_CHECKS = 401
_LOOK_NS, _REPEAT_NS, _SOON_NS = 1_000_000_000, 30_000_000_000, 4_000_000_000


class Health:
    """Says `PreArm: ...` for each check that fails: every 30 s while disarmed, and soon after all was well before.

    Autopilots that say nothing of their own accord have no words for `prearm`.
    """

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self._look_ns = 0
        self._said_ns = 0
        self._well = False

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {RUN_CHECKS: self._run}

    def tick(self) -> None:
        flight = self._board.flight
        if flight.time_ns < self._look_ns:
            return
        self._look_ns = flight.time_ns + _LOOK_NS
        if flight.armed:
            return
        failing = self._failing()
        after = flight.time_ns - self._said_ns
        if failing and (after > _REPEAT_NS or (self._well and after > _SOON_NS)):
            self._said_ns = flight.time_ns
            self._well = False
            self._say(failing)
        elif not failing:
            self._well = True

    def _run(self, command: Command) -> Result:
        if self._board.flight.armed:
            return self._board.personality.checks_when_armed
        self._say(self._failing())
        return Result.ACCEPTED

    def _failing(self) -> tuple[str, ...]:
        return self._board.personality.prearm(self._board.flight, self._board.parameters)

    def _say(self, failing: tuple[str, ...]) -> None:
        for text in failing:
            self._board.texts.say(CRITICAL, f"PreArm: {text}")
