"""What waits for the next tick of an agent whose ticks carry the air network."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from bench.contracts import AirMessage

# As much as an inbox of the air network holds of one topic. An agent that takes no ticks loses the rest.
MAX_MESSAGES, MAX_BYTES = 4096, 32 * 1024 * 1024


class Outbox:
    """Messages in the order in which they were published. `has_reader`: the agent has said what it reads."""

    def __init__(self) -> None:
        self.has_reader = False
        self.dropped = 0
        """Messages that were lost because nobody took them."""
        # With its bytes on the wire, and whether it is latched.
        self._waiting: list[tuple[AirMessage, int, bool]] = []

    def add(self, topic: str, message: dict[str, Any], size_bytes: int, *, latched: bool) -> None:
        """Keep a message for the next tick."""
        self._waiting.append((AirMessage(topic=topic, message=message), size_bytes, latched))

    def open_for(self, topics: Collection[str]) -> None:
        """The agent reads these topics, and what was latched on others is not for it."""
        self.has_reader = True
        self._waiting = [item for item in self._waiting if item[0].topic in topics]

    def take(self) -> tuple[AirMessage, ...]:
        """All of it, for a tick."""
        messages = tuple(message for message, _, _ in self._waiting)
        self._waiting.clear()
        return messages

    def shrink(self) -> None:
        """Drop the oldest beyond the limits, except for what is latched: that is few, and has no later message like it."""
        count, size = len(self._waiting), sum(size for _, size, _ in self._waiting)
        kept = []
        for item in self._waiting:
            if item[2] or (count <= MAX_MESSAGES and size <= MAX_BYTES):
                kept.append(item)
            else:
                count, size, self.dropped = count - 1, size - item[1], self.dropped + 1
        self._waiting = kept
