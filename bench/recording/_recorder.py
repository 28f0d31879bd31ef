"""The recorder: every record of a session into one MCAP file, in order of simulated time, the same bytes every time."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, cast

from mcap.writer import CompressionType, Writer

from bench.contracts import START, Record
from bench.documents import dump_json
from bench.simspec import RealAutopilot, SimSpec
from bench.streams import message_class, schema_text

PROFILE = "ros2"
LIBRARY = "rebar"
SIMSPEC_ATTACHMENT = "simspec.json"
VERSIONS = "rebar.versions"
SESSION = "rebar.session"
# Chosen, not measured: larger chunks compress better, and a crash loses the one that is open.
CHUNK_BYTES = 256 * 1024


class Recorder:
    """A `Tap`: call it with each record, in order of time. Made by `open_recording` only."""

    def __init__(self, file: _HashedFile) -> None:
        self._file = file
        self._writer = Writer(
            cast(IO[bytes], file),
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._sequences: dict[int, int] = {}
        self.last = START
        """Moment of the latest record; the start when there is none."""
        self.sha256: str | None = None
        """Digest of the whole file, once the block of `open_recording` is left; None before."""

    def __call__(self, record: Record) -> None:
        """Append one record.

        Raises ValueError when it lies before the one before it: that is a fault of the bench.
        """
        if record.time < self.last:
            raise ValueError(
                f"record on {record.topic} at {record.time.ns} ns lies before the last one at {self.last.ns} ns"
            )
        self.last = record.time
        channel = self._channels.get((record.topic, record.type_name)) or self._register(record)
        sequence = self._sequences[channel] = self._sequences[channel] + 1
        self._writer.add_message(channel, record.time.ns, record.data, record.time.ns, sequence)

    @property
    def messages(self) -> int:
        """Records taken in so far."""
        return sum(self._sequences.values())

    def _register(self, record: Record) -> int:
        schema = self._schemas.get(record.type_name)
        if schema is None:
            # One session has one release of a type, whose class its value has.
            known = record.type_name if message_class(record.type_name) else type(record.value)
            text = schema_text(known).encode()
            schema = self._schemas[record.type_name] = self._writer.register_schema(
                record.type_name, "ros2msg", text
            )
        # Registered at its first record, so that a recording has only channels with messages, in a fixed
        # order.
        channel = self._writer.register_channel(record.topic, "cdr", schema)
        self._channels[record.topic, record.type_name] = channel
        self._sequences[channel] = 0
        return channel

    def _begin(self, simspec: SimSpec, versions: Mapping[str, str], metadata: Mapping[str, str]) -> None:
        self._writer.start(profile=PROFILE, library=LIBRARY)
        # The times of the attachment are 0 and the dictionaries sorted: equal sessions make equal bytes.
        self._writer.add_attachment(0, 0, SIMSPEC_ATTACHMENT, "application/json", _as_flown(simspec).encode())
        self._writer.add_metadata(VERSIONS, dict(sorted(versions.items())))
        self._writer.add_metadata(SESSION, dict(sorted(metadata.items())))

    def _finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self.sha256 = self._file.sha256()


@contextmanager
def open_recording(
    path: Path, *, simspec: SimSpec, versions: Mapping[str, str], metadata: Mapping[str, str] | None = None
) -> Iterator[Recorder]:
    """Yield a recorder that writes to `path`, replacing what is there; leaving the block, even by an error,
    closes the file whole.

    The SimSpec (attachment), `versions` and `metadata` stand at the head of the file, so that they survive
    whatever cuts it off. None of them may hold a wall clock, a host or a path of this machine: equal sessions
    make equal bytes. Of the SimSpec that is left out which says how it is launched and not what is flown. Raises OSError
    when the file cannot be written.
    """
    with path.open("wb") as file:
        recorder = Recorder(_HashedFile(file))
        # Written and flushed before the session: even a recording that is cut off says what it was.
        recorder._begin(simspec, versions, metadata or {})
        try:
            yield recorder
        finally:
            recorder._finish()
            # The digest goes into result.json, which is synced too: it must not outlive the bytes it speaks
            # of.
            os.fsync(file.fileno())


def _as_flown(simspec: SimSpec) -> str:
    """JSON of the SimSpec without how it is launched: how the agent is confined, the folders of its manifest and of a real
    autopilot, ground stations that only look on, limits on the time of the host. The run's `simspec.json` has all of them.
    """
    agent = simspec.agent.model_copy(
        update={"isolation": None, "manifest": PurePosixPath(simspec.agent.manifest).name}
    )
    heard = tuple(link for link in simspec.vehicle.outside_links if link.heard)
    vehicle = simspec.vehicle.model_copy(update={"outside_links": heard})
    if isinstance(vehicle.autopilot, RealAutopilot):
        firmware = PurePosixPath(vehicle.autopilot.firmware).name
        autopilot = vehicle.autopilot.model_copy(update={"firmware": firmware})
        vehicle = vehicle.model_copy(update={"autopilot": autopilot})
    flown = simspec.model_copy(update={"agent": agent, "vehicle": vehicle})
    return dump_json(flown, exclude={"budgets"})


class _HashedFile:
    """What the MCAP writer needs of a stream; it only ever appends, so the digest is had on the way."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._digest = hashlib.sha256()
        self._count = 0

    def write(self, data: bytes) -> int:
        self._digest.update(data)
        self._count += len(data)
        count = self._file.write(data)
        # Chunks that shrink to little would wait in the file's buffer, and be lost with the process.
        self._file.flush()
        return count

    def tell(self) -> int:
        return self._count

    def sha256(self) -> str:
        return self._digest.hexdigest()
