"""The recorder's own MCAP writer against the `mcap` package's: the same calls, the same bytes."""

from __future__ import annotations

import random
from io import BytesIO

import pytest
from mcap.writer import CompressionType, Writer

from bench.recording._mcap_writer import McapWriter


def written_by_both(seed: int, messages: int, chunk_bytes: int) -> tuple[bytes, bytes]:
    """One file of each writer: the same attachments, metadata, schemas, channels and messages, drawn from `seed`."""
    draw = random.Random(seed)
    ours, theirs = BytesIO(), BytesIO()
    writer = McapWriter(ours, chunk_bytes)
    reference = Writer(
        theirs, chunk_size=chunk_bytes, compression=CompressionType.ZSTD, enable_data_crcs=True
    )
    writer.start("ros2", "rebar")
    reference.start("ros2", "rebar")
    for number in range(draw.randrange(3)):
        data = draw.randbytes(draw.randrange(200))
        writer.add_attachment(f"file-{number}", "text/plain", data)
        reference.add_attachment(0, 0, f"file-{number}", "text/plain", data)
    for number in range(draw.randrange(3)):
        texts = {f"key-{key}": "grün" * key for key in range(draw.randrange(4))}
        writer.add_metadata(f"metadata-{number}", texts)
        reference.add_metadata(f"metadata-{number}", texts)
    channels: list[int] = []
    time_ns = 0
    for sequence in range(messages):
        # Channels join on the way, as topics do in a session; a large schema fills a chunk by itself.
        if not channels or draw.random() < 0.05:
            text = draw.randbytes(draw.choice((0, 30, 2 * chunk_bytes)))
            schema = writer.register_schema(f"type-{sequence}", "ros2msg", text)
            assert schema == reference.register_schema(f"type-{sequence}", "ros2msg", text)
            channels.append(writer.register_channel(f"/topic/{sequence}", "cdr", schema))
            assert channels[-1] == reference.register_channel(f"/topic/{sequence}", "cdr", schema)
        # Often several at one moment, and the first ones at the start.
        time_ns += draw.choice((0, 0, 20_000_000, 3_000_000_000))
        channel, data = draw.choice(channels), draw.randbytes(draw.choice((0, 7, 100, chunk_bytes)))
        writer.add_message(channel, time_ns, data, sequence)
        reference.add_message(channel, time_ns, data, time_ns, sequence)
    writer.finish()
    reference.finish()  # type: ignore[no-untyped-call]
    return ours.getvalue(), theirs.getvalue()


@pytest.mark.parametrize(("messages", "chunk_bytes"), [(0, 500), (1, 500), (40, 100_000), (400, 500)])
def test_the_bytes_are_those_of_the_package(messages: int, chunk_bytes: int) -> None:
    """Files without a message, with one chunk, and with very many, five of each."""
    for seed in range(5):
        ours, theirs = written_by_both(seed, messages, chunk_bytes)
        assert ours == theirs
