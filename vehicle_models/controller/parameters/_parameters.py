"""Parameters: the store, and the service that lists, reads and sets them."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any

from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ..links._frames import KINDS
from ..links._radio import Channel
from ._store import REAL32, UINT32

_VALUE = KINDS["PARAM_VALUE"].id
UNKNOWN_NAME, WRONG_TYPE = 1, 7  # MAV_PARAM_ERROR
LIST_PER_STEP = 20  # a list of a thousand takes about a second, as the real ones' do
HASH_CHECK = "_HASH_CHECK"


class Parameters:
    """PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, and what is sent unasked."""

    def __init__(self, board: ServiceContext) -> None:
        self._store = board.parameters
        self._style = board.personality.parameter_style
        self._radio = board.radio
        self._flight = board.flight
        self._lists: dict[str, tuple[Channel, int]] = {}  # by channel: the next index to send
        self._pushes = [(round(one.first_s * 1e9), one) for one in self._style.pushes]
        self._next_push_ns = min((due for due, _ in self._pushes), default=None)

    def handlers(self) -> Mapping[str, Handler]:
        return {"PARAM_REQUEST_LIST": self._list, "PARAM_REQUEST_READ": self._read, "PARAM_SET": self._set}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        if self._lists:
            self._go_on_listing()
        if self._next_push_ns is not None and self._next_push_ns <= self._flight.time_ns:
            self._push()

    def _push(self) -> None:
        """Send what is due, to those who have spoken."""
        later = []
        for due_ns, push in self._pushes:
            if due_ns <= self._flight.time_ns:
                if push.clock:
                    self._store.put(push.name, due_ns // 1_000_000_000)
                for channel in self._radio.channels:
                    if channel.heard:
                        self._say(channel, push.name, 65535)
                if push.every_s is None:
                    continue
                due_ns += round(push.every_s * 1e9)
            later.append((due_ns, push))
        self._pushes = later
        self._next_push_ns = min((due for due, _ in later), default=None)

    def _go_on_listing(self) -> None:
        for name, (channel, at) in list(self._lists.items()):
            end = min(at + LIST_PER_STEP, len(self._store.names))
            for index in range(at, end):
                self._say(channel, self._store.names[index], index)
            if end < len(self._store.names):
                self._lists[name] = (channel, end)
            else:
                del self._lists[name]

    def _list(self, message: Any, sender: Sender) -> None:
        if self._style.hash_first:
            self._say_hash(sender.channel)
        self._lists[sender.channel.name] = (sender.channel, 0)

    def _read(self, message: Any, sender: Sender) -> None:
        if message.param_index >= 0:
            if message.param_index < len(self._store.names):
                self._say(sender.channel, self._store.names[message.param_index], message.param_index)
            else:
                self._refuse(sender, "", UNKNOWN_NAME)
        elif message.param_id == HASH_CHECK and self._style.hash_first:
            self._say_hash(sender.channel)
        else:
            self._by_name(message.param_id, sender)

    def _by_name(self, asked: str, sender: Sender) -> None:
        name = self._find(asked)
        if name is None:
            self._refuse(sender, asked, UNKNOWN_NAME)
        else:
            self._say(sender.channel, name, self._reply_index(name), asked)

    def _set(self, message: Any, sender: Sender) -> None:
        if self._style.hash_first and message.param_id == HASH_CHECK:
            self._lists.pop(sender.channel.name, None)  # the client knows them all by the hash: the list ends
            return
        name = self._find(message.param_id)
        if name is None:
            self._refuse(sender, message.param_id, UNKNOWN_NAME)
            return
        kind = self._store.kinds[name]
        if self._style.checks_type and message.param_type != kind:
            self._refuse(sender, message.param_id, WRONG_TYPE)
            return
        value = float(message.param_value)
        if self._style.bytewise and kind != REAL32:
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        elif not math.isfinite(value) and not self._style.bytewise:
            return
        changed = self._store.put(name, value)
        self._say(sender.channel, name, self._reply_index(name), message.param_id)
        if changed and self._style.changes_twice:
            for channel in self._radio.channels:
                self._say(channel, name, self._reply_index(name))

    def _find(self, asked: str) -> str | None:
        if asked in self._store.kinds:
            return asked
        upper = asked.upper()
        return upper if self._style.any_case and upper in self._store.kinds else None

    def _reply_index(self, name: str) -> int:
        return self._store.index[name] if self._style.index_in_replies else 65535

    def _say(self, channel: Channel, name: str, index: int, spelling: str = "") -> None:
        kind = self._store.kinds[name]
        if self._style.bytewise:
            (value,) = struct.unpack("<f", self._store.packed(name))
        else:
            value = self._store[name]
        channel.say(_VALUE, (value, len(self._store.names), index, (spelling or name).encode(), kind))

    def _say_hash(self, channel: Channel) -> None:
        (value,) = struct.unpack("<f", struct.pack("<I", self._store.digest()))
        channel.say(_VALUE, (value, len(self._store.names), 65535, HASH_CHECK.encode(), UINT32))

    def _refuse(self, sender: Sender, name: str, error: int) -> None:
        if self._style.unknown == "error":
            sender.channel.tell(
                "PARAM_ERROR",
                target_system=sender.system,
                target_component=sender.component,
                param_id=name.encode(),
                param_index=-1,
                error=error,
            )
