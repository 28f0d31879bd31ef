"""Sticks: MANUAL_CONTROL of a joystick, RC_CHANNELS_OVERRIDE in place of a radio."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .._flight import Behaviour, Flight, Sticks
from .._personality import Event
from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ..guidance._guidance import Guidance
from ._modes import Modes

_RADIO_US = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)  # a simulated radio at rest: throttle at its lowest
_CHANNELS = len(_RADIO_US)
_SMOOTH_S = 0.1  # of stick movement
_KEEP_US, _RELEASE_US = 65535, 0


class Movement:
    """How fast the sticks move: shares of their way in a second, smoothed. The first position is no movement."""

    def __init__(self) -> None:
        self._rates: tuple[float, ...] = (0.0,) * 4
        self._last: tuple[int, tuple[float, ...]] | None = None

    def feel(self, sticks: Sticks, now_ns: int) -> float:
        """Take a position; the rate of the stick that moves fastest."""
        at = (sticks.roll, sticks.pitch, sticks.yaw, sticks.throttle)
        if self._last is None or now_ns > self._last[0]:
            if self._last is not None:
                span_s = (now_ns - self._last[0]) * 1e-9
                share = span_s / (_SMOOTH_S + span_s)
                moved = zip(self._rates, at, self._last[1], strict=True)
                self._rates = tuple(rate + share * ((one - before) / span_s - rate) for rate, one, before in moved)
            self._last = (now_ns, at)
        return max(abs(rate) for rate in self._rates)


class Manual:
    """Keeps `flight.sticks` and `flight.rc_us`. Sticks that nobody moves any more are gone after a while."""

    def __init__(self, board: ServiceContext, guidance: Guidance, modes: Modes) -> None:
        self._board = board
        self._guidance = guidance
        self._modes = modes
        self._movement = Movement()
        self._given_ns: int | None = None
        self._us: dict[int, int] = {}  # channels that somebody overrides
        if board.personality.feels_loose_sticks:
            self._feel_radio()

    def handlers(self) -> Mapping[str, Handler]:
        return {"MANUAL_CONTROL": self._joystick, "RC_CHANNELS_OVERRIDE": self._override}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        flight = self._board.flight
        if self._given_ns is None or flight.time_ns - self._given_ns < round(
            min(self._guidance.limits.sticks.lost_after_s, 1e6) * 1e9
        ):
            return
        self._given_ns = None
        self._movement = Movement()
        if self._board.personality.feels_loose_sticks:
            self._us.clear()
            self._feel_radio()
        else:
            flight.sticks = None

    def _joystick(self, m: Any, sender: Sender) -> None:
        board = self._board
        values = (m.y, m.x, m.z, m.r)
        if m.target == 0 or not self._may_fly(sender):
            return
        if board.personality.takes_radio_overrides:
            self._override_by_joystick(*values)
            return
        if not all(-1000 <= one <= 1000 for one in values):
            return
        right, ahead, up, turn = (one / 1000.0 for one in values)
        flight = board.flight
        flight.sticks = sticks = Sticks(right, ahead, turn, 2.0 * max(up, 0.0) - 1.0)
        self._given_ns = flight.time_ns
        fast = self._movement.feel(sticks, flight.time_ns) > self._guidance.limits.sticks.overrides_from
        if fast and self._yields(flight):
            self._take_over(flight)

    def _yields(self, flight: Flight) -> bool:
        """Whether what flies now gives way to sticks; a failsafe does once its Hold is over, that of the battery never."""
        if not flight.flying or flight.mode.behaviour not in self._guidance.limits.sticks.overrides:
            return False
        return not flight.failsafe or (flight.mode.behaviour is not Behaviour.HOLD and flight.failsafe != "battery")

    def _take_over(self, flight: Flight) -> None:
        personality = self._board.personality
        if personality.pilot_modes is None:
            return
        placed, blind = personality.pilot_modes
        self._modes.switch(personality.mode(placed if flight.position_ok else blind))
        self._board.texts.say(*personality.texts[Event.PILOT_TOOK_OVER])

    def _override_by_joystick(self, right: int, ahead: int, up: int, turn: int) -> None:
        for channel, value in ((0, 1500 + right // 2), (1, 1500 - ahead // 2), (2, 1000 + up), (3, 1500 + turn // 2)):
            if 800 <= value <= 2200:  # INT16_MAX and its like: this axis is not given
                self._us[channel] = value
        self._overridden()

    def _override(self, m: Any, sender: Sender) -> None:
        if not self._board.personality.takes_radio_overrides or not self._may_fly(sender):
            return
        for channel in range(_CHANNELS):
            value = getattr(m, f"chan{channel + 1}_raw")
            if value == _RELEASE_US:
                self._us.pop(channel, None)
            elif value != _KEEP_US:
                self._us[channel] = min(max(value, 800), 2200)
        self._overridden()

    def _overridden(self) -> None:
        self._given_ns = self._board.flight.time_ns
        self._feel_radio()

    def _feel_radio(self) -> None:
        """Sticks as the channels, overridden or not, have them; channel 2 is nose down when it is low."""
        flight = self._board.flight
        flight.rc_us = us = tuple(self._us.get(channel, value) for channel, value in enumerate(_RADIO_US))
        right, back, up, turn = (min(max((one - 1500) / 500.0, -1.0), 1.0) for one in us[:4])
        flight.sticks = Sticks(right, -back, turn, up)

    def _may_fly(self, sender: Sender) -> bool:
        board = self._board
        return board.personality.is_station(sender.system, board.parameters)
