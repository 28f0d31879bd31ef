"""Flight logs: none are kept, and a client that asks for their list hears so at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .._service import MessageHandler, MessageSender


class Logs:
    """LOG_REQUEST_LIST is answered with an entry that counts no logs, as both autopilots do without logs; requests
    for the data of a log, and LOG_ERASE, find nothing.
    """

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"LOG_REQUEST_LIST": self._send_list}

    def _send_list(self, message: Any, sender: MessageSender) -> None:
        sender.channel.send_message("LOG_ENTRY", id=0, num_logs=0, last_log_num=0, time_utc=0, size=0)
