"""Parts of the vehicle under a real autopilot: airframe, gate, telemetry, instances, pace."""

from __future__ import annotations

import csv
import math
import os
import struct
import sys
import xml.etree.ElementTree as ET
from importlib.resources import files
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any

import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import simspec

from bench.contracts import VehiclePlan
from bench.errors import FirmwareFault, SetupError
from bench.simspec import RealAutopilot, SimSpec, VehicleSpec
from vehicle_models import open_wing, open_x500
from vehicle_models.firmware._airframe import ardupilot_parameters, merged, px4_parameters
from vehicle_models.firmware._body import Body
from vehicle_models.firmware._gate import Gate
from vehicle_models.firmware._instances import claimed_instance
from vehicle_models.firmware._pace import ThreadWatch, held_on
from vehicle_models.firmware._px4 import Px4Kind
from vehicle_models.firmware._telemetry import Telemetry
from vehicle_models.x500 import ROTORS

PACKER: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)


def frame(message: Any) -> bytes:
    return bytes(message.pack(PACKER))


def test_the_autopilot_is_told_the_geometry_of_the_aircraft_file() -> None:
    """Places and torques of x500.xml, whose x points back; FRD for PX4."""
    root = ET.parse(str(files("vehicle_models") / "x500" / "x500.xml")).getroot()
    forces = {force.get("name"): force for force in root.iter("force")}
    parameters = px4_parameters(log=False, charge=1.0)
    for number, name in enumerate(ROTORS):
        location = forces[name].find("location")
        assert location is not None
        x, y = (float(location.findtext(axis) or "nan") for axis in "xy")
        assert parameters[f"CA_ROTOR{number}_PX"] == pytest.approx(-x)
        assert parameters[f"CA_ROTOR{number}_PY"] == pytest.approx(y)
    thrust_lbs, torque_lbft = (
        float(root.findtext(f".//function[@name='rotor/{name}']//value") or "nan")
        for name in ("front-right-lbs", "yaw-ftlb")
    )
    ratio_m = torque_lbft / thrust_lbs * 0.3048
    assert parameters["CA_ROTOR0_KM"] == parameters["CA_ROTOR1_KM"] == pytest.approx(ratio_m, rel=1e-3)
    assert parameters["CA_ROTOR2_KM"] == parameters["CA_ROTOR3_KM"] == pytest.approx(-ratio_m, rel=1e-3)
    ardupilot = ardupilot_parameters(log=False, samples_hz=800, capacity_wh=60.0)
    assert parameters["MPC_THR_HOVER"] == ardupilot["MOT_THST_HOVER"] == 0.59
    # Later ones win, and whole numbers have no point.
    assert merged({"A": 1.0, "B": 0.174}, {"B": 2}, {"C": -0.5}) == {"A": "1", "B": "2", "C": "-0.5"}


@pytest.mark.parametrize(("autopilot", "samples_hz"), [("px4", 200), ("ardupilot", 800)])
def test_rotors_turned_as_in_a_real_climb_give_that_climb(autopilot: str, samples_hz: int) -> None:
    """Takeoffs of real PX4 and ArduCopter (docs/real-autopilots.md), flown again by their rotor speeds alone.

    `rotors` is the root mean square of the four speeds, ten a second; between two of them the thrust is interpolated.
    """
    with (Path(__file__).parent / "real_climbs.csv").open(encoding="utf-8") as file:
        rows = [
            [float(row[name]) for name in ("time_s", "rotors", "height_m", "climb_mps")]
            for row in csv.DictReader(file)
            if row["autopilot"] == autopilot
        ]
    body = Body(simspec(), samples_hz, 50)
    assert body.plant.motion.up_m == pytest.approx(0.0, abs=0.003)
    assert body.plant.specific_force_mps2() == pytest.approx((0.0, 0.0, -9.81), abs=0.02)
    times, rotors, _, _ = zip(*rows, strict=True)
    thrusts = [speed * speed for speed in rotors]
    apart = []
    for number, (time_s, _, _, climb_mps) in enumerate(rows[1:], start=1):
        samples = round((time_s - times[number - 1]) * samples_hz)
        for sample in range(samples):
            share = sample / samples
            body.plant.turn_rotors(
                [math.sqrt(thrusts[number - 1] * (1 - share) + thrusts[number] * share)] * 4
            )
            body.plant.advance()
        apart.append(abs(-body.plant.motion.vd_mps - climb_mps))
    assert rows[-1][2] > 7.0
    # Ten samples a second lose what the controller did between them: 0.1 m/s after seven seconds without feedback.
    assert max(apart) < 0.11
    assert body.plant.motion.up_m == pytest.approx(rows[-1][2], rel=0.06)


def test_the_gate_withholds_what_changes_the_simulation_or_ends_the_program() -> None:
    def command(number: int, *params: float, to: int = 1) -> Any:
        padded = [*params, *[0.0] * (7 - len(params))]
        return mavlink.MAVLink_command_long_message(to, to, number, 0, *padded)

    number = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    reboot = frame(command(number, 1))
    reboot_int = frame(mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, 1, 0, 0, 0, 0, 0, 0))
    shell = frame(mavlink.MAVLink_serial_control_message(10, 0, 0, 0, 8, [0] * 70))
    failure = frame(command(mavlink.MAV_CMD_INJECT_FAILURE, 0, 1))
    wind = frame(mavlink.MAVLink_param_set_message(1, 1, b"SIM_WIND_SPD", 5.0, 9))
    sensors = frame(mavlink.MAVLink_hil_gps_message(0, 3, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 9))
    arm = frame(command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1))
    speed = frame(mavlink.MAVLink_param_set_message(1, 1, b"MPC_XY_CRUISE", 5.0, 9))
    beat = frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    # To system 0, component 0: MAVLink 2 cuts the zeros, and with them the upper byte of the command.
    reboot_all = frame(command(number, 1, to=0))
    assert reboot_all[1] == 29
    reset, save = (frame(command(mavlink.MAV_CMD_PREFLIGHT_STORAGE, action)) for action in (2, 1))
    small_letters = frame(mavlink.MAVLink_param_set_message(1, 1, b"SIM_wind_spd", 5.0, 9))
    ends = (reboot, reboot_int, reboot_all, shell)
    changes = (failure, wind, small_letters, sensors, reset)
    harmless = (arm, speed, beat, save)
    strict, open_to_clients = Gate(simulation_control=False), Gate(simulation_control=True)
    for gate, withheld in ((strict, (*ends, *changes)), (open_to_clients, ends)):
        for message in (*ends, *changes, *harmless):
            assert gate.admits(message) is (message not in withheld)
        assert gate.refused == len(withheld)
    # MAVLink 1 too, whose header is shorter.
    assert not strict.admits(bytes(command(number, 1).pack(PACKER, force_mavlink1=True)))


def test_the_truth_of_the_simulation_is_not_passed_on() -> None:
    motion = (*(0,) * 3, *(0,) * 3, 0, 0, 0, *(0,) * 3, 0, 0, *(0,) * 3)
    truths = [
        mavlink.MAVLink_hil_state_quaternion_message(0, (1, 0, 0, 0), *motion[3:]),
        mavlink.MAVLink_sim_state_message(1, *(0,) * 20),
    ]
    estimate = frame(mavlink.MAVLink_attitude_message(1, 0.1, -0.2, 0.3, 0.4, 0.5, 0.6))
    # SIMSTATE stands in a dialect of its own: only its header counts here.
    frames = [*map(frame, truths), bytes([0xFD, 1, 0, 0, 0, 1, 1, 164, 0, 0, 0, 0, 0])]
    strict = Gate(simulation_control=False)
    assert [strict.states_truth(each) for each in (*frames, estimate)] == [True, True, True, False]
    assert not any(Gate(simulation_control=True).states_truth(each) for each in frames)


def transfer(opcode: int, path: bytes, sequence: int = 7, stated_bytes: int | None = None) -> bytes:
    size = len(path) if stated_bytes is None else stated_bytes
    payload = struct.pack("<HBBBBBBI", sequence, 2, opcode, size, 0, 0, 0, 0) + path
    return frame(mavlink.MAVLink_file_transfer_protocol_message(0, 3, 1, list(payload.ljust(251, b"\0"))))


def test_files_of_the_autopilot_are_read_and_plans_are_written_but_nothing_else_is() -> None:
    """Each opcode of the specification, on parameters, scripts, plans and logs; the client hears why, at once."""
    # Create, remove, make and remove a folder, open to write, truncate, rename.
    writing = (6, 8, 9, 10, 11, 12, 13)
    for path in (b"@PARAM/param.pck", b"/fs/microsd/params", b"/fs/microsd/etc/rc.txt"):
        for opcode in range(16):
            strict, free = Gate(simulation_control=False), Gate(simulation_control=True)
            assert strict.admits(transfer(opcode, path)) is (opcode not in writing), (opcode, path)
            assert free.admits(transfer(opcode, path))
            answers = strict.take_answers()
            assert (len(answers), strict.refused) == ((1, 1) if opcode in writing else (0, 0))
            assert free.take_answers() == []
    gate = Gate(simulation_control=False)
    for plan in (b"@MISSION/mission.dat", b"@FENCE/fence.dat", b"@RALLY/rally.dat"):
        assert gate.admits(transfer(6, plan))
        # Its second path would lead anywhere.
        assert not gate.admits(transfer(13, plan + b"\0@PARAM/param.pck"))
    assert len(gate.take_answers()) == 3
    # Whatever its stated size says.
    assert not Gate(simulation_control=False).admits(transfer(6, b"@PARAM/param.pck", stated_bytes=0))
    assert not Gate(simulation_control=False).admits(transfer(6, b"@MISSION/mission.dat", stated_bytes=3))
    assert gate.admits(transfer(6, b"@MISSION/mission.dat\0"))
    assert not gate.admits(transfer(11, b"@PARAM/param.pck", sequence=65535))
    parser: Any = mavlink.MAVLink(None)
    (answer,) = parser.parse_buffer(bytearray(b"".join(gate.take_answers())))
    assert (answer.get_srcSystem(), answer.get_srcComponent()) == (3, 1)
    assert (answer.target_system, answer.target_component) == (PACKER.srcSystem, PACKER.srcComponent)
    sequence, session, opcode, size, requested, *_ = struct.unpack_from("<HBBBBBBI", bytes(answer.payload))
    assert (sequence, session, opcode, size, requested, answer.payload[12]) == (0, 2, 129, 1, 11, 9)
    assert gate.take_answers() == []


def test_no_file_of_the_host_is_read_through_the_autopilot(tmp_path: Path) -> None:
    """Nor listed, nor judged by its checksum: a program on this machine could read the truth of the session."""
    secret = tmp_path / "simspec.json"
    secret.touch()
    hosts = [b"../../etc/passwd", b"/fs/microsd/../../..", b"@SYS/../..", b"/etc/passwd"]
    hosts += [bytes(tmp_path), bytes(secret)]
    own = [b"", b"/", b"/fs/microsd/log", b"etc/extras/general.json.xz", b"/etc/extras/a.json"]
    own += [b"@SYS/threads.txt", b"a..b"]
    for control in (False, True):
        for opcode in (3, 4, 14):
            gate = Gate(simulation_control=control)
            assert [gate.admits(transfer(opcode, path)) for path in own] == [True] * len(own)
            assert [gate.admits(transfer(opcode, path)) for path in hosts] == [False] * len(hosts)
            assert len(gate.take_answers()) == gate.refused == len(hosts)
        # ArduPilot reads up to a zero and PX4 by the stated size: neither is led past the gate by the other's manner.
        gate = Gate(simulation_control=control)
        assert not gate.admits(transfer(4, b"/etc/passwd", stated_bytes=2))
        assert gate.admits(transfer(4, b"/log\0/../../etc/passwd"))


def test_the_estimate_is_what_the_autopilot_says_of_itself() -> None:
    place = (473977420, 85455940, 498123, 10000)
    hashes = (list(range(1, 9)), [0] * 8, [0] * 8)
    said = (
        mavlink.MAVLink_heartbeat_message(2, 12, 209, 0x03040000, 4, 3),
        mavlink.MAVLink_attitude_message(1, 0.1, -0.2, 0.3, 0.4, 0.5, 0.6),
        mavlink.MAVLink_global_position_int_message(1, *place, 120, -240, 60, 0),
        mavlink.MAVLink_autopilot_version_message(0, 0x011100FF, 0, 0, 0, *hashes, 0, 0, 0),
        mavlink.MAVLink_statustext_message(6, b"of no interest"),
    )
    telemetry = Telemetry()
    telemetry.take([frame(message) for message in said])
    assert (telemetry.armed, telemetry.custom_mode, telemetry.heartbeats) == (True, 0x03040000, 1)
    assert telemetry.attitude_rad == pytest.approx((0.1, -0.2, 0.3))
    assert telemetry.rates_radps == pytest.approx((0.4, 0.5, 0.6))
    assert (telemetry.latitude_e7, telemetry.longitude_e7) == place[:2]
    assert telemetry.altitude_m == 498.123
    assert telemetry.velocity_ned_mps == (1.2, -2.4, 0.6)
    assert telemetry.version == "1.17.0 (0807060504030201)"
    other = mavlink.MAVLink(None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_CAMERA)
    telemetry.take([bytes(mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3).pack(other))])
    assert telemetry.armed
    parser: Any = mavlink.MAVLink(None)
    requests = [parser.parse_buffer(bytearray(data))[0] for data in telemetry.requests(50.0)]
    assert [(request.command, request.param1, request.param2) for request in requests] == [
        (512, 148.0, 0.0),
        (511, 30.0, 20000.0),
        (511, 33.0, 20000.0),
    ]


def test_numbers_of_autopilots_are_held_until_given_back(tmp_path: Path) -> None:
    with (
        claimed_instance(lambda number: number > 2, tmp_path) as first,
        claimed_instance(lambda number: number > 2, tmp_path) as second,
    ):
        assert 2 < first < second
        assert len(list(tmp_path.iterdir())) == 2
    assert list(tmp_path.iterdir()) == []
    with (
        pytest.raises(SetupError, match="10 autopilots run on this machine already"),
        claimed_instance(lambda _: False, tmp_path),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_thread_is_held_on_its_core_and_let_go() -> None:
    before = os.sched_getaffinity(0)
    core = max(before)
    with held_on(frozenset({core})):
        assert os.sched_getaffinity(0) == {core}
    assert os.sched_getaffinity(0) == before
    with held_on(frozenset()):
        assert os.sched_getaffinity(0) == before


@pytest.mark.process
def test_the_watch_waits_for_threads_that_run() -> None:
    def alive() -> None:
        """It lives."""

    sleeper = "import sys; print(flush=True); sys.stdin.read()"
    runner = "print(flush=True)\nwhile True: pass"
    for text, sleeps in ((sleeper, True), (runner, False)):
        command = [sys.executable, "-IS", "-c", text]
        with Popen(command, stdin=PIPE, stdout=PIPE, start_new_session=True) as process:
            assert process.stdout
            process.stdout.readline()
            watch = ThreadWatch(process.pid, alive, patience_s=60.0 if sleeps else 0.2)
            try:
                if sleeps:
                    watch.wait(starting=True)
                else:
                    with pytest.raises(FirmwareFault, match=r"have not slept for 0\.2 s"):
                        watch.wait(starting=False)
            finally:
                watch.close()
                process.kill()


def test_quiet_is_refused_where_sleep_cannot_be_seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("vehicle_models.firmware._pace.unseen_reason", lambda: "/proc is closed")
    for name in ("bin/px4", "etc/init.d-posix/rcS"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch(mode=0o755)
    faults = {}
    for pace in ("quiet", "one_core"):
        autopilot = RealAutopilot(kind="px4", firmware=str(tmp_path), pace=pace)
        plan = VehiclePlan(simspec(vehicle={"autopilot": autopilot}), ())
        faults[pace] = Px4Kind().faults(plan, autopilot)
    assert faults["one_core"] == []
    assert [fault.where for fault in faults["quiet"]] == ["vehicle.autopilot.pace"]
    assert "/proc is closed" in str(SetupError(faults["quiet"]))


def test_a_simspec_names_an_imitation_or_a_firmware() -> None:
    assert VehicleSpec().model_dump()["autopilot"] == "px4"
    document = {"kind": "ardupilot", "firmware": "arducopter", "parameters": {"WPNAV_SPEED": 500}}
    spec = VehicleSpec.model_validate({"autopilot": document})
    assert isinstance(spec.autopilot, RealAutopilot)
    assert (spec.autopilot.pace, spec.autopilot.log) == ("one_core", False)
    assert str(spec.autopilot) == "ardupilot (real)"
    paces = [RealAutopilot(kind="px4", firmware="px4", **given).pace for given in ({}, {"pace": "free"})]
    assert paces == ["quiet", "free"], "PX4 repeats unless it is told not to"
    with pytest.raises(ValidationError, match="firmware"):
        VehicleSpec.model_validate({"autopilot": {"kind": "px4"}})


def test_what_a_real_autopilot_cannot_do_is_refused(tmp_path: Path) -> None:
    program = tmp_path / "arducopter"
    program.touch(mode=0o755)

    def refused(**vehicle: Any) -> str:
        autopilot = {"kind": "ardupilot", "firmware": str(program)}
        spec = simspec(vehicle={"autopilot": autopilot, **vehicle})
        with pytest.raises(SetupError) as raised, open_x500(VehiclePlan(spec, ())):
            pass
        return str(raised.value)

    failures = [{"at_s": 1.0, "kind": "gps_off"}, {"at_s": 2.0, "kind": "gps_drift", "drift_mps": 1.0}]
    text = refused(failures=failures, camera={"gimbal": True}, ground_truth=True)
    assert [line.split(":")[0] for line in text.splitlines()] == [
        "vehicle.camera.gimbal",
        "vehicle.ground_truth",
    ]
    wing = simspec(vehicle={"autopilot": {"kind": "px4", "firmware": str(tmp_path)}, "model": "wing"})
    with (
        pytest.raises(SetupError, match="real autopilots fly the model x500 alone"),
        open_wing(VehiclePlan(wing, ())),
    ):
        pass


def test_the_receivers_error_is_in_what_the_autopilot_gets() -> None:
    spec: SimSpec = simspec(vehicle={"gps": {"wander_m": 8.0, "noise_m": 0.5}})
    body = Body(spec, 200, 50)
    east_m, north_m, up_m = body.navigation.fix_error_enu_m
    assert math.hypot(east_m, north_m) > 0.5
    truth, fix = body.place(), body.fix()
    # A degree of latitude at 47 degrees north.
    assert (fix.latitude_e7 - truth.latitude_e7) / 1e7 * 111170.0 == pytest.approx(north_m, abs=0.05)
    assert fix.altitude_m - truth.altitude_m == pytest.approx(up_m, abs=1e-6)
    latitude_deg, longitude_deg = body.seen_latitude_longitude_deg()
    assert (round(latitude_deg * 1e7), round(longitude_deg * 1e7)) == (fix.latitude_e7, fix.longitude_e7)


def test_a_failsafe_is_told_with_its_cause_where_the_autopilot_says_one() -> None:
    """Two causes one after the other, each cleared; one of PX4, which names none; none where nothing is critical."""

    def beat(status: int, armed: bool = True) -> bytes:
        return frame(mavlink.MAVLink_heartbeat_message(2, 3, 209 if armed else 81, 6, status, 3))

    def text(words: bytes) -> bytes:
        return frame(mavlink.MAVLink_statustext_message(4, words))

    telemetry, told = Telemetry(), []
    for frames in (
        [beat(4)],
        [text(b"GCS Failsafe"), beat(5)],
        [text(b"GCS Failsafe Cleared"), beat(4)],
        [text(b"Battery 1 is low 10.50V used 166 mAh"), text(b"Battery Failsafe"), beat(5)],
        [beat(3, armed=False)],
        [text(b"EKF Failsafe: changed to LAND Mode"), beat(5)],
    ):
        telemetry.take(frames)
        told.append(telemetry.failsafe)
    assert told == ["", "link", "", "battery", "", "position"]
    px4 = Telemetry()
    px4.take([text(b"Failsafe activated: entering Hold for 5 seconds"), beat(5)])
    assert px4.failsafe == "unknown"
