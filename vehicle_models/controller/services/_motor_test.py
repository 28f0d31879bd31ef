"""DO_MOTOR_TEST: one rotor after another turns for a while, on the ground, shown as armed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..links._enums import MAV_CMD
from ..state._service import Command, CommandHandler, CommandResult
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL, INFO

# MOTOR_TEST_THROTTLE_TYPE
_PERCENT, _PWM, _PILOT = 0, 1, 2
_MAX_SPAN_S = 600.0
# Of the radio, counted from 0.
_THROTTLE_CHANNEL = 2


@dataclass(slots=True)
class _MotorTestRun:
    position: int  # in the order of the test, from 0
    remaining: int  # rotors, this one included
    share: float | None  # of full speed; None where the throttle made no sense
    span_ns: int
    begun_ns: int
    pauses: bool = False


class MotorTest:
    """ArduCopter's test, after its source: each rotor turns for the given time, stops for half of it, then
    the next turns.

    An autopilot without an `order` of rotors does not know the command.
    """

    def __init__(self, context: ServiceContext, order: tuple[int, ...]) -> None:
        self._context = context
        self._order = order
        self._run: _MotorTestRun | None = None

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.DO_MOTOR_TEST: self._begin} if self._order else {}

    def tick(self) -> None:
        run, flight = self._run, self._context.flight
        if run is None:
            return
        elapsed_ns = flight.time_ns - run.begun_ns
        if run.share is None or flight.armed or (elapsed_ns >= run.span_ns and run.remaining <= 1):
            self._end()
        # A rotor turns for the span and stops for half of it; integers keep that exact.
        elif elapsed_ns * 2 >= run.span_ns * 3:
            run.position, run.remaining = run.position + 1, run.remaining - 1
            run.begun_ns, run.pauses = flight.time_ns, False
            self._turn(run.position, run.share)
        elif elapsed_ns >= run.span_ns and not run.pauses:
            run.pauses = True
            self._stop()

    def _begin(self, command: Command) -> CommandResult:
        flight, texts = self._context.flight, self._context.texts
        if flight.flying or flight.armed:
            texts.send(CRITICAL, "Motor Test: vehicle not landed")
            return CommandResult.FAILED
        if self._run is None:
            texts.send(INFO, "starting motor test")
        first, kind, throttle, span_s, count = (
            param if math.isfinite(param) else 0.0 for param in command.params[:5]
        )
        share = self._share(kind, throttle) if math.isfinite(command.params[2]) else None
        span_ns = round(min(max(span_s, 0.0), _MAX_SPAN_S) * 1e9)
        remaining = max(int(count), 1) if count < 256.0 else 1
        self._run = _MotorTestRun(int(first) - 1, remaining, share, span_ns, flight.time_ns)
        flight.tests_motors = True
        self._stop()
        if share is not None:
            self._turn(self._run.position, share)
        return CommandResult.ACCEPTED

    def _share(self, kind: float, throttle: float) -> float | None:
        """The throttle as a share of full speed; None where it is out of bounds."""
        if kind == _PERCENT:
            pwm_us = 1000.0 + 10.0 * throttle if throttle <= 100.0 else 0.0
        elif kind == _PWM:
            pwm_us = throttle
        elif kind == _PILOT:
            pwm_us = float(self._context.flight.rc_us[_THROTTLE_CHANNEL])
        else:
            return None
        return min(max((pwm_us - 1000.0) / 1000.0, 0.0), 1.0) if 800.0 <= pwm_us <= 2200.0 else None

    def _turn(self, position: int, share: float) -> None:
        if 0 <= position < len(self._order):
            self._context.airframe.test_rotor(self._order[position], share)

    def _stop(self) -> None:
        for rotor in self._order:
            self._context.airframe.test_rotor(rotor, 0.0)

    def _end(self) -> None:
        self._stop()
        self._run = None
        self._context.flight.tests_motors = False
        self._context.texts.send(INFO, "finished motor test")
