"""LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END and LOG_ERASE, as the autopilots' sources have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..links._radio import Channel
from ..policies._logs import LogPolicy
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ._recorder import FlightRecorder
from ._storage import FlightLog, LogStorage

# Bytes of data in one LOG_DATA.
DATA_BYTES = 90
# What ArduPilot's SITL sends in one go; at 50 Hz some 180 kB a second.
_MESSAGES_PER_STEP = 40


@dataclass(slots=True)
class _Transfer:
    """What one link is sent: a list from `next_entry` to `last_entry`, or `remaining` bytes of a log from
    `offset`. `files` are the logs with their sizes as they were listed last.
    """

    channel: Channel
    files: list[tuple[FlightLog, int]]
    next_entry: int = 0
    last_entry: int = -1
    number: int = -1
    log: FlightLog | None = None
    offset: int = 0
    remaining: int = 0
    sending: bool = False

    @property
    def listing(self) -> bool:
        return self.next_entry <= self.last_entry

    @property
    def active(self) -> bool:
        return self.listing or self.sending


class LogTransfer:
    """Hands logs out. A client asks again for what was lost, by offset; a transfer belongs to a link."""

    def __init__(
        self, context: ServiceContext, policy: LogPolicy, recorder: FlightRecorder, storage: LogStorage
    ) -> None:
        self._flight = context.flight
        self._policy = policy
        self._recorder = recorder
        self._storage = storage
        self._transfers: dict[str, _Transfer] = {}  # by link; where data need a list, the links that had one
        self._warned = False

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {
            "LOG_REQUEST_LIST": self._request_list,
            "LOG_REQUEST_DATA": self._request_data,
            "LOG_REQUEST_END": self._request_end,
            "LOG_ERASE": self._erase,
        }

    def tick(self) -> None:
        if self._transfers and not (self._policy.armed_text and self._flight.armed):
            for transfer in self._transfers.values():
                self._continue(transfer)

    def _request_list(self, message: Any, sender: MessageSender) -> None:
        if self._refuses_armed(sender):
            return
        if self._policy.busy_text and self._is_busy():
            sender.channel.send_text(*self._policy.busy_text)
            return
        transfer = self._transfer(sender)
        transfer.sending = False
        # PX4 scans its folder anew only for a list from the beginning.
        if message.start == 0 or not transfer.files or not self._policy.needs_list:
            transfer.files = self._scan()
        first, count = self._policy.first_number, len(transfer.files)
        if not count:
            sender.channel.send_message("LOG_ENTRY", id=0, num_logs=0, last_log_num=0, time_utc=0, size=0)
            return
        last = first + count - 1
        # PX4 begins with the last log when asked for later ones; ArduPilot then sends none.
        start = min(message.start, last) if self._policy.needs_list else message.start
        transfer.next_entry, transfer.last_entry = max(start, first), min(message.end, last)

    def _request_data(self, message: Any, sender: MessageSender) -> None:
        if self._refuses_armed(sender) or self._refuses_busy(sender):
            return
        if self._policy.needs_list and sender.channel.name not in self._transfers:
            return
        transfer = self._transfer(sender)
        transfer.last_entry, transfer.sending = -1, False
        # A log that is being recorded grows; PX4 sends no more of it than it has listed.
        if not self._policy.needs_list:
            transfer.files = self._scan()
        index = message.id - self._policy.first_number
        if not 0 <= index < len(transfer.files):
            return
        transfer.number = message.id
        transfer.log, size = transfer.files[index]
        transfer.offset = message.ofs
        transfer.remaining = min(max(size - message.ofs, 0), message.count)
        transfer.sending = True

    def _request_end(self, message: Any, sender: MessageSender) -> None:
        if not self._refuses_armed(sender):
            self._transfers.pop(sender.channel.name, None)

    def _erase(self, message: Any, sender: MessageSender) -> None:
        if not self._refuses_armed(sender):
            self._transfers.pop(sender.channel.name, None)
            self._recorder.erase()

    def _refuses_armed(self, sender: MessageSender) -> bool:
        """Say once in a flight that an armed vehicle hands nothing out."""
        text = self._policy.armed_text
        if text is None or not self._flight.armed:
            self._warned = False
            return False
        if not self._warned:
            self._warned = True
            sender.channel.send_text(*text)
        return True

    def _refuses_busy(self, sender: MessageSender) -> bool:
        """Silently for the link that has the transfer: its client repeats requests to fill gaps."""
        if self._policy.busy_text is None or not self._is_busy():
            return False
        transfer = self._transfers.get(sender.channel.name)
        if not (transfer and transfer.active):
            sender.channel.send_text(*self._policy.busy_text)
        return True

    def _is_busy(self) -> bool:
        return any(transfer.active for transfer in self._transfers.values())

    def _transfer(self, sender: MessageSender) -> _Transfer:
        return self._transfers.setdefault(sender.channel.name, _Transfer(sender.channel, []))

    def _scan(self) -> list[tuple[FlightLog, int]]:
        return [(log, log.size()) for log in self._storage.logs]

    def _continue(self, transfer: _Transfer) -> None:
        for _ in range(_MESSAGES_PER_STEP):
            if transfer.listing:
                self._send_next_entry(transfer)
            elif transfer.sending:
                self._send_next_data(transfer)
            else:
                return

    def _send_next_entry(self, transfer: _Transfer) -> None:
        number = transfer.next_entry
        log, size = transfer.files[number - self._policy.first_number]
        transfer.next_entry += 1
        transfer.channel.send_message(
            "LOG_ENTRY",
            id=number,
            num_logs=len(transfer.files),
            last_log_num=transfer.last_entry,
            time_utc=log.end_utc_s,
            size=size,
        )

    def _send_next_data(self, transfer: _Transfer) -> None:
        assert transfer.log
        length = min(transfer.remaining, DATA_BYTES)
        data = self._storage.read(transfer.log)[transfer.offset : transfer.offset + length]
        transfer.channel.send_message(
            "LOG_DATA",
            id=transfer.number,
            ofs=transfer.offset,
            count=length,
            data=[*data, *bytes(DATA_BYTES - length)],
        )
        transfer.offset += length
        transfer.remaining -= length
        # A full last message says that there is more, so the end is only seen by `remaining`.
        transfer.sending = transfer.remaining > 0
