"""ArduPilot's PREFLIGHT_CALIBRATION: results as observed, the six positions of the accelerometers as in its source."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, auto
from typing import Any

from ..links._enums import MAV_CMD
from ..links._radio import Channel
from ..policies._commands import CommandAnswer
from ..state._service import Command, CommandHandler, CommandResult, MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL, INFO, StatusText
from ._commands import Commands

# Values of the fifth parameter.
_SIX_POSITIONS, _LEVEL_TRIM, _SIMPLE, _FORCED_SAVE = 1.0, 2.0, 4.0, 76.0
# Positions in the order of ACCELCAL_VEHICLE_POS, from 1.
_POSITIONS = ("level", "on its LEFT side", "on its RIGHT side", "nose DOWN", "nose UP", "on its BACK")
_POSITION_FAILED = 16_777_216
_REQUEST_PERIOD_NS = 1_000_000_000
_SAMPLE_NS = 500_000_000
# Between two calibrations of the accelerometers that end at once.
_PAUSE_NS = 5_000_000_000
_BAROMETER = CommandAnswer(
    (CommandResult.IN_PROGRESS, CommandResult.ACCEPTED),
    ((INFO, "Calibrating barometer"), (INFO, "Barometer 1 calibration complete")),
)
_TRIM: StatusText = (INFO, "Trim OK: roll=0.00 pitch=0.00 yaw=0.00")


class _State(Enum):
    IDLE = auto()
    WAITING = auto()  # for the client to say that the vehicle lies as requested
    SAMPLING = auto()
    FAILED = auto()  # repeated until the next one begins


class AccelerometerCalibration:
    """PREFLIGHT_CALIBRATION. Gyroscopes, barometer, level and the simple calibration end with their results, and
    change nothing.

    The calibration in six positions asks for one after the other, with a text and ACCELCAL_VEHICLE_POS, on the link
    that started it. It fails at the second, as the real one does with a vehicle that nobody turns: the same
    acceleration twice.
    """

    def __init__(self, context: ServiceContext, commands: Commands) -> None:
        self._context = context
        self._commands = commands
        self._channel: Channel | None = None
        self._state = _State.IDLE
        self._position = 1
        self._announced = 0
        self._announces = True  # a client that answers by command needs no texts
        self._acknowledgeable = False
        self._request_ns = self._sampled_ns = 0
        self._simple_ns = -_PAUSE_NS

    def commands(self) -> Mapping[int, CommandHandler]:
        return {
            MAV_CMD.PREFLIGHT_CALIBRATION: self._calibrate,
            MAV_CMD.ACCELCAL_VEHICLE_POS: self._take_position,
        }

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"COMMAND_ACK": self._take_acknowledgement}

    def tick(self) -> None:
        if self._state is _State.IDLE:
            return
        now_ns = self._context.flight.time_ns
        if self._context.flight.armed and self._state is not _State.FAILED:
            self._say("Calibration cancelled")
            self._state = _State.IDLE
        elif self._state is _State.SAMPLING and now_ns >= self._sampled_ns:
            self._end_sample()
        elif self._state is _State.WAITING:
            self._ask(now_ns)
        elif self._state is _State.FAILED:
            self._request(now_ns, _POSITION_FAILED)

    def _calibrate(self, command: Command) -> CommandResult | None:
        gyroscopes, barometer, accelerometers = (command.params[index] for index in (0, 2, 4))
        if self._context.flight.armed:
            self._context.texts.send(CRITICAL, "Disarm to allow calibration")
            return CommandResult.FAILED
        if gyroscopes == 1.0:
            return CommandResult.ACCEPTED
        if barometer == 1.0:
            self._commands.answer(command, _BAROMETER)
            return None
        if accelerometers == _SIX_POSITIONS:
            self._start(command.sender.channel)
            return CommandResult.ACCEPTED
        if accelerometers in (_LEVEL_TRIM, _SIMPLE):
            return self._calibrate_standing(accelerometers)
        return CommandResult.ACCEPTED if accelerometers == _FORCED_SAVE else CommandResult.UNSUPPORTED

    def _calibrate_standing(self, kind: float) -> CommandResult:
        now_ns = self._context.flight.time_ns
        if now_ns - self._simple_ns < _PAUSE_NS:
            return CommandResult.TEMPORARILY_REJECTED
        self._simple_ns = now_ns
        if kind == _LEVEL_TRIM:
            self._context.texts.send(*_TRIM)
        return CommandResult.ACCEPTED

    def _start(self, channel: Channel) -> None:
        if self._state in (_State.WAITING, _State.SAMPLING):
            return
        self._channel, self._state = channel, _State.WAITING
        self._position, self._announced = 1, 0
        self._announces, self._acknowledgeable = True, False
        # The first request comes at once.
        self._request_ns = self._context.flight.time_ns

    def _ask(self, now_ns: int) -> None:
        if self._position != self._announced:
            self._announced = self._position
            if self._announces:
                self._say(f"Place vehicle {_POSITIONS[self._position - 1]} and press any key.")
                self._acknowledgeable = True
        self._request(now_ns, self._position)

    def _request(self, now_ns: int, position: int) -> None:
        if now_ns < self._request_ns or self._channel is None:
            return
        self._request_ns = now_ns + _REQUEST_PERIOD_NS
        # For every system, as the real one sends it.
        fields = dict.fromkeys(("target_system", "target_component", "confirmation"), 0)
        unused = {f"param{number}": 0.0 for number in range(2, 8)}
        self._channel.send_message(
            "COMMAND_LONG", **fields, command=MAV_CMD.ACCELCAL_VEHICLE_POS, param1=float(position), **unused
        )

    def _take_position(self, command: Command) -> CommandResult:
        self._announces = False
        if self._state is not _State.WAITING or command.params[0] != self._announced:
            return CommandResult.FAILED
        self._begin_sample()
        return CommandResult.ACCEPTED

    def _take_acknowledgement(self, message: Any, sender: MessageSender) -> None:
        """The older way: ground stations answer the text with an acknowledgement that names no command, or the
        position in its place, and TEMPORARILY_REJECTED.
        """
        about_position = message.command <= len(_POSITIONS)
        rejected = message.result == CommandResult.TEMPORARILY_REJECTED
        if self._state is _State.WAITING and self._acknowledgeable and about_position and rejected:
            self._acknowledgeable = False
            self._begin_sample()

    def _begin_sample(self) -> None:
        self._state = _State.SAMPLING
        self._sampled_ns = self._context.flight.time_ns + _SAMPLE_NS

    def _end_sample(self) -> None:
        if self._position == 1:
            self._position, self._state = 2, _State.WAITING
            return
        # The vehicle still lies as in the first position.
        self._say("Calibration FAILED")
        self._state = _State.FAILED

    def _say(self, text: str) -> None:
        """A text for the link that started the calibration alone."""
        if self._channel:
            self._channel.send_text(CRITICAL, text)
