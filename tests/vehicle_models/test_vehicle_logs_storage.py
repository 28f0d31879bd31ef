"""The storage of flight logs: paths by time, and room made for new ones."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest
from log_client import ulog

from vehicle_models.controller import PX4
from vehicle_models.controller.logs._storage import FlightLog, LogStorage
from vehicle_models.controller.state._flight_state import ReferencePoint
from vehicle_models.controller.state._log_records import SAMPLE, FlightSample, LoggedText, LogOpening
from vehicle_models.controller.state._parameter_store import Parameter


@pytest.mark.parametrize(
    ("shift_min", "path"), [(0, "log/2026-03-01/23_30_12.ulg"), (60, "log/2026-03-02/00_30_12.ulg")]
)
def test_a_log_is_named_for_its_beginning_in_the_time_zone(shift_min: float, path: str) -> None:
    """Twelve seconds after a start at half past eleven."""
    boot_us = round(datetime(2026, 3, 1, 23, 30, tzinfo=UTC).timestamp() * 1e6)
    parameters, values = (Parameter("SDLOG_UTC_OFFSET", 0.0),), (float(shift_min),)
    opening = LogOpening(
        12_000_000, boot_us, ReferencePoint(0, 0, 0.0), 2, PX4.telemetry.gps_quality, parameters, values
    )
    assert PX4.logs.path(0, opening, 0) == path


def test_logs_of_one_second_have_paths_of_their_own() -> None:
    """Three begun in the same second, and one in the next; the first three keep their paths when the oldest goes."""
    one_bytes = made_log(10).recorded_bytes
    storage = LogStorage(max_recorded_bytes=3 * one_bytes)

    def paths() -> list[str]:
        return [PX4.logs.path(0, log.opening, log.namesakes).rsplit("/")[-1] for log in storage.logs]

    for begin_us in (0, 400_000, 999_999):
        storage.begin(made_log(10, begin_us))
    assert paths() == ["00_00_00.ulg", "00_00_00_1.ulg", "00_00_00_2.ulg"]
    storage.begin(made_log(10, 1_000_000))
    assert storage.make_room()
    assert paths() == ["00_00_00_1.ulg", "00_00_00_2.ulg", "00_00_01.ulg"]


def made_log(seconds: int, begin_us: int = 0) -> FlightLog:
    """A log of made samples at 10 Hz, with a text a second."""
    names = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR", "SDLOG_UTC_OFFSET")
    parameters = tuple(Parameter(name, 0.0) for name in names)
    opening = LogOpening(
        begin_us, 0, ReferencePoint(0, 0, 0.0), 2, PX4.telemetry.gps_quality, parameters, (0.0,) * 4
    )
    log = FlightLog(opening, PX4.logs.encoder)
    mode = PX4.modes.initial.custom
    for count in range(10 * seconds):
        numbers = [float(count)] * (len(FlightSample._fields) - 9)
        at = count * 100_000
        fields: list[Any] = [at, mode, True, True, False, True, True, 0, count, *numbers]
        for place in ("latitude_e7", "longitude_e7", "fix_latitude_e7", "fix_longitude_e7"):
            fields[FlightSample._fields.index(place)] = count
        log.add_sample(SAMPLE.pack(*fields), at)
        if count % 10 == 0:
            log.add_note(LoggedText(at, 6, f"second {count // 10}"))
    return log


def test_the_oldest_logs_make_room_for_new_ones() -> None:
    one_bytes = made_log(10).recorded_bytes
    storage = LogStorage(max_recorded_bytes=3 * one_bytes)
    logs = [made_log(10) for _ in range(5)]
    for log in logs:
        storage.begin(log)
        assert storage.make_room()
    assert list(storage.logs) == logs[2:]
    storage.begin(made_log(100))
    assert not storage.make_room()
    assert len(storage.logs) == 1


def test_written_files_are_forgotten_when_they_are_too_many() -> None:
    logs = [made_log(10), made_log(12)]
    contents = [bytes(log.content()) for log in logs]
    storage = LogStorage(max_written_bytes=len(contents[1]))
    for log in logs:
        storage.begin(log)
    for _ in range(2):
        for log, content in zip(logs, contents, strict=True):
            assert storage.read(log) == content
            assert [kept.written_bytes for kept in logs if kept is not log] == [0]
            assert [kept.size() for kept in logs] == [len(content) for content in contents]
    assert [m.message for m in ulog(contents[1]).logged_messages] == [f"second {n}" for n in range(12)]
