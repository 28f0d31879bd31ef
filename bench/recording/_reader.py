"""Recordings read back: whole ones, and what is left of those that a crash cut off."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from bench.contracts import Record, SimTime, Tape
from bench.documents import read_json_document
from bench.errors import SetupError
from bench.simspec import SimSpec

from ._container import Container
from ._recorder import SIMSPEC_ATTACHMENT
from ._tape import TapeBuilder

CUT = "recording"
"""The entry of `Tape.malformed` that says that the recording ends before its session did."""


def read_records(path: Path | str) -> Iterator[Record]:
    """Every record of a recording, in order of time; of one that was cut off, those up to the last whole chunk.

    Raises SetupError when the file is missing, is no MCAP file, or was not written in order of time. Channels
    that do not hold CDR of ROS 2 types are passed over.
    """
    return _records(Container(Path(path)))


def read_tape(path: Path | str, simspec: SimSpec | None = None) -> Tape:
    """The typed streams of a recording. A cut recording says so in `malformed["recording"]`.

    `simspec` is what `read_simspec` returned for this recording, for callers that need both.
    Raises SetupError as `read_records` and `read_simspec` do.
    """
    builder = TapeBuilder(simspec or read_simspec(path))
    container = Container(Path(path))
    for record in _records(container):
        builder(record)
    if not container.complete:
        builder.note(CUT)
    return builder.tape()


def read_simspec(path: Path | str) -> SimSpec:
    """The realized SimSpec that a recording carries. Raises SetupError when it has none or an invalid one."""
    container = Container(Path(path))
    for item in container:
        if isinstance(item, Attachment) and item.name == SIMSPEC_ATTACHMENT:
            return _simspec(item.data, f"{path}: {SIMSPEC_ATTACHMENT}")
    if container.cut is not None:
        raise _damaged(container)
    raise SetupError(
        path, f"holds no {SIMSPEC_ATTACHMENT}", "give a recording of this bench, cut off after its head"
    )


def check_whole(path: Path | str) -> None:
    """Raises SetupError for a recording that was cut off or damaged since it was written, by all checksums in it."""
    container = Container(Path(path))
    for _ in container:
        pass
    if container.cut is not None:
        raise _damaged(container)


def read_metadata(path: Path | str) -> dict[str, dict[str, str]]:
    """The metadata records of a recording by name: `rebar.versions`, `rebar.session`."""
    return {item.name: item.metadata for item in Container(Path(path)) if isinstance(item, Metadata)}


def _records(container: Container) -> Iterator[Record]:
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    last_ns = 0
    for item in container:
        match item:
            case Message():
                channel = channels.get(item.channel_id)
                if channel is None:
                    continue
                # Sorting would hide a fault of the writer, and a tape is built in one pass.
                if item.log_time < last_ns:
                    fault = f"a message on {channel[0]} at {item.log_time} ns follows one at {last_ns} ns"
                    raise SetupError(
                        container.path, fault, "give a recording of this bench, which is in order of time"
                    )
                last_ns = item.log_time
                yield Record(SimTime(item.log_time), channel[0], channel[1], item.data)
            case Schema():
                schemas[item.id] = item.name
            # Foreign channels are passed over: somebody may have merged another log into the file.
            case Channel() if item.message_encoding == "cdr" and item.schema_id in schemas:
                channels[item.id] = (item.topic, schemas[item.schema_id])


def _damaged(container: Container) -> SetupError:
    remedy = "restore it from a copy; docs/recordings.md says how to save what can be read of it as a recording of its own"
    return SetupError(container.path, f"damaged: {container.cut}", remedy)


def _simspec(data: bytes, source: str) -> SimSpec:
    return read_json_document(data.decode(errors="replace"), SimSpec, source)
