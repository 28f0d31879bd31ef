"""docs/streams.md agrees with the code."""

from __future__ import annotations

from pathlib import Path

from bench.contracts import CLOCK, TF, TF_STATIC, VehicleTopics
from bench.streams import String, encode

PAGE = (Path(__file__).parents[2] / "docs" / "streams.md").read_text()


def test_the_page_lists_every_topic_of_the_air_network() -> None:
    """A topic that is added to the contracts is added to the page."""
    topics = VehicleTopics("{v}")
    named = [
        CLOCK,
        TF,
        TF_STATIC,
        topics.mission,
        topics.intelligence,
        topics.detections,
        topics.camera_info("{c}"),
        topics.image_raw("{c}"),
        topics.image_compressed("{c}"),
    ]
    for topic in (*named, topics.orders, topics.consents, topics.operator_link, *topics.from_agent):
        assert f"| `{topic}` |" in PAGE


def test_the_encoding_example_of_the_page_is_correct() -> None:
    """The bytes that the page shows for other languages are the bytes that the bench sends."""
    assert "00010000 03000000 686900" in PAGE
    assert encode(String("hi")).hex() == "00010000 03000000 686900".replace(" ", "")
