"""TIMESYNC and PING."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext


class Clock:
    """Answers what asks for the time; answers to our own requests are taken silently."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board

    def handlers(self) -> Mapping[str, Handler]:
        pings: dict[str, Handler] = {"PING": self._ping} if self._board.personality.answers_ping else {}
        return {"TIMESYNC": self._timesync, **pings}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def _timesync(self, m: Any, sender: Sender) -> None:
        if m.tc1 == 0:
            sender.channel.tell(
                "TIMESYNC",
                tc1=self._board.flight.time_ns,
                ts1=m.ts1,
                target_system=sender.system,
                target_component=sender.component,
            )

    def _ping(self, m: Any, sender: Sender) -> None:
        if m.target_system == 0 and m.target_component == 0:
            sender.channel.tell(
                "PING",
                time_usec=m.time_usec,
                seq=m.seq,
                target_system=sender.system,
                target_component=sender.component,
            )
