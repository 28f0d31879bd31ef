"""PX4's flight logs: recorded, listed, handed out, streamed, and read by pyulog."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from log_client import (
    ACCEPTED,
    ARM,
    FTP_HEAD,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Download,
    FlownLogs,
    downloaded,
    fly_twice,
    listed,
    ulog,
)
from pyulog.core import ULog
from vehicle_client import Client, Make, mavlink, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500
from vehicle_models.controller.files._ftp import FtpOpcode
from vehicle_models.controller.logs._streaming import DATA_BYTES, NO_MESSAGE_STARTS


@pytest.fixture(scope="module")
def px4_logs() -> Iterator[FlownLogs]:
    client = Client()
    client.is_station = True
    link = LinkSpec("onboard", "udp_out", port=client.port, streams="onboard")
    plan = VehiclePlan(simspec(vehicle={"parameters": {"RTL_RETURN_ALT": 22.0}}), (link,))
    with client.socket, open_x500(plan) as vehicle:
        client.vehicle = vehicle
        client.fly(1.0)
        fly_twice(client)
        entries = listed(client)
        yield FlownLogs(client, entries, [downloaded(client, entry) for entry in entries])


def topic(log: ULog, name: str) -> dict[str, Any]:
    data: dict[str, Any] = log.get_dataset(name).data
    return data


def test_each_flight_has_a_log_with_the_time_of_its_end(px4_logs: FlownLogs) -> None:
    first, second = px4_logs.entries
    assert [(e.id, e.num_logs, e.last_log_num) for e in px4_logs.entries] == [(0, 2, 1), (1, 2, 1)]
    start_s = simspec().environment.start_utc.timestamp()
    ends_s = [ulog(content).last_timestamp * 1e-6 for content in px4_logs.contents]
    assert [e.time_utc for e in (first, second)] == [int(start_s + end_s) for end_s in ends_s]
    assert ulog(px4_logs.contents[0]).start_timestamp < 100_000, "SDLOG_MODE 1: from the start on"
    assert ulog(px4_logs.contents[1]).start_timestamp > ends_s[0] * 1e6


def test_a_log_says_of_the_flight_what_telemetry_said(px4_logs: FlownLogs) -> None:
    """At the same moments: position, velocity, attitude, degrees, fixes, battery."""
    log = ulog(px4_logs.contents[0])
    received: dict[tuple[str, int], Any] = {
        (m.get_type(), m.time_boot_ms): m for m in px4_logs.client.received if hasattr(m, "time_boot_ms")
    }

    def pairs(name: str, message: str) -> list[tuple[Any, dict[str, Any]]]:
        data = topic(log, name)
        rows = [{key: values[row] for key, values in data.items()} for row in range(len(data["timestamp"]))]
        matches = [(received.get((message, int(row["timestamp"]) // 1000)), row) for row in rows]
        return [(message, row) for message, row in matches if message]

    positions = pairs("vehicle_local_position", "LOCAL_POSITION_NED")
    assert len(positions) > 60
    for m, row in positions:
        assert [row[n] for n in ("x", "y", "z", "vx", "vy", "vz")] == pytest.approx(
            [m.x, m.y, m.z, m.vx, m.vy, m.vz], abs=1e-5
        )
    assert min(row["z"] for _, row in positions) < -2.0
    degrees = pairs("vehicle_global_position", "GLOBAL_POSITION_INT")
    assert len(degrees) > 60
    for m, row in degrees:
        assert (row["lat"], row["lon"]) == pytest.approx((m.lat * 1e-7, m.lon * 1e-7), abs=1e-9)
        assert row["alt"] == pytest.approx(m.alt * 1e-3, abs=1e-3)
    attitudes = pairs("vehicle_attitude", "ATTITUDE_QUATERNION")
    assert len(attitudes) > 60
    for m, row in attitudes:
        assert [row[f"q[{n}]"] for n in range(4)] == pytest.approx([m.q1, m.q2, m.q3, m.q4], abs=1e-6)
    fixes = topic(log, "vehicle_gps_position")
    raw = {(m.lat, m.lon, m.alt) for m in of("GPS_RAW_INT", px4_logs.client.received)}
    places = zip(fixes["latitude_deg"], fixes["longitude_deg"], fixes["altitude_msl_m"], strict=True)
    assert {(round(a * 1e7), round(o * 1e7), round(h * 1e3)) for a, o, h in list(places)[8:-8]} <= raw
    assert list(topic(log, "sensor_gps")["eph"]) == list(fixes["eph"])
    battery = topic(log, "battery_status")
    assert all(14.0 < volts < 17.0 for volts in battery["voltage_v"])
    assert battery["discharged_mah"][-1] > battery["discharged_mah"][0]


def test_a_log_says_modes_texts_parameters_and_the_autopilot(px4_logs: FlownLogs) -> None:
    log = ulog(px4_logs.contents[0])
    status = topic(log, "vehicle_status")
    states = [int(s) for s in status["nav_state"]]
    changes = [state for state, previous in zip(states, [None, *states], strict=False) if state != previous]
    assert changes[:3] == [4, 17, 4], "hold, takeoff, hold"
    assert 18 in changes, "land"
    assert (status["arming_state"][0], max(status["arming_state"]), status["arming_state"][-1]) == (1, 2, 1)
    landed = topic(log, "vehicle_land_detected")["landed"]
    assert (landed[0], min(landed), landed[-1]) == (1, 0, 1)
    texts = [m.message for m in log.logged_messages]
    sent = [text.rstrip("\t") for text in px4_logs.client.texts()]
    assert texts == sent[: len(texts)]
    assert {"Armed by external command", "Takeoff detected", "Disarmed by landing"} <= set(texts)
    assert {m.log_level_str() for m in log.logged_messages} == {"INFO"}
    assert len(log.initial_parameters) == 888
    assert log.initial_parameters["RTL_RETURN_ALT"] == 22.0
    assert log.get_default_parameters(0)["RTL_RETURN_ALT"] == 30.0
    assert [(name, value) for _, name, value in log.changed_parameters] == [
        ("MPC_XY_CRUISE", 3.5),
        ("NAV_ACC_RAD", 4.25),
    ]
    later = ulog(px4_logs.contents[1])
    assert later.initial_parameters["NAV_ACC_RAD"] == 4.25
    assert later.logged_messages[0].message == "Armed by external command"
    assert (log.msg_info_dict["sys_name"], log.get_version_info_str()) == ("PX4", "v1.17.0 (beta)")
    home = topic(log, "home_position")
    assert home["lat"][-1] * 1e7 == pytest.approx(px4_logs.client.last("HOME_POSITION").latitude, abs=0.6)


def test_pyulog_writes_a_log_that_says_the_same(px4_logs: FlownLogs, tmp_path: Path) -> None:
    """What is read is all there is: its own writer gives an equal log back."""
    for content in px4_logs.contents:
        log = ulog(content)
        assert not log.file_corruption
        assert not log.dropouts
        log.write_ulog(str(tmp_path / "copy.ulg"))
        assert ULog(str(tmp_path / "copy.ulg")) == log


def test_what_is_lost_on_the_way_is_asked_for_again(px4_logs: FlownLogs) -> None:
    draw = random.Random(4)
    for entry, content in zip(px4_logs.entries, px4_logs.contents, strict=True):
        assert downloaded(px4_logs.client, entry, lambda count: draw.random() < 0.01) == content


def test_pieces_are_the_ones_that_were_asked_for(px4_logs: FlownLogs) -> None:
    """An offset and a count; nothing beyond the end; another log instead of the first; nothing after an end without
    a list.
    """
    client, (first, second) = px4_logs.client, px4_logs.contents
    piece = Download(client, 0, 0)
    piece.request(1000, 200)
    piece.take(client.fly(0.1))
    assert sorted(piece.parts) == [1000, 1090, 1180]
    assert piece.content() == first[1000:1200]
    end = Download(client, 0, 0)
    end.request(len(first) - 5, 200)
    end.take(client.fly(0.1))
    assert end.content() == first[-5:]
    beyond = Download(client, 0, 0)
    beyond.request(len(first) + 90, 90)
    beyond.take(client.fly(0.1))
    assert beyond.parts == {len(first) + 90: b""}
    other = Download(client, 1, 0)
    piece.request(0, 0xFFFFFFFF)
    client.fly(0.02)
    other.request(0, 90)
    messages = client.fly(0.1)
    other.take(messages)
    assert other.content() == second[:90]
    assert [m.id for m in of("LOG_DATA", messages)] == [1]
    for number in (2, 60_000):
        Download(client, number, 0).request(0, 90)
    client.send(mavlink.MAVLink_log_request_end_message(1, 1))
    piece.request(0, 90)
    assert not of("LOG_DATA", client.fly(0.1))
    assert [e.id for e in listed(client, 1, 1)] == [1]


def test_the_log_folder_has_the_same_files(px4_logs: FlownLogs) -> None:
    """By MAVLink FTP, from the root and as on a board's memory card."""
    client = px4_logs.client
    sequence = 0

    def ask(opcode: int, data: bytes = b"", offset: int = 0) -> tuple[int, bytes]:
        nonlocal sequence
        sequence += 2
        payload = FTP_HEAD.pack(sequence & 0xFFFF, 0, opcode, len(data), 0, 0, 0, offset) + data
        client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload.ljust(251, b"\0")))
        (answer,) = of("FILE_TRANSFER_PROTOCOL", client.fly(0.04))
        raw = bytes(answer.payload)
        return raw[3], raw[12 : 12 + raw[4]]

    start = simspec().environment.start_utc
    for root in (b"log", b"/fs/microsd/log"):
        _, folders = ask(FtpOpcode.LIST, root)
        assert folders == f"D{start:%Y-%m-%d}\0".encode()
        folder = root + b"/" + folders[1:-1]
        _, files = ask(FtpOpcode.LIST, folder)
        names = [entry[1:].split(b"\t") for entry in files.split(b"\0")[:-1]]
        assert [int(size) for _, size in names] == [len(content) for content in px4_logs.contents]
        assert names[0][0] == f"{start:%H_%M_%S}.ulg".encode()
        for (name, _), content in zip(names, px4_logs.contents, strict=True):
            assert ask(FtpOpcode.OPEN, folder + b"/" + name)[0] == FtpOpcode.ACK
            assert ask(FtpOpcode.READ, offset=500)[1] == content[500:739]
            assert ask(FtpOpcode.TERMINATE)[0] == FtpOpcode.ACK
    assert ask(FtpOpcode.REMOVE, folder + b"/" + names[0][0])[0] == FtpOpcode.NAK


def test_a_log_does_not_depend_on_who_read_it_when(make: Make) -> None:
    """Two vehicles flown alike: one is asked ten times on its way, the other in the end."""
    contents = []
    for asks in (True, False):
        client = make()
        client.fly(4.0)
        assert client.command(ARM, 1) == [ACCEPTED]
        for count in range(10):
            if asks:
                client.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
            if count == 5:
                client.put(NAV_ACC_RAD=4.25)
            client.fly(0.14)
        assert client.command(ARM, 0) == [ACCEPTED]
        contents.append(downloaded(client, listed(client)[0]))
    assert contents[0] == contents[1]


@pytest.mark.parametrize(
    ("parameters", "before", "between", "logs"),
    [
        ({}, 1, 1, 2),
        ({"SDLOG_MODE": 0.0}, 0, 1, 2),
        ({"SDLOG_MODE": -1.0}, 0, 1, 2),
        ({"SDLOG_MODE": 2.0}, 1, 1, 1),
        ({"SDLOG_BACKEND": 2.0}, 0, 0, 0),
    ],
)
def test_parameters_say_what_px4_logs(
    make: Make, parameters: dict[str, float], before: int, between: int, logs: int
) -> None:
    client = make(simspec(vehicle={"parameters": parameters}))
    client.fly(3.5)
    assert listed(client)[0].num_logs == before
    for count in (between, logs):
        assert client.command(ARM, 1) == [ACCEPTED]
        client.fly(0.3)
        assert client.command(ARM, 0) == [ACCEPTED]
        client.fly(0.3)
        assert listed(client)[0].num_logs == count
    entries = listed(client)
    assert len(entries) == max(logs, 1)
    if not logs:
        assert (entries[0].id, entries[0].size, entries[0].time_utc) == (0, 0, 0)


def test_erased_logs_are_gone_and_the_next_flight_has_one(make: Make) -> None:
    client = make()
    client.fly(4.0)
    assert client.command(ARM, 1) == [ACCEPTED]
    client.fly(0.3)
    client.send(mavlink.MAVLink_log_erase_message(1, 1))
    assert listed(client)[0].num_logs == 0
    client.fly(0.5)
    assert client.command(ARM, 0) == [ACCEPTED]
    assert listed(client)[0].num_logs == 0
    assert client.command(ARM, 1) == [ACCEPTED]
    client.fly(0.5)
    assert listed(client)[0].num_logs == 1


def test_logs_outlive_a_restart(make: Make) -> None:
    client = make()
    client.fly(4.0)
    assert client.command(ARM, 1) == [ACCEPTED]
    client.fly(0.5)
    assert client.command(ARM, 0) == [ACCEPTED]
    (entry,) = listed(client)
    content = downloaded(client, entry)
    assert client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == [ACCEPTED]
    client.fly(1.0)
    first, second = listed(client)
    assert (first.id, first.size, second.id) == (0, entry.size, 1)
    assert downloaded(client, first) == content
    assert second.time_utc > first.time_utc
    assert ulog(downloaded(client, second)).start_timestamp < 100_000


def test_two_clients_of_px4_receive_different_logs_at_once(
    two_links: Callable[..., tuple[Client, Client]],
) -> None:
    first, second = two_links("px4")
    fly_twice(first)
    entries = listed(first)
    second.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    first.fly(0.1)
    downloads = Download(first, 0, entries[0].size), Download(second, 1, entries[1].size)
    for download in downloads:
        download.request(0, 0xFFFFFFFF)
    downloads[0].take(first.fly(4.0))
    second._listen()
    downloads[1].take(second.received)
    for download in downloads:
        assert len(download.content()) == download.size
        assert ulog(download.content()).initial_parameters["MPC_XY_CRUISE"]


def streamed(client: Client, seconds: float, acknowledges: Callable[[int], bool]) -> list[Any]:
    """Packets of a stream in order, each once; the client acknowledges what it is told to."""
    packets: dict[int, Any] = {}
    attempts = 0
    for _ in range(round(seconds / 0.02)):
        for m in client.fly(0.02):
            if m.get_type() not in ("LOGGING_DATA", "LOGGING_DATA_ACKED"):
                continue
            packets[m.sequence] = m
            if m.get_type() == "LOGGING_DATA_ACKED":
                attempts += 1
                if acknowledges(attempts):
                    client.send(mavlink.MAVLink_logging_ack_message(1, 1, m.sequence))
    assert sorted(packets) == list(range(len(packets)))
    return [m for _, m in sorted(packets.items())]


def test_a_log_is_streamed_from_an_acknowledged_head_on(make: Make) -> None:
    """Every third acknowledgement is lost; the head is repeated until it is there. A second stream is refused, and one
    that nobody acknowledges ends by itself.
    """
    client = make()
    client.fly(4.0)
    assert client.command(mavlink.MAV_CMD_LOGGING_START, 1) == [UNSUPPORTED]
    assert client.command(mavlink.MAV_CMD_LOGGING_START) == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_LOGGING_START) == [TEMPORARILY_REJECTED]
    packets = streamed(client, 14.0, lambda attempt: attempt % 3 != 0)
    assert client.command(mavlink.MAV_CMD_LOGGING_STOP) == [ACCEPTED]
    assert packets[-1].get_type() == "LOGGING_DATA"
    content = b"".join(bytes(m.data[: m.length]) for m in packets)
    log = ulog(content)
    assert len(log.initial_parameters) == 888
    times_s = topic(log, "vehicle_local_position")["timestamp"] * 1e-6
    assert max(abs(step - 0.1) for step in times_s[1:] - times_s[:-1]) < 1e-6
    assert times_s[-1] - times_s[0] > 13.0
    # Where the first message of a packet begins, a reader that lost the packet before can go on.
    for count, m in enumerate(packets[1:], start=1):
        if m.first_message_offset != NO_MESSAGE_STARTS:
            before = b"".join(bytes(p.data[: p.length]) for p in packets[:count])
            assert content[len(before) + m.first_message_offset + 2] in b"IFPQADL"
    assert any(m.first_message_offset == NO_MESSAGE_STARTS or m.length < DATA_BYTES for m in packets)
    assert client.command(mavlink.MAV_CMD_LOGGING_START) == [ACCEPTED]
    assert len(streamed(client, 5.0, lambda attempt: False)) == 1
    assert client.command(mavlink.MAV_CMD_LOGGING_START) == [ACCEPTED]
