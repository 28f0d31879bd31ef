"""What a client does before anything else: TIMESYNC, PING, and SETUP_SIGNING with the key by which frames are signed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from ..links._radio import Channel
from ..links._signing import Signing
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


class SigningKeys:
    """Takes a key from any client, as an autopilot on a wired link does."""

    def __init__(self, signing: Signing) -> None:
        self._signing = signing

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"SETUP_SIGNING": self._setup}

    def _setup(self, message: Any, sender: MessageSender) -> None:
        self._signing.required = True
        self._signing.set_key(bytes(message.secret_key), message.initial_timestamp)
