"""The queue of messages: packed for each channel, in order, and sent together at the end of a step."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from bench.contracts import MavlinkTap

from ._frames import Packer, message_id, sender, target_system, wire_values
from ._link import Link
from ._signing import Signing

_V1, _V2 = 0xFE, 0xFD
# Of one link, which is 2400 a second; the rest waits, so that a flood costs its own link only.
MESSAGES_PER_STEP = 48


class Channel:
    """One link as the services see it: a name, a sequence number, a queue to send."""

    def __init__(self, link: Link, packer: Packer, signing: Signing, number: int = 0) -> None:
        self.link = link
        self._signing = signing
        self._number = number
        self._uses_v1 = False
        self._known_systems: set[int] = set()  # systems that have sent something here
        self.name = link.spec.name
        # Whether a client has sent something here. Nobody can on a link that is not heard, and whoever looks on there
        # is to see something.
        self.has_client = not link.spec.heard
        self._packer = packer
        self._sequence = 0
        self._queue: list[bytes] = []
        # Whether there is a receiver; decided once a step, so that all of a step is sent or nothing.
        self.connected = link.connected()

    def send(self, number: int, values: Iterable[Any]) -> None:
        """Queue a message for every client of this channel; values in wire order."""
        if not self.connected:
            return
        frame: bytes | None
        if self._uses_v1:
            frame = self._packer.pack_v1(number, self._sequence, values)
        elif self._signing.on:
            frame = self._packer.pack_signed(number, self._sequence, values, self._sign)
        else:
            frame = self._packer.pack(number, self._sequence, values)
        if frame is not None:
            self._queue.append(frame)
            self._sequence = (self._sequence + 1) & 0xFF

    def send_message(self, name: str, **fields: Any) -> None:
        """Queue a message given by field names."""
        self.send(*wire_values(name, **fields))

    def send_text(self, severity: int, text: str) -> None:
        """Queue a short STATUSTEXT for the clients of this channel alone."""
        self.send_message("STATUSTEXT", severity=severity, text=text.encode(), id=0, chunk_seq=0)

    def admits(self, frame: bytes) -> bool:
        """Whether a received frame may be handled. The channel learns from it which systems are there, and
        which MAVLink they speak: 2, unless every frame so far was MAVLink 1.
        """
        if not self._signing.admits(frame, message_id(frame)):
            return False
        # One MAVLink 2 frame is enough to show that a client understands it.
        self._uses_v1 = frame[0] == _V1 and (self._uses_v1 or not self.has_client)
        self.has_client = True
        self._known_systems.add(sender(frame)[0])
        return True

    def forward(self, frame: bytes) -> None:
        """Queue another client's frame unchanged, unless it is for a system that never sent anything here."""
        known = target_system(frame) in (0, *self._known_systems)
        if self.connected and known and not (self._uses_v1 and frame[0] == _V2):
            self._queue.append(frame)

    def _sign(self, unsigned: bytes) -> bytes:
        return self._signing.sign(unsigned, self._number)

    def begin(self) -> None:
        """Begin a step."""
        self.connected = self.link.connected() and not self.link.silenced
        # Messages that arrive during a simulated loss of the link are lost, not delayed.
        if self.link.silenced:
            self.link.inbox.clear()

    def flush(self, tap: MavlinkTap | None) -> None:
        """Send the queue."""
        if self._queue:
            frames, self._queue = self._queue, []
            self.link.sent += len(frames)
            if tap:
                tap(self.name, "to_agent", b"".join(frames))
            self.link.send(frames)


class Radio:
    """All channels; `waits_for_client` keeps unrequested messages off one until a client has spoken."""

    def __init__(self, channels: list[Channel], tap: MavlinkTap | None, waits_for_client: bool) -> None:
        self.channels = channels
        self._tap = tap
        self._waits_for_client = waits_for_client

    def broadcast(
        self, name: str, goes_over: Callable[[Channel], bool] | None = None, /, **fields: Any
    ) -> None:
        """Queue a message on the channels that `goes_over` admits, and that the autopilot may send to unasked."""
        self.broadcast_values(*wire_values(name, **fields), goes_over)

    def broadcast_values(
        self, number: int, values: Iterable[Any], goes_over: Callable[[Channel], bool] | None = None
    ) -> None:
        """The same, with the values in wire order."""
        for channel in self.channels:
            heard = channel.has_client or not self._waits_for_client
            if heard and (goes_over is None or goes_over(channel)):
                channel.send(number, values)

    def take(self, channel: Channel) -> list[bytes]:
        """The frames of a channel that are handled in this step."""
        frames = channel.link.inbox.take(MESSAGES_PER_STEP)
        if self._tap and frames:
            self._tap(channel.name, "from_agent", b"".join(frames))
        return frames

    def begin(self) -> None:
        for channel in self.channels:
            channel.begin()

    def flush(self) -> None:
        for channel in self.channels:
            channel.flush(self._tap)
