"""MCAP files as the `mcap` package writes them, byte for byte, at an eighth of the cost of a message.

`mcap.writer.Writer` makes nine calls and three objects for a message, and a session has seventy messages a simulated
second: that was a tenth of the bench's CPU time. Here a message is one `struct` call into a buffer; all other records
are written by the package's own classes. `tests/recording/test_recording_mcap_writer.py` compares the two files.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Sequence
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

# The MCAP specification: the first and the last bytes of a file.
MAGIC = b"\x89MCAP0\r\n"
_COMPRESSION = "zstd"
# Opcode and length of the record, then channel, sequence, log time and publish time; the data follows.
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS_BYTES = struct.calcsize("<HIQQ")
# Opcode and length of a message index, then channel and length of its array of (log time, offset).
_MESSAGE_INDEX = struct.Struct("<BQHI")


class Stream(Protocol):
    """What the writer needs of a file: it only ever appends."""

    def write(self, data: bytes, /) -> int: ...

    def tell(self) -> int: ...

    def flush(self) -> None: ...


class McapWriter:
    """Writes one file: `start`, then attachments, metadata and messages, then `finish`.

    Messages come in order of time. A chunk is closed once it holds more than `chunk_bytes`.
    """

    def __init__(self, stream: Stream, chunk_bytes: int) -> None:
        self._stream = stream
        self._crc = 0
        self._chunk_bytes = chunk_bytes
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: defaultdict[int, int] = defaultdict(int)
        self._first_ns = 0
        self._last_ns = 0
        self._begin_chunk()

    def start(self, profile: str, library: str) -> None:
        """Begin the file."""
        self._append(MAGIC)
        self._write(Header(profile, library))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Add a file, with 0 as its times."""
        attachment = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        offset, length = self._write(attachment)
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=0,
                create_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_metadata(self, name: str, metadata: dict[str, str]) -> None:
        """Add names with their texts."""
        offset, length = self._write(Metadata(name=name, metadata=metadata))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """The id of a new schema."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._add_to_chunk(schema)
        return schema.id

    def register_channel(self, topic: str, encoding: str, schema: int) -> int:
        """The id of a new channel."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata={},
            schema_id=schema,
        )
        self._channels.append(channel)
        self._add_to_chunk(channel)
        return channel.id

    def add_message(self, channel: int, time_ns: int, data: bytes, sequence: int) -> None:
        """Add a message that was published when it is logged."""
        chunk = self._chunk
        if not self._counts:
            self._first_ns = time_ns
        if not self._chunk_indices:
            self._chunk_first_ns = time_ns
        self._last_ns = time_ns
        self._counts[channel] += 1
        index = self._chunk_indices.get(channel)
        if index is None:
            index = self._chunk_indices[channel] = []
        index += (time_ns, len(chunk))
        length = _MESSAGE_FIELDS_BYTES + len(data)
        chunk += _MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence, time_ns, time_ns)
        chunk += data
        if len(chunk) > self._chunk_bytes:
            self._finish_chunk()

    def finish(self) -> None:
        """Write the open chunk, the summary and the end of the file."""
        self._finish_chunk()
        # Over all bytes up to here: chunks have checksums of their own, indices and metadata have none.
        self._write(DataEnd(self._crc))
        summary_start = self._stream.tell()
        summary = RecordBuilder()
        groups = [
            self._write_group(summary, summary_start, opcode, records)
            for opcode, records in (
                (Opcode.SCHEMA, self._schemas),
                (Opcode.CHANNEL, self._channels),
                (Opcode.STATISTICS, [self._statistics()]),
                (Opcode.CHUNK_INDEX, self._chunks),
                (Opcode.ATTACHMENT_INDEX, self._attachments),
                (Opcode.METADATA_INDEX, self._metadata),
            )
        ]
        offsets_start = summary_start + summary.count
        for group in groups:
            group.write(summary)
        data: bytes = summary.end()  # type: ignore[no-untyped-call]
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, summary_start, offsets_start)
        self._stream.write(data)
        self._write(
            Footer(
                summary_start=summary_start,
                summary_offset_start=offsets_start,
                summary_crc=zlib.crc32(footer_head, zlib.crc32(data)),
            )
        )
        self._stream.write(MAGIC)

    def _write(self, record: McapRecord) -> tuple[int, int]:
        """Write a record outside of chunks; its offset and length."""
        data = _bytes_of(record)
        offset = self._stream.tell()
        self._append(data)
        return offset, len(data)

    def _append(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)

    def _write_group(
        self, summary: RecordBuilder, start: int, opcode: Opcode, records: Sequence[McapRecord]
    ) -> SummaryOffset:
        group_start = summary.count
        for record in records:
            record.write(summary)
        return SummaryOffset(
            group_opcode=opcode, group_start=start + group_start, group_length=summary.count - group_start
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._first_ns,
            message_end_time=self._last_ns,
            schema_count=len(self._schemas),
        )

    def _begin_chunk(self) -> None:
        self._chunk = bytearray()
        self._chunk_first_ns = 0
        # Of each channel in the order of their first messages: time, offset, time, offset ...
        self._chunk_indices: dict[int, list[int]] = {}

    def _add_to_chunk(self, record: McapRecord) -> None:
        self._chunk += _bytes_of(record)
        if len(self._chunk) > self._chunk_bytes:
            self._finish_chunk()

    def _finish_chunk(self) -> None:
        # Schemas and channels wait for a message.
        if not self._chunk_indices:
            return
        data = bytes(self._chunk)
        compressed = zstandard.compress(data)
        offset, length = self._write(
            Chunk(
                compression=_COMPRESSION,
                data=compressed,
                message_start_time=self._chunk_first_ns,
                message_end_time=self._last_ns,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        offsets, indices = {}, bytearray()
        for channel, entries in self._chunk_indices.items():
            offsets[channel] = self._stream.tell() + len(indices)
            size = 8 * len(entries)
            indices += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 2 + 4 + size, channel, size)
            indices += struct.pack(f"<{len(entries)}Q", *entries)
        self._append(bytes(indices))
        # Chunks that shrink to little would wait in the file's buffer, and be lost with the process.
        self._stream.flush()
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=_COMPRESSION,
                compressed_size=len(compressed),
                message_end_time=self._last_ns,
                message_index_length=len(indices),
                message_index_offsets=offsets,
                message_start_time=self._chunk_first_ns,
                uncompressed_size=len(data),
            )
        )
        self._begin_chunk()


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
