# mypy: disable-error-code=unreachable
# A property that is None inside the block and a digest after it looks unreachable to the type checker.
"""Recordings: written, read by us and by a reader we did not write, cut off, damaged, hostile."""

from __future__ import annotations

import hashlib
import random
import struct
import subprocess
import sys
from pathlib import Path

import made_run
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import DecodedMessageTuple, make_reader
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

from bench.contracts import Record, SimTime
from bench.errors import SetupError
from bench.recording import check_whole, open_recording, read_metadata, read_records, read_simspec
from bench.streams import String, encode

VERSIONS = {"rebar": "0.1.0", "jsbsim": "1.3.3"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole recording of several chunks."""
    path = tmp_path_factory.mktemp("run") / "recording.mcap"
    write(path, records())
    return path


def records() -> list[Record]:
    return made_run.records(made_run.simspec(), seconds=60.0)


def write(path: Path, records: list[Record]) -> str:
    with open_recording(
        path, simspec=made_run.simspec(), versions=VERSIONS, metadata={"realization": "p1-r1"}
    ) as recorder:
        for record in records:
            recorder(record)
    assert recorder.sha256 is not None
    return recorder.sha256


def test_round_trip(tmp_path: Path, recorded: Path) -> None:
    """What is read is what was recorded: every record, the SimSpec, the versions. The digest is that of the file."""
    assert list(read_records(recorded)) == records()
    assert read_simspec(recorded) == made_run.simspec()
    assert read_metadata(recorded) == {"rebar.versions": VERSIONS, "rebar.session": {"realization": "p1-r1"}}
    path = tmp_path / "recording.mcap"
    with open_recording(path, simspec=made_run.simspec(), versions={}) as recorder:
        assert recorder.sha256 is None
    assert recorder.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert recorder.messages == 0


def test_an_independent_reader_decodes_every_message(recorded: Path) -> None:
    """mcap-ros2-support decodes all of it by the schemas in the file, in order of time, counted by topic from 1."""
    ours = records()
    theirs = decoded(recorded)
    assert len(theirs) == len(ours)
    assert sorted((message.channel.topic, message.message.log_time) for message in theirs) == sorted(
        (record.topic, record.time.ns) for record in ours
    )
    assert all(message.message.log_time == message.message.publish_time for message in theirs)
    odometry = [message for message in theirs if message.channel.topic == "/truth/odometry"]
    assert [message.message.sequence for message in odometry] == list(range(1, len(odometry) + 1))
    assert odometry[10].decoded_message.pose.pose.position.y == pytest.approx(2.0)
    boxes = next(
        message.decoded_message for message in theirs if message.channel.topic == "/vehicle_1/detections"
    )
    assert boxes.detections[0].results[0].hypothesis.class_id == "civilian"


def decoded(path: Path) -> list[DecodedMessageTuple]:
    with path.open("rb") as file:
        return list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())


def test_the_index_is_complete(recorded: Path) -> None:
    """Profile, library, statistics and attachment index are as the seeking readers of the field want them."""
    with recorded.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert (reader.get_header().profile, reader.get_header().library) == ("ros2", "rebar")
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(records())
        assert summary.statistics.chunk_count > 2
        assert [attachment.name for attachment in summary.attachment_indexes] == ["simspec.json"]
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}


def test_equal_records_make_equal_bytes_in_another_process(recorded: Path, tmp_path: Path) -> None:
    """Nothing of the clock, the process, the hash seed or the path is in the file."""
    script = (
        "import sys; from pathlib import Path; sys.path[:0] = sys.argv[2:]\n"
        "import test_recording_files as t; t.write(Path(sys.argv[1]), t.records())"
    )
    other = tmp_path / "elsewhere.mcap"
    here = Path(__file__).parent
    # made_run is one folder up; pytest adds that folder by itself, because of its conftest.
    command = [sys.executable, "-c", script, str(other), str(here), str(here.parent)]
    subprocess.run(command, check=True, env={"PYTHONHASHSEED": "7"}, timeout=60)
    assert other.read_bytes() == recorded.read_bytes()


def test_a_record_out_of_order_is_a_bench_error(tmp_path: Path) -> None:
    """Records out of order raise an error, and the earlier records stay in a complete file."""
    path = tmp_path / "recording.mcap"
    late, early = (Record(SimTime(ns), "/x", String.TYPE, encode(String("x"))) for ns in (5, 4))
    with (  # noqa: PT012 - the recording is to be closed by the error
        pytest.raises(ValueError, match="/x at 4 ns lies before the last one at 5 ns"),
        open_recording(path, simspec=made_run.simspec(), versions={}) as recorder,
    ):
        recorder(late)
        recorder(early)
    assert list(read_records(path)) == [late]


def test_a_truncated_recording_is_read_up_to_the_cut(recorded: Path, tmp_path: Path) -> None:
    """A recording truncated at any byte gives a prefix of its records, more for later cuts, and never a traceback."""
    whole, ours = recorded.read_bytes(), records()
    cut_file = tmp_path / "cut.mcap"
    read: list[int] = []
    for length in sorted(random.Random(1).sample(range(8, len(whole)), 60)):
        cut_file.write_bytes(whole[:length])
        survivors = list(read_records(cut_file))
        assert survivors == ours[: len(survivors)]
        read.append(len(survivors))
    assert read == sorted(read)
    assert read[0] < read[-1] == len(ours)


def test_truncation_loses_at_most_one_chunk(recorded: Path, tmp_path: Path) -> None:
    with recorded.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    _, second, third, *_ = summary.chunk_indexes
    cut_file = tmp_path / "cut.mcap"
    cut_file.write_bytes(recorded.read_bytes()[: third.chunk_start_offset + third.chunk_length - 1])
    assert list(read_records(cut_file))[-1].time.ns == second.message_end_time


def test_reading_ends_at_damage(recorded: Path, tmp_path: Path) -> None:
    """Bytes changed anywhere give fewer records, never other ones, and never a traceback."""
    whole, ours, chance = recorded.read_bytes(), records(), random.Random(2)
    damaged = tmp_path / "damaged.mcap"
    for _ in range(40):
        broken = bytearray(whole)
        where = chance.randrange(8, len(whole))
        broken[where] ^= 1 << chance.randrange(8)
        damaged.write_bytes(broken)
        try:
            survivors = list(read_records(damaged))
        except SetupError:
            continue
        assert survivors == ours[: len(survivors)]


@pytest.mark.parametrize("text", [b"", b"\x89MCAP", b"name: demo\n" * 20])
def test_a_file_of_another_format_is_refused(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "thing.mcap"
    path.write_bytes(text)
    for read in (lambda: list(read_records(path)), lambda: read_simspec(path)):
        with pytest.raises(
            SetupError, match=r"thing\.mcap: is not an MCAP recording \(give the recording.mcap of a run\)"
        ):
            read()


def test_a_missing_file_and_a_missing_simspec_are_reported(tmp_path: Path) -> None:
    """No file, a folder, and a foreign MCAP file without a SimSpec each get a sentence."""
    with pytest.raises(SetupError, match="there is no such file"):
        read_simspec(tmp_path / "none.mcap")
    with pytest.raises(SetupError, match="it is a folder"):
        read_simspec(tmp_path)
    path = foreign(tmp_path / "foreign.mcap", times=(1,))
    with pytest.raises(SetupError, match=r"holds no simspec\.json"):
        read_simspec(path)


def test_foreign_recordings_are_refused_when_unordered_or_unreadable(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="at 3 ns follows one at 7 ns"):
        list(read_records(foreign(tmp_path / "order.mcap", times=(7, 3))))
    with pytest.raises(SetupError, match="lz4"):
        list(read_records(foreign(tmp_path / "lz4.mcap", times=(1,), compression=CompressionType.LZ4)))


def chunk_of(compression: str, data: bytes, size: int) -> bytes:
    chunk = RecordBuilder()
    Chunk(compression, data, 0, 0, 0, size).write(chunk)
    return bytes(chunk.end())


OVERRUN = struct.pack("<BQHIQQ", 5, 500, 1, 1, 0, 0) + b"short"


@pytest.mark.parametrize(
    ("record", "fault"),
    [
        # A frame that states more bytes than its chunk does: found before anything is allocated.
        (
            chunk_of("zstd", zstandard.compress(b"\0" * 9 * 5_000_000), 1000),
            "the record at byte 8 is damaged",
        ),
        # A message that is cut short inside a chunk, even without a checksum.
        (chunk_of("", OVERRUN, len(OVERRUN)), "the record at byte 8 is damaged"),
        # An unfinished record, whose length some writers leave at all ones.
        (struct.pack("<BQ", 6, 2**64 - 1) + b"rest", "ends within the record at byte 8"),
        (struct.pack("<BQ", 6, 2**62) + b"rest", "ends within the record at byte 8"),
        (struct.pack("<BQ", 6, 1000) + b"rest", "ends within the record at byte 8"),
    ],
    ids=["a bomb", "an overrun", "all ones", "2**62", "1000"],
)
def test_a_record_that_is_not_what_it_says_ends_the_reading(
    tmp_path: Path, record: bytes, fault: str
) -> None:
    path = tmp_path / "hostile.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + record)
    assert list(read_records(path)) == []
    with pytest.raises(SetupError, match=fault):
        check_whole(path)


def test_a_damaged_simspec_is_rejected(recorded: Path, tmp_path: Path) -> None:
    """The checksum finds one changed letter in the attachment: no SimSpec rather than a wrong one."""
    path = tmp_path / "damaged.mcap"
    path.write_bytes(recorded.read_bytes().replace(b'"east_m": 120.0', b'"east_m": 220.0', 1))
    assert path.read_bytes() != recorded.read_bytes()
    with pytest.raises(SetupError, match=r"damaged: the record at byte"):
        read_simspec(path)


def foreign(
    path: Path, *, times: tuple[int, ...], compression: CompressionType = CompressionType.ZSTD
) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        schema = writer.register_schema(String.TYPE, "ros2msg", b"string data")
        channel = writer.register_channel("/x", "cdr", schema)
        for time_ns in times:
            writer.add_message(channel, time_ns, encode(String("x")), time_ns)
        writer.finish()
    return path
