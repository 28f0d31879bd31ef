"""The mission protocol as far as it goes: an empty store that says so. Uploads are refused, honestly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ._board import Board, CommandHandler, Handler, Sender

_ACCEPTED, _UNSUPPORTED, _DENIED = 0, 3, 14  # MAV_MISSION_RESULT


class Missions:
    """MISSION_REQUEST_LIST gives 0 items; MISSION_COUNT of more than none is answered by DENIED."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def handlers(self) -> Mapping[str, Handler]:
        return {
            "MISSION_REQUEST_LIST": self._list,
            "MISSION_COUNT": lambda m, s: self._acknowledge(m, s, _ACCEPTED if m.count == 0 else _DENIED),
            "MISSION_CLEAR_ALL": lambda m, s: self._acknowledge(m, s, _ACCEPTED),
            "MISSION_ITEM_INT": lambda m, s: self._acknowledge(m, s, _DENIED),
            "MISSION_ITEM": lambda m, s: self._acknowledge(m, s, _DENIED),
            "MISSION_WRITE_PARTIAL_LIST": lambda m, s: self._acknowledge(m, s, _UNSUPPORTED),
        }

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        pass

    def _list(self, m: Any, sender: Sender) -> None:
        sender.channel.tell(
            "MISSION_COUNT",
            count=0,
            target_system=sender.system,
            target_component=sender.component,
            mission_type=m.mission_type,
        )

    def _acknowledge(self, m: Any, sender: Sender, result: int) -> None:
        sender.channel.tell(
            "MISSION_ACK",
            type=result,
            target_system=sender.system,
            target_component=sender.component,
            mission_type=m.mission_type,
        )
