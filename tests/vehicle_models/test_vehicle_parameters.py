"""Parameters as a client sees them: tables, encodings, hash, lists, pushes; and the file that keeps them."""

from __future__ import annotations

import re
import socket
import struct
import zlib
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from ports import free_port
from vehicle_client import NAN, Client, Make, mavlink, of, simspec

from bench.contracts import LinkSpec
from bench.errors import SetupError
from bench.simulation import StandalonePlan, run_standalone
from bench.simulation._parameter_file import ParameterFile
from vehicle_models import tables
from vehicle_models.controller import AUTOPILOTS
from vehicle_models.controller.state._parameter_store import INT8, INT16, INT32, REAL32
from vehicle_models.tables import PARAMETER_SECTIONS, constant_subscripts


def values(messages: list[Any]) -> list[Any]:
    return of("PARAM_VALUE", messages)


def put(client: Client, name: str, value: float, kind: int = 9) -> list[Any]:
    client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    return client.fly(0.02)


def bits(number: int) -> float:
    (value,) = struct.unpack("<f", struct.pack("<i", number))
    return float(value)


def test_px4_list_begins_with_a_hash_that_a_client_can_compute(make: Make) -> None:
    """_HASH_CHECK, then every index in order of names; the hash is the CRC over names and values received."""
    client = make()
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    first, *rest = values(client.fly(1.5))
    assert (first.param_id, first.param_index, first.param_type) == ("_HASH_CHECK", 65535, 5)
    assert [value.param_index for value in rest] == list(range(first.param_count))
    names = [value.param_id for value in rest]
    assert names == sorted(names)
    assert len(names) > 600
    from vehicle_models.controller.px4 import PX4

    volatile = {definition.name for definition in PX4.parameters.definitions if definition.volatile}
    crc = 0xFFFFFFFF
    for value in rest:
        if value.param_id not in volatile:
            crc = zlib.crc32(value.param_id.encode() + struct.pack("<f", value.param_value), crc)
    assert struct.pack("<f", first.param_value) == struct.pack("<I", crc ^ 0xFFFFFFFF)


def test_px4_list_ends_when_the_client_knows_the_hash(make: Make) -> None:
    """A ground station with a cache sets _HASH_CHECK: no more values come, and no answer."""
    client = make()
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    client.fly(0.1)
    put(client, "_HASH_CHECK", 0.0)
    assert not values(client.fly(1.0))


def test_px4_set_reports_twice_and_errors(make: Make) -> None:
    """A change is reported twice, an equal value and what is no number once; wrong type, unknown name and index are
    errors; ranges are not enforced.
    """
    client = make()
    assert [value.param_value for value in values(put(client, "MPC_XY_VEL_MAX", 9999.0))] == [9999.0, 9999.0]
    assert len(values(put(client, "MPC_XY_VEL_MAX", 9999.0))) == 1
    assert len(values(put(client, "NAV_DLL_ACT", bits(2), 6))) == 2
    assert [value.error for value in of("PARAM_ERROR", put(client, "NAV_DLL_ACT", 2.0, 9))] == [7]
    assert [value.error for value in of("PARAM_ERROR", put(client, "nav_dll_act", 2.0, 6))] == [1]
    assert [value.param_value for value in values(put(client, "MPC_XY_VEL_MAX", NAN))] == [9999.0]
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 30000))
    assert [value.error for value in of("PARAM_ERROR", client.fly(0.1))] == [1]


def test_ardupilot_pushes_and_clamps(make: Make) -> None:
    """From the start: ground pressures when the origin is found and running time every 30 s; integers clamped, any
    case, index 65535.
    """
    client = make(simspec("ardupilot"))
    client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    client.fly(0.02)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    pushed = values(client.fly(61.0))
    names = ["BARO1_GND_PRESS", "BARO2_GND_PRESS", "STAT_RUNTIME", "STAT_RUNTIME"]
    assert [(value.param_id, value.param_index) for value in pushed] == [(name, 65535) for name in names]
    assert [value.param_value for value in pushed[2:]] == [30.0, 60.0]
    (answer,) = values(put(client, "fltmode1", 300.0))
    assert (answer.param_id, answer.param_value, answer.param_index) == ("fltmode1", 127.0, 65535)
    assert not values(put(client, "NO_SUCH", 1.0))


@pytest.mark.parametrize(
    ("autopilot", "kinds", "checksum"),
    [
        ("px4", {REAL32: 602, INT32: 286}, 0x7D1E0B7E),
        ("ardupilot", {REAL32: 560, INT8: 423, INT16: 328, INT32: 86}, 0x8232B1F1),
    ],
)
def test_all_parameters_of_the_real_autopilot_exist(
    autopilot: str, kinds: dict[int, int], checksum: int
) -> None:
    """As many of each type as the real one lists, each once; the checksum over names, types and values is that of
    the lists that were read from the real ones.
    """
    definitions = AUTOPILOTS[autopilot].parameters.definitions
    assert Counter(parameter.kind for parameter in definitions) == kinds
    assert len({parameter.name for parameter in definitions}) == len(definitions)
    record = sorted(f"{p.name} {p.kind} {p.default:.6g}" for p in definitions if p.name != "MAV_SYS_ID")
    assert zlib.crc32("\n".join(record).encode()) == checksum


def test_defaults_that_decide_what_an_autopilot_does() -> None:
    """Those on which clients and assessors rely; the lists of the real autopilots have these values."""
    px4, ardupilot = (
        {parameter.name: parameter.default for parameter in AUTOPILOTS[name].parameters.definitions}
        for name in ("px4", "ardupilot")
    )
    shown = {"COM_LOW_BAT_ACT": 3, "NAV_ACC_RAD": 2, "RTL_DESCEND_ALT": 10, "SYS_FAILURE_EN": 1}
    assert (shown | {"MAV_SYS_ID": 1, "MIS_TAKEOFF_ALT": 2.5, "NAV_DLL_ACT": 0}).items() <= px4.items()
    assert {"FENCE_RADIUS": 150, "FS_GCS_ENABLE": 0, "RTL_ALT": 1500}.items() <= ardupilot.items()
    assert [ardupilot[f"SERVO{number}_FUNCTION"] for number in (1, 2, 3, 4, 5)] == [33, 34, 35, 36, 0]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot", "wing"])
def test_every_parameter_that_the_code_names_exists(autopilot: str) -> None:
    """A name in square brackets that looks like a parameter of the autopilot's folder is one, or a mode, or a message."""
    folder = {"wing": "px4_wing"}.get(autopilot, autopilot)
    definitions = {parameter.name for parameter in PARAMETER_SECTIONS[autopilot].parameters.definitions}
    modes = {mode.name for mode in PARAMETER_SECTIONS[autopilot].modes.modes}
    named = set[str]()
    for path in (Path(tables.__file__).parent / "controller" / folder).glob("*.py"):
        named |= {name for name in constant_subscripts(path) if re.fullmatch(r"[A-Z0-9]+(_[A-Z0-9]+)+", name)}
    messages = {kind.msgname for kind in mavlink.mavlink_map.values()}
    assert len(named) > 10
    assert named - modes - messages <= definitions


def fly_and_set(file: Path, *messages: bytes) -> list[bytes]:
    """Fly shortly while a client sends something; returns what it received."""
    port = free_port(socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.connect(("127.0.0.1", port))
        link = LinkSpec("onboard", "udp_in", port=port, streams="none")
        client.setblocking(False)

        def say(line: str) -> None:
            for message in messages:
                client.send(message)

        plan = StandalonePlan("px4", [link], speed=100.0, duration_s=2.5, parameter_file=file)
        run_standalone(plan, say)
        datagrams = []
        with suppress(BlockingIOError):
            while True:
                datagrams.append(client.recv(65535))
        return datagrams


def test_set_parameters_survive_a_restart(tmp_path: Path) -> None:
    """A client's PARAM_SET is in the file after the flight, alone; the next flight begins with it."""
    file = tmp_path / "parameters.json"
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    fly_and_set(file, bytes(mavlink.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", 7.5, 9).pack(mav)))
    assert ParameterFile(file).load() == {"MIS_TAKEOFF_ALT": 7.5}
    request = bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"MIS_TAKEOFF_ALT", -1).pack(mav))
    said = mavlink.MAVLink(None).parse_buffer(b"".join(fly_and_set(file, request)))
    assert [message.param_value for message in values(said)] == [7.5]


@pytest.mark.parametrize("text", ["no json", "[1, 2]", '{"MIS_TAKEOFF_ALT": "high"}', '{"NO_SUCH": 1}'])
def test_a_bad_file_is_refused(tmp_path: Path, text: str) -> None:
    """Before anything flies, and the file stays as it was."""
    file = tmp_path / "parameters.json"
    file.write_text(text)
    with pytest.raises(SetupError):
        run_standalone(StandalonePlan(duration_s=0.1, parameter_file=file))
    assert file.read_text() == text
