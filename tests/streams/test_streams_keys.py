"""Zenoh keys, liveliness tokens and attachments, compared with the worked example of the wire contract."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.streams import CLOCK_QOS, RELIABLE_10, SENSOR_DATA, TF_QOS, QoS, data_key
from bench.streams._keys import (
    endpoint_gid,
    endpoint_token,
    is_name,
    node_token,
    read_sequence,
    write_attachment,
)

ZID = "aac3178e146ba6f1fc6e6a4085e77f21"
TOPIC = "/vehicle_1/camera/front/image_raw/compressed"
TYPE = "sensor_msgs/msg/CompressedImage"
HASH = "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
TOKEN = (
    f"@ros2_lv/7/{ZID}/0/3/MP/%/%vehicle_1/sim/%vehicle_1%camera%front%image_raw%compressed/"
    f"sensor_msgs::msg::dds_::CompressedImage_/{HASH}/2::,5:,:,:,,"
)


def test_tokens_and_key_equal_the_worked_example() -> None:
    """ROS 2 tools discover a node and its endpoints by exactly these tokens."""
    assert node_token(7, ZID, 0, "/vehicle_1", "sim") == f"@ros2_lv/7/{ZID}/0/0/NN/%/%vehicle_1/sim"
    assert endpoint_token(7, ZID, (0, 3), "MP", ("/vehicle_1", "sim"), TOPIC, TYPE, SENSOR_DATA) == TOKEN
    key = f"7/vehicle_1/camera/front/image_raw/compressed/sensor_msgs::msg::dds_::CompressedImage_/{HASH}"
    assert data_key(7, TOPIC, TYPE) == key


def test_the_root_namespace_is_a_percent_sign() -> None:
    assert node_token(7, ZID, 0, "/", "agent") == f"@ros2_lv/7/{ZID}/0/0/NN/%/%/agent"


def test_gid_and_attachment_equal_the_worked_example() -> None:
    """The GID is the XXH3-128 of the token in rmw_zenoh's byte order."""
    gid = endpoint_gid(TOKEN)
    assert gid.hex() == "69691635998920aace0414dceff92d98"
    attachment = write_attachment(1, 1_700_000_000_123_456_789, gid)
    assert attachment.hex() == "0100000000000000" + "15cd853dfe9c9717" + "10" + gid.hex()
    assert read_sequence(attachment) == 1


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (RELIABLE_10, "::,10:,:,:,,"),
        (SENSOR_DATA, "2::,5:,:,:,,"),
        (CLOCK_QOS, "2::,1:,:,:,,"),
        (TF_QOS, "::,100:,:,:,,"),
        (QoS(latched=True, depth=1), ":1:,1:,:,:,,"),
        (QoS(depth=42), "::,:,:,:,,"),
    ],
)
def test_qos_profiles_are_written_as_rmw_zenoh_writes_them(qos: QoS, text: str) -> None:
    """Fields that equal their default are left out."""
    assert qos.text == text


@settings(max_examples=200, database=None, derandomize=True)
@given(st.binary(max_size=40))
def test_malformed_attachments_are_none(data: bytes) -> None:
    """An attachment has 33 bytes, a sequence number from 0 and a 16-byte GID."""
    well_formed = len(data) == 33 and data[16] == 16 and int.from_bytes(data[:8], "little", signed=True) >= 0
    assert (read_sequence(data) is not None) == well_formed


@pytest.mark.parametrize(("sequence", "read"), [(-1, None), (0, 0), (1, 1), (2**62, 2**62)])
def test_sequence_numbers_start_at_zero_or_one(sequence: int, read: int | None) -> None:
    """rmw_zenoh starts at 1, two independent ROS 2 clients at 0; nothing starts below."""
    assert read_sequence(write_attachment(sequence, 0, bytes(16))) == read


@pytest.mark.parametrize(
    "name", ["", "/", "clock", "/a//b", "/a/", "/*", "/a/**", "/@adv", "/a$*", "/a?b", "/1a", "/a\n"]
)
def test_names_with_wildcards_or_invalid_chunks_are_refused(name: str) -> None:
    """A wildcard or a verbatim chunk in a name would widen the allow-list."""
    assert not is_name(name)
