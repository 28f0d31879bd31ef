"""The logs that the vehicle keeps, as on its memory card."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from ..files._served_files import FileContent
from ..policies._logs import LogPolicy
from ..state._log_records import SAMPLE, FlightSample, LogEncoder, LoggedText, LogOpening, Note

# What the samples of all logs may take: half a day at ten samples a second.
MAX_RECORDED_BYTES = 64 << 20
# What written files may take beside them; a file is written again when it is asked for again.
MAX_WRITTEN_BYTES = 64 << 20
# Of a note in memory, roughly; a text's own characters come on top.
_NOTE_BYTES = 200


class FlightLog:
    """One log: an opening, samples and notes in the order of time. Written by `encoder` as far as it is recorded,
    whenever it is read.
    """

    def __init__(self, opening: LogOpening, encoder: Callable[[LogOpening], LogEncoder]) -> None:
        self.opening = opening
        self.end_us = opening.time_us
        # How many logs of the storage began in the same second before; an aborted flight lasts less than one.
        self.namesakes = 0
        self.recorded_bytes = 8 * len(opening.values)
        self._new_encoder = encoder
        self._samples = bytearray()
        self._notes: list[tuple[int, Note]] = []  # with the number of samples in front
        self._file: _LogFile | None = None
        self._size = 0  # of the file when it was last written
        self._recorded_at_size = -1

    @property
    def begin_utc_s(self) -> int:
        """When the log was begun, in seconds of UTC."""
        return (self.opening.boot_utc_us + self.opening.time_us) // 1_000_000

    @property
    def end_utc_s(self) -> int:
        """When the last sample or note was taken, in seconds of UTC, as a file's time of modification."""
        return (self.opening.boot_utc_us + self.end_us) // 1_000_000

    @property
    def written_bytes(self) -> int:
        """What the written file takes in memory."""
        return len(self._file.content) if self._file else 0

    def add_sample(self, packed: bytes, time_us: int) -> None:
        self._samples += packed
        self.end_us = time_us
        self.recorded_bytes += SAMPLE.size

    def add_note(self, note: Note) -> None:
        self._notes.append((len(self._samples), note))
        self.end_us = note.time_us
        self.recorded_bytes += _NOTE_BYTES + (len(note.text) if isinstance(note, LoggedText) else 0)

    def size(self) -> int:
        """Bytes of the file."""
        return self._size if self._recorded_at_size == self.recorded_bytes else len(self.content())

    def content(self) -> bytearray:
        """The file. It grows at its end, so an offset stays good while the log is recorded."""
        if self._file is None:
            self._file = _LogFile(self._new_encoder(self.opening))
        self._file.extend(self._samples, self._notes)
        self._size, self._recorded_at_size = len(self._file.content), self.recorded_bytes
        return self._file.content

    def forget(self) -> None:
        """Free what was written; `content` writes it again."""
        self._file = None


class _LogFile:
    """A log as far as it is written."""

    def __init__(self, encoder: LogEncoder) -> None:
        self.content = bytearray(encoder.head())
        self._encoder = encoder
        self._samples_end = 0  # in bytes of samples
        self._notes_end = 0

    def extend(self, samples: bytearray, notes: list[tuple[int, Note]]) -> None:
        """Write what was recorded since; a note comes behind the samples that were there before it."""
        for place, note in notes[self._notes_end :]:
            self._extend_to(place, samples)
            self.content += self._encoder.note(note)
        self._notes_end = len(notes)
        self._extend_to(len(samples), samples)

    def _extend_to(self, end: int, samples: bytearray) -> None:
        for fields in SAMPLE.iter_unpack(samples[self._samples_end : end]):
            self.content += self._encoder.sample(FlightSample._make(fields))
        self._samples_end = end


class LogStorage:
    """Logs in the order in which they were begun. When there is no room left, the oldest goes."""

    def __init__(
        self, max_recorded_bytes: int = MAX_RECORDED_BYTES, max_written_bytes: int = MAX_WRITTEN_BYTES
    ) -> None:
        self._max_recorded_bytes = max_recorded_bytes
        self._max_written_bytes = max_written_bytes
        self._logs: list[FlightLog] = []

    @property
    def logs(self) -> Sequence[FlightLog]:
        return self._logs

    def begin(self, log: FlightLog) -> None:
        namesakes = [other.namesakes for other in self._logs if other.begin_utc_s == log.begin_utc_s]
        log.namesakes = max(namesakes, default=-1) + 1
        self._logs.append(log)

    def make_room(self) -> bool:
        """Drop the oldest logs until the rest fits; False when the one that is recorded is too large by itself."""
        while sum(log.recorded_bytes for log in self._logs) > self._max_recorded_bytes:
            if len(self._logs) == 1:
                return False
            del self._logs[0]
        return True

    def read(self, log: FlightLog) -> bytearray:
        """A log's file."""
        content = log.content()
        if sum(written.written_bytes for written in self._logs) > self._max_written_bytes:
            for other in self._logs:
                if other is not log:
                    other.forget()
        return content

    def files(self, policy: LogPolicy) -> dict[str, FileContent]:
        """The logs as files, by the path at which the autopilot has them."""
        return {
            policy.path(number, log.opening, log.namesakes): partial(self._content, log)
            for number, log in enumerate(self._logs, start=policy.first_number)
        }

    def _content(self, log: FlightLog, query: str) -> bytes:
        return bytes(self.read(log))

    def erase(self) -> None:
        self._logs.clear()
