"""Flight logs: recorded, listed, handed out, read by pyulog and by pymavlink's DFReader."""

from __future__ import annotations

import io
import math
import random
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pymavlink.DFReader import DFReader_binary
from pyulog.core import ULog
from vehicle_client import NAN, Client, mavlink, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_x500
from vehicle_models.controller import PX4
from vehicle_models.controller._flight_state import ReferencePoint
from vehicle_models.controller.files._ftp import FtpOpcode
from vehicle_models.controller.logs._records import SAMPLE, FlightSample, LoggedText, LogOpening
from vehicle_models.controller.logs._storage import FlightLog, LogStorage
from vehicle_models.controller.logs._streaming import DATA_BYTES, NO_MESSAGE_STARTS
from vehicle_models.controller.parameters._store import Parameter

Make = Callable[..., Client]
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ACCEPTED, TEMPORARILY_REJECTED, UNSUPPORTED = 0, 1, 3
_FORCE = 21196
_FTP_HEAD = struct.Struct("<HBBBBBBI")


def listed(client: Client, start: int = 0, end: int = 0xFFFF) -> list[Any]:
    client.send(mavlink.MAVLink_log_request_list_message(1, 1, start, end))
    return [m for m in client.fly(0.1) if m.get_type() == "LOG_ENTRY"]


@dataclass
class Download:
    """What a client of one log has; it drops every message that `lost` picks, and asks for the gaps again."""

    client: Client
    number: int
    size: int
    lost: Callable[[int], bool] = lambda count: False
    parts: dict[int, bytes] = field(default_factory=dict)
    received: int = 0

    def request(self, offset: int, count: int) -> None:
        self.client.send(mavlink.MAVLink_log_request_data_message(1, 1, self.number, offset, count))

    def take(self, messages: list[Any]) -> None:
        for m in messages:
            if m.get_type() == "LOG_DATA" and m.id == self.number:
                self.received += 1
                if not self.lost(self.received):
                    self.parts[m.ofs] = bytes(m.data[: m.count])

    def first_gap(self) -> tuple[int, int]:
        """Where the first gap begins and ends."""
        begin = 0
        while self.parts.get(begin):
            begin += len(self.parts[begin])
        return begin, min((place for place in self.parts if place > begin), default=self.size)

    def content(self) -> bytes:
        return b"".join(part for _, part in sorted(self.parts.items()))


def downloaded(
    client: Client, entry: Any, lost: Callable[[int], bool] = lambda count: False, limit: int = 200
) -> bytes:
    """A whole log, asked for again gap by gap until there is none."""
    transfer = Download(client, entry.id, entry.size, lost)
    transfer.request(0, 0xFFFFFFFF)
    transfer.take(client.fly(entry.size / 90 / 40 * 0.02 + 0.04))
    for _ in range(limit):
        begin, end = transfer.first_gap()
        if begin >= entry.size:
            break
        transfer.request(begin, end - begin)
        transfer.take(client.fly((end - begin) / 90 / 40 * 0.02 + 0.04))
    assert len(transfer.content()) == entry.size
    return transfer.content()


def ulog(content: bytes) -> ULog:
    return ULog(io.BytesIO(content))


def dataflash(content: bytes, path: Path) -> dict[str, list[Any]]:
    """Messages by name."""
    path.write_bytes(content)
    reader = DFReader_binary(str(path))
    messages: dict[str, list[Any]] = {}
    while (message := reader.recv_msg()) is not None:
        messages.setdefault(message.get_type(), []).append(message)
    assert "BAD_DATA" not in messages
    reader.data_map.close()
    reader.filehandle.close()
    return messages


@dataclass
class FlownLogs:
    """A PX4 that has flown, then stood armed once more; its two logs as a client received them."""

    client: Client
    entries: list[Any]
    contents: list[bytes]


def fly_twice(client: Client) -> None:
    client.fly(4.0)
    assert client.command(ARM, 1) == [ACCEPTED]
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, NAN) == [ACCEPTED]
    client.fly(7.0)
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"MPC_XY_CRUISE", 3.5, 9))
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"NAV_ACC_RAD", 4.25, 9))
    client.fly(1.0)
    assert client.command(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN) == [ACCEPTED]
    client.fly(9.0)
    assert not client.vehicle.condition().armed
    assert client.command(ARM, 1) == [ACCEPTED]
    client.fly(2.0)
    assert client.command(ARM, 0) == [ACCEPTED]
    client.fly(1.0)


@pytest.fixture(scope="module")
def px4_logs() -> Iterator[FlownLogs]:
    client = Client()
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
    raw = {(m.lat, m.lon, m.alt) for m in px4_logs.client.received if m.get_type() == "GPS_RAW_INT"}
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
    assert [m.id for m in messages if m.get_type() == "LOG_DATA"] == [1]
    for number in (2, 60_000):
        Download(client, number, 0).request(0, 90)
    client.send(mavlink.MAVLink_log_request_end_message(1, 1))
    piece.request(0, 90)
    assert not [m for m in client.fly(0.1) if m.get_type() == "LOG_DATA"]
    assert [e.id for e in listed(client, 1, 1)] == [1]


def test_the_log_folder_has_the_same_files(px4_logs: FlownLogs) -> None:
    """By MAVLink FTP, from the root and as on a board's memory card."""
    client = px4_logs.client
    sequence = 0

    def ask(opcode: int, data: bytes = b"", offset: int = 0) -> tuple[int, bytes]:
        nonlocal sequence
        sequence += 2
        payload = _FTP_HEAD.pack(sequence & 0xFFFF, 0, opcode, len(data), 0, 0, 0, offset) + data
        client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload.ljust(251, b"\0")))
        (answer,) = [m for m in client.fly(0.04) if m.get_type() == "FILE_TRANSFER_PROTOCOL"]
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
                client.send(mavlink.MAVLink_param_set_message(1, 1, b"NAV_ACC_RAD", 4.25, 9))
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


@pytest.fixture
def two_links() -> Iterator[Callable[..., tuple[Client, Client]]]:
    """Two clients of one vehicle, each on a link of its own. The second only listens while the first flies."""
    with ExitStack() as stack:

        def build(autopilot: str, **changes: Any) -> tuple[Client, Client]:
            first, second = Client(), Client(244)
            links = []
            for number, client in enumerate((first, second)):
                stack.callback(client.socket.close)
                links.append(LinkSpec(f"link{number}", "udp_out", port=client.port, streams="none"))
            first.vehicle = second.vehicle = stack.enter_context(
                open_x500(VehiclePlan(simspec(autopilot, **changes), tuple(links)))
            )
            first.fly(1.1)
            second._listen()
            return first, second

        yield build


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
        client.fly(42.0)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
        assert client.command(ARM, 1) == [ACCEPTED]
        assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3) == [ACCEPTED]
        client.fly(6.0)
        client.send(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 700, 9))
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
    fixes = {(m.lat, m.lon) for m in client.received if m.get_type() == "GPS_RAW_INT"}
    places = [(round(row.Lat * 1e7), round(row.Lng * 1e7)) for row in log["GPS"]]
    assert sum(place in fixes for place in places) > 0.9 * len(places) > 50
    # GPS time is UTC with 18 leap seconds more, counted from 1980.
    start_s = simspec().environment.start_utc.timestamp()
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
    client.fly(43.0)
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
    assert [m.ofs for m in first.fly(0.1) if m.get_type() == "LOG_DATA"] == [90]


@pytest.mark.parametrize(("parameters", "logs"), [({"LOG_DISARMED": 1.0}, 1), ({"LOG_BACKEND_TYPE": 2.0}, 0)])
def test_parameters_say_what_a_copter_logs(make: Make, parameters: dict[str, float], logs: int) -> None:
    """Disarmed, just started."""
    client = make(simspec("ardupilot", vehicle={"parameters": {"LOG_DISARMED": 1.0, **parameters}}))
    assert listed(client)[0].num_logs == logs


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
