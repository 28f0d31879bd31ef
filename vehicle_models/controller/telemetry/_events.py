"""Events: the machine-readable twins of texts, numbered without gaps so that a client can ask for what it missed."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ._event_names import EventName

_KEPT = 64
_UNAVAILABLE = 0  # MAV_EVENT_ERROR_REASON


class Events:
    """EVENT beside the texts that have one, CURRENT_EVENT_SEQUENCE, and REQUEST_EVENT for what was missed."""

    def __init__(self, board: ServiceContext, names: tuple[EventName, ...]) -> None:
        self._board = board
        self._names = names
        self._kept: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._next = 0
        if names:
            board.texts.listeners.append(self._said)

    @property
    def sequence(self) -> int:
        """Number of the last event; 65535 before the first."""
        return (self._next - 1) & 0xFFFF

    def handlers(self) -> Mapping[str, Handler]:
        return {"REQUEST_EVENT": self._again} if self._names else {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def _said(self, severity: int, text: str) -> None:
        found = next((one for one in self._names if text.startswith(one.text)), None)
        if found is None:
            return
        event = {
            "id": found.number,
            "event_time_boot_ms": self._board.flight.time_ms,
            "sequence": self._next,
            "log_levels": severity << 4 | severity,
        }
        self._next = (self._next + 1) & 0xFFFF
        self._kept.append(event)
        self._board.radio.broadcast("EVENT", **event)

    def _again(self, message: Any, sender: Sender) -> None:
        first, last = message.first_sequence, message.last_sequence
        wanted = [one for one in self._kept if (one["sequence"] - first) & 0xFFFF <= (last - first) & 0xFFFF]
        for event in wanted:
            sender.channel.tell("EVENT", **event)
        if not wanted or wanted[0]["sequence"] != first:
            oldest = self._kept[0]["sequence"] if self._kept else self._next
            sender.channel.tell(
                "RESPONSE_EVENT_ERROR",
                target_system=sender.system,
                target_component=sender.component,
                sequence=first,
                sequence_oldest_available=oldest,
                reason=_UNAVAILABLE,
            )
