"""Parameters: the store, and the service that lists, reads and sets them."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any

from ..links._frames import KINDS
from ..links._radio import Channel
from ..policies._parameters import ParameterPolicy
from ..state._parameter_store import REAL32, UINT32
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ..state._texts import WARNING

_VALUE = KINDS["PARAM_VALUE"].id
# MAV_PARAM_ERROR
_DOES_NOT_EXIST, _READ_ONLY, _TYPE_MISMATCH = 1, 5, 7
# PX4's parameter that holds the hash over all others.
_HASH_CHECK = "_HASH_CHECK"
_NO_INDEX = 65535


class Parameters:
    """PARAM_*; without `simulation_control` parameters of the simulation can be read and not set."""

    def __init__(self, context: ServiceContext, policy: ParameterPolicy, simulation_control: bool) -> None:
        self._store = context.parameters
        self._policy = policy
        self._simulation_control = simulation_control
        self._texts = context.texts
        self.refused = 0
        """Attempts to set a parameter of the simulation."""
        self._radio = context.radio
        self._flight = context.flight
        self._lists: dict[str, tuple[Channel, int]] = {}  # by channel: the next index to send
        self._pushes = [(round(push.first_s * 1e9), push) for push in self._policy.pushes]
        self._next_push_ns = min((due for due, _ in self._pushes), default=None)
        # What was due before the session has been sent to nobody.
        if self._next_push_ns is not None and self._next_push_ns < self._flight.time_ns:
            self._push()

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"PARAM_REQUEST_LIST": self._list, "PARAM_REQUEST_READ": self._read, "PARAM_SET": self._set}

    def tick(self) -> None:
        if self._lists:
            self._continue_lists()
        if self._next_push_ns is not None and self._next_push_ns <= self._flight.time_ns:
            self._push()

    def _push(self) -> None:
        """Send what is due on the channels where a client has sent something."""
        later = []
        for due_ns, push in self._pushes:
            if due_ns <= self._flight.time_ns:
                if push.counts_seconds:
                    self._store.put(push.name, due_ns // 1_000_000_000)
                for channel in self._radio.channels:
                    if channel.has_client:
                        self._send(channel, push.name, _NO_INDEX)
                if push.every_s is None:
                    continue
                due_ns += round(push.every_s * 1e9)
            later.append((due_ns, push))
        self._pushes = later
        self._next_push_ns = min((due for due, _ in later), default=None)

    def _continue_lists(self) -> None:
        for name, (channel, start) in list(self._lists.items()):
            end = min(start + self._policy.listed_per_step, len(self._store.names))
            for index in range(start, end):
                self._send(channel, self._store.names[index], index)
            if end < len(self._store.names):
                self._lists[name] = (channel, end)
            else:
                del self._lists[name]

    def _list(self, message: Any, sender: MessageSender) -> None:
        if self._policy.hash_first:
            self._send_hash(sender.channel)
        self._lists[sender.channel.name] = (sender.channel, 0)

    def _read(self, message: Any, sender: MessageSender) -> None:
        if message.param_index >= 0:
            if message.param_index < len(self._store.names):
                self._send(sender.channel, self._store.names[message.param_index], message.param_index)
            else:
                self._refuse(sender, "", _DOES_NOT_EXIST)
        elif message.param_id == _HASH_CHECK and self._policy.hash_first:
            self._send_hash(sender.channel)
        else:
            self._read_by_name(message.param_id, sender)

    def _read_by_name(self, requested: str, sender: MessageSender) -> None:
        name = self._find(requested)
        if name is None:
            self._refuse(sender, requested, _DOES_NOT_EXIST)
        else:
            self._send(sender.channel, name, self._reply_index(name), requested)

    def _set(self, message: Any, sender: MessageSender) -> None:
        if self._policy.hash_first and message.param_id == _HASH_CHECK:
            # A client that sets the hash knows all values, so the list ends.
            self._lists.pop(sender.channel.name, None)
            return
        name = self._find(message.param_id)
        if name is None:
            self._refuse(sender, message.param_id, _DOES_NOT_EXIST)
            return
        if not self._simulation_control and self._policy.is_simulation(name):
            self._deny(name, message.param_id, sender)
            return
        kind = self._store.kinds[name]
        if self._policy.checks_type and message.param_type != kind:
            self._refuse(sender, message.param_id, _TYPE_MISMATCH)
            return
        value = float(message.param_value)
        if self._policy.bytewise and kind != REAL32:
            # PX4 carries the bits of an integer in the float field.
            value = float(struct.unpack("<i", struct.pack("<f", value))[0])
        elif not math.isfinite(value) and not self._policy.bytewise:
            return
        changed = self._store.put(name, value)
        self._send(sender.channel, name, self._reply_index(name), message.param_id)
        if changed and self._policy.changes_twice:
            for channel in self._radio.channels:
                self._send(channel, name, self._reply_index(name))

    def _deny(self, name: str, requested: str, sender: MessageSender) -> None:
        """Refuse to set a parameter that can only be read."""
        self.refused += 1
        if self._policy.write_denied is None:
            self._refuse(sender, requested, _READ_ONLY)
            return
        self._texts.send(WARNING, self._policy.write_denied.format(name=name))
        self._send(sender.channel, name, self._reply_index(name), requested)

    def _find(self, requested: str) -> str | None:
        if requested in self._store.kinds:
            return requested
        upper = requested.upper()
        return upper if self._policy.any_case and upper in self._store.kinds else None

    def _reply_index(self, name: str) -> int:
        return self._store.index[name] if self._policy.index_in_replies else _NO_INDEX

    def _send(self, channel: Channel, name: str, index: int, spelling: str = "") -> None:
        kind = self._store.kinds[name]
        if self._policy.bytewise:
            (value,) = struct.unpack("<f", self._store.packed(name))
        else:
            value = self._store[name]
        channel.send(_VALUE, (value, len(self._store.names), index, (spelling or name).encode(), kind))

    def _send_hash(self, channel: Channel) -> None:
        (value,) = struct.unpack("<f", struct.pack("<I", self._store.digest()))
        channel.send(_VALUE, (value, len(self._store.names), 65535, _HASH_CHECK.encode(), UINT32))

    def _refuse(self, sender: MessageSender, name: str, error: int) -> None:
        if self._policy.unknown == "error":
            sender.answer("PARAM_ERROR", param_id=name.encode(), param_index=-1, error=error)
