"""The texts of the wire, against the worked example of the contract."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.streams import CLOCK_QOS, RELIABLE_10, SENSOR_DATA, TF_QOS, QoS, data_key
from bench.streams._keys import endpoint_gid, endpoint_token, is_name, node_token, read_sequence, write_attachment

ZID = "aac3178e146ba6f1fc6e6a4085e77f21"
TOPIC = "/vehicle_1/camera/front/image_raw/compressed"
TYPE = "sensor_msgs/msg/CompressedImage"
HASH = "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
TOKEN = (
    f"@ros2_lv/7/{ZID}/0/3/MP/%/%vehicle_1/sim/%vehicle_1%camera%front%image_raw%compressed/"
    f"sensor_msgs::msg::dds_::CompressedImage_/{HASH}/2::,5:,:,:,,"
)


def test_tokens_and_key_are_those_of_the_worked_example() -> None:
    """Tools see a node and its endpoint by exactly these texts."""
    assert node_token(7, ZID, 0, "/vehicle_1", "sim") == f"@ros2_lv/7/{ZID}/0/0/NN/%/%vehicle_1/sim"
    assert endpoint_token(7, ZID, (0, 3), "MP", ("/vehicle_1", "sim"), TOPIC, TYPE, SENSOR_DATA) == TOKEN
    key = f"7/vehicle_1/camera/front/image_raw/compressed/sensor_msgs::msg::dds_::CompressedImage_/{HASH}"
    assert data_key(7, TOPIC, TYPE) == key


def test_root_namespace_is_one_percent_sign() -> None:
    """No chunk of a token may be empty."""
    assert node_token(7, ZID, 0, "/", "agent") == f"@ros2_lv/7/{ZID}/0/0/NN/%/%/agent"


def test_gid_and_attachment_are_those_of_the_worked_example() -> None:
    """XXH3-128 of the token, in rmw_zenoh's order of bytes."""
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
def test_qos_texts(qos: QoS, text: str) -> None:
    """The profiles as rmw_zenoh writes them; what equals its default is left out."""
    assert qos.text == text


@settings(max_examples=200, database=None, derandomize=True)
@given(st.binary(max_size=40))
def test_other_attachments_are_none(data: bytes) -> None:
    """Whatever is not 33 bytes with a positive number and a 16-byte id is no attachment."""
    good = len(data) == 33 and data[16] == 16 and int.from_bytes(data[:8], "little", signed=True) > 0
    assert (read_sequence(data) is not None) == good


@pytest.mark.parametrize("sequence", [0, -1])
def test_numbers_start_at_one(sequence: int) -> None:
    """A number below one is malformed."""
    assert read_sequence(write_attachment(sequence, 0, bytes(16))) is None


@pytest.mark.parametrize("name", ["", "/", "clock", "/a//b", "/a/", "/*", "/a/**", "/@adv", "/a$*", "/a?b", "/1a", "/a\n"])
def test_no_other_text_becomes_part_of_a_key(name: str) -> None:
    """Wildcards and verbatim chunks in a name would open the allow-list."""
    assert not is_name(name)
