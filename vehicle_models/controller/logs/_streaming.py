"""PX4's log streaming: LOGGING_START, LOGGING_STOP and what they send, as its source has them.

The head of the log is sent in LOGGING_DATA_ACKED, one at a time until a LOGGING_ACK has come; the rest in
LOGGING_DATA, which nobody repeats.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..links._enums import MAV_CMD
from ..policies._logs import LogPolicy
from ..state._log_records import SAMPLE, FlightSample, LogEncoder, Note
from ..state._service import Command, CommandHandler, CommandResult, MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ._recorder import FlightRecorder
from ._ulog import HEADER_BYTES, message_starts

# Bytes of data in one message, and the offset that stands for none.
DATA_BYTES, NO_MESSAGE_STARTS = 249, 255
# ulog_stream_ack: ACK_TIMEOUT, ACK_MAX_TRIES
_ACK_TIMEOUT_NS, _ACK_MAX_TRIES = 50_000_000, 50
# What may wait for the head to be acknowledged: three minutes.
_MAX_WAITING_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class _Packet:
    data: bytes
    first_message: int


class _Stream:
    """One streamed log, and the client that receives it."""

    def __init__(self, sender: MessageSender, encoder: LogEncoder) -> None:
        self.sender = sender
        self._encoder = encoder
        head = encoder.head()
        starts = [0, *(HEADER_BYTES + start for start in message_starts(head[HEADER_BYTES:]))]
        self.head = deque(_packets(head, starts))
        self.data: deque[_Packet] = deque()
        self.sequence = 0
        self.sent_ns = 0
        self.tries = 0

    def add_sample(self, packed: bytes, time_us: int) -> None:
        self._add(self._encoder.sample(FlightSample._make(SAMPLE.unpack(packed))))

    def add_note(self, note: Note) -> None:
        self._add(self._encoder.note(note))

    def _add(self, data: bytes) -> None:
        self.data.extend(_packets(data, message_starts(data)))


class LogStreaming:
    """Streams to one client at a time."""

    def __init__(self, context: ServiceContext, policy: LogPolicy, recorder: FlightRecorder) -> None:
        self._context = context
        self._policy = policy
        self._recorder = recorder
        self._stream: _Stream | None = None

    def commands(self) -> Mapping[int, CommandHandler]:
        if self._policy.streams is None:
            return {}
        return {MAV_CMD.LOGGING_START: self._start, MAV_CMD.LOGGING_STOP: self._stop}

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"LOGGING_ACK": self._take_acknowledgement} if self._policy.streams else {}

    def tick(self) -> None:
        stream = self._stream
        if stream is None:
            return
        if stream.head:
            self._send_head(stream)
        else:
            while stream.data:
                self._send("LOGGING_DATA", stream, stream.data.popleft())
                stream.sequence += 1

    def _start(self, command: Command) -> CommandResult | None:
        # Only ULog, format 0, can be streamed.
        if command.params[0] >= 0.5:
            return CommandResult.UNSUPPORTED
        assert self._policy.streams
        if self._stream or not self._policy.streams(self._context.parameters):
            return CommandResult.TEMPORARILY_REJECTED
        self._stream = _Stream(command.sender, self._policy.encoder(self._recorder.opening()))
        self._recorder.attach(self._stream)
        return CommandResult.ACCEPTED

    def _stop(self, command: Command) -> CommandResult | None:
        self._end()
        return CommandResult.ACCEPTED

    def _end(self) -> None:
        if self._stream:
            self._recorder.detach(self._stream)
            self._stream = None

    def _take_acknowledgement(self, message: Any, sender: MessageSender) -> None:
        stream = self._stream
        if stream and stream.head and stream.tries and message.sequence == stream.sequence & 0xFFFF:
            stream.head.popleft()
            stream.sequence += 1
            stream.tries = 0

    def _send_head(self, stream: _Stream) -> None:
        now_ns = self._context.flight.time_ns
        if stream.tries and now_ns - stream.sent_ns <= _ACK_TIMEOUT_NS:
            return
        stream.tries += 1
        if stream.tries > _ACK_MAX_TRIES or len(stream.data) * DATA_BYTES > _MAX_WAITING_BYTES:
            self._end()
            return
        stream.sent_ns = now_ns
        self._send("LOGGING_DATA_ACKED", stream, stream.head[0])

    def _send(self, name: str, stream: _Stream, packet: _Packet) -> None:
        stream.sender.answer(
            name,
            sequence=stream.sequence & 0xFFFF,
            length=len(packet.data),
            first_message_offset=packet.first_message,
            data=[*packet.data, *bytes(DATA_BYTES - len(packet.data))],
        )


def _packets(data: bytes, starts: list[int]) -> list[_Packet]:
    packets = []
    for place in range(0, len(data), DATA_BYTES):
        part = data[place : place + DATA_BYTES]
        index = bisect_left(starts, place)
        within = index < len(starts) and starts[index] < place + len(part)
        packets.append(_Packet(part, starts[index] - place if within else NO_MESSAGE_STARTS))
    return packets
