"""One pass over a recording that copies it and adds what viewers show."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

from bench.contracts import Evidence, Observation, Record, SimTime, VehicleTopics
from bench.errors import SetupError
from bench.simspec import SimSpec
from bench.streams import RosMessage, String, Time, encode, schema_text_of

from .._container import Container
from .._copy import ItemCopy
from .._reader import read_records, read_simspec
from .._recorder import CHUNK_BYTES, LIBRARY, PROFILE
from ._deriver import LOG, OBSERVATIONS, VIEWER_PREFIX, Derived, ViewerDeriver
from ._messages import Log, LogLevel


@dataclass(frozen=True, slots=True)
class ExportResult:
    """What an export wrote. `cut` says where the recording ends early, None when it is whole.

    `malformed` counts by topic what could not be decoded: copied, but shown nowhere.
    """

    copied: int
    derived: int
    pictures: bool
    malformed: Mapping[str, int]
    cut: str | None


def export_for_viewers(
    source: Path | str, target: Path | str, observations: Iterable[Observation] = ()
) -> ExportResult:
    """Write every message of the recording `source` as it is, and beside it what viewers show, to `target`: also what was
    measured in it, each of the `observations` at each of its moments.

    Works on a recording of any age, also one that was cut off. Memory does not grow with the recording. The same
    recording gives the same bytes. Raises SetupError when `source` is no recording of the bench or is an export
    already, or when `target` exists; OSError when `target` cannot be written. A failure leaves no `target`.
    """
    source, target = Path(source), Path(target)
    simspec = read_simspec(source)
    pictures = _cameras_with_pictures(source, simspec)
    deriver = ViewerDeriver(simspec, pictures=pictures)
    if os.path.lexists(target):
        raise SetupError(target, "exists already", "give another name with --out, or delete it")
    # Under another name until it is whole: a viewer must not open half a file as if it were one.
    partial = target.with_name(f"{target.name}.partial")
    try:
        with partial.open("wb") as file:
            writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
            writer.start(profile=PROFILE, library=LIBRARY)
            of_main = simspec.vehicle.camera.name in pictures
            result = _write(Container(source), writer, deriver, _moments(observations), pictures=of_main)
            writer.finish()  # type: ignore[no-untyped-call]
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)
    return result


def _cameras_with_pictures(source: Path, simspec: SimSpec) -> set[str]:
    """The names of the cameras of which the recording holds pictures.

    Reads it once, which also finds whatever makes it unreadable.
    """
    topics = VehicleTopics(simspec.vehicle.name)
    camera_of = {
        topic: camera.name
        for camera in simspec.vehicle.cameras
        for topic in (topics.image_raw(camera.name), topics.image_compressed(camera.name))
    }
    pictures = set()
    for record in read_records(source):
        if record.topic.startswith(VIEWER_PREFIX):
            raise SetupError(
                source,
                f"is an export already: it has the topic {record.topic}",
                "give the recording.mcap of a run",
            )
        if record.topic in camera_of:
            pictures.add(camera_of[record.topic])
    return pictures


def _moments(observations: Iterable[Observation]) -> deque[tuple[SimTime, list[Derived]]]:
    """The messages of each observation at each of its moments, in order of time; at the start where it has none."""
    moments = []
    for observation in observations:
        for evidence in observation.evidence or (Evidence(time_s=0.0, text=""),):
            at = observation.model_copy(update={"evidence": (evidence,)})
            time = SimTime(max(0, round(evidence.time_s * 1e9)))
            messages: list[Derived] = [(OBSERVATIONS, String(at.model_dump_json()))]
            if observation.x is not None and observation.x < 1.0:
                text = f"{observation.observable} {observation.x:.2g}: {evidence.text}"
                messages.append((LOG, Log(Time.of(time.ns), LogLevel.WARNING, text, OBSERVATIONS)))
            moments.append((time, messages))
    return deque(sorted(moments, key=lambda moment: moment[0]))


def _write(
    container: Container,
    writer: Writer,
    deriver: ViewerDeriver,
    moments: deque[tuple[SimTime, list[Derived]]],
    *,
    pictures: bool,
) -> ExportResult:
    copy, derived = ItemCopy(writer), _DerivedChannels(writer)
    names: dict[int, tuple[str, str]] = {}
    schemas: dict[int, str] = {}
    started = False
    for item in container:
        while moments and isinstance(item, Message) and moments[0][0].ns < item.log_time:
            derived.add(*moments.popleft())
        copy.add(item)
        match item:
            case Message() if item.channel_id in names:
                time = SimTime(item.log_time)
                if not started:
                    derived.add(time, deriver.ground(Time.of(time.ns)))
                    started = True
                topic, type_name = names[item.channel_id]
                derived.add(time, deriver(Record(time, topic, type_name, item.data)))
            case Channel() if item.message_encoding == "cdr":
                names[item.id] = (item.topic, schemas.get(item.schema_id, ""))
            case Schema():
                schemas[item.id] = item.name
    for moment in moments:
        derived.add(*moment)
    return ExportResult(
        copy.messages, derived.messages, pictures, dict(sorted(deriver.malformed.items())), container.cut
    )


class _DerivedChannels:
    """Writes derived messages, each topic on a channel that is registered with its first message."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequences: dict[str, int] = {}
        self.messages = 0

    def add(self, time: SimTime, derived: Iterable[Derived]) -> None:
        """Write messages that belong to one moment."""
        for topic, message in derived:
            channel = self._channels.get(topic)
            if channel is None:
                channel = self._register(topic, type(message))
            sequence = self._sequences[topic] = self._sequences[topic] + 1
            self._writer.add_message(channel, time.ns, encode(message), time.ns, sequence)
            self.messages += 1

    def _register(self, topic: str, kind: type[RosMessage]) -> int:
        schema = self._schemas.get(kind.TYPE)
        if schema is None:
            text = schema_text_of(kind).encode()
            schema = self._schemas[kind.TYPE] = self._writer.register_schema(kind.TYPE, "ros2msg", text)
        channel = self._channels[topic] = self._writer.register_channel(topic, "cdr", schema, {})
        self._sequences[topic] = 0
        return channel
