"""CDR encoding compared with rosbags and with golden bytes; decoding of malformed bytes."""

from __future__ import annotations

import struct
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from other_encoder import encoded
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from bench.streams import (
    MESSAGES,
    CameraInfo,
    Clock,
    CompressedImage,
    Detection2DArray,
    Header,
    Image,
    Odometry,
    Point,
    Pose,
    PoseArray,
    Quaternion,
    String,
    Time,
    UInt8MultiArray,
    decode,
    decode_pose_array,
    encode,
    encode_pose_array,
    message_class,
    type_name_of,
)
from bench.streams._schemas import Field, dependencies, fields_of

RANGES = {
    "int8": (-128, 127),
    "uint8": (0, 255),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
}
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=9)


def field_values(field: Field) -> st.SearchStrategy[Any]:
    if not isinstance(field.of, str):
        strategy = messages(field.of)
    elif field.of in RANGES:
        strategy = st.integers(*RANGES[field.of])
    else:
        strategy = {"string": TEXT, "bool": st.booleans(), "float64": st.floats(allow_nan=False)}[field.of]
    if field.of == "uint8" and field.count == "sequence":
        return st.binary(max_size=9)
    if field.count == "one":
        return strategy
    if field.count == "array":
        # One drawn value and the indices are enough to show a wrong order, and quicker than drawing them all.
        return strategy.map(lambda drawn: (drawn, *(float(n) for n in range(1, field.size))))
    return st.lists(strategy, max_size=3).map(tuple)


def messages(kind: Any) -> st.SearchStrategy[Any]:
    return st.builds(kind, **{field.name: field_values(field) for field in fields_of(kind)})


@pytest.fixture(scope="module")
def store() -> Typestore:
    """The ROS 2 Jazzy types of rosbags, and vision_msgs 4.1.1 from the message definitions of its release."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in VISION.items():
        store.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    return store


VISION = {
    "Point2D": "float64 x\nfloat64 y",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\nstring id",
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
}


@pytest.mark.parametrize("kind", MESSAGES, ids=type_name_of)
def test_encoding_and_decoding_agree_with_rosbags(kind: Any, store: Typestore) -> None:
    """Encoding gives the bytes of an independent serialiser; decoding restores the message from either byte order."""

    @settings(max_examples=12, deadline=None, database=None, derandomize=True)
    @given(messages(kind))
    def check(message: Any) -> None:
        data = encode(message)
        assert data.hex() == encoded(store, message).hex()
        assert decode(kind, data) == message
        assert decode(kind, encoded(store, message, little_endian=False)) == message

    check()


def test_bytes_equal_the_worked_example() -> None:
    """The example of the wire contract, which was checked against the serialiser that rmw_zenoh links."""
    image = CompressedImage(Header(Time(12, 500_000_000), "cam"), "jpeg", b"\xff\xd8\xff\xd9")
    expected = "00010000 0c000000 0065cd1d 04000000 63616d00 05000000 6a70656700 000000 04000000 ffd8ffd9"
    assert encode(image) == bytes.fromhex(expected)
    assert encode(Clock(Time.of(12_500_000_000))) == bytes.fromhex("00010000 0c000000 0065cd1d")
    assert Time.of(12_345_678_901) == Time(12, 345_678_901)
    assert Time.of(12_345_678_901).ns == 12_345_678_901
    assert encode(String("hi")) == bytes.fromhex("00010000 03000000 686900")


def test_padding_to_four_bytes_is_accepted_and_longer_padding_is_not() -> None:
    """Some writers pad a sample to four bytes; a longer sample is not this message."""
    data = encode(String("hi"))
    assert decode(String, data + b"\0") == String("hi")
    assert decode(String, data + bytes(4)) is None


@pytest.mark.parametrize(
    "data", [b"", b"\0\1\0", b"\0\1\0\0", b"\0\3\0\0" + bytes(8), b"\1\1\0\0" + bytes(8)]
)
def test_bytes_without_a_plain_cdr_header_decode_to_none(data: bytes) -> None:
    """Truncated headers and other encapsulations (parameter lists, XCDR2) are not guessed at."""
    assert decode(Clock, data) is None


@pytest.mark.parametrize("count", [2**32 - 1, 2**31, 10**6])
@pytest.mark.parametrize("kind", [String, UInt8MultiArray, PoseArray, Detection2DArray, CameraInfo])
def test_hostile_lengths_decode_to_none(kind: Any, count: int) -> None:
    """A length that exceeds the remaining bytes is refused before memory of that size is allocated."""
    data = encode(kind())
    for offset in range(4, len(data) - 3, 4):
        forged = data[:offset] + struct.pack("<I", count) + data[offset + 4 :]
        decoded = decode(kind, forged)
        assert decoded is None or len(encode(decoded)) <= len(forged)


def test_strings_without_a_nul_or_with_invalid_utf8_decode_to_none() -> None:
    """A string is UTF-8 and ends with NUL; a string of length 0 is read as empty."""
    head = b"\0\1\0\0"
    assert decode(String, head + struct.pack("<I", 3) + b"abc") is None
    assert decode(String, head + struct.pack("<I", 3) + b"\xff\xfe\0") is None
    assert decode(String, head + struct.pack("<I", 0)) == String("")


@pytest.mark.parametrize("kind", MESSAGES, ids=type_name_of)
def test_truncated_messages_decode_to_none(kind: Any) -> None:
    """A prefix that lacks more than four bytes does not decode as the message."""
    data = encode(kind())
    assert all(decode(kind, data[:end]) is None for end in range(len(data) - 4))


@settings(max_examples=300, deadline=None, database=None, derandomize=True)
@given(st.sampled_from([message.TYPE for message in MESSAGES]), st.binary(max_size=300), st.booleans())
def test_random_bytes_never_raise(type_name: str, noise: bytes, with_header: bool) -> None:
    """Any bytes decode to a message or None, and a decoded message can be encoded again."""
    kind = message_class(type_name)
    assert kind is not None
    decoded = decode(kind, (b"\0\1\0\0" if with_header else b"") + noise)
    assert decoded is None or isinstance(encode(decoded), bytes)


@settings(max_examples=200, deadline=None, database=None, derandomize=True)
@given(messages(Detection2DArray), st.data())
def test_flipped_bytes_never_raise(message: Detection2DArray, draw: st.DataObject) -> None:
    """A valid message with one changed byte decodes to a message or None."""
    data = bytearray(encode(message))
    offset = draw.draw(st.integers(0, len(data) - 1))
    data[offset] ^= draw.draw(st.integers(1, 255))
    decoded = decode(Detection2DArray, bytes(data))
    assert decoded is None or isinstance(decoded, Detection2DArray)


def test_encoding_values_out_of_range_raises() -> None:
    """A value out of range raises an error that names the message type; an unknown type raises as well."""
    with pytest.raises(ValueError, match="sensor_msgs/msg/Image"):
        encode(Image(is_bigendian=1000))
    with pytest.raises(ValueError, match="Odometry"):
        encode(Odometry(header=Header(Time(2**40))))
    with pytest.raises(TypeError, match="no message"):
        encode(object())
    with pytest.raises(KeyError):
        decode("std_msgs/msg/Strong", b"")


@pytest.mark.parametrize("frame_id", ["", "m", "map", "odom", "base_link"])
@pytest.mark.parametrize("count", [0, 1, 7])
def test_pose_arrays_from_numpy_give_the_same_bytes(count: int, frame_id: str) -> None:
    """The array functions and the message classes agree at every alignment, for encoding and decoding."""
    numbers = np.arange(count * 7, dtype=np.float64).reshape(count, 7)
    poses = tuple(Pose(Point(*row[:3]), Quaternion(*row[3:])) for row in numbers.tolist())
    stamp = Time(3, 4)
    data = encode_pose_array(stamp, frame_id, numbers[:, :3], numbers[:, 3:])
    assert data == encode(PoseArray(Header(stamp, frame_id), poses))
    decoded = decode_pose_array(data)
    assert decoded is not None
    assert decoded[0] == stamp.ns
    assert np.array_equal(np.hstack(decoded[1:]), numbers)


def test_pose_arrays_without_attitude_have_the_identity_attitude() -> None:
    """Foot points have no attitude, so each pose gets the identity quaternion."""
    decoded = decode(PoseArray, encode_pose_array(Time(), "map", np.ones((2, 3))))
    assert decoded is not None
    assert decoded.poses == (Pose(Point(1.0, 1.0, 1.0)),) * 2


@settings(max_examples=300, deadline=None, database=None, derandomize=True)
@given(st.binary(max_size=200), st.integers(0, 3))
def test_random_pose_arrays_never_raise(noise: bytes, count: int) -> None:
    """decode_pose_array accepts exactly the bytes that decode accepts, except big-endian ones."""
    base = encode_pose_array(Time(1, 2), "map", np.zeros((count, 3)))
    for data in (noise, b"\0\1\0\0" + noise, base[: len(noise)], base + noise):
        arrays, message = decode_pose_array(data), decode(PoseArray, data)
        if arrays is not None:
            assert message is not None
            assert len(message.poses) == len(arrays[1])
        elif message is not None:
            assert data[1] == 0  # only `decode` reads big endian


def test_every_field_of_every_message_class_is_serialised() -> None:
    known = set(MESSAGES)
    for kind in MESSAGES:
        assert [field.name for field in fields_of(kind)] == [field.name for field in fields(kind)]  # type: ignore[arg-type]
        assert set(dependencies(kind)) <= known
