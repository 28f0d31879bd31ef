"""DO_MOTOR_TEST: one rotor after another turns for a while, on the ground, shown as armed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext
from ..telemetry._texts import CRITICAL, INFO

MOTOR_TEST = 209
_PERCENT, _PWM, _PILOT = 0, 1, 2  # MOTOR_TEST_THROTTLE_TYPE
_LONGEST_S = 600.0
_THROTTLE = 2  # channel of the radio


@dataclass(slots=True)
class _Test:
    place: int  # in the order of the test, from 0
    count: int  # rotors to go, this one included
    share: float | None  # of full speed; None where the throttle made no sense
    span_ns: int
    begun_ns: int
    pauses: bool = False


class MotorTest:
    """ArduCopter's, after its source: each rotor turns for the time asked, a pause of half of that, then the next.

    Personalities without an order of rotors do not know the command.
    """

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self._test: _Test | None = None

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MOTOR_TEST: self._begin} if self._board.personality.motor_order else {}

    def tick(self) -> None:
        test, flight = self._test, self._board.flight
        if test is None:
            return
        past_ns = flight.time_ns - test.begun_ns
        if test.share is None or flight.armed or (past_ns >= test.span_ns and test.count <= 1):
            self._end()
        elif past_ns * 2 >= test.span_ns * 3:
            test.place, test.count, test.begun_ns, test.pauses = test.place + 1, test.count - 1, flight.time_ns, False
            self._turn(test.place, test.share)
        elif past_ns >= test.span_ns and not test.pauses:
            test.pauses = True
            self._stop()

    def _begin(self, command: Command) -> Result:
        flight, texts = self._board.flight, self._board.texts
        if flight.flying or flight.armed:
            texts.say(CRITICAL, "Motor Test: vehicle not landed")
            return Result.FAILED
        if self._test is None:
            texts.say(INFO, "starting motor test")
        first, kind, throttle, span_s, count = (one if math.isfinite(one) else 0.0 for one in command.params[:5])
        share = self._share(kind, throttle) if math.isfinite(command.params[2]) else None
        span_ns = round(min(max(span_s, 0.0), _LONGEST_S) * 1e9)
        self._test = _Test(int(first) - 1, max(int(count), 1) if count < 256.0 else 1, share, span_ns, flight.time_ns)
        flight.tests_motors = True
        self._stop()
        if share is not None:
            self._turn(self._test.place, share)
        return Result.ACCEPTED

    def _share(self, kind: float, throttle: float) -> float | None:
        """The throttle as a share of full speed; None for what is out of bounds."""
        if kind == _PERCENT:
            pwm = 1000.0 + 10.0 * throttle if throttle <= 100.0 else 0.0
        elif kind == _PWM:
            pwm = throttle
        elif kind == _PILOT:
            pwm = float(self._board.flight.rc_us[_THROTTLE])
        else:
            return None
        return min(max((pwm - 1000.0) / 1000.0, 0.0), 1.0) if 800.0 <= pwm <= 2200.0 else None

    def _turn(self, place: int, share: float) -> None:
        order = self._board.personality.motor_order
        if 0 <= place < len(order):
            self._board.airframe.test_rotor(order[place], share)

    def _stop(self) -> None:
        for rotor in self._board.personality.motor_order:
            self._board.airframe.test_rotor(rotor, 0.0)

    def _end(self) -> None:
        self._stop()
        self._test = None
        self._board.flight.tests_motors = False
        self._board.texts.say(INFO, "finished motor test")
