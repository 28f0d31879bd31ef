"""PX4's calibration of sensors: the texts by which clients follow it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from ..links._enums import MAV_CMD
from ..state._service import Command, CommandHandler, CommandResult
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL, INFO, StatusText

_STEP_NS = 500_000_000
# How long PX4 waits for the next side of a vehicle that nobody turns; chosen, not measured.
_PATIENCE_NS = 30_000_000_000
# (index of the parameter, its value): what is calibrated, and whether the vehicle has to be turned for that.
_KINDS: dict[tuple[int, float], tuple[str, bool]] = {
    (0, 1.0): ("gyro", False),
    (1, 1.0): ("mag", True),
    (2, 1.0): ("baro", False),
    (4, 1.0): ("accel", True),
    (4, 2.0): ("level", False),
}


class Calibration:
    """PREFLIGHT_CALIBRATION: accepted at once, then texts that begin with `[cal]`, as MAVSDK and ground stations read
    them. What needs the vehicle turned fails after a while, because it stands where it stands. Nothing is changed by a
    calibration: the sensors have no errors that it could remove.
    """

    def __init__(self, context: ServiceContext) -> None:
        self._context = context
        self._pending: deque[tuple[int, StatusText]] = deque()

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.PREFLIGHT_CALIBRATION: self._calibrate}

    def tick(self) -> None:
        while self._pending and self._pending[0][0] <= self._context.flight.time_ns:
            _, text = self._pending.popleft()
            self._context.texts.send(*text)

    def _calibrate(self, command: Command) -> CommandResult:
        if self._context.flight.armed:
            return CommandResult.TEMPORARILY_REJECTED
        requested = [kind for (index, value), kind in _KINDS.items() if command.params[index] == value]
        if not requested:
            # All zeros end a calibration that runs.
            if self._pending:
                self._pending.clear()
                self._context.texts.send(INFO, "[cal] calibration cancelled")
            return CommandResult.ACCEPTED
        if self._pending:
            return CommandResult.TEMPORARILY_REJECTED
        self._begin(*requested[0])
        return CommandResult.ACCEPTED

    def _begin(self, name: str, needs_turning: bool) -> None:
        now_ns = self._context.flight.time_ns
        # 2 is the version of these texts.
        self._pending.append((now_ns, (INFO, f"[cal] calibration started: 2 {name}")))
        if needs_turning:
            self._pending.append((now_ns + _STEP_NS, (INFO, "[cal] down orientation detected")))
            failure = (CRITICAL, "[cal] calibration failed: timeout: no motion")
            self._pending.append((now_ns + _PATIENCE_NS, failure))
            return
        for step, percent in enumerate((20, 40, 60, 80, 100), start=1):
            self._pending.append((now_ns + step * _STEP_NS, (INFO, f"[cal] progress <{percent}>")))
        self._pending.append((now_ns + 6 * _STEP_NS, (INFO, f"[cal] calibration done: {name}")))
