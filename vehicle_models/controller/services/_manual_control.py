"""Sticks: MANUAL_CONTROL of a joystick, RC_CHANNELS_OVERRIDE in place of a radio."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..guidance._guidance import Guidance
from ..policies._modes import ModePolicy
from ..policies._setpoints import SetpointPolicy
from ..state._flight_state import Behaviour, Cause, FlightState, StickPositions
from ..state._service import MessageHandler, MessageSender, Stream
from ..state._service_context import ServiceContext
from ..state._texts import FlightEvent
from ._modes import Modes

# A simulated radio at rest: throttle at its lowest.
_RADIO_US = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)
_CHANNELS = len(_RADIO_US)
# Of stick rates.
_SMOOTHING_S = 0.1
# RC_CHANNELS_OVERRIDE: ignore this channel, give it back to the radio.
_KEEP_US, _RELEASE_US = 65535, 0
_PWM_RANGE_US = (800, 2200)


class StickMovement:
    """How fast the sticks move: shares of their travel in a second, smoothed, from the second position on."""

    def __init__(self) -> None:
        self._rates: tuple[float, ...] = (0.0,) * 4
        self._last: tuple[int, tuple[float, ...]] | None = None

    def update(self, sticks: StickPositions, now_ns: int) -> float:
        """Take a position and return the rate of the stick that moves fastest."""
        positions = (sticks.roll, sticks.pitch, sticks.yaw, sticks.throttle)
        if self._last is None or now_ns > self._last[0]:
            if self._last is not None:
                span_s = (now_ns - self._last[0]) * 1e-9
                share = span_s / (_SMOOTHING_S + span_s)
                changes = zip(self._rates, positions, self._last[1], strict=True)
                self._rates = tuple(
                    rate + share * ((position - previous) / span_s - rate)
                    for rate, position, previous in changes
                )
            self._last = (now_ns, positions)
        return max(abs(rate) for rate in self._rates)


@dataclass(eq=False)
class ManualControl:
    """Keeps `flight.sticks` and `flight.rc_us`. Sticks are lost when no more messages come for a while."""

    _context: ServiceContext
    _policy: SetpointPolicy
    _mode_policy: ModePolicy
    _guidance: Guidance
    _modes: Modes
    _is_ground_station: Callable[[int], bool]
    _movement: StickMovement = field(default_factory=StickMovement)
    _received_ns: int | None = None
    _overrides_us: dict[int, int] = field(default_factory=dict)  # by channel

    def __post_init__(self) -> None:
        if self._policy.simulates_radio:
            self._read_radio()

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"MANUAL_CONTROL": self._take_joystick, "RC_CHANNELS_OVERRIDE": self._take_override}

    def streams(self) -> Mapping[str, Stream]:
        flight = self._context.flight
        # 16 channels and an unknown signal strength, as ArduPilot's SITL reports.
        return {"RC_CHANNELS": lambda: (flight.time_ms, *flight.rc_us, *(0,) * 10, 16, 255)}

    def tick(self) -> None:
        flight = self._context.flight
        lost_ns = round(min(self._guidance.limits.sticks.lost_after_s, 1e6) * 1e9)
        if self._received_ns is None or flight.time_ns - self._received_ns < lost_ns:
            return
        self._received_ns = None
        self._movement = StickMovement()
        if self._policy.simulates_radio:
            self._overrides_us.clear()
            self._read_radio()
        else:
            flight.sticks = None

    def _take_joystick(self, m: Any, sender: MessageSender) -> None:
        axes = (m.y, m.x, m.z, m.r)
        # A joystick has to name its vehicle; 0 would move every vehicle of a network.
        if m.target == 0 or not self._is_ground_station(sender.system):
            return
        if self._policy.radio_overrides:
            self._override_by_joystick(*axes)
            return
        if not all(-1000 <= axis <= 1000 for axis in axes):
            return
        right, forward, up, turn = (axis / 1000.0 for axis in axes)
        flight = self._context.flight
        flight.sticks = sticks = StickPositions(right, forward, turn, 2.0 * max(up, 0.0) - 1.0)
        self._received_ns = flight.time_ns
        fast = self._movement.update(sticks, flight.time_ns) > self._guidance.limits.sticks.overrides_from
        if fast and self._may_take_over(flight):
            self._take_over(flight)

    def _may_take_over(self, flight: FlightState) -> bool:
        """Whether the mode gives way to sticks: a failsafe's does behind its Hold, the battery's never."""
        if not flight.flying or flight.mode.behaviour not in self._guidance.limits.sticks.overrides:
            return False
        holds = flight.mode.behaviour is Behaviour.HOLD
        return not flight.failsafe or (not holds and flight.failsafe != Cause.BATTERY)

    def _take_over(self, flight: FlightState) -> None:
        if self._mode_policy.pilot is None:
            return
        with_position, without_position = self._mode_policy.pilot
        self._modes.switch(with_position if flight.position_ok else without_position)
        self._context.texts.announce(FlightEvent.PILOT_TOOK_OVER)

    def _override_by_joystick(self, right: int, forward: int, up: int, turn: int) -> None:
        lowest_us, highest_us = _PWM_RANGE_US
        for channel, pwm_us in (
            (0, 1500 + right // 2),
            (1, 1500 - forward // 2),
            (2, 1000 + up),
            (3, 1500 + turn // 2),
        ):
            # An axis of INT16_MAX means that it is not given.
            if lowest_us <= pwm_us <= highest_us:
                self._overrides_us[channel] = pwm_us
        self._apply_overrides()

    def _take_override(self, m: Any, sender: MessageSender) -> None:
        if not self._policy.radio_overrides or not self._is_ground_station(sender.system):
            return
        self.override([getattr(m, f"chan{channel + 1}_raw") for channel in range(_CHANNELS)])

    def override(self, channels_us: Iterable[int]) -> None:
        """Override the first of the radio's channels; 0 gives one back to it, 65535 leaves it as it is."""
        lowest_us, highest_us = _PWM_RANGE_US
        for channel, pwm_us in enumerate(channels_us):
            if pwm_us == _RELEASE_US:
                self._overrides_us.pop(channel, None)
            elif pwm_us != _KEEP_US:
                self._overrides_us[channel] = min(max(pwm_us, lowest_us), highest_us)
        self._apply_overrides()

    def _apply_overrides(self) -> None:
        self._received_ns = self._context.flight.time_ns
        self._read_radio()

    def _read_radio(self) -> None:
        """Set the sticks to the channels, overridden or not; a low channel 2 is nose down."""
        flight = self._context.flight
        flight.rc_us = rc_us = tuple(
            self._overrides_us.get(channel, pwm_us) for channel, pwm_us in enumerate(_RADIO_US)
        )
        right, backward, up, turn = (min(max((pwm_us - 1500) / 500.0, -1.0), 1.0) for pwm_us in rc_us[:4])
        flight.sticks = StickPositions(right, -backward, turn, up)
