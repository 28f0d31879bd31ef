"""The first difference of two recordings."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from bench.contracts import Record

from ._reader import read_metadata, read_records, read_simspec


@dataclass(frozen=True, slots=True)
class RecordingDifference:
    """Where two recordings begin to differ: the earlier record's `time_s` and `topic`, None if not in a record."""

    what: str
    time_s: float | None = None
    topic: str | None = None

    def __str__(self) -> str:
        return self.what if self.time_s is None else f"{self.topic} at {self.time_s:.3f} s: {self.what}"


def recording_difference(first: Path, second: Path) -> RecordingDifference | None:
    """The first record in which two recordings differ, else what differs in their heads; None if nothing does.

    Versions of software are part of the head. Raises SetupError as `read_records` does.
    """
    for record, other in zip_longest(read_records(first), read_records(second)):
        if record != other:
            return _record_difference(record, other)
    if read_simspec(first) != read_simspec(second):
        return RecordingDifference("the SimSpecs in their heads differ")
    heads = read_metadata(first), read_metadata(second)
    for name in sorted(heads[0].keys() | heads[1].keys()):
        if heads[0].get(name) != heads[1].get(name):
            return RecordingDifference(f"the entries {name} in their heads differ")
    return None


def _record_difference(first: Record | None, second: Record | None) -> RecordingDifference:
    if first is None or second is None:
        record, shorter = (second, "first") if first is None else (first, "second")
        # Of two records that differ, one is there.
        assert record is not None
        what = f"the {shorter} recording ends before this record"
        return RecordingDifference(what, record.time.s, record.topic)
    earlier, later = sorted((first, second), key=lambda record: record.time)
    if (first.time, first.topic) != (second.time, second.topic):
        what = f"the other recording has {later.topic} at {later.time.s:.3f} s in this place"
    elif first.type_name != second.type_name:
        what = f"a {first.type_name} in the first recording, a {second.type_name} in the second"
    else:
        what = f"the messages differ from byte {_first_different_byte(first.data, second.data)} on"
    return RecordingDifference(what, earlier.time.s, earlier.topic)


def _first_different_byte(first: bytes, second: bytes) -> int:
    pairs = enumerate(zip(first, second, strict=False))
    return next((place for place, (a, b) in pairs if a != b), min(len(first), len(second)))
