"""ArduPilot's calibration of compasses (source): DO_START_, DO_ACCEPT_, DO_CANCEL_MAG_CAL and progress."""

from __future__ import annotations

from collections.abc import Mapping

from ..links._enums import MAV_CMD
from ..links._frames import KINDS
from ..links._radio import Channel
from ..state._service import ChannelStream, Command, CommandHandler, CommandResult, Stream, Values
from ..state._service_context import ServiceContext
from ..state._texts import NOTICE

_ALL_COMPASSES = 0xFF
_FIRST_ATTEMPT = 1
# MAG_CAL_STATUS, as far as a vehicle on the ground gets.
_WAITING_TO_START, _RUNNING_STEP_ONE = 1, 2
# A sample counts only if it differs from those before it. A vehicle that stands still gives one of the 300 that
# are needed, which is a third of 1/300: 0 %.
_PERCENT_OF_STANDING_STILL = 0
# One of the 80 directions has been seen; which one depends on the field, and is the first one here.
_NO_DIRECTION, _ONE_DIRECTION = bytes(10), bytes((1, *bytes(9)))


class CompassCalibration:
    """Begins, shows progress as long as a client likes, and never ends by itself: nobody turns the vehicle, so
    there is neither success nor failure, and no MAG_CAL_REPORT. As with the real one, the vehicle is not armed
    without force between the first calibration and a restart.
    """

    def __init__(self, context: ServiceContext) -> None:
        self._context = context
        self._runs: dict[int, int] = {}  # by compass: when samples are taken, in ns
        self._progress = KINDS["MAG_CAL_PROGRESS"].id

    def commands(self) -> Mapping[int, CommandHandler]:
        return {
            MAV_CMD.DO_START_MAG_CAL: self._start,
            MAV_CMD.DO_ACCEPT_MAG_CAL: self._accept,
            MAV_CMD.DO_CANCEL_MAG_CAL: self._cancel,
        }

    def streams(self) -> Mapping[str, Stream | ChannelStream]:
        return {"MAG_CAL_PROGRESS": ChannelStream(self._send_progress)}

    def _start(self, command: Command) -> CommandResult:
        if self._context.flight.armed:
            self._context.texts.send(NOTICE, "Disarm to allow compass calibration")
            return CommandResult.FAILED
        mask, delay_s = _mask(command), command.params[3]
        if mask is None:
            return CommandResult.FAILED
        used = self._compasses_in_use()
        # All means those that are in use; a list may name no others.
        compasses = used if mask == _ALL_COMPASSES else [number for number in range(8) if mask & 1 << number]
        if not compasses or not set(compasses) <= set(used):
            self._end(mask)
            return CommandResult.FAILED
        now_ns = self._context.flight.time_ns
        # NaN and a negative delay begin at once.
        wait_ns = round(min(delay_s, 1e6) * 1e9) if delay_s > 0.0 else 0
        for number in compasses:
            self._runs.setdefault(number, now_ns + wait_ns)
        self._keep_disarmed()
        return CommandResult.ACCEPTED

    def _compasses_in_use(self) -> list[int]:
        """Of the three that the SITL has."""
        p = self._context.parameters
        if not p["COMPASS_ENABLE"]:
            return []
        uses = (p["COMPASS_USE"], p["COMPASS_USE2"], p["COMPASS_USE3"])
        return [number for number, use in enumerate(uses) if use]

    def _accept(self, command: Command) -> CommandResult:
        """Nothing is ever finished, so a calibration that runs ends without having been accepted."""
        mask = _mask(command)
        if mask is None:
            return CommandResult.FAILED
        return CommandResult.FAILED if self._end(mask) else CommandResult.ACCEPTED

    def _cancel(self, command: Command) -> CommandResult:
        mask = _mask(command)
        if mask is None:
            return CommandResult.FAILED
        self._end(mask)
        return CommandResult.ACCEPTED

    def _end(self, mask: int) -> bool:
        """End the calibrations of `mask`; whether there were any."""
        ended = [number for number in self._runs if mask & 1 << number]
        for number in ended:
            del self._runs[number]
        if ended:
            self._keep_disarmed()
        return bool(ended)

    def _keep_disarmed(self) -> None:
        reason = "Compass calibration running" if self._runs else "Compass calibrated requires reboot"
        self._context.flight.calibration_failures = (reason,)

    def _send_progress(self, channel: Channel) -> Values | None:
        """Each compass has a message of its own: queue all but the last, and return that."""
        now_ns = self._context.flight.time_ns
        mask = sum(1 << number for number in self._runs)
        messages: list[Values] = []
        for number, begin_ns in sorted(self._runs.items()):
            status = _RUNNING_STEP_ONE if now_ns >= begin_ns else _WAITING_TO_START
            directions = _ONE_DIRECTION if now_ns >= begin_ns else _NO_DIRECTION
            head = (0.0, 0.0, 0.0, number, mask, status, _FIRST_ATTEMPT, _PERCENT_OF_STANDING_STILL)
            messages.append((*head, *directions))
        for message in messages[:-1]:
            channel.send(self._progress, message)
        return messages[-1] if messages else None


def _mask(command: Command) -> int | None:
    """The compasses that a command is about; None for a value that is no mask."""
    value = command.params[0]
    return (int(value) or _ALL_COMPASSES) if 0.0 <= value <= 255.0 else None
