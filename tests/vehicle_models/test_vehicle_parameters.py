"""Parameters as a client sees them: tables, encodings, hash, lists, pushes."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import Any

from vehicle_client import Client, mavlink, simspec

Make = Callable[..., Client]


def values(messages: list[Any]) -> list[Any]:
    return [message for message in messages if message.get_type() == "PARAM_VALUE"]


def put(client: Client, name: str, value: float, kind: int = 9) -> list[Any]:
    client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    return client.fly(0.02)


def bits(number: int) -> float:
    (value,) = struct.unpack("<f", struct.pack("<i", number))
    return float(value)


def test_px4_list_begins_with_a_hash_that_a_client_can_compute(make: Make) -> None:
    """_HASH_CHECK first, then every index in order of names; the hash is the CRC over names and values
    received.
    """
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
    """A change is reported twice, an equal value once; wrong type and unknown name are errors; ranges are not
    enforced.
    """
    client = make()
    assert [value.param_value for value in values(put(client, "MPC_XY_VEL_MAX", 9999.0))] == [9999.0, 9999.0]
    assert len(values(put(client, "MPC_XY_VEL_MAX", 9999.0))) == 1
    assert len(values(put(client, "NAV_DLL_ACT", bits(2), 6))) == 2
    assert [
        value.error for value in put(client, "NAV_DLL_ACT", 2.0, 9) if value.get_type() == "PARAM_ERROR"
    ] == [7]
    assert [
        value.error for value in put(client, "nav_dll_act", 2.0, 6) if value.get_type() == "PARAM_ERROR"
    ] == [1]


def test_ardupilot_pushes_and_clamps(make: Make) -> None:
    """Ground pressures when the origin is found and running time every 30 s; integers clamped, any case,
    index 65535.
    """
    client = make(simspec("ardupilot"))
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    pushed = values(client.fly(61.0))
    assert [(value.param_id, value.param_index) for value in pushed] == [
        ("BARO1_GND_PRESS", 65535),
        ("BARO2_GND_PRESS", 65535),
        ("STAT_RUNTIME", 65535),
        ("STAT_RUNTIME", 65535),
    ]
    assert [value.param_value for value in pushed[2:]] == [30.0, 60.0]
    (answer,) = values(put(client, "fltmode1", 300.0))
    assert (answer.param_id, answer.param_value, answer.param_index) == ("fltmode1", 127.0, 65535)
    assert not values(put(client, "NO_SUCH", 1.0))


def test_table_rows_stand_for_many() -> None:
    """Spans of numbers and of texts, and a default that carries the number."""
    from vehicle_models.controller.ardupilot import ARDUPILOT

    definitions = {definition.name: definition for definition in ARDUPILOT.parameters.definitions}
    assert [definitions[f"SERVO{number}_FUNCTION"].default for number in (1, 4, 5)] == [31, 34, 0]
    assert {"COMPASS_OFS_X", "COMPASS_OFS2_X", "COMPASS_OFS3_X", "INS_USE", "INS_USE2"} <= set(definitions)
    assert len(definitions) == len(ARDUPILOT.parameters.definitions)
