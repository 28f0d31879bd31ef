"""The two physics links, field by field, against pymavlink and a JSON reader: order, units, masks, resends, silence."""

from __future__ import annotations

import json
import math
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from typing import Any

import pymap3d
import pytest
from pymavlink.dialects.v20 import common

from bench.errors import FirmwareFault
from vehicle_models.firmware._ardupilot_link import ArduPilotLink, ArduPilotMetres, encoded_state, rotor_share
from vehicle_models.firmware._hil import HilEncoder, Place
from vehicle_models.firmware._px4_link import Px4Link
from vehicle_models.firmware._sensors import AirReading

IMU = (0.1, -0.2, -9.81, 0.01, -0.02, 0.03)
PLACE = Place(473977420, 85455940, 489.4, (3.0, -4.0, 0.5))


def decoded(data: bytes) -> list[Any]:
    parser: Any = common.MAVLink(None)
    return list(parser.parse_buffer(bytearray(data)))


def alive() -> None:
    """The program lives."""


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


def test_a_sample_has_the_units_and_masks_that_px4_takes() -> None:
    encoder = HilEncoder()
    data = encoder.gps(4000, PLACE)
    data += encoder.state(4000, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), PLACE, 5.0, (0.0, 0.0, -9.80665))
    data += encoder.sensor(4000, IMU, (0.21, 0.01, 0.43), AirReading(955.8, 489.2, 11.8))
    data += encoder.sensor(8000, IMU)
    gps, state, full, bare = decoded(data)

    assert (gps.get_type(), gps.time_usec) == ("HIL_GPS", 4000)
    assert (gps.lat, gps.lon, gps.alt) == (473977420, 85455940, 489400)
    assert (gps.eph, gps.epv, gps.fix_type, gps.satellites_visible, gps.id) == (90, 120, 3, 14, 0)
    assert (gps.vel, gps.vn, gps.ve, gps.vd) == (500, 300, -400, 50)
    assert gps.cog == pytest.approx(math.degrees(math.atan2(-4, 3)) % 360 * 100, abs=1)
    assert (state.lat, state.lon, state.alt) == (473977420, 85455940, 489400)
    assert (state.vx, state.vy, state.vz) == (300, -400, 50)
    assert (state.xacc, state.yacc, state.zacc, state.true_airspeed) == (0, 0, -1000, 500)
    assert state.attitude_quaternion == [1.0, 0.0, 0.0, 0.0]
    assert full.fields_updated == 0x1FFF & ~0x400
    assert bare.fields_updated == 0x3F
    assert (full.time_usec, full.id, full.diff_pressure) == (4000, 0, 0.0)
    assert (full.xacc, full.yacc, full.zacc, full.xgyro, full.ygyro, full.zgyro) == pytest.approx(IMU)
    assert (full.xmag, full.ymag, full.zmag) == pytest.approx((0.21, 0.01, 0.43))
    assert (full.abs_pressure, full.pressure_alt, full.temperature) == pytest.approx((955.8, 489.2, 11.8))
    assert [message.get_seq() for message in (gps, state, full, bare)] == [0, 1, 2, 3]


def test_what_16_bits_do_not_hold_is_cut() -> None:
    """An impact has more than the 32.7 g of HIL_STATE_QUATERNION; speeds of both messages have 16 bits too."""
    encoder = HilEncoder()
    for sign in (1.0, -1.0):
        fast = Place(0, 0, 488.0, (sign * 400.0, sign * -400.0, sign * 328.0))
        force = (sign * 330.0, sign * -330.0, sign * 320.0)
        data = encoder.gps(4000, fast)
        data += encoder.state(4000, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), fast, 700.0, force)
        gps, state = decoded(data)
        most = {1.0: 32767, -1.0: -32768}
        assert (gps.vel, gps.vn, gps.ve, gps.vd) == (56569, most[sign], most[-sign], most[sign])
        assert (state.vx, state.vy, state.vz) == (most[sign], most[-sign], most[sign])
        assert (state.xacc, state.yacc) == (most[sign], most[-sign])
        assert state.zacc == round(sign * 320.0 / 9.80665 * 1000.0)
        assert (state.ind_airspeed, state.true_airspeed) == (65535, 65535)


class Px4:
    """The other end of the simulator link, in the test's own thread: what it says lies ready before it is read."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.mav: Any = common.MAVLink(None, srcSystem=1, srcComponent=1)

    def send(self, message: Any) -> None:
        self.socket.sendall(message.pack(self.mav))

    def answer(self, time_us: int, *outputs: float, armed: bool = True) -> None:
        controls = [*outputs, *[0.0] * (16 - len(outputs))]
        self.send(common.MAVLink_hil_actuator_controls_message(time_us, controls, 128 if armed else 0, 1))


def connected(
    stack: ExitStack, answer_s: float = 30.0, is_asleep: Callable[[], bool] | None = None
) -> tuple[Px4Link, Px4]:
    link = stack.enter_context(closing(Px4Link(0, check_alive=alive, answer_s=answer_s)))
    px4 = Px4(link.port)
    stack.enter_context(px4.socket)
    link.connect(is_asleep)
    return link, px4


def test_a_px4_that_sleeps_without_an_answer_lets_the_simulation_go_on(stack: ExitStack) -> None:
    """Whatever it is asked while it works is waited for, an answer between the last two looks too."""
    looks: list[Callable[[], bool]] = []
    link, px4 = connected(stack, is_asleep=lambda: looks.pop(0)())

    def answers(time_us: int, asleep: bool) -> bool:
        px4.answer(time_us, 0.5)
        return asleep

    px4.answer(4000)
    assert link.exchange(4000, b"") is not None
    looks += [lambda: False, lambda: False, lambda: True]
    assert (link.exchange(8000, b""), link.silent) == (None, 1)
    looks += [lambda: True]
    assert (link.exchange(12000, b""), link.silent) == (None, 2)
    for time_us, asleep in ((16000, True), (20000, False)):
        looks += [lambda: False, partial(answers, time_us, asleep)]
        controls = link.exchange(time_us, b"")
        assert controls is not None
        assert (controls.time_us, controls.outputs[0], link.silent) == (time_us, 0.5, 0)
    assert (looks, link.unanswered) == ([], 2)
    # Where nobody can see whether it works, what it says in time counts all the same.
    blind, px4 = connected(stack)
    px4.answer(4000)
    assert blind.exchange(4000, b"") is not None
    assert (blind.exchange(8000, b""), blind.silent) == (None, 1)
    px4.answer(8000)
    px4.answer(12000, 0.25)
    controls = blind.exchange(12000, b"")
    assert controls is not None
    assert (controls.outputs[0], blind.silent) == (0.25, 0)


def test_px4_outputs_come_back_for_their_sample(stack: ExitStack) -> None:
    link, px4 = connected(stack)
    px4.send(common.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3))
    px4.send(common.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0))
    # Samples without an answer until its outputs run.
    assert link.exchange(4000, HilEncoder().sensor(4000, IMU)) is None
    px4.answer(4000, 0.9)  # too late: for a sample that is past
    px4.answer(8000, 0.1, 0.2, math.nan, 0.4)
    controls = link.exchange(8000, HilEncoder().sensor(8000, IMU))
    assert controls is not None
    assert controls.outputs[:2] == pytest.approx((0.1, 0.2))
    assert math.isnan(controls.outputs[2])
    assert controls.armed
    px4.answer(12000, armed=False)
    stopped = link.exchange(12000, HilEncoder().sensor(12000, IMU))
    assert stopped is not None
    assert not stopped.armed
    assert stopped.outputs == (0.0,) * 16
    assert link.unanswered == 1
    assert link.truth_interval_us == 5000
    sent = decoded(px4.socket.recv(65536))
    assert [message.time_usec for message in sent] == [4000, 8000, 12000]


def test_a_px4_that_fails_is_named_with_what_it_did(stack: ExitStack) -> None:
    busy, px4 = connected(stack, answer_s=0.05, is_asleep=lambda: False)
    px4.answer(4000)
    assert busy.exchange(4000, b"") is not None
    with pytest.raises(FirmwareFault, match=r"the sample of 0\.008 s for 0\.05 s without an answer"):
        busy.exchange(8000, b"")

    ahead, px4 = connected(stack)
    px4.answer(99000)
    with pytest.raises(FirmwareFault, match="PX4 answered a sample of 99000 us, but the last is of 4000 us"):
        ahead.exchange(4000, b"")

    stranger, px4 = connected(stack)
    px4.socket.sendall(b"GET / HTTP/1.0\r\n\r\n" * 8)
    with pytest.raises(FirmwareFault, match="does not speak MAVLink"):
        stranger.exchange(4000, b"")

    gone, px4 = connected(stack)
    px4.socket.close()
    with pytest.raises(FirmwareFault, match="PX4 closed the simulator link"):
        gone.exchange(4000, HilEncoder().sensor(4000, IMU))

    unborn = stack.enter_context(closing(Px4Link(0, check_alive=alive, connect_s=0.01)))
    with pytest.raises(FirmwareFault, match=r"PX4 did not connect to TCP port \d+ within 0\.01 s"):
        unborn.connect()


def test_a_dead_program_is_told_before_anything_else(stack: ExitStack) -> None:
    def dead() -> None:
        raise FirmwareFault("the program ended with exit code 3")

    link = stack.enter_context(closing(Px4Link(0, check_alive=dead)))
    with pytest.raises(FirmwareFault, match="exit code 3"):
        link.connect()
    physics = stack.enter_context(closing(ArduPilotLink(0, check_alive=dead)))
    with pytest.raises(FirmwareFault, match="exit code 3"):
        physics.receive()


class ArduPilot:
    """The other end of the JSON physics."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(5.0)

    def send(self, count: int, *pulses: int, magic: int = 18458) -> None:
        width = 32 if magic == 29569 else 16
        padded = [*pulses, *[1000] * (width - len(pulses))]
        self.socket.send(struct.pack(f"<HHI{width}H", magic, 800, count, *padded))

    def answer(self) -> bytes:
        return self.socket.recv(4096)


def physics(stack: ExitStack, **patience_s: Any) -> tuple[ArduPilotLink, ArduPilot]:
    link = stack.enter_context(closing(ArduPilotLink(0, check_alive=alive, **patience_s)))
    ardupilot = ArduPilot(link.port)
    stack.enter_context(ardupilot.socket)
    return link, ardupilot


def state(time_s: float) -> bytes:
    rates, force = (0.1, 0.2, 0.3), (0.0, 0.0, -9.81)
    place, attitude, velocity = (1.0, 2.0, -3.0), (1.0, 0.0, 0.0, 0.0), (4.0, 5.0, 6.0)
    return encoded_state(time_s, rates, force, place, attitude, velocity, (12.25, 11.5))


def test_ardupilot_gets_one_answer_for_a_packet_however_often_it_sends_it(stack: ExitStack) -> None:
    """It takes each answer as that of its present packet: with one too many it would be ahead of the physics."""
    link, ardupilot = physics(stack)
    ardupilot.send(0, 1000, 1100, 1500, 2000)
    assert link.receive()[:4] == (1000, 1100, 1500, 2000)
    assert [rotor_share(pulse) for pulse in (0, 1000, 1590, 2000, 2100)] == [0.0, 0.0, 0.59, 1.0, 1.0]
    # The packet that waited for its answer too long lies there already, twice.
    ardupilot.send(0, 1000, 1100, 1500, 2000)
    ardupilot.send(0, 1000, 1100, 1500, 2000)
    link.answer(state(0.00125))
    assert json.loads(ardupilot.answer())["timestamp"] == 0.00125
    ardupilot.send(1, 1200, magic=29569)
    pulses = link.receive()
    assert (len(pulses), pulses[0], link.repeated) == (32, 1200, 2)
    ardupilot.send(1, 1200, magic=29569)
    ardupilot.send(0, 1300)
    assert link.receive()[0] == 1300
    assert (link.repeated, link.restarts) == (3, 1)
    stranger = ArduPilot(link.port)
    stack.enter_context(stranger.socket)
    stranger.send(7, 2000)
    stranger.socket.send(b"nonsense")
    ardupilot.send(1, 1400)
    assert link.receive()[0] == 1400
    assert link.strangers == 2
    link.answer(state(0.0025))
    assert json.loads(ardupilot.answer())["timestamp"] == 0.0025


def test_the_answer_is_one_line_that_ardupilot_can_search() -> None:
    line = state(0.00125)
    assert line[:1] == line[-1:] == b"\n"
    assert line.count(b"\n") == 2
    assert b" " not in line
    document = json.loads(line)
    assert document == {
        "timestamp": 0.00125,
        "imu": {"gyro": [0.1, 0.2, 0.3], "accel_body": [0.0, 0.0, -9.81]},
        "position": [1.0, 2.0, -3.0],
        "quaternion": [1.0, 0.0, 0.0, 0.0],
        "velocity": [4.0, 5.0, 6.0],
        "battery": {"voltage": 12.25, "current": 11.5},
    }
    # Keys are found as text: the first place where one stands must be its own.
    keys = ["timestamp", "imu", "gyro", "accel_body", "position", "quaternion", "velocity", "battery"]
    keys += ["voltage", "current"]
    assert [line.find(key.encode()) for key in keys] == [line.find(f'"{key}":'.encode()) + 1 for key in keys]


def test_an_ardupilot_that_fails_is_named_with_what_it_did(stack: ExitStack) -> None:
    link, ardupilot = physics(stack, connect_s=0.01, answer_s=0.01)
    with pytest.raises(FirmwareFault, match=r"ArduPilot sent nothing to UDP port \d+ within 0\.01 s"):
        link.receive()
    ardupilot.send(5)
    link.receive()
    with pytest.raises(FirmwareFault, match=r"no packet after frame 5 for 0\.01 s"):
        link.receive()
    ardupilot.send(7)
    with pytest.raises(FirmwareFault, match="frame 7 came after frame 5"):
        link.receive()
    for nonsense in (b"x", b"\x1a\x48" + bytes(10), struct.pack("<HHI16H", 4711, 800, 6, *[1000] * 16)):
        ardupilot.socket.send(nonsense)
        with pytest.raises(FirmwareFault, match=f"{len(nonsense)} bytes that are no packet"):
            link.receive()


def test_ardupilot_makes_the_true_degrees_of_its_metres() -> None:
    """Location::offset of ArduPilot on what the bench sends, against the rigorous place of a point 2 km away."""
    home = (-35.3632621, 149.1652374)
    metres = ArduPilotMetres(round(home[0] * 1e7), round(home[1] * 1e7))
    for north, east in ((2000.0, 0.0), (-500.0, 1500.0), (3.0, -4.0)):
        latitude, longitude, _ = pymap3d.ned2geodetic(north, east, 0.0, *home, 0.0)
        given_north, given_east = metres.north_east_m(latitude, longitude)
        per_e7 = 0.011131884502145034
        north_e7 = given_north / per_e7
        scale = math.cos(math.radians(home[0] + north_e7 * 1e-7 / 2))
        assert home[0] + north_e7 * 1e-7 == pytest.approx(latitude, abs=1e-9)
        assert home[1] + given_east / per_e7 / scale * 1e-7 == pytest.approx(longitude, abs=1e-9)
    across = ArduPilotMetres(100_000_000, 1_799_999_000)
    east_m = across.north_east_m(10.0, -179.9999)[1]
    assert east_m == pytest.approx(2000 * 0.011131884502145034 * math.cos(math.radians(10)), rel=1e-6)
