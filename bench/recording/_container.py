"""One pass over an MCAP file that ends, without complaint, where the file stops making sense.

The readers of the `mcap` package need the index at the end of the file, and a crash leaves none; its stream
reader takes a short read for a whole one. A recording may also come from a stranger: sizes are believed only
within limits.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema

from bench.documents import open_file
from bench.errors import SetupError

# The MCAP specification: the first and the last bytes of a file.
MAGIC = b"\x89MCAP0\r\n"
# Chosen, not measured: our chunks are 256 KiB, and a file from a stranger must not allocate without limit.
MAX_RECORD_BYTES = 256 * 1024 * 1024
Item = Schema | Channel | Message | Attachment | Metadata

# Of every record: opcode and length. A message begins with channel, sequence, log time and publish time.
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
# The footer: start of the summary and of its offsets, checksum. Statistics begin with the number of messages.
_FOOTER = struct.Struct("<BQQQI")
_FOOTER_BYTES = struct.calcsize("<QQI")
_CRC_BYTES = 4
_END_BYTES = _FOOTER.size + len(MAGIC)
_MESSAGE_COUNT = struct.Struct("<Q")
_DAMAGE = (McapError, struct.error, ValueError, OverflowError, zstandard.ZstdError)


class Container:
    """The schemas, channels, messages, attachments and metadata of one file, in the order in which they were written.

    After the pass, `cut` says where the file ends early or is damaged, or is None when it is whole: every checksum that
    it holds, its statistics and its last bytes agree. `complete` says that every message is there even so (a file may
    lack nothing but its index). Raises SetupError when the file is no MCAP file at all.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cut: str | None = None
        self.complete = False
        self._messages = 0

    def __iter__(self) -> Iterator[Item]:
        with open_file(self.path) as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise SetupError(self.path, "is not an MCAP recording", "give the recording.mcap of a run")
            yield from self._items(file, os.fstat(file.fileno()).st_size)

    def _items(self, file: IO[bytes], size: int) -> Iterator[Item]:
        crc = zlib.crc32(MAGIC)
        while True:
            start = file.tell()
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                self.cut = f"ends at byte {start} without an end record"
                return
            opcode, length = _HEAD.unpack(head)
            # Before anything is read: the length is a claim of the file.
            if length > min(size - file.tell(), MAX_RECORD_BYTES):
                self.cut = f"ends within the record at byte {start}"
                return
            payload = file.read(length)
            if opcode == Opcode.DATA_END:
                # No message may follow a DataEnd record; what comes after it is summary and index.
                self._check_data(payload, crc)
                if self.cut is None:
                    self._check_end(file.read(MAX_RECORD_BYTES))
                return
            crc = zlib.crc32(payload, zlib.crc32(head, crc))
            try:
                items = _read(opcode, payload)
            except UnsupportedCompressionError as error:
                remedy = "convert the file, for example with mcap compress --compression zstd"
                raise SetupError(self.path, f"cannot be read: {error}", remedy) from None
            except _DAMAGE as error:
                self.cut = f"the record at byte {start} is damaged ({type(error).__name__})"
                return
            self._messages += sum(type(item) is Message for item in items)
            yield from items

    def _check_data(self, payload: bytes, crc: int) -> None:
        """Check the data section, whose checksum is `crc`, against its end record."""
        # A record of which only the kind was damaged is passed over as an unknown one: without this its messages would
        # be missing in silence. MCAP writes 0 for "no checksum".
        if len(payload) != _CRC_BYTES or int.from_bytes(payload, "little") not in (0, crc):
            self.cut = "its bytes do not have the checksum that stands at their end"
        else:
            self.complete = True

    def _check_end(self, summary: bytes) -> None:
        """Check what follows the end record: summary, footer and the last bytes."""
        footer = len(summary) - _END_BYTES
        if footer < 0 or not summary.endswith(MAGIC):
            self.cut = "the index is missing; every message is there"
            return
        opcode, length, start, _, stated = _FOOTER.unpack_from(summary, footer)
        # The checksum goes from the start of the summary up to itself. MCAP writes 0 for "none".
        checked = summary[: -_CRC_BYTES - len(MAGIC)] if start else summary[footer : -_CRC_BYTES - len(MAGIC)]
        if (opcode, length) != (Opcode.FOOTER, _FOOTER_BYTES) or stated not in (0, zlib.crc32(checked)):
            self.cut = "the index is damaged; every message is there"
            return
        stated_messages = _stated_messages(summary[:footer])
        if stated_messages not in (None, self._messages):
            self.cut = f"it holds {self._messages} of {stated_messages} messages"
            self.complete = False


def _stated_messages(summary: bytes) -> int | None:
    """How many messages the statistics of a file state; None where it has none."""
    at = 0
    while at + _HEAD.size <= len(summary):
        opcode, length = _HEAD.unpack_from(summary, at)
        at += _HEAD.size
        if opcode == Opcode.STATISTICS and length >= _MESSAGE_COUNT.size:
            return int(_MESSAGE_COUNT.unpack_from(summary, at)[0])
        at += length
    return None


def _read(opcode: int, payload: bytes) -> list[Item]:
    """The items in one record; raises one of _DAMAGE when it is not what its opcode says."""
    if opcode == Opcode.CHUNK:
        return _read_chunk(Chunk.read(_stream(payload)))
    item = _read_item(opcode, payload)
    return [] if item is None else [item]


def _read_item(opcode: int, payload: bytes) -> Item | None:
    item: Item
    match opcode:
        case Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(payload)
            return Message(channel, log_time, payload[_MESSAGE.size :], publish_time, sequence)
        case Opcode.SCHEMA:
            item = Schema.read(_stream(payload))
        case Opcode.CHANNEL:
            item = Channel.read(_stream(payload))
        case Opcode.METADATA:
            item = Metadata.read(_stream(payload))
        case Opcode.ATTACHMENT:
            (stated,) = struct.unpack("<I", payload[-4:])
            # MCAP writes 0 for "no checksum".
            if stated not in (0, zlib.crc32(payload[:-4])):
                raise ValueError("checksum of an attachment")
            item = Attachment.read(_stream(payload))
        case _:
            return None
    return item


def _read_chunk(chunk: Chunk) -> list[Item]:
    data = _uncompressed(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("checksum of a chunk")
    items: list[Item] = []
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if length > len(data) - at:
            raise ValueError("length of a record in a chunk")
        item = _read_item(opcode, data[at : at + length])
        if item is not None:
            items.append(item)
        at += length
    return items


def _uncompressed(chunk: Chunk) -> bytes:
    if chunk.uncompressed_size > MAX_RECORD_BYTES:
        raise ValueError("size of a chunk")
    match chunk.compression:
        case "":
            return chunk.data
        case "zstd":
            # The size that the frame states is what would be allocated.
            if zstandard.frame_content_size(chunk.data) not in (-1, chunk.uncompressed_size):
                raise ValueError("size of a chunk")
            return zstandard.ZstdDecompressor().decompress(
                chunk.data, max_output_size=chunk.uncompressed_size
            )
        case other:
            raise UnsupportedCompressionError(other)


def _stream(payload: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(payload))
