"""STATUSTEXT: what the autopilot reports in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum, auto

from ..links._radio import Radio

StatusText = tuple[int, str]
"""A text with its MAV_SEVERITY."""

EMERGENCY, ALERT, CRITICAL, ERROR, WARNING, NOTICE, INFO, DEBUG = range(8)
_CHUNK_BYTES = 50


class FlightEvent(Enum):
    """Moments at which an autopilot may send a text."""

    ARMED = auto()
    DISARMED = auto()
    DISARMED_BY_LANDING = auto()
    DISARMED_IDLE = auto()
    TAKEOFF_DEFAULT = auto()
    TAKEOFF_RAISED = auto()
    TAKEOFF_BELOW = auto()
    TAKEOFF_DETECTED = auto()
    LANDING_DETECTED = auto()
    LANDING = auto()
    RETURNING = auto()
    TERMINATED = auto()
    PILOT_TOOK_OVER = auto()
    CRASHED = auto()


class Texts:
    """Sends texts; long ones in chunks with one id, as the specification asks.

    `by_event` are the autopilot's texts for moments of the flight. `ending` is put behind every text: PX4
    ends a text that is an event as well with a tab.
    """

    def __init__(self, radio: Radio, by_event: Mapping[FlightEvent, StatusText], ending: str) -> None:
        self._radio = radio
        self._by_event = by_event
        self._ending = ending
        self._id = 0
        self._kept: list[StatusText] | None = None  # while they are kept back
        self.listeners: list[Callable[[int, str], None]] = []
        self.text_listeners: list[Callable[[int, str], None]] = []  # of texts alone

    def notify(self, severity: int, text: str) -> None:
        """Tell the listeners of an event that has no text on the links."""
        for listener in self.listeners:
            listener(severity, text)

    def announce(self, event: FlightEvent, *values: float) -> None:
        """Send the text of an event, with `values` in its braces; nothing where the autopilot has no text for
        it.
        """
        if event in self._by_event:
            severity, text = self._by_event[event]
            self.send(severity, text.format(*values) if values else text)

    def send(self, severity: int, text: str) -> None:
        self.notify(severity, text)
        for listener in self.text_listeners:
            listener(severity, text)
        if self._kept is None:
            self._broadcast(severity, text)
        else:
            self._kept.append((severity, text))

    def keep(self) -> None:
        """Keep texts back until they are released."""
        self._kept = []

    def release(self) -> None:
        """Send the texts that were kept back, and further ones at once."""
        kept, self._kept = self._kept or [], None
        for severity, text in kept:
            self._broadcast(severity, text)

    def _broadcast(self, severity: int, text: str) -> None:
        data = (text + self._ending).encode("ascii", "replace")
        chunks = [data[start : start + _CHUNK_BYTES] for start in range(0, len(data), _CHUNK_BYTES)]
        text_id = 0
        if len(chunks) > 1:
            self._id = text_id = self._id % 0xFFFF + 1
        for number, chunk in enumerate(chunks):
            self._radio.broadcast("STATUSTEXT", severity=severity, text=chunk, id=text_id, chunk_seq=number)
