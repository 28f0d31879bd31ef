"""Vehicles under real autopilots, with strict stand-ins in the autopilots' place: whole flights, failures, leftovers."""

from __future__ import annotations

import math
import os
import re
import signal
import socket
from collections.abc import Generator, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import firmware_stand_in as stand_in
import pytest
from firmware_files import install_firmware
from vehicle_client import Client, mavlink, of, simspec

from bench.contracts import LinkSpec, VehiclePlan
from bench.errors import FirmwareFault, SetupError
from bench.simspec import RealAutopilot
from vehicle_models.firmware import Budgets, FirmwareX500, open_firmware_x500
from vehicle_models.firmware._ardupilot import RunningArduPilot
from vehicle_models.firmware._program import FirmwareProgram
from vehicle_models.firmware._px4 import Px4Kind, RunningPx4

pytestmark = [pytest.mark.process, pytest.mark.flight]


KINDS = ("px4", "ardupilot")
Firmware = dict[str, Path]


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Firmware:
    return {kind: install_firmware(tmp_path_factory.mktemp(kind) / "firmware", kind) for kind in KINDS}


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def client() -> Iterator[Client]:
    made = Client()
    with made.socket:
        yield made


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Temporary files of this test alone: others fly at the same time."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    return tmp_path / "temporary"


def programs(folder: Path) -> list[str]:
    """Command lines of the processes that autopilots of this test started: their HOME is in its folder."""
    commands = []
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            try:
                if f"HOME={folder}".encode() in Path(entry.path, "environ").read_bytes():
                    commands.append(Path(entry.path, "cmdline").read_bytes().replace(b"\0", b" ").decode())
            except OSError:
                continue
    return commands


def px4_number(folder: Path) -> int:
    """The instance of the one PX4 that runs."""
    (number,) = {match[1] for command in programs(folder) if (match := re.search(r"px4 -d -i (\d)", command))}
    return int(number)


def assert_nothing_left(folder: Path) -> None:
    assert programs(folder) == []
    assert list(folder.iterdir()) == []


@contextmanager
def opened(
    kind: str,
    firmware: Path,
    *,
    parameters: Mapping[str, float] | None = None,
    budgets: Budgets | None = None,
    artefacts: Path | None = None,
    client: Client | None = None,
    boot_s: float = 3.2,
    pace: str = "one_core",
    log: bool = False,
    seed: int = 0,
    start_utc: str = "2026-06-21T11:30:00Z",
    **vehicle: Any,
) -> Generator[FirmwareX500]:
    # Nobody waits for its MAVLink but the tests of that.
    hello = {"STAND_IN_HELLO_S": 0.0} if kind == "px4" else {}
    autopilot = {
        "kind": kind,
        "firmware": str(firmware),
        "parameters": hello | dict(parameters or {}),
        "boot_s": boot_s,
        "pace": pace,
        "log": log,
    }
    vehicle = {
        "simulation_control": False,
        "home": {"east_m": 20.0, "north_m": 30.0, "heading_deg": 40.0},
        **vehicle,
    }
    gusts = {"wind": {"speed_mps": 2.0, "turbulence_mps": 2.0}} if seed else {}
    environment = {"start_utc": start_utc, **gusts}
    spec = simspec(vehicle={**vehicle, "autopilot": autopilot}, environment=environment, seeds={"root": seed})
    links = (LinkSpec("onboard", "udp_out", port=client.port),) if client else ()
    with open_firmware_x500(VehiclePlan(spec, links, artefacts=artefacts), budgets=budgets) as flown:
        if client:
            client.vehicle = flown
        yield flown


def flown_up(client: Client, kind: str, height_m: float = 10.0) -> FirmwareX500:
    """Armed, and on its way to this height."""
    vehicle = client.vehicle
    assert isinstance(vehicle, FirmwareX500)
    # Of ArduPilot there are heartbeats alone, once a second.
    client.fly(1.1)
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.fly(0.1)
    # PX4 takes it above mean sea level.
    height = height_m + (vehicle._plan.simspec.world.origin.altitude_m if kind == "px4" else 0.0)
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, height)
    return vehicle


def test_a_stand_in_takes_off_and_lands(
    kind: str, client: Client, firmware: Firmware, folder: Path, tmp_path: Path
) -> None:
    with opened(kind, firmware[kind], client=client, artefacts=tmp_path / "kept", log=True) as vehicle:
        description = vehicle.boot()
        assert vehicle.time.ns == 0
        name = "PX4" if kind == "px4" else "ArduPilot"
        program = r"(px4|arducopter) sha256:[0-9a-f]{64}"
        assert re.fullmatch(rf"{name} 1\.2\.3 \(\w+\), {program}, pace one_core", description)
        assert vehicle.condition().landed
        assert not vehicle.condition().armed
        if kind == "px4":
            lock = Path(f"/tmp/px4_lock-{px4_number(folder)}")
            assert lock.exists()
        flown_up(client, kind, 3.0)
        if kind == "ardupilot":
            # The SITL aborts where it computes with NaN, unless it is told not to.
            client.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, math.nan, math.nan)
        client.fly(4.5)
        truth = vehicle.truth()
        east, north, up = truth.position_enu_m
        assert up == pytest.approx(3.0, abs=0.3)
        # It stands over its home, with the heading of its home: rotors, frames and signs are right.
        assert (east, north) == pytest.approx((20.0, 30.0), abs=0.5)
        assert math.degrees(truth.yaw_rad) == pytest.approx(40.0, abs=3.0)
        estimate = vehicle.estimate()
        assert estimate.position_enu_m == pytest.approx(truth.position_enu_m, abs=0.15)
        assert estimate.yaw_rad == pytest.approx(truth.yaw_rad, abs=0.05)
        condition = vehicle.condition()
        assert condition.armed
        assert not condition.landed
        assert 0.9 < condition.battery_fraction < 1.0
        client.command(mavlink.MAV_CMD_NAV_LAND)
        client.fly(8.0)
        assert vehicle.condition().landed
        assert not vehicle.condition().armed
        assert not vehicle.condition().crashed
        acknowledged = [message.command for message in of("COMMAND_ACK", client.received)]
        assert {400, 22, 21} <= set(acknowledged)
        assert vehicle.sent()["onboard"] == len(client.received)
    artefacts = {path.name for path in (tmp_path / "kept").iterdir()}
    assert artefacts == {"console.log", "10_00_00.ulg" if kind == "px4" else "00000001.BIN"}
    console = (tmp_path / "kept" / "console.log").read_text()
    assert re.fullmatch(r"\d+\.\d\d s: SIM_BAT_MIN_PCT 99\n", console) if kind == "px4" else console == ""
    assert kind == "ardupilot" or not lock.exists()
    assert_nothing_left(folder)


@pytest.mark.parametrize("shares_network", [False, True])
def test_two_at_once_and_two_in_a_row_do_not_meet(
    kind: str, shares_network: bool, firmware: Firmware, folder: Path, request: pytest.FixtureRequest
) -> None:
    if shares_network:
        request.getfixturevalue("shared_network")
    for _ in range(2):
        with ExitStack() as stack:
            pair = [stack.enter_context(opened(kind, firmware[kind], boot_s=0.2)) for _ in range(2)]
            for vehicle in pair:
                vehicle.boot()
                assert (running_program(vehicle).network_fault == "no network for you") is shares_network
            for _ in range(10):
                for vehicle in pair:
                    vehicle.step()
            assert [vehicle.time.s for vehicle in pair] == [0.2, 0.2]
            assert len(list(folder.iterdir())) == len(programs(folder)) == 2
        assert_nothing_left(folder)


def test_failures_reach_an_ardupilot_that_simulates_the_part_itself(
    firmware: Firmware, tmp_path: Path
) -> None:
    """Off and on again at their moments."""
    failures = [{"at_s": 0.2, "kind": "gps_off", "duration_s": 0.3}]
    kept = tmp_path / "kept"
    with opened("ardupilot", firmware["ardupilot"], boot_s=0.3, failures=failures, artefacts=kept) as vehicle:
        vehicle.boot()
        for _ in range(80):
            vehicle.step()
    told = [line.split(" s: ") for line in (kept / "console.log").read_text().splitlines()]
    assert [text for _, text in told] == ["SIM_GPS_DISABLE 1", "SIM_GPS_DISABLE 0"]
    assert [float(time) for time, _ in told] == pytest.approx([0.5, 0.8], abs=0.05)


@pytest.mark.parametrize(
    ("failure", "parameter", "unconfirmed"),
    [
        ({"kind": "gps_off"}, {"STAND_IN_FORGETS": 1}, "SIM_GPS_DISABLE"),
        ({"kind": "battery_drop", "to_fraction": 0.5}, {"BATT_MONITOR": 0}, "command 42651"),
    ],
)
def test_an_ardupilot_that_does_not_confirm_a_failure_is_told(
    failure: dict[str, Any], parameter: dict[str, float], unconfirmed: str, firmware: Firmware
) -> None:
    """One that does not know the names, or takes no charge."""
    failures = [{"at_s": 0.1, **failure}]
    program = firmware["ardupilot"]
    with opened("ardupilot", program, boot_s=0.3, failures=failures, parameters=parameter) as vehicle:
        vehicle.boot()
        for _ in range(55):
            vehicle.step()
        with pytest.raises(FirmwareFault, match=f"has not confirmed {unconfirmed}"):
            vehicle.step()


def test_the_autopilot_has_the_battery_of_the_bench(kind: str, client: Client, firmware: Firmware) -> None:
    """Within 3 % in flight, behind a drop and a start with less than all; its own empties by the clock, or is not there."""
    failures = [{"at_s": 6.0, "kind": "battery_drop", "to_fraction": 0.3}]
    battery = {"capacity_wh": 2.0, "initial_fraction": 0.7}
    with opened(
        kind, firmware[kind], client=client, failures=failures, battery=battery, boot_s=0.2
    ) as vehicle:
        vehicle.boot()
        flown_up(client, kind)
        told = []
        for span_s in (1.0, 1.5, 1.5, 2.0, 1.5):
            client.fly(span_s)
            told.append(
                (client.last("SYS_STATUS").battery_remaining / 100.0, vehicle.condition().battery_fraction)
            )
        apart = [abs(remaining - fraction) for remaining, fraction in told]
        assert max(apart) <= 0.03, told
        assert 0.5 < told[2][1] < 0.66
        assert 0.2 < told[-1][1] < 0.29
        assert vehicle.condition().failures == ("battery_drop 0.3",)
        if kind == "ardupilot":
            assert "Battery Failsafe" not in client.texts()


def test_a_battery_that_the_user_gave_px4_is_left_to_it(client: Client, firmware: Firmware) -> None:
    given = {"SIM_BAT_DRAIN": 10.0, "SIM_BAT_MIN_PCT": 20.0}
    with opened("px4", firmware["px4"], client=client, parameters=given, boot_s=0.2) as vehicle:
        vehicle.boot()
        flown_up(client, "px4")
        client.fly(5.5)
        assert 35 < client.last("SYS_STATUS").battery_remaining < 60
        assert vehicle.condition().battery_fraction > 0.98


def test_no_drop_of_a_battery_that_the_user_gave_px4(firmware: Firmware) -> None:
    """Whichever of the two places of parameters names it."""
    given = {"SIM_BAT_DRAIN": 10.0}
    autopilot = {"kind": "px4", "firmware": str(firmware["px4"])}
    documents: list[tuple[dict[str, Any], list[str]]] = [
        ({"autopilot": autopilot, "parameters": given}, ["vehicle.failures[0].kind"]),
        ({"autopilot": {**autopilot, "parameters": given}}, ["vehicle.failures[0].kind"]),
        ({"autopilot": autopilot}, []),
    ]
    for document, refused in documents:
        drop = [{"at_s": 1.0, "kind": "battery_drop", "to_fraction": 0.5}]
        spec = simspec(vehicle={**document, "failures": drop})
        assert isinstance(spec.vehicle.autopilot, RealAutopilot)
        faults = Px4Kind().faults(VehiclePlan(spec, ()), spec.vehicle.autopilot)
        assert [fault.where for fault in faults] == refused


@pytest.mark.parametrize("pace", ["quiet", "free"])
def test_no_message_of_a_client_ends_the_simulation_of_px4(
    pace: str, client: Client, firmware: Firmware
) -> None:
    """OFFBOARD on the ground without setpoints stops its outputs, and so does the end of a flight in the air: its clock runs on.

    It stands as long as it is in that mode, then flies; its rotors stop with the flight, and it falls.
    """
    with opened("px4", firmware["px4"], client=client, boot_s=0.2, pace=pace) as vehicle:
        vehicle.boot()
        client.fly(1.1)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
        client.fly(3.0)
        assert vehicle.condition().mode == "OFFBOARD"
        assert vehicle.counters()["firmware_unanswered"] > 400
        assert vehicle.condition().landed
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
        flown_up(client, "px4")
        client.fly(5.0)
        assert vehicle.truth().position_enu_m[2] > 8.0
        assert vehicle.condition().armed
        client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)
        client.fly(0.5)
        velocity = vehicle.truth().velocity_enu_mps
        assert velocity[2] < -2.5, "it falls freely, a fifth of a second later at most"
        client.fly(2.5)
        condition = vehicle.condition()
        assert condition.crashed
        assert condition.mode == "TERMINATION"
        assert vehicle.truth().position_enu_m[2] == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize(
    ("start", "begins"), [("2026-06-21T11:30:00Z", 1_782_041_399), ("2099-01-01T00:00:00Z", 2**31 - 1)]
)
def test_arducopter_has_the_date_of_the_scene(
    start: str, begins: int, firmware: Firmware, folder: Path
) -> None:
    """Its receiver's clock begins 0.2 s of boot before the session, in whole seconds that 32 bits hold."""
    with opened("ardupilot", firmware["ardupilot"], start_utc=start, boot_s=0.2) as vehicle:
        vehicle.boot()
        assert any(f"--start-time {begins} " in command for command in programs(folder))


@pytest.mark.parametrize(("kind", "height_m", "rise_s"), [("px4", 30.0, 11.0), ("ardupilot", 6.0, 3.0)])
def test_a_fall_is_a_crash(
    kind: str, height_m: float, rise_s: float, client: Client, firmware: Firmware
) -> None:
    """From thirty metres the impact has more g than the 16 bits of PX4's truth hold."""
    failures = [{"at_s": rise_s + 1.5, "kind": "motor_off", "instance": number} for number in (1, 2, 3, 4)]
    with opened(kind, firmware[kind], client=client, failures=failures, boot_s=0.2) as vehicle:
        vehicle.boot()
        flown_up(client, kind, height_m + 3.0)
        client.fly(rise_s)
        assert vehicle.truth().position_enu_m[2] > height_m
        client.fly(4.5)
        assert vehicle.condition().crashed


def test_the_first_heartbeat_is_waited_for(firmware: Firmware) -> None:
    """PX4's comes after some five simulated seconds, and its version behind it; one that never comes is told."""
    with opened("px4", firmware["px4"], boot_s=3.5, parameters={"STAND_IN_HELLO_S": 5.1}) as vehicle:
        assert vehicle.boot().startswith("PX4 1.2.3 (5tand1n), px4 sha256:")
    with (
        opened("px4", firmware["px4"], boot_s=3.5, parameters={"STAND_IN_HELLO_S": 99.0}) as vehicle,
        pytest.raises(FirmwareFault, match="PX4 has sent no MAVLink heartbeat in 30 s"),
    ):
        vehicle.boot()


def test_what_a_killed_bench_leaves_is_gone_with_the_next_flight(
    firmware: Firmware, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pid = os.fork()
    if pid == 0:
        with opened("ardupilot", firmware["ardupilot"], boot_s=0.1) as vehicle:
            vehicle.boot()
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(pid, 0)
    (left,) = folder.iterdir()
    assert re.fullmatch(r"rebar-autopilot-.{8}\.scratch", left.name)
    monkeypatch.setattr("bench.temporary_folders.UNLOCKED_S", 0.0)
    with opened("ardupilot", firmware["ardupilot"], boot_s=0.1) as vehicle:
        vehicle.boot()
        assert left not in folder.iterdir()
    assert_nothing_left(folder)


FAULTS = {
    stand_in.DIES: r"ended with SIGSEGV; its console ends with: out of memory in the mixer.*of clients: .*COMMAND_LONG \d",
    stand_in.HANGS: r"for 0\.5 s|the clock of PX4 stands still: for 5\.0 simulated s",
    stand_in.TALKS_NONSENSE: r"does not speak MAVLink|bytes that are no packet",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_an_autopilot_that_fails_in_the_air_is_the_fault_of_its_firmware(
    kind: str, fault: int, client: Client, firmware: Firmware, folder: Path
) -> None:
    budgets = Budgets(connect_s=60.0, answer_s=0.5 if fault == stand_in.HANGS else 30.0)
    with opened(
        kind, firmware[kind], client=client, parameters={"STAND_IN_FAULT": fault}, budgets=budgets, boot_s=0.2
    ) as vehicle:
        vehicle.boot()
        flown_up(client, kind)
        with pytest.raises(FirmwareFault, match=FAULTS[fault]):
            client.fly(8.0)
        if kind == "ardupilot" or fault != stand_in.HANGS:
            assert vehicle.truth().position_enu_m[2] == pytest.approx(stand_in.FAULT_HEIGHT_M, abs=0.2)
    assert_nothing_left(folder)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (stand_in.ENDS_AT_ONCE, "exit code 7; its console ends with: no airframe of this name"),
        (stand_in.NEVER_CONNECTS, r"did not (connect|listen).* within 0\.6 s"),
    ],
)
def test_an_autopilot_that_does_not_start_says_why(
    kind: str, fault: int, words: str, firmware: Firmware, folder: Path
) -> None:
    patience = Budgets(connect_s=0.6 if fault == stand_in.NEVER_CONNECTS else 60.0)
    parameters = {"STAND_IN_FAULT": fault}
    with (
        opened(kind, firmware[kind], parameters=parameters, budgets=patience) as vehicle,
        pytest.raises(FirmwareFault, match=words),
    ):
        vehicle.boot()
    assert_nothing_left(folder)


@pytest.mark.parametrize("fault", [stand_in.IGNORES_SIGTERM, stand_in.LEAVES_CHILD])
def test_the_program_is_killed_with_all_that_it_started(fault: int, firmware: Firmware, folder: Path) -> None:
    parameters = {"STAND_IN_FAULT": fault}
    with opened("ardupilot", firmware["ardupilot"], parameters=parameters, boot_s=0.1) as vehicle:
        vehicle.boot()
        assert len(programs(folder)) == (2 if fault == stand_in.LEAVES_CHILD else 1)
    assert_nothing_left(folder)


@pytest.mark.parametrize(("kind", "pace"), [("px4", "quiet"), ("ardupilot", "one_core")])
def test_the_same_commands_at_the_same_moments_give_the_same_flight(
    kind: str, pace: str, firmware: Firmware
) -> None:
    """To the last bit with one seed, and another flight with another seed: wind and receiver's error reach it."""
    flights = []
    for root in (1, 1, 2):
        client, gps = Client(), {"wander_m": 1.0}
        with (
            client.socket,
            opened(kind, firmware[kind], client=client, boot_s=0.2, pace=pace, gps=gps, seed=root) as vehicle,
        ):
            vehicle.boot()
            flown_up(client, kind)
            client.fly(0.8)
            flights.append((vehicle.truth(), vehicle.condition().battery_fraction))
    assert flights[0] == flights[1]
    assert flights[0][0].position_enu_m[2] > 0.1
    assert flights[0] != flights[2]


@pytest.fixture
def shared_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a system that gives nobody a network namespace."""
    module = tmp_path / "refusing.py"
    module.write_text("def unshare_network():\n    raise OSError(1, 'no network for you')\n")
    monkeypatch.setattr("bench.network_namespace.__file__", str(module))


def test_ports_that_px4_has_itself_are_refused_where_it_shares_the_network(
    firmware: Firmware, shared_network: None
) -> None:
    spec = simspec(
        vehicle={"autopilot": {"kind": "px4", "firmware": str(firmware["px4"])}, "simulation_control": False}
    )
    link = LinkSpec("onboard", "udp_out", port=14540)
    with (
        open_firmware_x500(VehiclePlan(spec, (link,))) as vehicle,
        pytest.raises(SetupError, match=r"PX4 itself sends to UDP port 14540.*no network for you"),
    ):
        vehicle.boot()


def test_an_autopilot_in_a_network_of_its_own_leaves_the_ports_of_the_host_free(
    firmware: Firmware, folder: Path
) -> None:
    """Nobody outside can reach it either: an agent has the vehicle's links, and no other way."""
    with opened("px4", firmware["px4"], boot_s=0.1) as vehicle:
        vehicle.boot()
        if fault := running_program(vehicle).network_fault:
            pytest.skip(f"no network of its own here: {fault}")
        number = px4_number(folder)
        for port in (14540, 14580, 18570):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(("127.0.0.1", port + number))


def running_program(vehicle: FirmwareX500) -> FirmwareProgram:
    running = vehicle._running
    assert isinstance(running, RunningPx4 | RunningArduPilot)
    return running.program
