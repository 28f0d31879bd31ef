"""Flight controller boards in hardware-in-the-loop mode, with a strict stand-in at the other end of a pseudo terminal."""

from __future__ import annotations

import contextlib
import json
import math
import os
import struct
import time
from collections.abc import Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from board_stand_in import INT32, REAL32, Board
from boards import MAX_PARAMETERS, declare, frame_bytes, plan_line
from serial_cable import Cable
from vehicle_client import Client, mavlink, of, simspec

from bench.cli._app import run
from bench.cli._machine import _firmware as check_firmware
from bench.contracts import LinkSpec, VehiclePlan
from bench.errors import FirmwareFault, SetupError
from vehicle_models.firmware import Budgets, FirmwareX500, open_firmware_x500

HEIGHT_M = 2.0


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    with closing(Cable(tmp_path / "ttyACM0")) as plugged:
        yield plugged


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the bench notes what it has changed on boards."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path / "home" / ".local" / "state" / "rebar" / "boards"


@pytest.fixture
def client() -> Iterator[Client]:
    made = Client()
    with made.socket:
        yield made


@contextmanager
def opened(
    board: Board,
    client: Client | None = None,
    *,
    boot_s: float = 1.0,
    artefacts: Path | None = None,
    simulation_control: bool = False,
    **autopilot: Any,
) -> Generator[FirmwareX500]:
    options = {"device": str(board.cable.path), "baud": board.baud, **autopilot}
    document = {"kind": "px4-board", "options": options, "boot_s": boot_s}
    vehicle_spec = {"autopilot": document, "simulation_control": simulation_control}
    spec = simspec(vehicle=vehicle_spec, pace={"mode": "realtime"})
    links = (LinkSpec("onboard", "udp_out", port=client.port),) if client else ()
    plan = VehiclePlan(spec, links, artefacts=artefacts)
    with pytest.MonkeyPatch.context() as monkeypatch:
        declare(monkeypatch, board.clock())
        with open_firmware_x500(plan, budgets=Budgets(connect_s=8.0)) as vehicle:
            if client:
                client.vehicle = vehicle
            yield vehicle


def parameter(board: Board, name: str) -> float:
    return board.parameters[name][0]


def step(vehicle: FirmwareX500, board: Board, span_s: float, client: Client | None = None) -> None:
    """As a session in real time does it: sleep until the step is due, then make it."""
    for _ in range(round(span_s / vehicle.step_s)):
        due_s = board.now_s + vehicle.step_s
        if client:
            client.fly(vehicle.step_s)
        else:
            vehicle.receive()
            vehicle.step()
        board.run(max(0.0, due_s - board.now_s))


@pytest.mark.parametrize(("baud", "samples_hz"), [(921600, 200), (115200, 100)])
def test_a_board_takes_off_and_lands_by_its_sensors_alone(
    baud: int, samples_hz: int, cable: Cable, client: Client, tmp_path: Path
) -> None:
    """At both ends of what lines carry; its parameters are the airframe's in flight, and its own again afterwards."""
    board = Board(cable, baud)
    before = dict(board.parameters)
    with opened(board, client, artefacts=tmp_path / "kept") as vehicle:
        flown = f"PX4 board 1.16.0, {cable.path} at {baud} baud, {samples_hz} samples a second, in real time"
        assert vehicle.boot() == flown
        assert board.restarts == 1
        assert parameter(board, "HIL_ACT_FUNC3") == 103
        assert parameter(board, "CA_ROTOR1_PX") == pytest.approx(-0.174, abs=0.01)
        step(vehicle, board, 0.2, client)
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        step(vehicle, board, 0.2, client)
        altitude = vehicle._plan.simspec.world.origin.altitude_m + HEIGHT_M
        client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, altitude)
        step(vehicle, board, 3.5, client)
        truth, condition = vehicle.truth(), vehicle.condition()
        assert condition.armed
        assert truth.position_enu_m[2] == pytest.approx(HEIGHT_M, abs=0.5)
        assert math.hypot(*truth.position_enu_m[:2]) < 1.0
        assert vehicle.estimate().position_enu_m == pytest.approx(truth.position_enu_m, abs=0.6)
        counters = vehicle.counters()
        lost = ("firmware_late_samples", "firmware_lost_bytes", "firmware_lost_messages")
        assert [counters[name] for name in lost] == [0, 0, 0]
    times_s = list(board.sensor_times_s)[-301:]
    assert (times_s[-1] - times_s[0]) / 300 == pytest.approx(1 / samples_hz, rel=0.05)
    assert not board.pilot.armed
    assert board.parameters == before
    changed = json.loads((tmp_path / "kept" / "board-parameters-before.json").read_text())
    assert changed["HIL_ACT_FUNC3"] == 0
    assert "SYS_HITL" not in changed
    assert (tmp_path / "kept" / "console.log").read_text() == f"{len(changed)} parameters put back\n"
    kinds = {message.get_type() for message in client.received}
    assert {"HEARTBEAT", "ATTITUDE", "COMMAND_ACK"} <= kinds
    assert "HIL_ACTUATOR_CONTROLS" not in kinds


def flown_into(board: Board, fault: str, fails: Any) -> None:
    with opened(board) as vehicle:
        vehicle.boot()
        step(vehicle, board, 0.1)
        fails()
        with pytest.raises(FirmwareFault, match=fault):
            step(vehicle, board, 3.0)


def test_a_board_that_fails_in_flight_is_no_fault_of_the_agent(cable: Cable) -> None:
    """It restarts by itself, falls silent, or leaves simulation: each ends the session as a fault of the firmware."""
    board = Board(cable)
    flown_into(
        board, "went away and came back: it restarted, or its cable is loose|no HIL_ACTUATOR", board.restart
    )
    board.run(3.0)

    def fall_silent() -> None:
        board.silent_from_s = board.now_s

    flown_into(board, r"no HIL_ACTUATOR_CONTROLS came from the board on .*ttyACM0 for 0\.5 s", fall_silent)
    board.silent_from_s = math.inf

    def leave_simulation() -> None:
        board.left_simulation = True

    # Its outputs cease at once, its heartbeat says so within a second.
    flown_into(board, r"left hardware-in-the-loop mode|no HIL_ACTUATOR_CONTROLS came", leave_simulation)


def test_a_board_gets_its_sensors_until_the_agent_has_started(cable: Cable) -> None:
    """Between the start and the first step a thread keeps it in real time; what fails meanwhile is told by that step."""
    board = Board(cable)
    with opened(board, boot_s=0.2) as vehicle:
        vehicle.boot()
        begun_s = board.now_s
        while board.now_s < begun_s + 2.0:
            time.sleep(0.001)
        step(vehicle, board, 0.1)
        assert vehicle.time.s == pytest.approx(0.1)
        kept = [moment for moment in board.sensor_times_s if begun_s < moment < begun_s + 2.0]
        assert len(kept) == pytest.approx(400, abs=4)
        assert vehicle.condition().landed
    with opened(board, boot_s=0.2) as vehicle:
        vehicle.boot()
        board.on_slice = board.restart_once
        while board.restarts < 3:
            time.sleep(0.001)
        fault = "went away and came back|no HIL_ACTUATOR_CONTROLS came"
        with pytest.raises(FirmwareFault, match=fault):
            step(vehicle, board, 5.0)


def test_a_line_that_loses_bytes_costs_samples_and_is_counted(cable: Cable) -> None:
    """One byte in a thousand in each direction: the flight goes on."""
    board = Board(cable, lose_every=1000)
    with opened(board) as vehicle:
        vehicle.boot()
        step(vehicle, board, 1.0)
        assert board.bad_bytes > 0
        assert not vehicle.condition().crashed


def test_a_board_that_reads_too_slowly_loses_whole_messages(cable: Cable) -> None:
    """What the bench could not send is counted, and that its parameters are not its own again is told."""
    board = Board(cable)
    with ExitStack() as stack:
        vehicle = stack.enter_context(opened(board))
        vehicle.boot()
        # Until its first step the vehicle is kept by a thread of its own.
        step(vehicle, board, 0.1)
        board.byte_share = board.in_credit = 0.0
        filler = os.open(cable.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        with contextlib.suppress(BlockingIOError):
            while os.write(filler, bytes(4096)):
                continue
        os.close(filler)
        step(vehicle, board, 1.0)
        assert vehicle.counters()["firmware_lost_bytes"] > 1000
        words = r"0 parameters put back; NOT PUT BACK: CA_ROTOR0_PX, .*'HIL_ACT_FUNC1': 0"
        with pytest.raises(FirmwareFault, match=words):
            stack.close()


def test_boards_that_cannot_simulate_are_refused_before_anything_moves(cable: Cable) -> None:
    real = Board(cable)
    real.parameters["SYS_HITL"] = (0, INT32)
    real._start()
    with (
        opened(real) as vehicle,
        pytest.raises(SetupError, match=r"has SYS_HITL 0 and is not in.*propellers off"),
    ):
        vehicle.boot()
    assert not [message for message in real.heard if message.command != 511]
    # Set, and not restarted since.
    real.parameters["SYS_HITL"] = (1, INT32)
    with opened(real) as vehicle, pytest.raises(SetupError, match="has SYS_HITL 1 and is not in"):
        vehicle.boot()
    armed = Board(cable)
    armed.pilot.armed = True
    with opened(armed) as vehicle, pytest.raises(SetupError, match="is armed"):
        vehicle.boot()
    other = Board(cable, autopilot=3)
    with opened(other) as vehicle, pytest.raises(FirmwareFault, match=r"is no PX4 \(MAV_AUTOPILOT 3\)"):
        vehicle.boot()
    dead = Board(cable, byte_share=0.0)
    dead.intervals_s, dead.away_until_s = {}, math.inf
    with (
        opened(dead) as vehicle,
        pytest.raises(FirmwareFault, match=r"no heartbeat.*within 8 s; nothing came"),
    ):
        vehicle.boot()


def test_parameters_that_a_board_lacks_or_refuses_leave_it_as_it_was(cable: Cable) -> None:
    board = Board(cable)
    before = dict(board.parameters)
    with (
        opened(board, parameters={"NO_SUCH": 1.0, "NOR_THIS": 2.0}) as vehicle,
        pytest.raises(SetupError, match=r"NO_SUCH.*does not have it") as missing,
    ):
        vehicle.boot()
    assert len(missing.value.faults) == 2
    board.refused_parameters = frozenset({"MPC_XY_CRUISE"})
    with (
        opened(board, parameters={"MPC_XY_CRUISE": 9.0}) as vehicle,
        pytest.raises(SetupError, match=r"MPC_XY_CRUISE.*does not take 9"),
    ):
        vehicle.boot()
    assert board.parameters == before


def test_a_bench_that_was_killed_puts_back_at_its_next_start(cable: Cable, home: Path) -> None:
    """Its notes are there before the first change, and go when all is as it was."""
    board = Board(cable)
    before = dict(board.parameters)
    with opened(board, boot_s=0.2) as vehicle:
        vehicle.boot()
        (note,) = home.iterdir()
        noted, changed = note.read_text(), dict(board.parameters)
    assert board.parameters == before
    assert list(home.iterdir()) == []
    # As after a kill: the board is the simulated aircraft's, and the notes lie there.
    board.parameters = dict(changed)
    note.write_text(noted)
    with opened(board, boot_s=0.2) as vehicle:
        vehicle.boot()
        assert parameter(board, "HIL_ACT_FUNC3") == 103
    assert board.parameters == before
    assert list(home.iterdir()) == []
    # A damaged note is no reason to go on: it may be all that is known of the board.
    note.write_text(noted[:-5])
    with opened(board) as vehicle, pytest.raises(SetupError, match=r"cannot be read.*then remove the file"):
        vehicle.boot()
    assert board.parameters == before
    # One that it does not take back is told, and the note stays for whoever mends it.
    board.parameters, board.refused_parameters = dict(changed), frozenset({"HIL_ACT_FUNC2"})
    note.write_text(noted)
    with opened(board) as vehicle, pytest.raises(FirmwareFault, match="does not take HIL_ACT_FUNC2 back"):
        vehicle.boot()
    assert note.read_text() == noted
    note.unlink()
    board.parameters, board.refused_parameters = dict(before), frozenset()
    home.chmod(0o500)
    if not os.access(home, os.W_OK):
        with opened(board) as vehicle, pytest.raises(SetupError, match="cannot be noted"):
            vehicle.boot()
        assert board.parameters == before
    home.chmod(0o700)


def test_streams_that_do_not_fit_are_refused_with_the_reason(cable: Cable, client: Client) -> None:
    """Those of the SimSpec before the start, those of an agent in the air."""
    board = Board(cable, 115200)
    words = r"streams_hz\.LOCAL_POSITION_NED at 50 Hz|LOCAL_POSITION_NED.*are free"
    with (
        pytest.raises(SetupError, match=words),
        opened(board, streams_hz={"LOCAL_POSITION_NED": 50.0}),
    ):
        pass
    with opened(board, client, boot_s=0.2, streams_hz={"LOCAL_POSITION_NED": 10.0}) as vehicle:
        vehicle.boot()
        step(vehicle, board, 0.3, client)
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 105, 1e6 / 50)
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 93, 1e6)
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 1e6 / 5)
        client.send(mavlink.MAVLink_param_set_message(1, 1, b"HIL_ACT_FUNC1", 0.0, 6))
        step(vehicle, board, 0.3, client)
        denied = [m.result for m in of("COMMAND_ACK", client.received) if m.command == 511][-3:]
        texts = client.texts()
        assert vehicle.counters()["firmware_refused"] == 3
        assert parameter(board, "HIL_ACT_FUNC1") == 101
    assert sorted(denied) == [0, 2, 2]
    assert any(text.startswith("HIGHRES_IMU at 50 Hz takes") for text in texts)
    assert any("stays at 100 Hz" in text for text in texts)
    assert "HIL_ACT_FUNC1 is not set over the bench" in texts
    assert board.intervals_s[32] == pytest.approx(0.2)


def test_what_agents_set_on_a_board_is_put_back(
    cable: Cable, client: Client, home: Path, tmp_path: Path
) -> None:
    """A parameter that the bench has never read, one that it has, and one that the board does not have."""
    board = Board(cable)
    board.parameters |= {"MPC_Z_VEL_MAX_UP": (3.0, REAL32), "COM_RC_IN_MODE": (1, INT32)}
    original = dict(board.parameters)
    kept, parameters = tmp_path / "kept", {"COM_RC_IN_MODE": 4}
    with opened(board, client, boot_s=0.2, artefacts=kept, parameters=parameters) as vehicle:
        vehicle.boot()
        step(vehicle, board, 0.1, client)
        client.received.clear()
        for name, value in ((b"MPC_Z_VEL_MAX_UP", 9.0), (b"MPC_XY_CRUISE", 7.0), (b"NONE", 1.0)):
            client.send(mavlink.MAVLink_param_set_message(1, 1, name, value, REAL32))
        step(vehicle, board, 0.3, client)
        assert (parameter(board, "MPC_Z_VEL_MAX_UP"), parameter(board, "MPC_XY_CRUISE")) == (9.0, 7.0)
        # Noted before the change, in case that the bench is killed.
        (note,) = home.iterdir()
        assert json.loads(note.read_text())["MPC_Z_VEL_MAX_UP"] == [3.0, REAL32]
        # The agent is not told the former value, which would look like a refusal.
        answers = [(message.param_id, message.param_value) for message in of("PARAM_VALUE", client.received)]
        assert answers == [("MPC_Z_VEL_MAX_UP", 9.0), ("MPC_XY_CRUISE", 7.0)]
    assert board.parameters == original
    assert json.loads((kept / "board-parameters-before.json").read_text())["MPC_XY_CRUISE"] == 5.0


def test_agents_leave_nothing_else_on_a_board(cable: Cable, client: Client) -> None:
    """Files, signing keys, calibrations and a reset of all parameters are refused and answered, whoever asks."""
    board = Board(cable)
    names = ("PREFLIGHT_STORAGE", "PREFLIGHT_CALIBRATION", "DO_START_MAG_CAL")
    commands = [getattr(mavlink, f"MAV_CMD_{name}") for name in names]
    open_to_write = struct.pack("<HBBBBBBI", 7, 0, 11, 6, 0, 0, 0, 0) + b"params"
    with opened(board, client, boot_s=0.2, simulation_control=True) as vehicle:
        vehicle.boot()
        step(vehicle, board, 0.1, client)
        board.heard.clear()
        for command in commands:
            client.command(command, 2.0)
        client.send(mavlink.MAVLink_setup_signing_message(1, 1, [1] * 32, 5))
        payload = list(open_to_write.ljust(251, b"\0"))
        client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        for number in range(MAX_PARAMETERS + 1):
            client.send(mavlink.MAVLink_param_set_message(1, 1, f"P{number}".encode(), 1.0, REAL32))
        step(vehicle, board, 0.2, client)
        assert [message for message in board.heard if message.get_type() != "COMMAND_LONG"] == []
        assert not {message.command for message in board.heard} & set(commands)
    denied = {m.command: m.result for m in of("COMMAND_ACK", client.received)}
    assert [denied[command] for command in commands] == [2, 2, 2]
    (answer,) = (m for m in of("FILE_TRANSFER_PROTOCOL", client.received))
    assert (answer.payload[3], answer.payload[12]) == (129, 9)
    assert "SETUP_SIGNING is not done over the bench" in client.texts()
    assert f"P{MAX_PARAMETERS}: over {MAX_PARAMETERS} parameters a session" in client.texts()


def test_the_budget_of_a_line_adds_up() -> None:
    """At every speed, by adding the bytes of what is planned; slow lines are refused, and better ones carry more."""
    with pytest.raises(SetupError, match="use 115200 or more"):
        plan_line(57600, {})
    rates = []
    for baud in (115200, 230400, 460800, 921600):
        budget = plan_line(baud, {"LOCAL_POSITION_NED": 5.0})
        to_board = budget.samples_hz * 77 + 8 * 51 + 21
        from_board = sum(rate * frame_bytes(name) for name, rate in budget.streams_hz.items())
        assert to_board + budget.free_to_board_bps == pytest.approx(0.95 * baud / 10)
        assert from_board + 200 + budget.free_from_board_bps == pytest.approx(0.95 * baud / 10)
        assert budget.free_from_board_bps >= 0
        assert budget.free_to_board_bps >= 700
        rates.append((budget.samples_hz, budget.streams_hz["ATTITUDE"]))
    assert rates == sorted(rates)
    assert (rates[0][0], rates[-1]) == (100, (200, 50.0))
    with pytest.raises(SetupError) as refused:
        plan_line(115200, {"HIGHRES_IMU": 50.0, "NO_MESSAGE": 1.0})
    assert len(refused.value.faults) == 2


def test_a_board_keeps_real_time_and_says_what_it_cannot(
    cable: Cable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    declare(monkeypatch)
    document = {"kind": "px4-board", "options": {"device": str(tmp_path / "none")}}
    failures = [{"at_s": 1, "kind": "battery_drop", "to_fraction": 0.1}, {"at_s": 1, "kind": "gps_off"}]
    spec = simspec(vehicle={"autopilot": document, "failures": failures, "simulation_control": False})
    with pytest.raises(SetupError) as refused, open_firmware_x500(VehiclePlan(spec, ())):
        pass
    texts = " ".join(map(str, refused.value.faults))
    assert "pace.mode: a board keeps real time" in texts
    assert "vehicle.failures[0].kind: battery_drop does not reach a board" in texts
    assert "there is no device" in texts
    assert len(refused.value.faults) == 3


def test_commands_fly_a_board_by_its_plugin(
    cable: Cable, client: Client, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`rebar fly` and `rebar doctor`; options that it does not have, and devices that are not there, are named."""
    board = Board(cable, 115200)
    before = dict(board.parameters)
    declare(monkeypatch, board.clock())
    firmware = f"px4-board:device={cable.path},baud=115200"
    flown = f"PX4 board 1.16.0, {cable.path} at 115200 baud, 100 samples a second, in real time"
    fly = ["fly", "--mavlink", f"udpout:127.0.0.1:{client.port}", "--firmware"]
    assert run([*fly, firmware, "--duration", "0.1"]) == 0
    assert capsys.readouterr().out.startswith(flown)
    assert run([*fly, firmware, "--speed", "2"]) == 2
    assert "--speed: another computer, or the firmware of a plug-in" in capsys.readouterr().err
    assert run([*fly, f"px4-board:device={cable.path}-2,baud=fast"]) == 2
    assert "vehicle.autopilot.options: baud: 'fast' is not valid" in capsys.readouterr().err
    assert run([*fly, f"px4-board:device={cable.path}-2"]) == 2
    assert f"vehicle.autopilot.options.device: there is no device {cable.path}-2" in capsys.readouterr().err
    assert check_firmware(firmware) == flown
    assert board.restarts == 2
    assert board.parameters == before
