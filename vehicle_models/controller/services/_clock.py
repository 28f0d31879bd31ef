"""TIMESYNC and PING."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from ..links._radio import Channel
from ..state._service import ChannelStream, MessageHandler, MessageSender, Stream, Values
from ..state._service_context import ServiceContext


class ClockService:
    """Answers requests for the time and sends its own; answers to those are ignored."""

    def __init__(self, context: ServiceContext, answers_ping: bool) -> None:
        self._flight = context.flight
        self._answers_ping = answers_ping
        # By channel, as the autopilot has one sender of pings for each.
        self._ping_numbers: Counter[str] = Counter()

    def handlers(self) -> Mapping[str, MessageHandler]:
        pings: dict[str, MessageHandler] = {"PING": self._answer_ping} if self._answers_ping else {}
        return {"TIMESYNC": self._answer_timesync, **pings}

    def streams(self) -> Mapping[str, Stream | ChannelStream]:
        return {"TIMESYNC": lambda: (0, self._flight.time_ns, 0, 0), "PING": ChannelStream(self._ping)}

    def _ping(self, channel: Channel) -> Values:
        self._ping_numbers[channel.name] += 1
        return (self._flight.time_us, self._ping_numbers[channel.name] & 0xFFFFFFFF, 0, 0)

    def _answer_timesync(self, message: Any, sender: MessageSender) -> None:
        # Any other is an answer, and answering answers would never end.
        if message.tc1 == 0:
            sender.answer("TIMESYNC", tc1=self._flight.time_ns, ts1=message.ts1)

    def _answer_ping(self, message: Any, sender: MessageSender) -> None:
        # Any other is an answer, and answering answers would never end.
        if message.target_system == 0 and message.target_component == 0:
            sender.answer("PING", time_usec=message.time_usec, seq=message.seq)
