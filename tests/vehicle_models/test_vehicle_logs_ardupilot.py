"""ArduPilot's flight logs: recorded, listed, handed out, and read by pymavlink's DFReader."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from log_client import ACCEPTED, ARM, Download, dataflash, downloaded, listed
from vehicle_client import Client, Make, mavlink, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500


@pytest.fixture(scope="module")
def copter_logs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Client, dict[str, list[Any]]]]:
    """An ArduCopter after two short flights with a gap, and its only log."""
    client = Client(255)
    link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
    with client.socket, open_x500(VehiclePlan(simspec("ardupilot"), (link,))) as vehicle:
        client.vehicle = vehicle
        client.fly(1.0)
        client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        client.fly(1.0)
        assert listed(client)[0].num_logs == 0
        client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 50, 1))
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
        assert client.command(ARM, 1) == [ACCEPTED]
        assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3) == [ACCEPTED]
        client.fly(6.0)
        client.put(WPNAV_SPEED=700)
        client.fly(1.0)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 9)
        client.fly(20.0)
        assert not vehicle.condition().armed
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
        assert client.command(ARM, 1) == [ACCEPTED]
        client.fly(1.0)
        assert client.command(ARM, 0) == [ACCEPTED]
        (entry,) = listed(client)
        assert (entry.id, entry.num_logs, entry.last_log_num) == (1, 1, 1)
        content = downloaded(client, entry, lambda count: count % 41 == 0)
        yield client, dataflash(content, tmp_path_factory.mktemp("logs") / "1.BIN")


def test_a_dataflash_log_says_of_the_flight_what_telemetry_said(
    copter_logs: tuple[Client, dict[str, list[Any]]],
) -> None:
    client, log = copter_logs
    received = {(m.get_type(), m.time_boot_ms): m for m in client.received if hasattr(m, "time_boot_ms")}
    compared = dict.fromkeys(("ATT", "POS", "XKF1"), 0)
    for row in log["ATT"]:
        if m := received.get(("ATTITUDE", row.TimeUS // 1000)):
            compared["ATT"] += 1
            assert [row.Roll, row.Pitch] == pytest.approx(
                [math.degrees(m.roll), math.degrees(m.pitch)], abs=1e-3
            )
            assert math.remainder(row.Yaw - math.degrees(m.yaw), 360.0) == pytest.approx(0.0, abs=1e-3)
    for row in log["POS"]:
        if m := received.get(("GLOBAL_POSITION_INT", row.TimeUS // 1000)):
            compared["POS"] += 1
            assert (row.Lat, row.Lng) == pytest.approx((m.lat * 1e-7, m.lon * 1e-7), abs=1e-9)
            assert (row.Alt, row.RelHomeAlt) == pytest.approx((m.alt * 1e-3, m.relative_alt * 1e-3), abs=2e-3)
    for row in log["XKF1"]:
        if m := received.get(("LOCAL_POSITION_NED", row.TimeUS // 1000)):
            compared["XKF1"] += 1
            motion = (row.PN, row.PE, row.PD, row.VN, row.VE, row.VD)
            assert motion == pytest.approx((m.x, m.y, m.z, m.vx, m.vy, m.vz), abs=1e-4)
    assert min(compared.values()) > 100, compared
    fixes = {(m.lat, m.lon) for m in of("GPS_RAW_INT", client.received)}
    places = [(round(row.Lat * 1e7), round(row.Lng * 1e7)) for row in log["GPS"]]
    assert sum(place in fixes for place in places) > 0.9 * len(places) > 50
    # GPS time is UTC with 18 leap seconds more, counted from 1980.
    # The autopilot has booted 50 s before the session begins.
    start_s = simspec().environment.start_utc.timestamp() - 50.0
    for row in log["GPS"]:
        utc_s = 315_964_800 + row.GWk * 604_800 + row.GMS * 1e-3 - 18
        assert utc_s == pytest.approx(start_s + row.TimeUS * 1e-6, abs=0.002)
    assert all(10.0 < row.Volt < 13.0 for row in log["BAT"])
    assert log["BAT"][-1].CurrTot > log["BAT"][0].CurrTot


def test_a_dataflash_log_says_modes_events_texts_and_parameters(
    copter_logs: tuple[Client, dict[str, list[Any]]],
) -> None:
    _, log = copter_logs
    assert [row.ModeNum for row in log["MODE"]] == [4, 9, 4]
    events = [row.Id for row in log["EV"]]
    assert [event for event in events if event in (10, 11)] == [10, 11, 10, 11]
    assert (events.count(28), events.count(18)) == (1, 1)
    assert "ERR" not in log
    texts = [row.Message for row in log["MSG"]]
    assert texts[:3] == ["ArduCopter V4.6.3 (92b0cd78)", "0" * 32, "Frame: QUAD/PLUS"]
    assert [text for text in texts if "motors" in text] == ["Arming motors", "Disarming motors"] * 2
    names = [row.Name for row in log["PARM"]]
    assert len(set(names)) == 1397
    assert [row.Value for row in log["PARM"] if row.Name == "WPNAV_SPEED"][-1] == 700.0
    assert next(row for row in log["PARM"] if row.Name == "WPNAV_SPEED").Default != 700.0


def test_a_dataflash_log_describes_every_message_with_units(
    copter_logs: tuple[Client, dict[str, list[Any]]],
) -> None:
    """Each message has as many columns as types, units and multipliers, and the length that its types take."""
    _, log = copter_logs
    formats = {row.Type: row for row in log["FMT"]}
    assert set(log) - {"FMT"} <= {row.Name for row in formats.values()}
    units, factors = {chr(row.Id) for row in log["UNIT"]}, {chr(row.Id) for row in log["MULT"]}
    assert len(log["FMTU"]) == len(formats) - 1
    for row in log["FMTU"]:
        described = formats[row.FmtType]
        columns = described.Columns.split(",")
        assert len(columns) == len(described.Format) == len(row.UnitIds) == len(row.MultIds)
        assert set(row.UnitIds) <= units | {"-"}
        assert set(row.MultIds) <= factors | {"-"}


def test_an_armed_copter_hands_nothing_out_and_says_so_once(make: Make) -> None:
    client = make(simspec("ardupilot", vehicle={"parameters": {"LOG_FILE_DSRMROT": 1.0}}), system=255)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    for flight in (1, 2):
        assert client.command(ARM, 1) == [ACCEPTED]
        assert not listed(client)
        assert not listed(client)
        client.send(mavlink.MAVLink_log_erase_message(1, 1))
        client.fly(0.3)
        assert client.texts().count("Disarm for log download") == flight
        assert client.command(ARM, 0) == [ACCEPTED]
        client.fly(0.1)
        assert [e.id for e in listed(client)] == list(range(1, flight + 1))
    client.send(mavlink.MAVLink_log_erase_message(1, 1))
    assert [(e.id, e.num_logs, e.size) for e in listed(client)] == [(0, 0, 0)]


def test_a_copter_serves_one_link_at_a_time(two_links: Callable[..., tuple[Client, Client]]) -> None:
    first, second = two_links("ardupilot", vehicle={"parameters": {"LOG_DISARMED": 1.0}})
    # A copter sends texts to those alone that it has heard.
    for client in (first, second):
        client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    first.fly(1.0)
    (entry,) = listed(first)
    download = Download(first, 1, entry.size)
    download.request(0, entry.size)
    messages = first.fly(0.06)
    second.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 90))
    # The link that has the transfer may repeat itself without a word.
    download.request(0, 90)
    messages += first.fly(0.1)
    second._listen()
    assert second.texts().count("Log download in progress") == 1
    assert "Log download in progress" not in first.texts()
    download.take(messages + first.fly(1.0))
    assert len(download.content()) == entry.size
    second.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 90))
    first.fly(0.1)
    second._listen()
    assert second.last("LOG_DATA").count == 90
    first.send(mavlink.MAVLink_log_request_data_message(1, 1, 1, 90, 90))
    assert [m.ofs for m in of("LOG_DATA", first.fly(0.1))] == [90]


@pytest.mark.parametrize(("parameters", "logs"), [({"LOG_DISARMED": 1.0}, 1), ({"LOG_BACKEND_TYPE": 2.0}, 0)])
def test_parameters_say_what_a_copter_logs(make: Make, parameters: dict[str, float], logs: int) -> None:
    """Disarmed, just started."""
    client = make(simspec("ardupilot", vehicle={"parameters": {"LOG_DISARMED": 1.0, **parameters}}))
    assert listed(client)[0].num_logs == logs
