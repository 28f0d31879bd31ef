"""What an autopilot remarks on in flight without being asked: rising clear of the ground, and meeting it again."""

from __future__ import annotations

from collections.abc import Mapping

from .._service import CommandHandler, Handler
from .._service_context import ServiceContext

_CLEAR_M = 2.5  # above where the vehicle rose from: there the compass is free of what lies in the ground
_APART_NS = 1_000_000_000  # between two meetings with the ground that are worth a word


class GroundTexts:
    """Says `clear_texts` once in every flight, and `touch_text` when the feet meet the ground, with the speed in m/s."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self._speaks = bool(board.personality.clear_texts or board.personality.touch_text)
        self._ground_m = board.flight.down_m
        self._cleared = False
        self._stood = True
        self._stood_ns = 0
        self._sank_mps = 0.0

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        if not self._speaks:
            return
        flight = self._board.flight
        if flight.on_ground:
            self._meet(max(flight.vd_mps, self._sank_mps))
            self._ground_m, self._cleared = flight.down_m, False
            self._stood_ns = flight.time_ns
        elif not self._cleared and self._ground_m - flight.down_m > _CLEAR_M:
            self._cleared = True
            for text in self._board.personality.clear_texts:
                self._board.texts.say(*text)
        self._stood, self._sank_mps = flight.on_ground, flight.vd_mps

    def _meet(self, speed_mps: float) -> None:
        said = self._board.personality.touch_text
        if said and not self._stood and self._board.flight.time_ns - self._stood_ns > _APART_NS:
            self._board.texts.say(said[0], said[1].format(speed_mps))
