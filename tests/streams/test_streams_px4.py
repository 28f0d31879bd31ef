"""The messages of px4_msgs, compared with the hashes, sizes and encoders of others."""

from __future__ import annotations

import csv
import math
import struct
from pathlib import Path
from random import Random
from typing import Any

import pytest
from other_encoder import encoded, random_message, store_of

from bench.streams import (
    PX4_FROM_AGENT,
    PX4_RELEASES,
    PX4_TO_AGENT,
    data_key,
    decode,
    encode,
    px4_message,
    px4_names,
    px4_plain_name,
    px4_releases_of,
    type_hash,
)

# From PX4/px4_msgs by a generator of its own; two thirds are confirmed by generated code, documentation or programs.
with Path(__file__).with_name("px4_hashes.csv").open(encoding="utf-8") as _file:
    ROWS = [tuple(row.values()) for row in csv.DictReader(_file)]


@pytest.mark.parametrize(("message", "release", "size", "hashed"), ROWS)
def test_hash_and_size_of_every_layout_are_those_of_px4_msgs(
    message: str, release: str, size: str, hashed: str
) -> None:
    kind = px4_message(message, release)
    assert type_hash(kind) == hashed
    assert len(encode(kind())) == int(size)
    assert release in px4_releases_of(message, hashed)


@pytest.mark.parametrize("release", PX4_RELEASES)
def test_random_messages_are_encoded_as_rosbags_does(release: str) -> None:
    random = Random(42)
    for topic, name in {**PX4_TO_AGENT, **PX4_FROM_AGENT}.items():
        if not px4_names(topic, release):
            continue
        kind = px4_message(name, release)
        mine = random_message(kind, random)
        assert encode(mine) == encoded(store_of(kind), mine)
        assert decode(kind, encode(mine)) == mine


def test_a_setpoint_is_the_bytes_that_px4_reads() -> None:
    kind: Any = px4_message("TrajectorySetpoint", "1.17")
    open_axes = (math.nan,) * 3
    setpoint = kind(1_000_000, (0.0, 0.0, -5.0), open_axes, open_axes, open_axes, 1.5, math.nan)
    parts = "00010000 40420f0000000000 00000000 00000000 0000a0c0", "0000c07f" * 9, "0000c03f 0000c07f"
    assert encode(setpoint).hex() == "".join(parts).replace(" ", "")
    assert struct.unpack_from("<f", encode(setpoint), 20) == (-5.0,)


def test_a_float_that_is_too_large_for_its_field_is_a_value_error() -> None:
    with pytest.raises(ValueError, match="px4_msgs/msg/VehicleRatesSetpoint: a value does not fit"):
        encode(px4_message("VehicleRatesSetpoint", "1.17")(roll=1e39))  # type: ignore[call-arg]


def test_releases_differ_in_what_they_do_not_share() -> None:
    """A status of 1.18 has another key, a command has not; what a release does not have is unknown."""
    keys = {
        name: {data_key(1, "/x", px4_message(name, release)) for release in PX4_RELEASES}
        for name in ("VehicleStatus", "VehicleCommand", "FailsafeFlags")
    }
    assert [len(found) for found in keys.values()] == [2, 1, 3]
    for name, release in (("VehicleStatus", "1.15"), ("SetpointConfig", "1.17")):
        with pytest.raises(KeyError):
            px4_message(name, release)
    hashed = type_hash(px4_message("SetpointConfig", "1.18"))
    assert px4_releases_of("SetpointConfig", hashed) == ["1.18", "main"]
    for name in ("VehicleStatus", "ActuatorMotors"):
        assert px4_releases_of(name, "RIHS01_0") == []


# Of the topics of PX4's uXRCE-DDS: MESSAGE_VERSION where it is above 0.
VERSIONED = {
    "1.16": {"vehicle_status": 1},
    "1.17": {
        **dict.fromkeys(("vehicle_status", "vehicle_local_position", "battery_status", "home_position"), 1),
        **dict.fromkeys(("arming_check_request", "arming_check_reply", "vehicle_attitude_setpoint"), 1),
    },
    "1.18": {
        **dict.fromkeys(
            ("vehicle_local_position", "battery_status", "home_position", "vehicle_command_ack"), 1
        ),
        **dict.fromkeys(("arming_check_request", "arming_check_reply", "vehicle_attitude_setpoint"), 1),
        "vehicle_status": 4,
        "register_ext_component_request": 2,
        "register_ext_component_reply": 1,
    },
}


@pytest.mark.parametrize("release", PX4_RELEASES)
def test_topics_whose_message_has_a_version_have_a_second_name(release: str) -> None:
    names = {topic: px4_names(topic, release) for topic in (*PX4_TO_AGENT, *PX4_FROM_AGENT)}
    absent = {topic for topic, found in names.items() if not found}
    newer = {"/fmu/in/setpoint_config", "/fmu/out/setpoint_config_reply"}
    assert absent == ({"/fmu/in/config_control_setpoints"} if release == "1.18" else newer)
    versioned = {found[1] for found in names.values() if len(found) > 1}
    assert {name.rpartition("/")[2] for name in versioned} == {
        f"{topic}_v{version}" for topic, version in VERSIONED[release].items()
    }
    assert {px4_plain_name(name) for found in names.values() for name in found} == set(names) - absent
    assert px4_names("/fmu/out/nothing", release) == ()


def test_a_nested_array_of_another_length_is_refused_both_ways() -> None:
    kind, event = px4_message("ArmingCheckReply", "1.17"), px4_message("Event", "1.17")
    for count in (4, 6):
        with pytest.raises(ValueError, match="elements in place of 5"):
            encode(kind(events=(event(),) * count))  # type: ignore[call-arg]
    whole = encode(kind(num_events=2))  # type: ignore[call-arg]
    assert decode(kind, whole[:-1]) is None
    assert decode(kind, whole + bytes(4)) is None
