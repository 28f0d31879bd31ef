"""ArduPilot's log over MAVLink, as its source has it: REMOTE_LOG_DATA_BLOCK, and REMOTE_LOG_BLOCK_STATUS in return.

A client starts it, receives numbered blocks of a DataFlash file and acknowledges each. A block stays in memory until
then; what is recorded while all blocks are in use is lost, as on the real one.
"""

from __future__ import annotations

import functools
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..policies._logs import BlockLogPolicy, LogPolicy
from ..state._log_records import SAMPLE, FlightSample, LogEncoder, Note
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext
from ._recorder import FlightRecorder

# Bytes of data in one block.
DATA_BYTES = 200
# MAV_REMOTE_LOG_DATA_BLOCK_COMMANDS, in place of a block's number.
STOP, START = 2_147_483_645, 2_147_483_646
# MAV_REMOTE_LOG_DATA_BLOCK_STATUSES; anything else acknowledges.
NACK = 0
# What ArduPilot sends in one go; at 50 Hz some 90 kB a second.
_BLOCKS_PER_STEP = 9
_RESEND_NS, _SILENCE_NS = 100_000_000, 10_000_000_000
# A block takes 216 bytes with its number, time and link; ArduPilot has no fewer than 8.
_MEMORY_OF_BLOCK, _MIN_BLOCKS = 216, 8


@dataclass(slots=True)
class _Block:
    number: int
    data: bytes
    sent_ns: int = 0


class _BlockLog:
    """One log on its way to one client."""

    def __init__(
        self,
        sender: MessageSender,
        encoder: LogEncoder,
        records: Callable[[], bool],
        max_blocks: int,
        now_ns: int,
    ) -> None:
        self.sender = sender
        self.answered_ns = self.sent_ns = now_ns
        self._encoder = encoder
        self._records = records
        self._max_blocks = max_blocks
        self._head = encoder.head()  # written as room allows, in front of everything else
        self._opening = True
        self._tail = b""  # of a block that is not full
        self._next_number = 0
        self.pending: deque[_Block] = deque()
        self.retries: deque[_Block] = deque()
        self.sent: OrderedDict[int, _Block] = OrderedDict()

    def add_sample(self, packed: bytes, time_us: int) -> None:
        # The encoder notes mode and events that have changed, so it takes only what is recorded.
        if not self._head and self._records():
            self._write(self._encoder.sample(FlightSample._make(SAMPLE.unpack(packed))))

    def add_note(self, note: Note) -> None:
        # What is known when the log begins is part of its head.
        if self._opening:
            self._head += self._encoder.note(note)
        elif not self._head and self._records():
            self._write(self._encoder.note(note))

    def write_head(self) -> None:
        """Write as much of the head as there is room for."""
        self._opening = False
        room = self._room_bytes()
        part, self._head = self._head[:room], self._head[room:]
        self._fill(part)

    def next_block(self) -> _Block | None:
        """The block to send next, if any waits."""
        queue = self.retries or self.pending
        return queue.popleft() if queue else None

    def acknowledge(self, number: int) -> bool:
        """Free a block that has arrived; whether it was waited for."""
        if self.sent.pop(number, None):
            return True
        match = next((block for block in self.retries if block.number == number), None)
        if match:
            self.retries.remove(match)
        return match is not None

    def retry(self, number: int) -> bool:
        """Send a block again; whether there is such a block."""
        block = self.sent.pop(number, None)
        if block:
            self.retries.append(block)
        return block is not None

    def overdue(self, now_ns: int) -> list[_Block]:
        """Blocks that were sent some time ago and not acknowledged."""
        return [block for block in self.sent.values() if now_ns - block.sent_ns > _RESEND_NS]

    def _write(self, data: bytes) -> None:
        """Add a record if the whole of it has room."""
        if len(data) <= self._room_bytes():
            self._fill(data)

    def _fill(self, data: bytes) -> None:
        data = self._tail + data
        full = len(data) - len(data) % DATA_BYTES
        for begin in range(0, full, DATA_BYTES):
            self.pending.append(_Block(self._next_number, data[begin : begin + DATA_BYTES]))
            self._next_number += 1
        self._tail = data[full:]

    def _room_bytes(self) -> int:
        used = len(self.pending) + len(self.retries) + len(self.sent)
        return (self._max_blocks - used) * DATA_BYTES - len(self._tail)


class LogBlocks:
    """Sends a log to one client at a time, from the moment at which it asks."""

    def __init__(
        self, context: ServiceContext, policy: LogPolicy, blocks: BlockLogPolicy, recorder: FlightRecorder
    ) -> None:
        self._context = context
        self._policy = policy
        self._blocks = blocks
        self._recorder = recorder
        self._log: _BlockLog | None = None
        self._resend_ns = 0

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"REMOTE_LOG_BLOCK_STATUS": self._take_status}

    def tick(self) -> None:
        log = self._log
        if log is None:
            return
        now_ns = self._context.flight.time_ns
        if log.answered_ns + _SILENCE_NS < log.sent_ns:
            self._end()
            return
        log.write_head()
        if not log.sent:
            # Who has nothing to answer is not silent.
            log.answered_ns = now_ns
        for _ in range(_BLOCKS_PER_STEP):
            block = log.next_block()
            if block is None:
                break
            log.sent[block.number] = block
            self._send(log, block)
        if now_ns >= self._resend_ns:
            self._resend_ns = now_ns + _RESEND_NS
            for block in log.overdue(now_ns):
                self._send(log, block)

    def _take_status(self, message: Any, sender: MessageSender) -> None:
        number, log = message.seqno, self._log
        if message.status == NACK:
            answered = log is not None and log.retry(number)
        elif number == START:
            self._begin(sender)
            return
        elif number == STOP:
            self._end()
            return
        else:
            answered = log is not None and log.acknowledge(number)
        if answered and log:
            log.answered_ns = self._context.flight.time_ns

    def _begin(self, sender: MessageSender) -> None:
        parameters = self._context.parameters
        if self._log or not self._blocks.enabled(parameters):
            return
        buffer_bytes = self._blocks.buffer_kib(parameters) * 1024
        max_blocks = max(buffer_bytes // _MEMORY_OF_BLOCK, _MIN_BLOCKS)
        flight = self._context.flight
        encoder = self._policy.encoder(self._recorder.opening())
        records = functools.partial(self._blocks.records, flight, parameters)
        self._log = _BlockLog(sender, encoder, records, max_blocks, flight.time_ns)
        self._recorder.attach(self._log)

    def _end(self) -> None:
        if self._log:
            self._recorder.detach(self._log)
            self._log = None

    def _send(self, log: _BlockLog, block: _Block) -> None:
        log.sent_ns = block.sent_ns = self._context.flight.time_ns
        log.sender.answer("REMOTE_LOG_DATA_BLOCK", seqno=block.number, data=[*block.data])
