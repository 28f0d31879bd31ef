"""Companion computers on serial devices, through pseudo terminals: two of them, losses, resets, wrong names."""

from __future__ import annotations

import fcntl
import os
import termios
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from serial_cable import Cable
from vehicle_client import mavlink, of, simspec

from bench.contracts import LinkSpec, Vehicle, VehiclePlan
from bench.errors import SetupError
from vehicle_models import open_x500
from vehicle_models.controller import open_links
from vehicle_models.controller.links._serial import SequenceReader, SerialDevice


@pytest.fixture
def cables(tmp_path: Path) -> Iterator[list[Cable]]:
    with ExitStack() as stack:
        yield [stack.enter_context(closing(Cable(tmp_path / name))) for name in ("ttyUSB0", "ttyACM0")]


class Companion:
    """A MAVLink client at the far end of a cable."""

    def __init__(self, cable: Cable, system: int) -> None:
        self.cable = cable
        self.mav: Any = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.robust_parsing = True
        self.raw = b""

    def packed(self, message: Any) -> bytes:
        data = bytes(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def ask(self, name: bytes) -> None:
        self.cable.write(self.packed(mavlink.MAVLink_param_request_read_message(1, 1, name, -1)))

    def messages(self) -> list[Any]:
        data = self.cable.read()
        self.raw += data
        return self.mav.parse_buffer(data) or []

    def parameters(self) -> list[str]:
        return [message.param_id for message in of("PARAM_VALUE", self.messages())]


def links(*cables: Cable, baud: int = 921600) -> tuple[LinkSpec, ...]:
    return tuple(LinkSpec(cable.path.name, "serial", path=str(cable.path), baud=baud) for cable in cables)


def fly(vehicle: Vehicle, steps: int) -> None:
    for _ in range(steps):
        vehicle.receive()
        vehicle.step()


def test_two_companions_on_two_devices_are_answered_each_on_its_own(cables: list[Cable]) -> None:
    first, second = Companion(cables[0], 245), Companion(cables[1], 246)
    with open_x500(VehiclePlan(simspec(), links(*cables))) as vehicle:
        assert vehicle.endpoints() == {cable.path.name: f"{cable.path}:921600" for cable in cables}
        first.ask(b"COM_OF_LOSS_T")
        second.ask(b"MPC_XY_VEL_MAX")
        fly(vehicle, 20)
        assert (first.parameters(), second.parameters()) == (["COM_OF_LOSS_T"], ["MPC_XY_VEL_MAX"])
        assert vehicle.receive() == {"ttyUSB0": 1, "ttyACM0": 1}
        counters = vehicle.counters()
    assert counters["serial_lost_bytes"] == counters["serial_lost_messages"] == 0
    assert counters["serial_resets"] == 0
    assert first.mav.total_receive_errors == 0


def test_bytes_that_are_lost_on_the_way_are_counted_and_the_rest_is_heard(cables: list[Cable]) -> None:
    """Of 40 messages each tenth loses a byte, as on a line with a bad contact."""
    companion = Companion(cables[0], 245)
    beats = [companion.packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)) for _ in range(40)]
    with open_x500(VehiclePlan(simspec(), links(*cables))) as vehicle:
        fly(vehicle, 1)
        cables[0].write(b"".join(beat[:-1] if index % 10 == 5 else beat for index, beat in enumerate(beats)))
        fly(vehicle, 20)
        assert vehicle.receive() == {"ttyUSB0": 36, "ttyACM0": 0}
        counters = vehicle.counters()
    assert counters["serial_lost_messages"] == 4
    assert counters["mavlink_garbage_bytes"] == 4 * (len(beats[0]) - 1)


def test_a_companion_that_does_not_read_loses_whole_messages(cables: list[Cable]) -> None:
    """Also on a slow line: what is read later are whole messages, and what is not there was counted."""
    companion = Companion(cables[0], 245)
    with open_x500(VehiclePlan(simspec(), links(cables[0], baud=57600))) as vehicle:
        fly(vehicle, 100)
        # The first bytes are the oldest: what came later found no room.
        times = [message.time_boot_ms for message in of("ATTITUDE", companion.messages())]
        assert 0 < times[-1] < 1900
        fly(vehicle, 5)
        companion.messages()
        assert companion.mav.total_receive_errors == 0
        counters = vehicle.counters()
    assert counters["serial_lost_bytes"] > 1000
    assert counters["mavlink_dropped"] > 20


def test_a_device_that_vanishes_is_taken_again_when_it_is_back(cables: list[Cable]) -> None:
    """Twice, while its neighbour stays; the vehicle flies on, and what is sent meanwhile is lost."""
    first, second = Companion(cables[0], 245), Companion(cables[1], 246)
    with open_x500(VehiclePlan(simspec(), links(*cables))) as vehicle:
        for _ in range(2):
            fly(vehicle, 5)
            # Half a message, whose other half will never come.
            cables[0].write(first.packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))[:9])
            fly(vehicle, 1)
            cables[0].unplug()
            second.ask(b"MPC_XY_VEL_MAX")
            fly(vehicle, 10)
            assert second.parameters() == ["MPC_XY_VEL_MAX"]
            cables[0].plug()
            first.mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
            first.mav.robust_parsing = True
            fly(vehicle, 5)
            first.ask(b"COM_OF_LOSS_T")
            fly(vehicle, 20)
            assert first.parameters() == ["COM_OF_LOSS_T"]
        counters = vehicle.counters()
    assert counters["serial_resets"] == 2
    assert counters["serial_lost_messages"] == 0
    assert counters["serial_lost_bytes"] > 100


def test_wrong_devices_are_told_with_the_fix(cables: list[Cable], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no device")
    faults = {
        (str(tmp_path / "ttyUSB7"), 115200): "there is no device",
        (str(tmp_path / "file"), 115200): "is no serial device",
        ("/dev/null", 115200): "is no serial device",
        (str(cables[0].path), 123): r"123 baud is no speed of this system \(give 57600, 115200",
    }
    for (path, baud), words in faults.items():
        with (
            pytest.raises(SetupError, match=f"link telem: .*{words}"),
            open_links((LinkSpec("telem", "serial", path=path, baud=baud),)),
        ):
            pass
    with (
        open_links(links(cables[1])),
        pytest.raises(SetupError, match=r"ttyACM0 is in use by another program \(end"),
        open_links(links(cables[1])),
    ):
        pass


def test_a_device_is_raw_at_its_speed_without_flow_control(cables: list[Cable]) -> None:
    device = SerialDevice(str(cables[0].path), 57600, "link")
    terminal = os.open(cables[0].path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    iflag, oflag, cflag, lflag, ispeed, ospeed, _ = termios.tcgetattr(terminal)
    assert ispeed == ospeed == termios.B57600
    assert not cflag & (termios.CRTSCTS | termios.PARENB | termios.CSTOPB)
    assert (iflag & (termios.IXON | termios.ICRNL), oflag & termios.OPOST, lflag & termios.ECHO) == (0, 0, 0)
    with pytest.raises(BlockingIOError):
        fcntl.flock(terminal, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(terminal)
    device.close()


def test_gaps_in_sequence_numbers_are_lost_messages() -> None:
    """Of two senders at once, across the wrap at 256, in both versions of MAVLink."""
    reader, lost = SequenceReader(), 0
    senders: list[Any] = [mavlink.MAVLink(None, srcSystem=system, srcComponent=1) for system in (1, 2)]
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    for index in range(600):
        for version, mav in enumerate(senders, start=1):
            frame = bytes(beat.pack(mav, force_mavlink1=version == 1))
            mav.seq = (mav.seq + 1) % 256
            if index % (7 + version) == 0 and index not in (0, 599):
                lost += 1
            else:
                assert reader.feed(frame) == [frame]
    assert reader.lost_messages == lost > 100
