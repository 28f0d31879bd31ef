"""Message types, compared with the hashes and definitions of ROS 2 installations."""

from __future__ import annotations

import pytest
from mcap_ros2._dynamic import generate_dynamic
from other_encoder import store_of
from rosbags.typesys import Stores, get_typestore

from bench.streams import MESSAGES, Clock, String, message_class, schema_text, type_hash, type_name_of

# From ROS 2 installations and from the upstream generator; the hashes are the same from Iron to Lyrical.
GOLDEN = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "rosgraph_msgs/msg/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "vision_msgs/msg/Detection2DArray": "214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968",
}
TYPE_NAMES = [type_name_of(kind) for kind in MESSAGES]


@pytest.mark.parametrize("type_name", GOLDEN)
def test_type_hashes_equal_those_of_ros_2_installations(type_name: str) -> None:
    """With a wrong hash, endpoints would not match, without any error."""
    assert type_hash(type_name) == "RIHS01_" + GOLDEN[type_name]


def test_type_hashes_of_standard_types_equal_those_of_rosbags() -> None:
    """Types that the golden table does not list are checked against an independent implementation."""
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    standard = [name for name in TYPE_NAMES if not name.startswith("vision_msgs/")]
    assert len(standard) > 20
    assert {name: type_hash(name) for name in standard} == {
        name: jazzy.hash_rihs01(name) for name in standard
    }


@pytest.mark.parametrize("type_name", TYPE_NAMES)
def test_schema_text_describes_the_same_fields(type_name: str) -> None:
    """The schema text of a recording, read by the parser of rosbags, gives the same type hash; and mcap-ros2-support, which
    reads recordings in Python, can build a decoder from it.
    """
    assert store_of(message_class(type_name)).hash_rihs01(type_name) == type_hash(type_name)
    short = type_name.replace("/msg/", "/")
    assert short in generate_dynamic(short, schema_text(type_name))


def test_message_classes_are_found_by_type_name() -> None:
    assert message_class("std_msgs/msg/String") is String
    assert message_class("std_msgs/msg/Strong") is None
    assert type_name_of(Clock) == "rosgraph_msgs/msg/Clock"
    with pytest.raises(TypeError, match="no message class"):
        type_name_of(int)
