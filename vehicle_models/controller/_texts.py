"""STATUSTEXT: what the autopilot says in words."""

from __future__ import annotations

from ._radio import Channel, Radio

EMERGENCY, ALERT, CRITICAL, ERROR, WARNING, NOTICE, INFO, DEBUG = range(8)
_PIECE = 50


class Texts:
    """Sends texts; long ones in pieces with one id, as the specification asks.

    `ending` is put behind every text (PX4 ends them with a tab); `needs_hearing` keeps them from channels on which
    nobody has spoken yet, as ArduPilot does.
    """

    def __init__(self, radio: Radio, ending: str, needs_hearing: bool) -> None:
        self._radio = radio
        self._ending = ending
        self._needs_hearing = needs_hearing
        self._id = 0

    def say(self, severity: int, text: str) -> None:
        data = (text + self._ending).encode("ascii", "replace")
        pieces = [data[at : at + _PIECE] for at in range(0, len(data), _PIECE)]
        identity = 0
        if len(pieces) > 1:
            self._id = identity = self._id % 0xFFFF + 1
        for number, piece in enumerate(pieces):
            self._radio.broadcast_where(self._reaches, "STATUSTEXT", severity=severity, text=piece, id=identity, chunk_seq=number)

    def _reaches(self, channel: Channel) -> bool:
        return channel.heard or not self._needs_hearing
