"""Events: the machine-readable twins of texts, numbered so that a client can ask for what it missed."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from ..state._service import Fields, MessageAnswer, MessageHandler, MessageSender, Stream
from ..state._service_context import ServiceContext
from ..state._texts import EventName

_STORED = 64
# MAV_EVENT_ERROR_REASON
_UNAVAILABLE = 0


class EventService:
    """EVENT beside the texts that have one, CURRENT_EVENT_SEQUENCE, and REQUEST_EVENT for what was missed."""

    def __init__(self, context: ServiceContext, names: tuple[EventName, ...]) -> None:
        self._context = context
        self._names = names
        self._stored: deque[Fields] = deque(maxlen=_STORED)
        self._next = 0
        if names:
            context.texts.listeners.append(self._send_event)

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"REQUEST_EVENT": self._send_again} if self._names else {}

    def streams(self) -> Mapping[str, Stream]:
        # The number of the last event; 65535 before the first.
        return {"CURRENT_EVENT_SEQUENCE": lambda: ((self._next - 1) & 0xFFFF, 0)}

    def answers(self) -> Mapping[str, MessageAnswer]:
        # PX4 streams it and refuses a request for it.
        return {"CURRENT_EVENT_SEQUENCE": lambda command: None} if self._names else {}

    def _send_event(self, severity: int, text: str) -> None:
        # The texts hold numbers behind their beginning, so only the beginning identifies an event.
        name = next((name for name in self._names if text.startswith(name.text)), None)
        if name is None:
            return
        event: Fields = {
            "id": name.number,
            "event_time_boot_ms": self._context.flight.time_ms,
            "sequence": self._next,
            "log_levels": severity << 4 | severity,
        }
        self._next = (self._next + 1) & 0xFFFF
        self._stored.append(event)
        self._context.radio.broadcast("EVENT", **event)

    def _send_again(self, message: Any, sender: MessageSender) -> None:
        first, last = message.first_sequence, message.last_sequence
        # Sequence numbers wrap around at 16 bits.
        requested = [
            event for event in self._stored if (event["sequence"] - first) & 0xFFFF <= (last - first) & 0xFFFF
        ]
        for event in requested:
            sender.channel.send_message("EVENT", **event)
        if not requested or requested[0]["sequence"] != first:
            oldest = self._stored[0]["sequence"] if self._stored else self._next
            sender.answer(
                "RESPONSE_EVENT_ERROR", sequence=first, sequence_oldest_available=oldest, reason=_UNAVAILABLE
            )
