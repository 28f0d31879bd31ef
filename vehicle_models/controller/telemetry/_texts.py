"""STATUSTEXT: what the autopilot says in words."""

from __future__ import annotations

from collections.abc import Callable

from ..links._radio import Radio

EMERGENCY, ALERT, CRITICAL, ERROR, WARNING, NOTICE, INFO, DEBUG = range(8)
_PIECE = 50


class Texts:
    """Sends texts; long ones in pieces with one id, as the specification asks.

    `ending` is put behind every text: PX4 ends those that are an event as well with a tab.
    """

    def __init__(self, radio: Radio, ending: str) -> None:
        self._radio = radio
        self._ending = ending
        self._id = 0
        self.listeners: list[Callable[[int, str], None]] = []

    def note(self, severity: int, text: str) -> None:
        """What is an event but no text: the listeners hear of it, the links do not."""
        for listener in self.listeners:
            listener(severity, text)

    def say(self, severity: int, text: str) -> None:
        self.note(severity, text)
        data = (text + self._ending).encode("ascii", "replace")
        pieces = [data[at : at + _PIECE] for at in range(0, len(data), _PIECE)]
        identity = 0
        if len(pieces) > 1:
            self._id = identity = self._id % 0xFFFF + 1
        for number, piece in enumerate(pieces):
            self._radio.broadcast("STATUSTEXT", severity=severity, text=piece, id=identity, chunk_seq=number)
