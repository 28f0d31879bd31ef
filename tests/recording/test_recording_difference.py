"""The first difference of two recordings, planted in made ones."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import made_run
import pytest

from bench.contracts import Record, SimTime
from bench.recording import open_recording, recording_difference
from bench.streams import String, encode

VERSIONS = {"python": "3.11.7", "numpy": "2.4.6"}


def record(number: int) -> Record:
    """Two topics in turn, two records at each moment."""
    return Record(
        SimTime(number // 2 * 50_000_000),
        "/ab"[:2] + str(number % 2),
        String.TYPE,
        encode(String(f"{number}")),
    )


def write(
    path: Path, records: Sequence[Record], versions: dict[str, str] = VERSIONS, name: str = "r"
) -> Path:
    with open_recording(
        path, simspec=made_run.simspec(), versions=versions, metadata={"realization": name}
    ) as recorder:
        for entry in records:
            recorder(entry)
    return path


RECORDS = [record(number) for number in range(40)]


@pytest.mark.parametrize("kind", ["data", "longer data", "topic", "type", "missing", "added"])
def test_a_planted_difference_is_found_where_it_was_planted(tmp_path: Path, kind: str) -> None:
    """At two random places, whichever of the two recordings is named first. Later differences are not told."""
    draw = random.Random(kind)
    whole = write(tmp_path / "whole.mcap", RECORDS)
    for place in draw.sample(range(1, 35), 2):
        planted = RECORDS[place]
        changed = {
            "data": [replace(planted, data=planted.data[:-2] + b"~" + planted.data[-1:])],
            "longer data": [replace(planted, data=planted.data + b"~")],
            "topic": [replace(planted, topic="/other")],
            "type": [replace(planted, type_name="std_msgs/msg/UInt8MultiArray")],
            "missing": [],
            "added": [replace(planted, topic="/other"), planted],
        }[kind]
        records = [*RECORDS[:place], *changed, *RECORDS[place + 1 : 38]]
        other = write(tmp_path / "other.mcap", records)
        for pair in ((whole, other), (other, whole)):
            difference = recording_difference(*pair)
            assert difference is not None
            assert difference.time_s == pytest.approx(planted.time.s)
            assert difference.topic in {planted.topic, "/other", RECORDS[place + 1].topic}
            if kind in ("data", "longer data", "type"):
                assert difference.topic == planted.topic


def test_a_recording_that_ends_early_and_heads_that_differ(tmp_path: Path) -> None:
    """The first record that is missing is named; heads are compared only where all records are equal."""
    whole = write(tmp_path / "whole.mcap", RECORDS)
    short = write(tmp_path / "short.mcap", RECORDS[:31], {})
    for first, second, shorter in ((whole, short, "second"), (short, whole, "first")):
        text = f"{RECORDS[31].topic} at 0.750 s: the {shorter} recording ends before this record"
        assert str(recording_difference(first, second)) == text

    assert recording_difference(whole, write(tmp_path / "same.mcap", RECORDS)) is None
    for other, entry in (
        (write(tmp_path / "versions.mcap", RECORDS, {**VERSIONS, "numpy": "2.4.5"}), "rebar.versions"),
        (write(tmp_path / "session.mcap", RECORDS, name="s"), "rebar.session"),
    ):
        assert str(recording_difference(whole, other)) == f"the entries {entry} in their heads differ"
